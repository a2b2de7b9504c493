"""What every report must hold in a real browser: a page in, what is wrong with it out, as a list of sentences."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

from browser import Browser, Page

LIMIT = 5_000_000
PHONE, SCREEN, PAPER = 390, 1200, 688  # pixels; paper: A4 without margins of 14 mm, at 96 pixels an inch
NUMBER = re.compile(r"([-+−]?[\d.]+(?:e[-+]?\d+)?)(?: ?(?:%|[A-Za-zµ]{1,3}[²³]?))?(?: \[[^]]*\])?")
TABLES = """[...document.querySelectorAll("table.sortable")].map(t => [...t.tHead.rows[0].cells].map((_, i) =>
    [...t.tBodies[0].rows].map(r => r.cells[i].textContent)))"""
CLICK = """(([t, c]) => { const head = document.querySelectorAll("table.sortable")[t].tHead.rows[0].cells[c];
    head.querySelector("button").click(); return head.getAttribute("aria-sort"); })"""
WIDER = """(width => [...document.querySelectorAll("table, img, canvas, p, h1, h2")]
    .filter(e => e.getBoundingClientRect().right > width + 1)
    .map(e => e.tagName + " " + e.textContent.trim().slice(0, 60)))"""
PICTURES = """[...document.images].map(i => [i.naturalWidth, i.getBoundingClientRect().width, i.alt])"""
FAINT = """(() => {
    const parts = text => text.match(/[\\d.]+/g).map(Number);
    const linear = v => (v /= 255) <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    const light = text => { const [r, g, b] = parts(text).map(linear);
        return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
    const behind = e => { const colour = getComputedStyle(e).backgroundColor;
        if (parts(colour)[3] !== 0) return colour;
        return e.parentElement ? behind(e.parentElement) : "rgb(255, 255, 255)"; };
    const own = e => [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
    return [...document.body.querySelectorAll("*")].filter(e => own(e) && e.getClientRects().length).filter(e => {
        const [a, b] = [light(getComputedStyle(e).color), light(behind(e))].sort((x, y) => y - x);
        return (a + 0.05) / (b + 0.05) < 4.5; }).map(e => e.tagName + " " + e.textContent.trim().slice(0, 40));
})()"""


def faults(browser: Browser, path: Path) -> list[str]:
    """Everything that a reader would miss in a report; an empty list is a good report."""
    found = [f"{path.stat().st_size} bytes"] if path.stat().st_size >= LIMIT else []
    page = browser.open(path, PHONE)
    if (width := page.run("document.scrollingElement.scrollWidth")) > PHONE:
        found.append(f"{width} pixels wide on a phone")
    page.resize(SCREEN)
    found += [f"picture '{alt}' of {own} pixels, shown on {shown}" for own, shown, alt in page.run(PICTURES)
              if not (own > 0 and shown > 0 and alt.strip())]  # fmt: skip
    found += [f"faint: {text}" for text in page.run(FAINT)]
    found += unsorted(page)
    found += printed(page)
    found += [f"complaint: {text}" for text in page.complaints()]
    found += [f"request: {address}" for address in page.requests() if address != path.resolve().as_uri()]
    page.close()
    return found


def unsorted(page: Page) -> list[str]:
    """Columns that a click on the head does not sort, up at first and then down."""
    found = []
    for table, columns in enumerate(page.run(TABLES)):
        for column in range(len(columns)):
            for order in ("ascending", "descending"):
                if page.run(f"{CLICK}([{table}, {column}])") != order:
                    found.append(f"table {table}, column {column}: aria-sort is not {order}")
                now = page.run(TABLES)[table]
                if not in_order(now[column], order == "descending"):
                    found.append(f"table {table}, column {column}: not {order}: {now[column][:9]}")
                if sorted(zip(*now, strict=True)) != sorted(zip(*columns, strict=True)):
                    found.append(f"table {table}, column {column}: rows were mixed up")
    return found


def in_order(texts: list[str], falling: bool = False) -> bool:
    """Whether the numbers among the cells rise (fall), in one block, and what is empty comes last."""
    full = [text for text in texts if text.strip(" –-")]
    if texts[: len(full)] != full:
        return False
    numbers = [NUMBER.fullmatch(text.strip()) for text in full]
    values = [float(match[1].replace("−", "-")) for match in numbers if match]
    kinds = [match is not None for match in numbers]
    return kinds == sorted(kinds, reverse=not falling) and all(
        (b <= a) if falling else (a <= b) for a, b in pairwise(values)
    )


def printed(page: Page) -> list[str]:
    """What is wrong on paper."""
    pages = pages_of_figures(pdf := page.pdf())
    found = [] if count_pages(pdf) > 0 else ["no page is printed"]
    shown = page.run("document.querySelectorAll('figure').length")
    if len(pages) != shown:
        found.append(f"{len(pages)} of {shown} figures are printed")
    found += [f"figure {i} is torn apart" for i, where in enumerate(pages) if len(where) != 1]
    page.ask("Emulation.setEmulatedMedia", media="print")
    page.resize(PAPER)
    found += [f"beyond the paper: {text}" for text in page.run(f"{WIDER}({PAPER})")]
    if page.run(
        "[...document.querySelectorAll('details')].some(d => d.querySelector('td')?.checkVisibility() === false)"
    ):
        found.append("settings are folded on paper")
    page.ask("Emulation.setEmulatedMedia", media="")
    page.resize(SCREEN)
    return found


def count_pages(pdf: bytes) -> int:
    return len(re.findall(rb"/Type /Page\b", pdf))


def pages_of_figures(pdf: bytes) -> list[set[bytes]]:
    """The pages on which every <figure> has parts, from the structure tree of a tagged PDF."""
    elements = dict(re.findall(rb"(\d+) 0 obj\n(<</Type /StructElem\n.*?)\nendobj", pdf, re.DOTALL))

    def pages(number: bytes) -> set[bytes]:
        content = elements[number]
        inside = content[content.index(b"/K ") :] if b"/K " in content else b""
        found = set(re.findall(rb"/Pg (\d+) 0 R", content))
        return found.union(*(pages(child) for child in re.findall(rb"(\d+) 0 R", inside) if child in elements))

    outer = [n for n, content in elements.items() if b"/S /Figure\n" in content and not _in_figure(content, elements)]
    return [pages(number) for number in outer]


def _in_figure(content: bytes, elements: dict[bytes, bytes]) -> bool:
    parent = re.search(rb"/P (\d+) 0 R", content)
    while parent and parent[1] in elements:
        if b"/S /Figure\n" in elements[parent[1]]:
            return True
        parent = re.search(rb"/P (\d+) 0 R", elements[parent[1]])
    return False
