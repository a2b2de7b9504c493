"""What a reader should know of a result: a code and its data in, a sentence and a record for a manifest out.

The sentence is the macro of ``templates/TEMPLATE.txt`` that has the name of the code; its arguments are the data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from studies.output.words import Words


@dataclass(frozen=True)
class Finding:
    """A verdict, warning or remark. template: file of `studies/templates` without '.txt'; data: arguments of the macro."""

    template: str
    code: StrEnum
    data: Mapping[str, Any] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The sentence."""
        return getattr(Words(self.template), self.code)(**self.data)

    def to_dict(self) -> dict[str, Any]:
        """Code and data, for a manifest."""
        return {"code": str(self.code), **self.data}
