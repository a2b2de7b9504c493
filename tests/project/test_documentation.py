"""Pages of docs/: their Python runs, their links lead somewhere, every page is in the table of contents."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np
import pytest

from studies.design.validation import ActualError
from studies.trials import judgement

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))


def blocks(page: str) -> list[str]:
    """Python blocks of a page."""
    return re.findall(r"^```python\n(.*?)^```$", (DOCS / page).read_text(), re.MULTILINE | re.DOTALL)


def plain(block: str) -> CodeType:
    """Compiled without the `from __future__` of this file."""
    return compile(block, "documentation", "exec", dont_inherit=True)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_page_on_extending_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Material, specimen, effect and importer as they stand; the effect that was put in is the one that is found."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    for block in blocks("extending.md"):
        exec(plain(block), names)
    specimen, mesh = names["specimen"], names["mesh"]
    assert mesh.area() == pytest.approx(specimen.exact_area(), rel=1e-3)
    found = names["found"]
    assert found.verdict == "explained"
    assert set(found.groups[found.named[0]]) == {"second invariant", "logarithm of the second invariant"}
    c01, deviation = found.final.additions[0].amplitudes[0], found.final.errors[0][0]
    assert abs(c01 - 0.05) < 3 * deviation < 0.005
    assert names["experiment"].noise.displacement_std == pytest.approx(0.005, rel=0.3)
    assert names["experiment"].loaded[1].force[-1, 0] == pytest.approx(names["force"][-1])


def test_the_new_effect_changes_nothing_at_its_null_value(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(plain("\n".join(blocks("extending.md")[:3])), names)
    effect = names["LogarithmOfTheSecondInvariant"]()
    F, P = np.random.default_rng(0).normal([[1.0, 0.0], [0.0, 1.0]], 0.1, (2, 5, 2, 2)), np.ones((2, 5, 2, 2))
    np.testing.assert_array_equal(effect.stress(None, F, P, (0.0,), ()), P)


def script(name: str) -> ModuleType:
    """A script of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)  # dataclasses look their module up there
    spec.loader.exec_module(module)
    return module


def test_no_number_is_stale() -> None:
    """Pages hold what docs/results says, and the files that follow from others follow from them."""
    assert script("insert_numbers").main(["--check"]) == 0
    for name, content in script("derive_numbers").main().items():
        assert json.loads((DOCS / "results" / f"{name}.json").read_text()) == content, f"{name}: run `make numbers`"


def test_every_result_says_how_it_was_made() -> None:
    for path in (DOCS / "results").glob("*.json"):
        assert json.loads(path.read_text())["command"], path.name


def test_a_stale_number_is_replaced_and_a_missing_one_is_named() -> None:
    inserted = script("insert_numbers").inserted
    numbers, tables = {"a.b": 0.384}, {"a.c": [["x", "y"], ["1", "2"]]}
    text = "of <!--=a.b:.2f-->0.3<!--/-->\n\n<!--table a.c-->\nold\n<!--/table-->\n"
    new, missing = inserted(text, numbers, tables)
    assert "of <!--=a.b:.2f-->0.38<!--/-->" in new and "| 1 | 2 |" in new and "old" not in new and not missing
    assert inserted(new, numbers, tables) == (new, [])
    assert inserted(text, {}, tables)[1] == ["no file has the number a.b"]
    assert inserted(text, numbers, {})[1] == ["no file has the table a.c"]
    assert len(inserted("<!--=a.b-->0.384<!--/--> of", numbers, tables)[1]) == 1


def test_numbers_of_a_design_count_a_failed_calibration_as_the_study_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DOCS / "study_numbers"))
    page = script("study_numbers/design")
    for modes in ({}, {"uniaxial": 0.3, "equibiaxial": 0.4}):
        assert page.overall({"modes": modes}) == ActualError("sheet", 0, modes).overall
    failed = {"title": page.OPTIMISED, "seed": 0, "modes": {}}
    found = page.actual_of_optimised({"validation": {"errors": [failed]}})
    assert set(found.values()) == {"inf % (inf % to inf %)"}


def test_every_trial_is_counted_once() -> None:
    """And how the strong effects ended adds up."""
    trials = judgement.read(DOCS / "trials" / "blind.json")
    assert len({one.trial for one in trials}) == len(trials)
    n = script("derive_numbers").numbers(trials)
    assert n["right"] + n["beside"] + n["group"] + n["dominant"] + n["missed"] + n["wrong"] == n["strong"]
    assert n["right"] + n["beside"] == n["strong_named"] and n["strong_named"] + n["group"] == n["strong_group_named"]
    assert n["removed_explained"] == n["removed_alike"] + n["removed_wrong"]


def words(text: str) -> int:
    """That a reader sees: without the markers of numbers and the bars of tables."""
    return len(re.sub(r"<!--.*?-->|\|", " ", text, flags=re.DOTALL).split())


def test_pages_that_everybody_reads_are_short() -> None:
    """README is one page, whose table is read cell by cell; the guide to the diagnosis has no place for its results."""
    readme = (ROOT / "README.md").read_text()
    assert words(readme) < 1100
    cells = [cell for line in readme.splitlines() if line.startswith("| ") for cell in line.split("|")]
    assert max(map(words, cells)) <= 50
    assert words((DOCS / "discover.md").read_text()) < 2600


def anchors(page: Path) -> set[str]:
    """Of headings, as GitHub and mkdocs make them, and of those that are written out."""
    text = re.sub("```.*?```", "", page.read_text(), flags=re.DOTALL)
    headings = re.findall(r"^#+ +(.*)$", text, re.MULTILINE)
    plain = (re.sub(r"<!--.*?-->|[`*_]|\]\([^)]*\)|\[", "", heading) for heading in headings)
    slugs = (re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in plain)
    return {*slugs, *re.findall(r'<a id="([^"]+)"', text)}


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    assert not re.search("^(<{7}|>{7}) ", page.read_text(), re.MULTILINE), "conflict of a merge"
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)]*))?\)", page.read_text()):
        if target.startswith("http"):
            continue
        there = page.parent / target if target else page
        assert there.exists(), target
        if anchor and there.suffix == ".md" and "reference" not in there.parts:
            assert anchor in anchors(there), f"{target}#{anchor}"


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: str(page.relative_to(ROOT)))
def test_source_files_that_are_named_exist(page: Path) -> None:
    """Of the repository: `folder/file.py`, `folder/`."""
    folders = "meshes|forward|calibrate|studies|tests|benchmarks"
    for name in re.findall(rf"\b((?:{folders})/[\w./]*(?:\.py|\.c|/)(?![\w/.*{{]))", page.read_text()):
        assert (ROOT / name).exists(), name


def test_every_page_is_in_the_table_of_contents() -> None:
    listed = set(re.findall(r"[\w/-]+\.md", (ROOT / ".ci" / "mkdocs.yml").read_text()))
    assert {str(page.relative_to(DOCS)) for page in PAGES} == listed


@pytest.mark.parametrize("package", ["meshes", "forward", "calibrate", "studies"])
def test_every_public_module_is_in_the_reference(package: str) -> None:
    """`make numbers` writes the pages from the tree."""
    assert (DOCS / "reference" / f"{package}.md").read_text() == script("reference_pages").page(package)
