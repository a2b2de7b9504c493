"""Reports in a real browser: nothing is fetched or complains, pictures show, tables sort, solids turn, paper holds it.

Every check of `report_checks` is broken once here, so that it is known to find something.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import browser
import numpy as np
import pytest
import report_checks
import thickness_stand_in
from browser import Browser, Page
from PIL import Image
from report_checks import faults
from study_stand_in import judged_fit, result_of, runs_with, store

from studies import cli
from studies.commands.reproduction import figures
from studies.grid import convergence_report, convergence_runs, steps
from studies.grid import report as study_report
from studies.grid.axes import Loss
from studies.grid.presets.resolution_study import RESOLUTION
from studies.grid.presets.thickness_study import THICKNESS
from studies.grid.results import Results
from studies.output import Manifest, write_figure
from studies.output.findings import Finding
from studies.output.report import Report
from studies.output.scene import Scene, palette
from studies.reports.alert_table import add_alerts
from studies.reports.model_remarks import ModelRemark

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(browser.program() is None, reason=f"none of {', '.join(browser.PROGRAMS)} on the PATH"),
    pytest.mark.timeout(900),
]  # fmt: skip
CELLS = [3, 1e-5, "2.6 %", "10 %", "", None, -4.0, float("nan"), "0.51 [0.4, 0.6]", float("inf"), 12345.6]
RISING = ["−4", "1e-05", "0.51 [0.4, 0.6]", "2.6 %", "3", "10 %", "12350", "inf"]  # before three empty cells


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with Browser(str(browser.program())) as running:
        yield running


def picture(path: Path, height: float = 3.0) -> Path:
    from studies.output import style

    with style.figure(6.0, height) as figure:
        figure.subplots().plot([0, 1], [0, 1])
        write_figure(path, figure)
    return path


def box() -> Scene:
    """An eighth of a box of 2 x 1 x 0.5 mm with its cut, coloured along x."""
    corners = np.array([[x, y, z] for x in (0, 1.0) for y in (0, 0.5) for z in (0, 0.25)])
    faces = np.array([[4, 6, 7], [4, 7, 5], [2, 3, 7], [2, 7, 6], [1, 5, 7], [1, 7, 3]])
    mirrors = tuple((x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1))
    return Scene("box", corners, faces, corners[:, 0], (0.0, 1.0), mirrors, np.array([[0, 4, 5], [0, 5, 1]]))


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of every kind of part; many figures, so that some would be torn apart on paper."""
    folder = tmp_path_factory.mktemp("report")
    report = Report("Everything <b>", "sub & line").paragraph("8.8 % -> 0.95 %; 1 < 2")
    (folder / "b.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"><rect width="9" height="9"/></svg>'
    )
    report.figure(folder / "b.svg").view([box(), box()], "place (mm)", "A box.")
    report.table(["number", "text"], [[cell, f"row {i}"] for i, cell in enumerate(CELLS)], "A mixed column. " * 20)
    report.table([f"column {i}" for i in range(14)], [[0.1234 * i for i in range(14)]] * 3, "Wide")
    for i in range(8):
        report.heading(f"Part {i}").figure(picture(folder / f"{i}.png", 2.5 + 0.4 * i), "Words below it. " * 25)
    report.details("Settings", {"seed": 1, "path": "a" * 200})
    return report.save(folder / "report.html")


@pytest.fixture
def page(chromium: Browser, everything: Path) -> Iterator[Page]:
    opened = chromium.open(everything)
    yield opened
    opened.close()


# --- a report of everything ---------------------------------------------------------------------------------------


def test_a_report_of_everything_has_no_fault(chromium: Browser, everything: Path) -> None:
    assert faults(chromium, everything) == []


@pytest.mark.parametrize(
    ("before", "after", "fault"),
    [
        ("</body>", "<script>console.error('no')</script></body>", "complaint: .*no"),
        ("</body>", "<script>absent.call()</script></body>", "complaint: .*absent is not defined"),
        ("</body>", '<img src="https://example.org/a.png" alt="a"></body>', "complaint: .*Content Security Policy"),
        ("default-src 'none'; img-src data:", "img-src data: file:", None),
        ("</body>", '<img src="nowhere.png" alt="a"></body>', "picture 'a' of 0 pixels"),
        ('alt="picture without a caption"', 'alt=""', "picture '' of 9"),
        ("return sign * ((Number", "return ((Number", "not descending"),
        ("if (p !== q)", "if (false)", "table 0, column 0: not"),
        ("head.ariaSort =", "head.title =", "aria-sort is not ascending"),
        (".forEach(row => body.append(row))", ".slice(1).forEach(row => row.remove())", "rows were mixed up"),
        ("break-inside: avoid", "break-inside: auto", "torn apart"),
        ("@media print {", "@media none {", "beyond the paper"),
        ("content-visibility: visible", "content-visibility: hidden", "settings are folded on paper"),
        (".scroll { overflow-x: auto;", ".scroll {", "wide on a phone"),
        ("color: #1a1a1a", "color: #999", "faint: P"),
        ("</body>", "<!--" + "a" * report_checks.LIMIT + "--></body>", "bytes"),
    ],
)  # fmt: skip
def test_what_is_broken_is_found(
    chromium: Browser, everything: Path, tmp_path: Path, before: str, after: str, fault: str | None
) -> None:
    text = everything.read_text()
    assert before in text
    text = text.replace(before, after)
    if fault is None:  # without the policy that forbids it, the request itself is seen
        text, fault = text.replace("</body>", '<img src="other.png" alt="a"></body>'), "request: file:.*other.png"
    (tmp_path / "broken.html").write_text(text)
    found = faults(chromium, tmp_path / "broken.html")
    assert any(re.search(fault, one) for one in found), found


def cells(page: Page, column: int = 0) -> list[str]:
    return page.run(report_checks.TABLES)[0][column]


def test_a_click_sorts_by_value_and_a_second_one_reverses(page: Page) -> None:
    x, y = page.run("(b => { b.scrollIntoView(); const r = b.getBoundingClientRect(); return [r.x + 5, r.y + 5]; })"
                    "(document.querySelector('th button'))")  # fmt: skip
    page.click(x, y)
    assert cells(page)[:8] == RISING and set(cells(page)[8:]) == {"–", ""}
    assert page.run("document.querySelector('th').ariaSort") == "ascending"
    page.click(x, y)
    assert cells(page)[:8] == RISING[::-1] and set(cells(page)[8:]) == {"–", ""}
    assert page.run("document.querySelector('th').ariaSort") == "descending"


def test_tables_sort_by_keyboard_and_text_in_natural_order(page: Page) -> None:
    page.run("document.querySelector('th button').focus()")
    page.press("Enter", "\r")
    page.press("Tab")
    page.press("Enter", "\r")
    heads = "[...document.querySelector('table').tHead.rows[0].cells].map(h => h.getAttribute('aria-sort'))"
    assert page.run(heads) == [None, "ascending"]
    assert cells(page, 1) == [f"row {i}" for i in range(len(CELLS))]  # row 10 after row 9
    page.press(" ", " ")
    assert cells(page, 1) == [f"row {i}" for i in reversed(range(len(CELLS)))]


def test_headings_are_listed_and_lead_there(page: Page) -> None:
    page.run("document.querySelectorAll('nav a')[5].click()")
    assert page.run("document.querySelector(location.hash).textContent") == "Part 5"
    assert abs(page.run("document.querySelector(location.hash).getBoundingClientRect().y")) < 60


def test_the_code_of_an_alert_opens_what_it_means(chromium: Browser, tmp_path: Path) -> None:
    nominal = Finding("prediction", ModelRemark.NOMINAL_LEVEL)
    page = chromium.open(add_alerts(Report("Alerts"), [nominal]).save(tmp_path / "alerts.html"))
    assert not page.run("document.querySelector('details').open")
    page.run("document.querySelector('td a').click()")
    page.settle()
    assert page.run("document.querySelector('details').open")
    assert nominal.alert.means in page.run("document.querySelector(location.hash).textContent")
    page.close()
    assert faults(chromium, tmp_path / "alerts.html") == []


# --- the solid that can be turned -----------------------------------------------------------------------------------


def shown(page: Page) -> np.ndarray:
    """(height, width, 3): the canvas as it is on the screen."""
    page.settle()
    return np.asarray(Image.open(io.BytesIO(page.picture("canvas"))).convert("RGB"), np.int64)[2:-2, 2:-2]


def painted(image: np.ndarray) -> float:
    return float((image.min(axis=2) < 250).mean())


def middle(page: Page) -> tuple[float, float]:
    """The middle of the canvas in the window, which is scrolled there."""
    x, y = page.run("(c => { c.scrollIntoView({block: 'center'}); const r = c.getBoundingClientRect();"
                    "return [r.x + r.width / 2, r.y + r.height / 2]; })(document.querySelector('canvas'))")  # fmt: skip
    return x, y


def test_the_solid_is_painted_in_the_colours_of_its_scale(page: Page) -> None:
    image = shown(page)
    assert 0.05 < painted(image) < 0.9
    body = image[image.min(axis=2) < 250]
    ends = [
        np.abs(body / body.max(axis=1, keepdims=True) - end / end.max()).sum(axis=1).min() for end in palette()[[0, -1]]
    ]
    assert max(ends) < 0.1  # both ends of the scale, but for the light
    assert page.run("[...document.querySelectorAll('.limit')].map(l => l.textContent)") == ["0", "1"]
    assert not page.run("document.querySelector('.absent').getClientRects().length")


def test_the_solid_turns_by_mouse_and_keys_and_is_cut_open(page: Page) -> None:
    first = shown(page)
    page.drag(*middle(page), 70, 0)
    spun = shown(page)
    page.drag(*middle(page), 0, 20)
    turned = shown(page)
    assert (spun != first).any() and (turned != spun).any()
    page.run("document.querySelector('canvas').focus()")
    page.press("ArrowUp")
    assert (shown(page) != turned).any()
    page.run("document.querySelector('[data-do=reset]').click()")
    assert (shown(page) == first).all()
    page.run("document.querySelector('[data-do=open]').click()")
    assert painted(shown(page)) < painted(first)
    page.run("document.querySelector('[data-do=nearer]').click()")
    assert painted(shown(page)) > 1.2 * 0.5 * painted(first)
    page.run("(s => { s.value = 1; s.dispatchEvent(new Event('change')); })(document.querySelector('[data-do=scene]'))")
    assert painted(shown(page)) > 0.02
    assert page.complaints() == []


@pytest.mark.parametrize("missing", ["() => null", "function (kind) { return kind === 'webgl2' ? null : {}; }"])
def test_without_webgl_a_message_stands_there(chromium: Browser, everything: Path, missing: str) -> None:
    page = chromium.open(everything, before=f"HTMLCanvasElement.prototype.getContext = {missing}")
    assert page.run("document.querySelector('.absent').getBoundingClientRect().height") > 20
    assert page.run("document.querySelector('canvas').getClientRects().length") == 0
    assert page.run("document.querySelector('.controls').getClientRects().length") == 0
    assert page.complaints() == []
    page.close()


def test_a_scale_of_colours_is_one_of_grey(page: Page) -> None:
    """Relative luminance rises along the palette, so that it survives grey print and colour blindness."""
    light = palette() / 255 @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light) > -1e-3).all() and light[-1] > 5 * light[0]


# --- reports of commands --------------------------------------------------------------------------------------------


def test_specimens(chromium: Browser, tmp_path: Path) -> None:
    assert cli.main(["specimens", "--quick", "--only", "square", "strip", "-o", str(tmp_path / "out")]) == 0
    assert faults(chromium, tmp_path / "out" / "report.html") == []


def test_predict(chromium: Browser, tmp_path: Path) -> None:
    from skip_network import neo_hooke

    neo_hooke().save(tmp_path / "model.json")
    words = [
        "predict",
        str(tmp_path / "model.json"),
        "--points",
        "21",
        "--against",
        "neo_hooke",
        "--parameter",
        "mu=0.3",
    ]
    assert cli.main([*words, "-o", str(tmp_path / "out")]) == 0
    assert faults(chromium, tmp_path / "out" / "report.html") == []


def test_supervised(chromium: Browser, tmp_path: Path) -> None:
    words = ["supervised", "--quick", "--data", "arruda-boyce", "--layers", "1", "-o", str(tmp_path / "out")]
    assert cli.main(words) == 0
    assert faults(chromium, tmp_path / "out" / "report.html") == []


def test_blind(chromium: Browser, tmp_path: Path) -> None:
    from judged_trials import trial

    from studies.trials import blind_report

    homes = [
        trial(tmp_path, "hit", ["force offset"], ["force offset"], value=1.1, absent=["twin"]),
        trial(tmp_path, "wrong", ["lens distortion"], ["force offset"], absent=["viscoelasticity"]),
        trial(tmp_path, "null", [], verdict="nothing significant"),
    ]
    blind_report.write_report(tmp_path, homes, {}, Manifest())
    assert faults(chromium, tmp_path / "report.html") == []


def test_resolution(chromium: Browser, tmp_path: Path) -> None:
    settings = replace(RESOLUTION.quick, nodes=1600, resolutions=("100", "50"), losses=(Loss.WEIGHTED,))
    cases = [result_of(case, {Loss.WEIGHTED: judged_fit(1.004 if case.noisy else 1.0)}) for case in settings.cases]
    for resolution in settings.resolutions:
        steps.mesh(tmp_path, settings, "cross", resolution)
    for result in cases:
        store(tmp_path, result)
    results = Results(tmp_path, settings)
    path = study_report.write(results, RESOLUTION.page(results))
    assert faults(chromium, path) == []


def test_convergence(chromium: Browser, tmp_path: Path) -> None:
    study = convergence_runs.series(quick=False)
    runs = runs_with(study, 1e-3)
    convergence_report.compose(tmp_path, study, runs, convergence_report.table(study, runs))
    assert faults(chromium, tmp_path / "report.html") == []


def test_the_page_of_all_figures(chromium: Browser, tmp_path: Path) -> None:
    """It shows every picture, also those in folders of a study, and needs none of their files."""
    paths = [tmp_path / "simulate" / "forces.png", tmp_path / "thickness" / "figures" / "maps.png"]
    for path in paths:
        path.parent.mkdir(parents=True)
        picture(path, 2.0)
        Manifest().beside(path)
    (tmp_path / "simulate" / "report.html").write_text("")
    written = figures.write_page(tmp_path, "quick", {"measured": "no data"}, ["blind"])
    assert faults(chromium, written) == []
    page = chromium.open(written)
    links = page.run("[...document.querySelectorAll('figure a')].map(a => a.getAttribute('href'))")
    assert links == [str(path.relative_to(tmp_path)) for path in paths]
    assert page.run("document.images.length") == 2
    page.close()


def test_simulate_calibrate_and_predict_another_test(chromium: Browser, tmp_path: Path) -> None:
    test, model = tmp_path / "simulate" / "experiment.npz", tmp_path / "calibrate" / "model.json"
    for words in (
        ["simulate", "--quick"],
        ["calibrate", str(test), "--quick"],
        ["predict", str(model), "--test", str(test)],
    ):
        assert cli.main([*words, "-o", str(tmp_path / words[0])]) == 0
        assert faults(chromium, tmp_path / words[0] / "report.html") == []


def test_discover(chromium: Browser, tmp_path: Path) -> None:
    from discoveries import explained, view
    from discovery_stand_in import StandInManifest, StandInModel

    from studies.reports.discovery import report as discovery_report

    path = discovery_report.write(tmp_path, view(explained()), StandInModel(), StandInManifest())
    assert faults(chromium, path) == []


def test_thickness(chromium: Browser, tmp_path: Path) -> None:
    results = Results(thickness_stand_in.fill(tmp_path / "out"), thickness_stand_in.SETTINGS)
    path = study_report.write(results, THICKNESS.page(results))
    assert faults(chromium, path) == []
    page = chromium.open(path)
    assert painted(shown(page)) > 0.05
    page.close()
