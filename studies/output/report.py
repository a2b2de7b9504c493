"""Report: paragraphs, figures and tables in, one self-contained HTML file out.

Pictures and solids are inlined, so the file can be mailed, archived and read offline; tables sort by a click on a
column head; solids turn (`studies.output.scene`); it prints well. A file above 5 MB gets its pictures reduced.
"""

from __future__ import annotations

import base64
import io
import json
import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from studies.errors import StudyError
from studies.output.scene import Scene
from studies.output.writing import write_text

LIMIT = 5_000_000
LONG = 24  # characters of a cell that needs room to wrap
SMALL = {"small tiny": 14, "small": 9}  # classes of tables with that many columns or more, for print
CONTENTS = 5  # headings from which on a report begins with a list of them
MIME = {".png": "image/png", ".svg": "image/svg+xml", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
PNG = b"\x89PNG"
DENSITY = 1.45  # pixels of a picture to one of the page: text in pictures is as large as that around them
# a number that was written as text: "2.6 %", "10 mm", "+0.3", "0.51 [0.49, 0.53]"
WRITTEN = re.compile(
    r"([-+\N{MINUS SIGN}]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?: ?(?:%|[A-Za-zµ]{1,3}[²³]?))?(?: \[[^]]*\])?"
)


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


@dataclass(frozen=True)
class Link:
    """A cell that leads to a place of the same report. anchor: of `Report.details`; title: shown beside the pointer."""

    text: str
    anchor: str
    title: str = ""

    def __str__(self) -> str:
        return self.text


@dataclass
class _Picture:
    content: bytes
    mime: str
    caption: str
    width: int = 0  # on the page, pixels; 0: its own
    kind: str = "figure"

    @property
    def source(self) -> str:
        return f"data:{self.mime};base64,{base64.b64encode(self.content).decode()}"


@dataclass
class Report:
    """A report with a title. Every method returns the report, so that calls can be chained.

    All text is escaped: it may contain any character. subtitle: what and how, in one line. pictures: files that were inlined, for the
    manifest.
    """

    title: str
    subtitle: str = ""
    pictures: list[Path] = field(default_factory=list, init=False)
    _parts: list[Any] = field(default_factory=list, repr=False)

    def heading(self, text: str) -> Self:
        """Begin a section."""
        self._parts.append({"kind": "heading", "text": text})
        return self

    def paragraph(self, text: str) -> Self:
        """Add running text."""
        self._parts.append({"kind": "paragraph", "text": _set(text)})
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
        pixels = int.from_bytes(content[16:20]) if content.startswith(PNG) else 0
        self._parts.append(_Picture(content, MIME[path.suffix.lower()], _set(caption), round(pixels / DENSITY)))
        self.pictures.append(path)
        return self

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "") -> Self:
        """A table; numbers are shown with four digits, None and NaN as a dash. Raises `ReportError`."""
        for i, row in enumerate(rows):
            if len(row) != len(columns):
                raise ReportError(f"table '{caption}': row {i} has {len(row)} cells for {len(columns)} columns")
        cells = [[_cell(value) for value in row] for row in rows]
        numeric = [_numeric([row[i] for row in cells]) for i in range(len(columns))]
        heads = [{"text": str(name), "number": number} for name, number in zip(columns, numeric, strict=True)]
        for row in cells:
            for cell, number in zip(row, numeric, strict=True):
                cell["number"] = number
        small = next((name for name, least in SMALL.items() if len(columns) >= least), "")
        self._parts.append({"kind": "table", "columns": heads, "rows": cells, "caption": _set(caption), "small": small})
        return self

    def view(self, scenes: Sequence[Scene], label: str, caption: str = "") -> Self:
        """Solids to be turned by the reader, one at a time; label: of the colours, with unit.

        A browser without WebGL shows a message instead, so a picture that says the same belongs beside it.
        """
        content = json.dumps([scene.packed() for scene in scenes], separators=(",", ":"))
        names = [scene.name for scene in scenes]
        self._parts.append({"kind": "view", "content": content, "names": names, "label": label, "caption": caption})
        return self

    def details(self, summary: str, content: Mapping[str, Any], anchors: bool = False) -> Self:
        """Names and values that fold out, such as settings or versions; nested names are written 'a / b'. anchors: whether a `Link`
        may lead to a name, in lower case."""
        items = [(key, _cell(value)["text"], key.lower() if anchors else "") for key, value in _flat(content)]
        self._parts.append({"kind": "details", "summary": summary, "rows": items})
        return self

    def html(self) -> str:
        """The whole document."""
        written = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
        headings = [part for part in self._parts if isinstance(part, dict) and part["kind"] == "heading"]
        for number, heading in enumerate(headings, start=1):
            heading["anchor"] = f"part-{number}"
        return page(
            "report.html", title=self.title, subtitle=self.subtitle, parts=self._parts, written=written,
            contents=headings if len(headings) >= CONTENTS else [],
            scenes=any(isinstance(part, dict) and part["kind"] == "view" for part in self._parts),
        )  # fmt: skip

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


def _set(text: str) -> str:
    """Text with arrows that are not torn apart at the end of a line."""
    return text.replace(" -> ", " → ")


def _cell(value: Any) -> dict[str, Any]:
    """Text of a cell, the value it is sorted by, whether it is a number, and whether it is long.

    Text that begins with a number, such as '2.6 %', is sorted by the number.
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return {"text": "–", "sort": "", "number": True, "long": False, "link": None}
    if isinstance(value, bool) or not hasattr(value, "__float__"):
        text = {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)
        found = WRITTEN.fullmatch(text)
        sort = repr(float(found[1].replace("\N{MINUS SIGN}", "-"))) if found else text.strip(" –-") and text
        link = value if isinstance(value, Link) else None
        return {"text": text, "sort": sort, "number": found is not None, "long": len(text) > LONG, "link": link}
    number = float(value) + 0.0  # no minus before a zero
    if math.isnan(number):
        return _cell(None)
    return {
        "text": _digits(value).replace("-", "\N{MINUS SIGN}", 1) if number < 0 else _digits(value).removeprefix("-"),
        "sort": repr(number) if math.isfinite(number) else "-Infinity" if number < 0 else "Infinity",
        "number": True,
        "long": False,
        "link": None,
    }


def _digits(value: Any) -> str:
    """Whole numbers in full, others to four digits; powers of ten from a million on and below 1e-4."""
    if isinstance(value, int) or (hasattr(value, "dtype") and value.dtype.kind in "iu"):
        return str(int(value))
    text = f"{float(value):.4g}"
    return f"{float(text):.0f}" if "e+0" in text and abs(float(value)) < 1e6 else text


def _numeric(cells: Sequence[Mapping[str, Any]]) -> bool:
    """Whether a column holds numbers: all cells but the empty ones, and at least one."""
    return any(cell["sort"] for cell in cells) and all(cell["number"] for cell in cells if cell["sort"])


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
    return replace(picture, content=content)


def thumbnail(path: Path, size: tuple[int, int], colours: int = 64) -> str:
    """A small copy of a picture as the source of an <img>; empty if the file is no picture."""
    from PIL import Image, UnidentifiedImageError

    buffer = io.BytesIO()
    try:
        with Image.open(path) as image:
            small = image.convert("RGB")
    except (OSError, UnidentifiedImageError):
        return ""
    small.thumbnail(size, Image.Resampling.LANCZOS)
    small.quantize(colours).save(buffer, "PNG", optimize=True)
    return _Picture(buffer.getvalue(), "image/png", "").source


def _flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Values that are no tables themselves, each with the path to it."""
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key} / ")
        elif isinstance(value, (list, tuple)) and any(isinstance(one, Mapping) for one in value):
            yield from _flat({f"{key} {i}": one for i, one in enumerate(value, 1)}, prefix)
        elif isinstance(value, (list, tuple)):
            yield f"{prefix}{key}", ", ".join(map(str, value)) or None
        else:
            yield f"{prefix}{key}", value
