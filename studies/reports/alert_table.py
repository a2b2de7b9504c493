"""Alerts as they are shown: findings in; lines for a terminal, the table of a report, or records for a manifest out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from studies.output.alerts import PAGE, Severity
from studies.output.findings import Finding
from studies.output.report import Link, Report

COLUMNS = ("code", "severity", "what was found", "what to do")


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """The most serious first, then by code."""
    order = list(Severity)
    return sorted(findings, key=lambda one: (order.index(one.alert.severity), one.alert.code))


def merged(reasons: Iterable[Finding], findings: Iterable[Finding]) -> list[Finding]:
    """Reasons of a headline, and findings; of a code that both have the findings, which say more, as severe as the reason."""
    known, found = list(reasons), list(findings)
    codes, raised = {one.alert.code for one in found}, {one.alert.code for one in known if one.raised}
    told = [one for one in known if one.alert.code not in codes]
    return told + [replace(one, raised=one.raised or one.alert.code in raised) for one in found]


def alert_lines(findings: Iterable[Finding]) -> Iterator[str]:
    """'- N203 warning: ...', without the severity where it is a note."""
    for finding in in_order(findings):
        alert = finding.alert
        severity = "" if alert.severity is Severity.NOTE else f" {alert.severity}"
        yield f"- {alert.code}{severity}: {finding.text}"


def alert_records(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """For a manifest."""
    return [finding.to_dict() for finding in in_order(findings)]


def add_alerts(report: Report, findings: Iterable[Finding]) -> Report:
    """The section 'Alerts': a table, and below it what the codes mean. Nothing where there are no findings."""
    ordered = in_order(findings)
    if not ordered:
        return report
    rows = [
        [Link(f.alert.code, f.alert.anchor, f.alert.page), str(f.alert.severity), _sentence(f.text), f.alert.do]
        for f in ordered
    ]
    means = {f.alert.code: f.alert.means for f in ordered}
    report.heading("Alerts").table(COLUMNS, rows, "")
    return report.details(f"What the codes mean (all codes: {PAGE})", means, anchors=True)


def _sentence(text: str) -> str:
    """With a capital; reasons of a headline have none."""
    return text[:1].upper() + text[1:]
