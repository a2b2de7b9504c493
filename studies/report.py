"""Report: paragraphs, figures and tables in, one self-contained HTML file out.

Pictures are inlined, so the file can be mailed, archived and read offline; tables sort by a click on a column
head; it prints well. A file above 5 MB gets its pictures reduced.
"""

from __future__ import annotations

import base64
import io
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from studies.errors import StudyError
from studies.writing import write_text

LIMIT = 5_000_000
MIME = {".png": "image/png", ".svg": "image/svg+xml", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}


class ReportError(StudyError, ValueError):
    """A figure or table that cannot go into a report."""


def page(template: str, **content: Any) -> str:
    """A template of ``templates/`` filled in; all text is escaped."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("studies"), autoescape=True, trim_blocks=True, lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    return environment.get_template(template).render(**content)


@dataclass
class _Picture:
    content: bytes
    mime: str
    caption: str
    kind: str = "figure"

    @property
    def source(self) -> str:
        return f"data:{self.mime};base64,{base64.b64encode(self.content).decode()}"


@dataclass
class Report:
    """A report with a title. Every method returns the report, so that calls can be chained.

    All text is escaped: it may contain any character. subtitle: what and how, in one line.
    """

    title: str
    subtitle: str = ""
    _parts: list[Any] = field(default_factory=list, repr=False)

    def heading(self, text: str) -> Self:
        self._parts.append({"kind": "heading", "text": text})
        return self

    def paragraph(self, text: str) -> Self:
        self._parts.append({"kind": "paragraph", "text": text})
        return self

    def figure(self, path: str | Path, caption: str = "") -> Self:
        """Inline a PNG, JPEG or SVG file. Raises `ReportError`."""
        path = Path(path)
        if path.suffix.lower() not in MIME:
            raise ReportError(f"{path}: a report takes {', '.join(MIME)}; save the figure as one of these")
        try:
            content = path.read_bytes()
        except OSError as error:
            raise ReportError(f"{path}: cannot be read ({error.strerror}); draw the figure first") from error
        self._parts.append(_Picture(content, MIME[path.suffix.lower()], caption))
        return self

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "") -> Self:
        """A table; numbers are shown with four digits, None and NaN as a dash. Raises `ReportError`."""
        for i, row in enumerate(rows):
            if len(row) != len(columns):
                raise ReportError(f"table '{caption}': row {i} has {len(row)} cells for {len(columns)} columns")
        cells = [[_cell(value) for value in row] for row in rows]
        self._parts.append({"kind": "table", "columns": list(columns), "rows": cells, "caption": caption})
        return self

    def details(self, summary: str, content: Mapping[str, Any]) -> Self:
        """Names and values that fold out, such as settings or versions."""
        items = [(str(key), _cell(value)["text"]) for key, value in content.items()]
        self._parts.append({"kind": "details", "summary": summary, "rows": items})
        return self

    def html(self) -> str:
        """The whole document."""
        written = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
        return page("report.html", title=self.title, subtitle=self.subtitle, parts=self._parts, written=written)

    def save(self, path: str | Path) -> Path:
        """Write the document atomically. Raises `OutputWriteError`."""
        path = Path(path)
        document = self.html()
        for colours, scale in ((256, 1.0), (64, 0.5)):
            if len(document) <= LIMIT:
                break
            self._parts = [_reduced(p, colours, scale) if isinstance(p, _Picture) else p for p in self._parts]
            document = self.html()
        if len(document) > LIMIT:
            print(f"equigap: {path} has {len(document) / 1e6:.1f} MB; use fewer figures", file=sys.stderr)
        write_text(path, document)
        return path


def _cell(value: Any) -> dict[str, Any]:
    """Text of a cell, the value it is sorted by, and whether it is a number."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return {"text": "–", "sort": "", "number": True}
    if isinstance(value, bool) or not hasattr(value, "__float__"):
        text = {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)
        return {"text": text, "sort": text, "number": False}
    number = float(value)
    if math.isnan(number):
        return _cell(None)
    whole = isinstance(value, int) or (hasattr(value, "dtype") and value.dtype.kind in "iu")
    text = str(int(value)) if whole else f"{number:.4g}"
    return {
        "text": text.replace("-", "\N{MINUS SIGN}", 1) if number < 0 else text,
        "sort": repr(number),
        "number": True,
    }


def _reduced(picture: _Picture, colours: int, scale: float) -> _Picture:
    """A PNG with fewer colours and pixels; other pictures, and those it would enlarge, as they are."""
    if picture.mime != "image/png":
        return picture
    from PIL import Image

    with Image.open(io.BytesIO(picture.content)) as image:
        size = (max(1, int(image.width * scale)), max(1, int(image.height * scale)))
        small = image.convert("RGB").resize(size).quantize(colours)
    buffer = io.BytesIO()
    small.save(buffer, "PNG", optimize=True)
    content = min(picture.content, buffer.getvalue(), key=len)
    return _Picture(content, picture.mime, picture.caption)
