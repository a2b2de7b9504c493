"""Pages of docs/: their Python runs, their links lead somewhere, every page is in the table of contents."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np
import pytest

from studies.trials import blind_report

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
    assert names["experiment"].n_increments == 3 and (tmp_path / "mine.npz").exists()


def test_the_new_effect_changes_nothing_at_its_null_value(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(plain("\n".join(blocks("extending.md")[:3])), names)
    effect = names["LogarithmOfTheSecondInvariant"]()
    F, P = np.random.default_rng(0).normal([[1.0, 0.0], [0.0, 1.0]], 0.1, (2, 5, 2, 2)), np.ones((2, 5, 2, 2))
    np.testing.assert_array_equal(effect.stress(None, F, P, (0.0,), (), None), P)


def test_the_tables_of_blind_trials_are_those_of_the_trials() -> None:
    """Each file is the trials.json of runs, every trial once; its tables stand on the page as a run prints them."""
    page = (DOCS / "discover.md").read_text()
    said, limits = (" ".join(path.read_text().split()) for path in (ROOT / "README.md", DOCS / "limits.md"))
    trials, first, before = (
        json.loads((DOCS / name).read_text()) for name in ("blind.json", "blind_first.json", "blind_before.json")
    )
    found, other, old = map(blind_report.summary, (trials, first, before))
    for some in (trials, first, before):
        assert len({one["trial"] for one in some}) == len(some)
    for numbers in (found, old):
        assert blind_report.markdown(numbers) in page
    assert f"**{len(trials)} trials**" in page and f"Before them {len(first)} trials" in page
    assert f"There {other['null_detections']} of {other['nulls']} without an effect were called significant" in page
    parts = (other["strong_group_named"], other["strong"], other["amplitudes_within"], other["amplitudes"],
             other["absent_wrong"], other["absent"], other["pairs_found"], other["pairs"])  # fmt: skip
    assert "{} of {} groups, {} of {} amplitudes, {} wrong names of {}, {} of {} pairs".format(*parts) in page
    pairs = sum(len(one["hidden"]) == 2 for one in before)
    both = f"{old['pairs_at_first_found']} of {old['pairs_at_first']}"
    assert f"of all {pairs} pairs, both named in {both} that scored above 10, and in the model in" in page
    quiet = found["nulls"] - found["null_detections"]
    assert f"In {len(trials)} blind trials" in said
    assert f"found nothing in {quiet} of {found['nulls']} without an effect" in said
    assert f"named the group of {found['strong_group_named']} of {found['strong']} strong effects" in said
    assert f"{found['amplitudes_within']} of {found['amplitudes']} amplitudes in their 95 % interval" in said
    assert f"a wrong name in {found['absent_wrong']} of {found['absent']}" in said
    fields = [
        a
        for one in trials
        for a in one["amplitudes"]
        if one["hidden"] == ["stiffness field"] and a["effect"] in one["hidden"]
    ]
    pulls = [(a["amplitudes"][k] - true) / a["deviations"][k] for a in fields for k, true in a["true"].items()]
    inside = f"{sum(abs(pull) <= 1.96 for pull in pulls)} of {len(pulls)}"
    assert f"of the coefficients of stiffness fields {inside}" in said and f"{inside} are within" in page
    assert f"named both in {found['pairs_found']} of {found['pairs']} pairs" in said
    assert f"a wrong name was given in {found['absent_wrong']} of {found['absent']} such cases" in limits
    assert f"both were named in {found['pairs_found']} of {found['pairs']} strong pairs" in limits


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text()):
        assert target.startswith("http") or (page.parent / target).exists(), target


def test_every_page_is_in_the_table_of_contents() -> None:
    listed = set(re.findall(r"[\w/-]+\.md", (ROOT / ".ci" / "mkdocs.yml").read_text()))
    assert {str(page.relative_to(DOCS)) for page in PAGES} == listed


def test_every_public_module_is_in_the_reference() -> None:
    """Of the packages that are called from Python; the studies are commands."""
    shown = set(re.findall(r"^::: (\S+)$", "\n".join(p.read_text() for p in PAGES), re.MULTILINE))
    for package in ("meshes", "forward", "calibrate"):
        for path in (ROOT / package).rglob("*.py"):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            if not path.stem.startswith("_"):
                assert name in shown, name
