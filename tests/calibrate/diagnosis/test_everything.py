"""All effects at once: what is there comes out within its prior; what is in no catalogue stays a discrepancy."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from discoveries import C01, few, nothing, sheet

from calibrate.data.experiment import Experiment
from calibrate.diagnosis import base_fit, score_tests
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.evidence.priors import Prior, read_priors
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.joint import discrepancy, everything
from calibrate.diagnosis.joint.everything import fit_everything, simple_base
from calibrate.diagnosis.joint.shares import FAR, Everything
from calibrate.diagnosis.score_tests import Status
from calibrate.diagnosis.selection import Verdict
from calibrate.effects import CATALOGUE
from calibrate.errors import FitError
from studies.sheets.homogeneous import homogeneous_experiments
from studies.sheets.homogeneous.homogeneous_experiments import curve

BY_NAME = {effect.name: effect for effect in CATALOGUE}
KNOWN = ("second invariant", "upturn", "lens distortion", "stiffness gradient")
PHI = 0.01


@cache
def turned() -> Experiment:
    """A Mooney-Rivlin plate seen by a camera that is turned by PHI: places and displacements turn, forces do not."""
    R = np.array([[np.cos(PHI), -np.sin(PHI)], [np.sin(PHI), np.cos(PHI)]])
    e = sheet()
    return replace(e, points=e.points @ R.T, displacements=e.displacements @ R.T)


@cache
def fitted(*names: str) -> Everything:
    problem, _ = base_fit.prepare([turned()], [HoldOut("every", 3).training])
    return fit_everything(problem, [BY_NAME[name] for name in names], read_priors())


def test_the_covariance_is_that_of_noise_and_discrepancy() -> None:
    """|whitened|^2 = r^T (1 + v D D^T)^-1 r."""
    problem, base = base_fit.prepare([sheet()], [HoldOut("every", 3).training])
    D = discrepancy.directions(problem)
    r = base.residual
    np.testing.assert_allclose(D.T @ D, np.eye(D.shape[1]), atol=1e-10)
    r = np.where(np.arange(len(r)) < base.n_rows, r, 0.0)  # the rows of the prior are not of the test
    values = [part.residual(base.c) for part in problem.trained]
    whitened = discrepancy.with_discrepancy(problem, D, 7.0).whiten(values)
    expected = r @ np.linalg.solve(np.eye(len(r)) + 7.0 * D @ D.T, r)
    assert whitened @ whitened == pytest.approx(expected, rel=1e-10)


def test_the_variance_of_a_discrepancy_is_estimated_without_bias() -> None:
    rng = np.random.default_rng(0)
    D = np.linalg.qr(rng.normal(size=(400, 72)))[0]
    draws = [rng.normal(size=400) + D @ rng.normal(0.0, 2.0, 72) for _ in range(2000)]
    found = [discrepancy.variance_of(draw, D) for draw in draws]
    assert np.mean(found) == pytest.approx(4.0, rel=0.03)
    (noise,) = rng.normal(size=(1, 400))
    assert discrepancy.variance_of(noise - D @ (D.T @ noise), D) == 0.0


def test_what_is_there_is_needed_and_plausible() -> None:
    found = fitted(*KNOWN, "image rotation")
    shares = {one.effect.name: one for one in found.shares}
    for name, true in (("second invariant", C01), ("image rotation", PHI)):
        one = shares[name]
        assert one.is_seen
        assert not one.is_far
        assert abs(one.amplitudes[0] - true) < 3 * one.deviations[0]
    assert not any(one.is_seen for name, one in shares.items() if name in ("lens distortion", "stiffness gradient"))
    assert found.fit.converged
    assert found.dispersion < 1.25
    assert found.predicts


def test_what_is_in_no_catalogue_is_left_to_the_discrepancy() -> None:
    """The rotation left out: it is not made of implausible amplitudes, and the second invariant stays what it is."""
    whole, lacking = fitted(*KNOWN, "image rotation"), fitted(*KNOWN)
    assert lacking.variance > 3 * (1 + whole.variance)
    assert not any(one.is_far for one in lacking.shares)
    assert lacking.before[1] is not None
    assert lacking.predicts


def test_a_simple_base_is_neo_hooke() -> None:
    problem, _ = base_fit.prepare([sheet()], [HoldOut("every", 3).training])
    one = simple_base(problem)
    x = one.basis.site_inputs
    psi = one.cone[:, 0] @ np.linalg.pinv(one.basis.interpolation).T
    assert one.cone.shape[1] == 1
    assert np.ptp(psi.reshape(len(x), -1)[:, one.basis.k]) < 1e-9


def test_only_tests_that_are_not_explained_get_a_fit_of_all_effects() -> None:
    assert nothing().everything is None
    effects = tuple(e for e in few() if e.name != "second invariant")
    found = discover([turned()], HoldOut("every", 3), effects=effects)
    assert (found.everything is not None) == (found.verdict is Verdict.NOT_EXPLAINED)
    assert found.everything is not None


def test_no_offset_where_forces_count_from_the_reference() -> None:
    for zeroed, status in ((True, Status.EXCLUDED), (False, Status.TESTED)):
        e = replace(sheet(), provenance={"zeroed": zeroed})
        problem, base = base_fit.prepare([e], [HoldOut("every", 3).training])
        (score,) = score_tests.score(problem, base, [BY_NAME["force offset"]])
        assert score.status is status


def test_a_fit_that_fails_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise FitError("no finite start")

    monkeypatch.setattr(everything.joint_fit, "fit", fails)
    effects = tuple(e for e in few() if e.name != "second invariant")
    found = discover([turned()], HoldOut("every", 3), effects=effects)
    assert found.everything is None
    assert found.without_everything == "no finite start"


def sceptical(*names: str) -> dict[str, Prior]:
    """Priors that hold some effects for nearly impossible."""
    return {**read_priors(), **{name: Prior(1e-3, "", "") for name in names}}


def test_no_plausible_effect_goes_beyond_its_limit() -> None:
    """A rotation that its prior holds for nearly impossible ends at three of its standard deviations, which is better than without it."""
    problem, _ = base_fit.prepare([turned()], [HoldOut("every", 3).training])
    found = fit_everything(problem, [BY_NAME[name] for name in (*KNOWN, "image rotation")], sceptical("image rotation"))
    (far,) = (one for one in found.shares if one.is_far)
    assert far.effect.name == "image rotation"
    assert found.plausible is not None
    shares = {one.effect.name: one for one in found.plausible.shares}
    assert set(shares) == {*KNOWN, "image rotation"}
    assert not any(one.is_far for one in shares.values())
    assert shares["image rotation"].over_prior == pytest.approx(FAR, rel=1e-6)
    assert [name for name, one in shares.items() if one.is_at_limit] == ["image rotation"]
    assert np.sign(shares["image rotation"].amplitudes) == np.sign(far.amplitudes)
    assert found.plausible.fit.objective > found.fit.objective
    lacking = fitted(*KNOWN)
    assert found.plausible.fit.objective < lacking.fit.objective + FAR**2


def test_a_warp_of_the_reference_is_found_among_plausible_effects_alone() -> None:
    """A sheet that regains strains of up to 0.2 % along the pull; without limits the warp is none of the effects."""
    warp, true = BY_NAME["initial warp"], turned()
    a = np.zeros(len(warp.amplitudes))
    a[[p.name for p in warp.amplitudes].index("a2")] = 0.002
    seen = true.points
    for _ in range(20):
        seen = seen + true.points - np.asarray(warp.places(None, seen, a, ()))
    test = replace(true, points=seen, displacements=true.points + true.displacements - seen)
    problem, _ = base_fit.prepare([test], [HoldOut("every", 3).training])
    found = fit_everything(
        problem, [BY_NAME[n] for n in (*KNOWN, "image rotation", "initial warp")], sceptical("image rotation")
    )
    assert "initial warp" not in {one.effect.name for one in found.shares}
    assert found.plausible is not None
    share = next(one for one in found.plausible.shares if one.effect.name == "initial warp")
    assert not share.is_far and not share.is_at_limit
    np.testing.assert_array_less(np.abs(np.array(share.amplitudes) - a), 4 * np.array(share.deviations) + 1e-4)
    k = int(a.argmax())
    assert share.largest == k and share.amplitudes[k] > 3 * share.deviations[k]


def test_where_all_is_plausible_there_is_no_second_fit() -> None:
    assert fitted(*KNOWN, "image rotation").plausible is None


def test_a_homogeneous_test_has_no_fields_that_could_be_wrong() -> None:
    """All its equations are of forces, so that neither a smooth discrepancy of the fields nor a variance of their own is left."""
    stretches = np.linspace(1.05, 1.6, 12)
    stress = 0.4 * (stretches - stretches**-2) * (1 + 0.1 * np.sin(9 * stretches))
    noise = homogeneous_experiments.noise(0.002, 1e-4)
    problem, base = base_fit.prepare(
        [curve("wavy", "uniaxial", stretches, stress, noise)], [HoldOut("every", 3).training]
    )
    assert discrepancy.directions(problem).shape[1] == 0
    assert discrepancy.field_variance(problem, base.c) == 1.0
    found = fit_everything(problem, [BY_NAME[name] for name in ("second invariant", "upturn")], read_priors())
    assert found.variance == 0.0 and found.field_variance == 1.0
    assert found.after[0].force <= found.before[0].force
