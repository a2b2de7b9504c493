"""The codes of what a reader should know: ``alerts.toml`` in, the `Alert` of every sentence out.

As in the reports of checkCIF, a code stays the same from version to version: one letter for the subject, three digits. An alert says how
serious it is, what it means and what to do. It belongs to one or more macros of ``studies/templates``, which word it with the numbers of the
case; a macro belongs to one alert. An alert may be raised to a higher severity, where the numbers ask for it.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from importlib import resources
from typing import Any

from studies.errors import AlertError, StudyError
from studies.output.words import Words

PAGE = "docs/alerts.md"
FILE = "alerts.toml"
CODE = re.compile(r"[A-Z][1-9]\d\d")
MUST, MAY = {"macros", "severity", "means", "do"}, {"raised", "when"}


class Severity(StrEnum):
    """How serious an alert is, the most serious first."""

    SERIOUS = "serious"
    WARNING = "warning"
    NOTE = "note"


@dataclass(frozen=True)
class Alert:
    """macros: 'TEMPLATE.MACRO' of its sentences. raised: the severity in the cases that `when` says; None: it is always the same."""

    code: str
    subject: str
    severity: Severity
    means: str
    do: str
    macros: tuple[str, ...]
    raised: Severity | None = None
    when: str = ""

    @property
    def anchor(self) -> str:
        """Of its place on a page: 'n203'."""
        return self.code.lower()

    @property
    def page(self) -> str:
        """Where it is explained: 'docs/alerts.md#n203'."""
        return f"{PAGE}#{self.anchor}"

    def as_raised(self) -> Alert:
        """With the higher severity. Raises `AlertError` where it has none."""
        if self.raised is None:
            raise AlertError(f"{self.code}: is raised, but {FILE} states no raised severity; add raised and when")
        return replace(self, severity=self.raised)


@cache
def registry() -> Mapping[str, Alert]:
    """Every alert by its code, in the order of the codes. Raises `AlertError`."""
    return read(resources.files("studies.output").joinpath(FILE).read_text(encoding="utf-8"))


def read(text: str) -> dict[str, Alert]:
    """Every alert of a registry, checked. Raises `AlertError`."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:  # a code that is there twice is one, too
        raise AlertError(f"{FILE}: cannot be read: {error}") from error
    subjects = content.pop("subjects", {})
    found = {code: _alert(code, entry, subjects) for code, entry in sorted(content.items())}
    by_macro(found)
    return found


def by_macro(alerts: Mapping[str, Alert]) -> dict[str, Alert]:
    """The alert of every 'TEMPLATE.MACRO'. Raises `AlertError` where two have the same."""
    found: dict[str, Alert] = {}
    for alert in alerts.values():
        for macro in alert.macros:
            if macro in found:
                raise AlertError(f"{FILE}: {macro} belongs to {found[macro].code} and {alert.code}; name it once")
            found[macro] = alert
    return found


@cache
def _registered() -> dict[str, Alert]:
    return by_macro(registry())


def alert_of(template: str, macro: str) -> Alert:
    """The alert that a sentence belongs to. Raises `AlertError` where there is none."""
    name = f"{template}.{macro}"
    if name not in _registered():
        raise AlertError(f"{name}: a finding without a code; add it to studies/output/{FILE}")
    return _registered()[name]


def _alert(code: str, entry: Any, subjects: Mapping[str, str]) -> Alert:
    """Raises `AlertError`."""
    if not CODE.fullmatch(code) or code[0] not in subjects:
        raise AlertError(f"{FILE}: {code} is no code; take a letter of {', '.join(subjects)} and three digits")
    if not isinstance(entry, dict) or not MUST <= set(entry) <= MUST | MAY or ("raised" in entry) != ("when" in entry):
        raise AlertError(f"{FILE}: {code} needs {', '.join(sorted(MUST))}, and may have raised together with when")
    if not entry["macros"] or not all(entry[key].strip() for key in ("means", "do")):
        raise AlertError(f"{FILE}: {code}: macros, means and do must not be empty")
    for name in entry["macros"]:
        _check_macro(code, name)
    severity, raised = (_severity(code, entry[key]) if key in entry else None for key in ("severity", "raised"))
    assert severity is not None
    if raised is not None and list(Severity).index(raised) >= list(Severity).index(severity):
        raise AlertError(f"{FILE}: {code}: raised must be more serious than {severity}")
    return Alert(
        code, subjects[code[0]], severity, entry["means"], entry["do"], tuple(entry["macros"]), raised, entry.get("when", "")
    )  # fmt: skip


def _check_macro(code: str, name: str) -> None:
    template, _, macro = name.partition(".")
    try:
        getattr(Words(template), macro)
    except (StudyError, LookupError) as error:  # a template that is not there is a LookupError of Jinja
        raise AlertError(f"{FILE}: {code}: there is no macro {name} in studies/templates; check its name") from error


def _severity(code: str, name: str) -> Severity:
    try:
        return Severity(name)
    except ValueError as error:
        raise AlertError(f"{FILE}: {code}: severity {name!r} is none; choose from {', '.join(Severity)}") from error
