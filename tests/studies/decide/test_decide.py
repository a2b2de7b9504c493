"""What would decide: expected evidence beside that of tests that are made, pairs of a diagnosis, programmes, files, and what is refused."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calibrate import errors
from calibrate.data.experiment import Experiment, Noise
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.evidence.linear_evidence import Evidence, Signature
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.evidence.signatures import evidence, modulus
from calibrate.diagnosis.problem import all_rows
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.effects.support.effect_data import Data
from calibrate.models.addition_json import addition_to_dict
from studies import cli
from studies.commands.design import completed
from studies.decide.expected_evidence import difference, expected
from studies.decide.programmes import Programme, loaded, recorded
from studies.decide.report import DECISIVE, Decision, SpecimenResult
from studies.decide.rivals import Rivals, read
from studies.design.pulls_within_limits import limited_pull

BY_NAME = {effect.name: effect for effect in CATALOGUE}
RELAXATION, LAG, MULLINS, TURN = "viscoelasticity", "lag between force and image", "Mullins softening", "image rotation"
OFFSET = "force offset"
RECEDES, RECEDED = "out-of-plane motion", 0.0015
STD, FORCE = 0.02, 2e-3  # mm; relative
PLAN = """
[camera]
pictures = 4
points = 1500
[[specimen]]
kind = "plate_with_hole"
"""


@cache
def plate() -> Experiment:
    """A ramp of a plate with a hole, without noise; what is stated is uncorrelated."""
    plan = completed(None, True, None, None)
    table = next(s for s in completed(None, False, None, None).specimen if s.title == "plate_with_hole")
    e = recorded(limited_pull(table.read(), plan.law.read(), plan), plan)
    return replace(e, noise=Noise(STD, 0.0, FORCE))


def rivals(name: str, amplitudes: tuple[float, ...], other: str, shape: tuple[float, ...] = ()) -> Rivals:
    return Rivals((Addition(BY_NAME[name], amplitudes, shape),), (other,), None)


def value(e: Experiment, pair: Rivals, stiffness: float = 1.0) -> float:
    (found,) = expected(e, [pair], stiffness, read_priors())
    assert found is not None
    return found


def realised(seed: int, hidden: Addition, other: str, noise: float = 1.0) -> float:
    """ln evidence of a hidden effect against another one, of the plate recorded with both the effect and noise, over what is stated."""
    e, rng = plate(), np.random.default_rng(seed)
    data = Data.of(e)
    moved = np.asarray(hidden.effect.displacements(data, data.u, hidden.amplitudes, hidden.shape))
    u = 2 * e.displacements - moved  # what is seen of the true displacements, to first order
    offset = hidden.amplitudes[0] if hidden.effect.name == OFFSET else 0.0
    read = 1 + noise * FORCE * rng.standard_normal(
        e.loaded[0].force.shape
    )  # by one load cell, as the forces of the plan are
    cells = tuple(replace(b, force=b.force * read + offset * np.sign(b.force)) for b in e.loaded)
    seen = replace(e, displacements=u + noise * STD * rng.standard_normal(u.shape), loaded=cells)
    weighed, clean = (weigh(one, (hidden.effect.name, other)) for one in (seen, e))
    weighed = replace(weighed, r=weighed.r - clean.r)  # the residual of a coarse mesh is no matter of this test
    singles = [(s.name, weighed.subset((i,)).log_evidence) for i, s in enumerate(weighed.signatures)]
    own, its = (max(value for name, value in singles if name == one) for one in (hidden.effect.name, other))
    return own - its


def weigh(e: Experiment, names: tuple[str, ...]) -> Evidence:
    problem, base = prepare([e], [all_rows])
    effects = [BY_NAME[name] for name in names]
    return evidence(problem, base, base.chains, effects, read_priors(), {})


@pytest.mark.parametrize(
    ("name", "amplitude", "other", "within"),
    [pytest.param(RECEDES, RECEDED, "lens distortion", 0.3, marks=pytest.mark.slow),
     pytest.param(RECEDES, RECEDED, "second invariant", 0.2, marks=pytest.mark.slow), (OFFSET, 1.0, "upturn", 0.1)],
)  # fmt: skip
def test_what_is_expected_is_what_tests_give(name, amplitude, other, within):
    """The noise of the strains blurs signatures: an out-of-plane motion is told less surely than expected."""
    hidden = Addition(BY_NAME[name], (amplitude,))
    found = value(plate(), Rivals((hidden,), (other,), None))
    given = [realised(seed, hidden, other) for seed in range(8)]
    assert found > DECISIVE
    assert abs(np.log(found / np.mean(given))) < within + 2 * np.std(given) / np.mean(given) / np.sqrt(len(given))


@pytest.mark.parametrize("many", [1, 15])
def test_noise_is_allowed_for_in_what_is_expected_against_many_amplitudes(many):
    """Mean of ln evidence over drawn noise; one amplitude is the truth, others could fit the noise as well."""
    rng = np.random.default_rng(0)
    columns = np.linalg.qr(rng.standard_normal((200, 1 + many + 4)))[0]
    truth, field = 3.0 * columns[:, :1], 10.0 * (columns[:, 1 : 1 + many] + 0.1 * columns[:, :1])
    signatures = tuple(
        Signature(name, (), S, 1.0, np.zeros(S.shape[1], bool)) for name, S in (("one", truth), ("many", field))
    )
    weighed = Evidence(signatures, -truth[:, 0], columns[:, 1 + many :], 0.0)
    noise = rng.standard_normal((125, 200))
    drawn = [
        [replace(weighed, r=weighed.r + sign * eps).subset((i,)).log_evidence for sign in (1, -1) for i in (0, 1)]
        for eps in noise
    ]
    each = np.array(drawn) @ [0.5, -0.5, 0.5, -0.5]
    scatter = each.std() / np.sqrt(len(each))
    assert difference(weighed, ("one",), ("many",)) == pytest.approx(each.mean(), abs=4 * scatter)


def test_without_noise_what_is_expected_is_what_a_test_gives():
    """But for what is not linear in the amplitude."""
    hidden = Addition(BY_NAME[RECEDES], (RECEDED,))
    found = value(plate(), Rivals((hidden,), ("lens distortion",), None))
    assert realised(0, hidden, "lens distortion", noise=0.0) == pytest.approx(found, rel=0.05)


def test_more_of_an_effect_is_told_more_surely_and_nothing_is_not():
    none, some, more = (value(plate(), rivals(RECEDES, (a,), "lens distortion")) for a in (0.0, RECEDED, 2 * RECEDED))
    assert abs(none) < DECISIVE < some
    assert more - none == pytest.approx(4 * (some - none), rel=0.2)


def test_amplitudes_follow_the_stiffness():
    """A second invariant of a share of the modulus is that share of another modulus."""
    problem, _ = prepare([plate()], [all_rows])
    here = modulus(problem)
    pairs = [rivals("second invariant", (0.1 * mu,), "upturn") for mu in (here, 3 * here)]
    assert value(plate(), pairs[1], 3 * here) == pytest.approx(value(plate(), pairs[0], here), rel=1e-6)


def test_a_pause_tells_relaxation_from_softening_and_the_way_back_more():
    pair = rivals(RELAXATION, (0.2,), MULLINS, (5.0,))
    ramp, hold, back = (value(loaded(plate(), one, 30.0), pair) for one in Programme)
    assert DECISIVE < 3 * ramp < hold
    assert 3 * hold < back


def test_programmes():
    e = plate()
    n = e.n_increments
    hold, back = (loaded(e, one, 8.0) for one in (Programme.HOLD, Programme.BACK))
    assert hold.time is not None and back.time is not None
    assert hold.time[n - 1] == back.time[n - 1] == 8.0
    assert hold.time[-1] == 16.0
    np.testing.assert_array_equal(hold.displacements[n:], np.repeat(e.displacements[-1:], len(hold.time) - n, axis=0))
    np.testing.assert_array_equal(back.displacements[n:], e.displacements[-2::-1])
    for one in (hold, back):
        assert (np.diff(one.time) > 0).all()


def test_what_a_test_cannot_show_is_left_open():
    """No time: no relaxation."""
    timeless = replace(plate(), time=None)
    assert expected(timeless, [rivals(RELAXATION, (0.2,), MULLINS, (5.0,))], 1.0, read_priors()) == [None]


def diagnosis(folder: Path, **changes) -> Path:
    """A discovery.json that leaves relaxation and lag open, and softening in the span of relaxation."""

    def explanation(effect, amplitudes, shape, probability, log_evidence):
        added = addition_to_dict(Addition(BY_NAME[effect], amplitudes, shape), (0.01,), "MPa")
        return {
            "effects": [effect],
            "not_in_catalogue": False,
            "probability": probability,
            "log_evidence": log_evidence,
            "fitted": True,
            "additions": [added],
        }

    explanations = [explanation(RELAXATION, (0.2,), (5.0,), 0.6, -10.0), explanation(LAG, (0.5,), (1.0,), 0.3, -11.0),
                    explanation(TURN, (0.01,), (), 0.01, -15.0)]  # fmt: skip
    content = {
        "format": "equigap-discovery", "version": 3, "verdict": "explained", "modulus": 0.4, "duration_s": 30.0,
        "evidence": {"fitted": True, "explanations": explanations, "not_in_catalogue": 0.0, "spanned_by": {RELAXATION: [MULLINS, "upturn with lens distortion"]}},
    } | changes  # fmt: skip
    (folder / "discovery.json").write_text(json.dumps(content))
    return folder


def test_pairs_of_a_diagnosis(tmp_path):
    found = read(diagnosis(tmp_path))
    assert [(one.names, one.others, one.now) for one in found.rivals] == [
        ((RELAXATION,), (LAG,), 1.0), ((RELAXATION,), (MULLINS,), None), ((LAG,), (RELAXATION,), -1.0),
    ]  # fmt: skip
    assert (found.modulus, found.duration) == (0.4, 30.0)


def test_no_effect_at_all_is_one_of_a_pair(tmp_path):
    nothing = {"effects": [], "not_in_catalogue": False, "probability": 0.4, "log_evidence": -10.5, "fitted": True, "additions": []}  # fmt: skip
    content = json.loads((diagnosis(tmp_path) / "discovery.json").read_text())["evidence"]
    relaxation = {**content["explanations"][0], "probability": 0.6}
    found = read(diagnosis(tmp_path, evidence={**content, "explanations": [relaxation, nothing], "spanned_by": {}}))
    assert [(one.text, one.now) for one in found.rivals] == [
        ("viscoelasticity against no effect", 0.5), ("no effect against viscoelasticity", -0.5),
    ]  # fmt: skip
    seen, unseen = expected(loaded(plate(), Programme.BACK, 30.0), found.rivals, 1.0, read_priors())
    assert seen is not None and unseen is not None
    assert seen > DECISIVE and seen > unseen > 0


def test_something_unknown_is_no_pair(tmp_path):
    found = read(
        diagnosis(tmp_path, evidence={"fitted": True, "explanations": [], "not_in_catalogue": 0.9, "spanned_by": {}})
    )
    assert not found.rivals
    assert found.unknown


@pytest.mark.parametrize(
    ("changes", "kind", "said"),
    [
        ({"format": "other"}, errors.FileFormatError, "run equigap discover again"),
        ({"modulus": None}, errors.FileFormatError, "run equigap discover again"),
        ({"evidence": None}, errors.ConfigError, "without --quick"),
    ],
)
def test_a_file_that_says_nothing_of_rivals_is_refused(tmp_path, changes, kind, said):
    with pytest.raises(kind, match=said):
        read(diagnosis(tmp_path, **changes))


def test_no_file_is_named(tmp_path):
    with pytest.raises(errors.DataNotFoundError, match="give the folder"):
        read(tmp_path)


def test_the_command_says_which_test_decides_and_resumes(tmp_path, capsys, monkeypatch):
    (tmp_path / "plan.toml").write_text(PLAN)
    diagnosis(tmp_path)
    monkeypatch.chdir(tmp_path)
    words = ["decide", "discovery.json", "plan.toml", "--quick", "-o", str(tmp_path / "out")]
    assert cli.main(words) == 0
    said = capsys.readouterr().out
    assert f"what {tmp_path.name} could not" in (tmp_path / "out" / "report.html").read_text()
    assert "W901" in said and "plate_with_hole, ramp and back" in said
    rows = list(csv.reader((tmp_path / "out" / "tests.csv").read_text().splitlines()))
    assert len(rows) == 1 + len(Programme)
    assert {"report.html", "report.json", "decision.json", "tests.png"} <= {
        p.name for p in (tmp_path / "out").iterdir()
    }
    kept = (tmp_path / "out" / "steps" / "plate_with_hole.json").stat().st_mtime_ns
    assert cli.main(words) == 0
    assert (tmp_path / "out" / "steps" / "plate_with_hole.json").stat().st_mtime_ns == kept


def test_nothing_open_and_nothing_possible_are_said(tmp_path, capsys):
    (tmp_path / "plan.toml").write_text(PLAN + "[sheet]\nleast_ligament_mm = 500.0\n")
    sure = diagnosis(tmp_path, verdict="nothing significant", evidence=None)
    assert cli.main(["decide", str(sure), "-o", str(tmp_path / "nothing")]) == 0
    assert "W903" in capsys.readouterr().out
    open_ = diagnosis(tmp_path)
    assert (
        cli.main(["decide", str(open_), str(tmp_path / "plan.toml"), "--quick", "-o", str(tmp_path / "refused")]) == 0
    )
    said = capsys.readouterr().out
    assert "W904" in said
    assert "no test that is possible shows it" in said


def test_a_test_that_cannot_show_a_pair_decides_nothing_of_it():
    """It tells least of that pair: another that tells something of all comes first."""
    one, other = SpecimenResult("a", {"ramp": [None, 50.0]}), SpecimenResult("b", {"ramp": [10.0, 10.0]})
    assert [test.specimen for test in Decision("", (), (one, other)).tests] == ["b", "a"]
