"""Put the numbers of `docs/results/*.json` into README.md and docs/*.md: `make numbers`.

In: result files, each with the command that made it, the date, and its `numbers` and `tables`. Out: the pages, in which

    <!--=resolution.bias_coarse-->-0.4 %<!--/-->       a number of resolution.json; `:.2f` behind the name formats it
    <!--table resolution.bias--> ... <!--/table-->     a table of it, on lines of its own

hold what the files say. With `--check` nothing is written: a stale number and a name that no file has are named, and the
exit status is 1. Both kinds of marker are comments, which GitHub and the pages of `make docs` do not show.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
NUMBER = re.compile(r"<!--=([\w.]+)(?::([^>]*?))?-->(.*?)<!--/-->", re.DOTALL)
TABLE = re.compile(r"<!--table ([\w.]+)-->\n(.*?)<!--/table-->", re.DOTALL)
AT_LINE_START = re.compile(r"^ {0,3}<!--=", re.MULTILINE)  # would begin a block of HTML and end the paragraph


def pages(root: Path = ROOT) -> list[Path]:
    """README.md and the pages of docs/."""
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def results(folder: Path = ROOT / "docs" / "results") -> tuple[dict[str, Any], dict[str, list[list[str]]]]:
    """Numbers and tables of all files, by FILE.NAME."""
    numbers: dict[str, Any] = {}
    tables: dict[str, list[list[str]]] = {}
    for path in sorted(folder.glob("*.json")):
        content = json.loads(path.read_text())
        numbers |= {f"{path.stem}.{key}": value for key, value in content.get("numbers", {}).items()}
        tables |= {f"{path.stem}.{key}": rows for key, rows in content.get("tables", {}).items()}
    return numbers, tables


def markdown(rows: list[list[str]]) -> str:
    """A table: the first row is its head."""
    head, *body = [[str(cell) for cell in row] for row in rows]
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ["---"] * len(head), *body))


def inserted(text: str, numbers: Mapping[str, Any], tables: Mapping[str, list[list[str]]]) -> tuple[str, list[str]]:
    """The text with what the files say, and what they do not have."""
    missing = [
        f"a line begins with a number: {text[m.start() : m.start() + 60]!r}" for m in AT_LINE_START.finditer(text)
    ]

    def number(match: re.Match[str]) -> str:
        name, spec, _ = match.groups()
        if name not in numbers:
            missing.append(f"no file has the number {name}")
            return match[0]
        mark = f"{name}:{spec}" if spec else name
        return f"<!--={mark}-->{format(numbers[name], spec or '')}<!--/-->"

    def table(match: re.Match[str]) -> str:
        if match[1] not in tables:
            missing.append(f"no file has the table {match[1]}")
            return match[0]
        return f"<!--table {match[1]}-->\n\n{markdown(tables[match[1]])}\n<!--/table-->"

    return TABLE.sub(table, NUMBER.sub(number, text)), missing


def main(arguments: list[str] | None = None) -> int:
    """Rewrite or check all pages; 1 where something is stale or missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where a number is stale")
    check = parser.parse_args(arguments).check
    numbers, tables = results()
    complaints = []
    for path in pages():
        text = path.read_text()
        new, missing = inserted(text, numbers, tables)
        complaints += [f"{path.relative_to(ROOT)}: {what}" for what in missing]
        if new != text and check:
            complaints.append(f"{path.relative_to(ROOT)}: stale numbers; run `make numbers`")
        elif new != text:
            path.write_text(new)
    for complaint in complaints:
        print(complaint, file=sys.stderr)
    return int(bool(complaints))


if __name__ == "__main__":
    sys.exit(main())
