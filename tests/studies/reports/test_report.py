"""Reports are one file that works offline, shows any text, and stays small."""

from __future__ import annotations

import base64
import re
import struct
import zlib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from studies.output import report as reports
from studies.output.report import Report, ReportError

PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


class Checker(HTMLParser):
    """Collects tags and checks that they are closed in order."""

    VOID = frozenset({"meta", "img", "br"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def noisy_png(path: Path, size: int) -> None:
    """A PNG that hardly compresses."""
    pixels = np.random.default_rng(0).integers(0, 256, (size, size * 3 + 1), np.uint8)
    pixels[:, 0] = 0
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(pixels.tobytes(), 1)),
        (b"IEND", b""),
    ]
    data = b"".join(struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in chunks)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + data)


@pytest.fixture
def full(tmp_path: Path) -> Report:
    (tmp_path / "a.png").write_bytes(PNG)
    (tmp_path / "b.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"><script>alert(1)</script></svg>')
    report = Report("Title <b>", "sub & line").heading("H").paragraph("1 < 2 </p><script>x</script>")
    report.figure(tmp_path / "a.png", 'caption "quoted"').figure(tmp_path / "b.svg")
    return report.table(["a", "b"], [[1, "x"], [float("nan"), None]], "cap").details("Settings", {"k": 0.1})


def test_is_well_formed_and_escapes_all_text(full: Report) -> None:
    checker = Checker()
    checker.feed(full.html())
    assert checker.open == []
    assert [tag for tag, _ in checker.seen].count("script") == 1
    assert "Title &lt;b&gt;" in full.html()


def test_needs_nothing_from_outside(full: Report) -> None:
    checker = Checker()
    checker.feed(full.html())
    sources = [attributes["src"] for _, attributes in checker.seen if "src" in attributes]
    assert len(sources) == 2
    assert all(source is not None and source.startswith("data:image/") for source in sources)
    assert not [a for _, a in checker.seen if "href" in a]
    assert "default-src 'none'" in full.html()
    assert base64.b64decode(str(sources[0]).split(",")[1]) == PNG


def test_is_saved_whole(full: Report, tmp_path: Path) -> None:
    path = full.save(tmp_path / "out" / "report.html")
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")


@pytest.mark.parametrize(
    ("value", "text", "sort"),
    [
        (3, "3", "3.0"), (np.int64(12345678), "12345678", "12345678.0"), (-0.123456, "\N{MINUS SIGN}0.1235", "-0.123456"),
        (1e-9, "1e-09", "1e-09"), (np.float64("nan"), "–", ""), (None, "–", ""), (True, "yes", "yes"), ("a", "a", "a"),
        ("2.6 %", "2.6 %", "2.6"), ("\N{MINUS SIGN}3", "\N{MINUS SIGN}3", "-3.0"), ("10 mm", "10 mm", "10.0"), ("1e-5", "1e-5", "1e-05"),
        ("0.5 [0.4, 0.6]", "0.5 [0.4, 0.6]", "0.5"), ("2D reference", "2D reference", "2D reference"), ("–", "–", ""), ("", "", ""),
        (25152.3, "25150", "25152.3"), (-0.0, "0", "0.0"), (float("-inf"), "\N{MINUS SIGN}inf", "-Infinity"),
    ],
)  # fmt: skip
def test_cells_show_four_digits_and_sort_by_value(value: object, text: str, sort: str) -> None:
    cell = reports._cell(value)
    assert (cell["text"], cell["sort"]) == (text, sort)


def test_wrong_parts_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ReportError, match="row 1"):
        Report("t").table(["a", "b"], [[1, 2], [1]])
    with pytest.raises(ReportError, match="absent.png"):
        Report("t").figure(tmp_path / "absent.png")
    with pytest.raises(ReportError, match="pdf"):
        Report("t").figure(tmp_path / "a.pdf")


def test_large_pictures_are_reduced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reports, "LIMIT", 100_000)
    noisy_png(tmp_path / "a.png", 250)
    assert (tmp_path / "a.png").stat().st_size > 150_000
    path = Report("t").figure(tmp_path / "a.png").save(tmp_path / "r.html")
    assert path.stat().st_size < 100_000
    assert re.search(r"data:image/png;base64,iVBOR", path.read_text())


def test_a_report_that_stays_large_is_written_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(reports, "LIMIT", 100)
    Report("t").save(tmp_path / "r.html")
    assert (tmp_path / "r.html").exists()
    assert "r.html" in capsys.readouterr().err
