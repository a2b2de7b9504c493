"""A design from its file to its report: limits are kept, a search finds a known minimum and resumes, verdicts follow their rule."""

import json

import numpy as np
import pytest

from calibrate.errors import FitError
from forward.materials import MooneyRivlin
from meshes import Strip
from studies.cli import main
from studies.commands import design as design_command
from studies.design import candidates, pattern_search
from studies.design.candidates import Candidate, family_of, judge, rank
from studies.design.design_plan import checked
from studies.design.expected_information import correlated_neighbours, quadrant_points
from studies.design.information import Criteria, Information
from studies.design.law_family import LawFamily
from studies.design.pattern_search import Evaluation, search
from studies.design.pulls_within_limits import Limit, View, limited_pull
from studies.design.validation import ActualError, Validation, Verdict, correlations, stress_errors
from studies.errors import DesignError

COARSE = {"size_factor": 4.0, "camera": {"pictures": 3, "points": 600}, "law": {"knots": 8}}
PLAN = checked({**COARSE, "specimen": [{"kind": "UT"}]}, "plan")


@pytest.mark.parametrize(
    ("table", "limits", "ends"),
    [
        ("machine", {"largest_force_N": 5.0}, Limit.FORCE),
        ("machine", {"largest_displacement_mm": 10.0}, Limit.DISPLACEMENT),
        ("sheet", {"largest_stretch": 1.5}, Limit.STRETCH),
        ("camera", {"largest_field_mm": 150.0, **COARSE["camera"]}, Limit.FIELD),
    ],
)
def test_a_pull_ends_at_the_first_limit(table, limits, ends):
    plan = checked({**COARSE, "specimen": [{"kind": "UT"}], table: limits}, "plan")
    pull = limited_pull(Strip(), MooneyRivlin(), plan)
    assert pull.limit == ends
    met = {
        Limit.FORCE: pull.forces["right"][-1] / plan.machine.largest_force_N,
        Limit.DISPLACEMENT: pull.displacement / plan.machine.largest_displacement_mm,
        Limit.STRETCH: (pull.stretches[-1] - 1) / (plan.sheet.largest_stretch - 1),
        Limit.FIELD: pull.view.field / plan.camera.largest_field_mm,
    }
    assert met[ends] == pytest.approx(0.99, abs=0.011)
    assert max(met.values()) <= 1.001


@pytest.mark.parametrize(
    ("table", "limits", "says"),
    [("machine", {"axes": 1}, "the machine has one"), ("sheet", {"least_ligament_mm": 25.0}, "narrowest ligament"),
     ("camera", {"largest_field_mm": 150.0}, "does not fit")],
)  # fmt: skip
def test_what_cannot_be_tested_is_named(table, limits, says):
    plan = checked({**COARSE, "specimen": [{"kind": "cross"}], table: limits}, "plan")
    with pytest.raises(DesignError, match=says):
        limited_pull(plan.specimen[0].read(), MooneyRivlin(), plan)


def test_points_and_correlated_noise():
    points = quadrant_points(Strip(half_length=10.0, half_width=5.0), 1.0)
    assert len(points) == 50
    assert correlated_neighbours(View(100.0, 0.1, 0.01, 1.0)) == pytest.approx(1.0)
    assert correlated_neighbours(View(100.0, 0.1, 5.0, 1.0)) == pytest.approx(2 * np.pi * 25, rel=1e-9)


def ranking_of(shares):
    """A ranking of made-up candidates whose tests tell every direction alike, the smaller the share the better."""
    family = family_of(PLAN)
    precision = np.linalg.inv(family.prior @ family.prior.T)
    made = [
        Candidate(name, Strip(), test=Information(precision * (1 / share**2 - 1), family.prior))
        for name, share in shares.items()
    ]
    return rank(made, family)


def test_ranking_and_verdict():
    ranking = ranking_of({"poor": 0.5, "best": 0.01, "good": 0.1})
    assert [p.candidate.title for p in ranking.places] == ["best", "good", "poor"]
    assert [p.test.overall / ranking.before.overall for p in ranking.places] == pytest.approx([0.01, 0.1, 0.5])
    assert [p.test.worst for p in ranking.places] == pytest.approx([0.01, 0.1, 0.5])
    errors = [
        ActualError(title, seed, dict.fromkeys(ranking.family.stretches, value))
        for seed in (0, 1)
        for title, value in (("best", 0.1), ("good", 0.2), ("poor", 0.3 if seed == 0 else 0.15))
    ]
    found = correlations(ranking, errors)
    assert found["test"] == pytest.approx([1.0, 0.5])
    verdicts = {
        (0.9, 0.7): Verdict.PREDICTS,
        (0.9, -0.1, 0.9): Verdict.SAYS_SOMETHING,
        (0.4,): Verdict.SAYS_SOMETHING,
        (0.2,): Verdict.DOES_NOT,
    }
    for values, verdict in verdicts.items():
        assert Validation({}, errors, {"test": list(values)}).verdict == verdict


def test_the_truth_has_no_error():
    law = MooneyRivlin()
    family = family_of(PLAN)
    true = LawFamily(law, family.stretches)
    errors = stress_errors(lambda mode, stretch: 1.02 * true.stress(mode), law, family)
    assert list(errors.values()) == pytest.approx([0.02] * 3)


def test_the_usual_plan_is_kept_and_replaces_an_earlier_one_whole(tmp_path, monkeypatch):
    """Who still reads the earlier file reads all of it."""

    def stop(*given):
        raise DesignError("stopped")

    monkeypatch.setattr(design_command, "judge_all", stop)
    plan, earlier = tmp_path / "design" / "plan.toml", tmp_path / "earlier.toml"
    for _ in range(2):
        with pytest.raises(DesignError, match="stopped"):
            design_command.design(output=tmp_path / "design")
        assert plan.read_bytes() == design_command.default_file().read_bytes()
        plan.write_text("of an earlier version")
        earlier.unlink(missing_ok=True)
        earlier.hardlink_to(plan)
    with pytest.raises(DesignError, match="stopped"):
        design_command.design(output=tmp_path / "design")
    assert earlier.read_text() == "of an earlier version"


SEARCH = {"kind": "strip", "between": {"half_length": [40.0, 80.0], "half_width": [5.0, 20.0]}, "evaluations": 60}


class TestSearch:
    @pytest.fixture
    def scored(self, monkeypatch):
        """Evaluations that were not read from a file; the score is a paraboloid, infinite for wide strips."""
        made = []

        def evaluate(self, values):
            made.append(values)
            x, y = values["half_length"], values["half_width"]
            score = np.inf if y > 15 else 0.1 + ((x - 55) / 40) ** 2 + ((y - 8) / 15) ** 2
            return Evaluation(values, score, "too wide" if y > 15 else "")

        monkeypatch.setattr(pattern_search._Score, "evaluate", evaluate)
        return made

    def test_finds_a_minimum_and_resumes(self, scored, tmp_path):
        plan = checked({**COARSE, "specimen": [{"kind": "UT"}], "optimise": SEARCH}, "plan")
        first = search(plan, [], tmp_path)
        assert first.best.values == pytest.approx({"half_length": 55.0, "half_width": 8.0}, abs=0.6)
        assert first.specimen.half_length == first.best.values["half_length"]
        count = len(scored)
        assert count <= 60
        assert len(first.evaluations) == count
        again = search(plan, [], tmp_path)
        assert len(scored) == count
        assert again.best == first.best

    def test_nothing_keeps_the_limits(self, monkeypatch, tmp_path):
        monkeypatch.setattr(
            pattern_search._Score, "evaluate", lambda self, values: Evaluation(values, np.inf, "too wide")
        )
        plan = checked({**COARSE, "specimen": [{"kind": "UT"}], "optimise": {**SEARCH, "evaluations": 4}}, "plan")
        with pytest.raises(DesignError, match="keeps the limits; the last: too wide"):
            search(plan, [], tmp_path)

    def test_a_place_that_is_not_there(self, tmp_path):
        table = {"kind": "UT", "between": {"perforation.0.y": [1.0, 2.0]}, "evaluations": 2}
        plan = checked({**COARSE, "specimen": [{"kind": "UT"}], "optimise": table}, "plan")
        with pytest.raises(DesignError, match="no such place"):
            search(plan, [], tmp_path)


def test_equations_and_test_tell_alike():
    """Plate with a hole: what the equations of a calibration tell is what the test tells, within a factor of three of the deviation."""
    plan = checked({**COARSE, "size_factor": 2.0, "specimen": [{"kind": "plate_with_hole"}]}, "plan")
    found = judge("plate", plan.specimen[0].read(), plan)
    family = family_of(plan)
    assert found.test is not None and found.equations is not None, found.reason
    test, equations = (Criteria.of(information, family) for information in (found.test, found.equations))
    for mode in family.stretches:
        assert 1 / 3 < equations.deviation[mode] / test.deviation[mode] < 3


def test_a_test_counts_where_the_equations_of_a_calibration_fail(monkeypatch, tmp_path):
    def fail(pull, family, plan):
        raise FitError("no equations")

    monkeypatch.setattr(candidates, "equation_information", fail)
    found = judge("UT", PLAN.specimen[0].read(), PLAN)
    assert found.equations is None and found.reason == "no equations"
    (place,) = rank([found], family_of(PLAN)).places
    alone = judge("UT", PLAN.specimen[0].read(), PLAN, equations=False)
    assert place.test == rank([alone], family_of(PLAN)).places[0].test
    file = tmp_path / "family.toml"
    file.write_text(
        "size_factor = 4.0\ncamera = { pictures = 2, points = 500 }\nlaw = { knots = 8 }\n"
        '[[specimen]]\nkind = "UT"\ntested = true\n'
        '[optimise]\nkind = "UT"\nevaluations = 2\nbetween = { half_width = [8.0, 12.0] }\n'
    )
    assert main(["design", str(file), "-o", str(tmp_path / "design")]) == 0
    results = json.loads((tmp_path / "design" / "design.json").read_text())["results"]
    assert results["candidates"] == []
    assert results["optimised"]["reason"] == "no equations"
    assert results["optimised"]["test"]["overall"] < results["before"]["overall"]


def test_a_specimen_that_was_tested_on_another_machine_counts():
    """What this one cannot pull was pulled elsewhere."""
    plan = checked(
        {**COARSE, "specimen": [{"kind": "cross", "tested": True}], "machine": {"axes": 1}, "sheet": {"least_ligament_mm": 25.0}},
        "plan",
    )  # fmt: skip
    specimen, family = plan.specimen[0].read(), family_of(plan)
    new, tested = (judge("cross", specimen, plan, tested=one, equations=False) for one in (False, True))
    assert new.test is None
    assert rank([tested], family).before.overall < rank([new], family).before.overall


def test_command(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(
        candidates,
        "equation_information",
        lambda pull, family, plan: Information(np.zeros(family.prior.shape), family.prior),
    )
    file = tmp_path / "family.toml"
    file.write_text(
        "size_factor = 4.0\ncamera = { pictures = 2, points = 500 }\nlaw = { knots = 8 }\nmachine = { axes = 1 }\n"
        '[[specimen]]\nkind = "UT"\n[[specimen]]\nkind = "PS"\ntested = true\n[[specimen]]\nkind = "cross"\n'
    )
    folder = tmp_path / "design"
    assert main(["design", str(file), "-o", str(folder)]) == 0
    assert "Cut UT" in capsys.readouterr().out
    results = json.loads((folder / "design.json").read_text())["results"]
    assert [c["title"] for c in results["candidates"]] == ["UT"]
    assert results["candidates"][0]["test"]["overall"] < results["before"]["overall"]
    assert "has one" in results["refused"][0]["reason"]
    assert (folder / "drawings" / "UT.dxf").exists()
    for picture in folder.glob("*.png"):
        assert picture.with_suffix(".json").exists()
    assert main(["design", str(file), "-o", str(folder)]) == 0  # goes through what is there
