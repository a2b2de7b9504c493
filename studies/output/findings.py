"""What a reader should know of a result: a macro and its data in; a sentence, its alert, and a record for a manifest out.

The sentence is the macro of ``templates/TEMPLATE.txt``; its arguments are the data. Its code, what it means and what to do are those of
``alerts.toml``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from studies.output.alerts import Alert, alert_of
from studies.output.words import Words


class Macro(StrEnum):
    """Base of the names of the macros of a template that word findings: each belongs to one alert."""


@dataclass(frozen=True)
class Finding:
    """A verdict, warning or remark. template: file of `studies/templates` without '.txt'; code: the macro, data: its arguments. raised:
    whether the numbers ask for the higher severity of its alert.

    Raises `AlertError` for a macro without an alert, and where one is raised that has no higher severity.
    """

    template: str
    code: Macro
    data: Mapping[str, Any] = field(default_factory=dict)
    raised: bool = False

    def __post_init__(self) -> None:
        _ = self.alert

    @property
    def alert(self) -> Alert:
        """Code, severity, meaning, what to do, and the page that explains it."""
        alert = alert_of(self.template, self.code)
        return alert.as_raised() if self.raised else alert

    @property
    def text(self) -> str:
        """The sentence."""
        return getattr(Words(self.template), self.code)(**self.data)

    def to_dict(self) -> dict[str, Any]:
        """Alert, sentence and data, for a manifest."""
        alert = self.alert
        return {
            "code": alert.code,
            "severity": str(alert.severity),
            "text": self.text,
            "means": alert.means,
            "do": alert.do,
            "page": alert.page,
            "data": dict(self.data),
        }
