"""Blind trials: fixed by their seed, silent about what they hide, and labelled in the convention of the catalogue."""

import json
from dataclasses import astuple, replace

import numpy as np
import pytest

from calibrate.data.experiment import Experiment
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition, Chain
from calibrate.equations.basis import SingleBasis
from calibrate.equations.equilibrium import equilibrium, neo_hooke
from forward.sheet.additions import Fibres, Gradient, MooneyPart, Mullins, Patch, Payne
from forward.sheet.damage_and_dispersion import SquircularInclusion
from forward.sheet.thin_sheet import PermanentSet, Prony
from studies.errors import OptionError
from studies.trials import blind_solution
from studies.trials.blind_data import HISTORIES, RAMP, draw, label, make, write
from studies.trials.blind_effects import BIAXIAL, CONFOUNDED, EFFECTS, FREQUENT, SOLID, UNLOADING
from studies.trials.blind_solution import SPECIMENS, clean_experiment, sheet

PLATES = [seed for seed in range(60) if draw(seed, None).specimen == "plate"]


@pytest.fixture
def coarse(monkeypatch):
    """Few quads, so that a trial takes a tenth of a second."""
    sizes = {name: {"hole_size": 1.5, "far_size": 4.0} for name in ("plate", "wide plate")}
    monkeypatch.setattr(blind_solution, "SIZES", {**blind_solution.SIZES, **sizes})
    blind_solution.forward_mesh.cache_clear()
    yield
    blind_solution.forward_mesh.cache_clear()


def plate(effect, second=None, **conditions):
    """The first trial on the small plate with an effect; on the cross with one of two axes."""
    specimen = "cross" if BIAXIAL in (effect, second) else "plate"
    seed = next(s for s in range(100) if draw(s, effect, second).specimen == specimen)
    return replace(draw(seed, effect, second), **conditions)


ABSORBED = ("upturn",)  # by the splines of the base, so that there is nothing to find
HIDEABLE = [effect for effect in CATALOGUE if effect.name not in ABSORBED and effect.beside is None]


def test_every_effect_of_the_catalogue_can_be_hidden():
    assert set(EFFECTS) == {effect.name for effect in HIDEABLE}
    assert set(CONFOUNDED) == {effect.name for effect in CATALOGUE if effect.confounded_with}


@pytest.mark.parametrize("effect", HIDEABLE, ids=[effect.name for effect in HIDEABLE])
def test_labels_speak_the_language_of_the_catalogue(effect):
    """Names of amplitudes and shapes; what is drawn is physically admissible."""
    for seed in range(5):
        hidden = label(draw(seed, effect.name))["effects"][0]
        assert hidden["name"] == effect.name
        shapes = effect.shapes if effect.shapes_vary else ()
        for parameters, values in ((effect.amplitudes, hidden["amplitudes"]), (shapes, hidden["shape"])):
            assert [p.name for p in parameters] == list(values)
            assert all(p.lower <= values[p.name] <= p.upper for p in parameters)


def test_a_trial_is_fixed_by_its_seed():
    for name in (None, *EFFECTS):
        assert draw(3, name) == draw(3, name) != draw(4, name)


def test_conditions_do_not_depend_on_the_effect():
    """Specimen, material, stretch and noise of a seed are the same whatever is hidden; what two axes have is hidden in a cross."""
    plain = draw(11, None)
    for name in EFFECTS:
        trial = draw(11, name)
        for key in ("specimen", "material", "stretch", "displacement_std", "correlation_length", "force_relative"):
            expected = "cross" if (name, key) == (BIAXIAL, "specimen") else getattr(plain, key)
            assert getattr(trial, key) == expected


def test_random_trials_hide_all_but_the_confounded():
    found = {draw(seed).effects[0].name for seed in range(300)}
    assert found == set(FREQUENT)


def test_conditions_span_what_is_asked():
    trials = [draw(seed, None) for seed in range(200)]
    assert {t.specimen for t in trials} == set(SPECIMENS)
    assert {len(t.factors) for t in trials} == {10, 12}
    assert 0.2 < np.mean([t.factors != RAMP for t in trials]) < 0.4
    assert all(1.2 <= t.stretch <= 1.6 and 1 <= t.times[-1] <= 60 for t in trials)
    extent = np.array([2 * max(SPECIMENS[t.specimen].half_extent) for t in trials])
    std = np.array([t.displacement_std for t in trials]) / extent
    assert std.min() < 3e-5 and std.max() > 1.5e-4 and std.min() >= 2e-5 and std.max() <= 2e-4
    for name in UNLOADING:
        assert draw(0, name).factors in HISTORIES


def test_times_follow_the_path_of_the_grips():
    trial = draw(0, "Mullins softening")
    rate = np.abs(np.diff(trial.factors, prepend=0)) / np.diff(trial.times, prepend=0)
    np.testing.assert_allclose(rate, rate[0])


def test_a_null_trial(coarse):
    """Declared noise is the noise there is; nothing else is recorded."""
    trial = draw(PLATES[0], None)
    experiment, sealed = make(trial)
    clean = clean_experiment(trial)
    noise = experiment.displacements - clean.displacements
    assert noise.std() == pytest.approx(experiment.noise.displacement_std, rel=0.1)
    assert sealed["effects"] == []
    assert experiment.thickness == trial.thickness
    np.testing.assert_array_equal(experiment.time, trial.times)
    error = [m.force - c.force for m, c in zip(experiment.loaded, clean.loaded, strict=True)]
    std = [np.hypot(experiment.noise.force_std_relative * np.abs(c.force), experiment.noise.force_std)
           for c in clean.loaded]  # fmt: skip
    assert np.std(np.array(error) / np.array(std)) == pytest.approx(1, rel=0.35)
    total = sum(b.force for b in clean.loaded)
    np.testing.assert_allclose(total, 0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("specimen", SPECIMENS)
def test_forces_are_converged(specimen):
    """Within 0.05 % at the largest stretch, on quads of two thirds of the size."""
    seed = next(s for s in range(100) if draw(s, None).specimen == specimen)
    trial = replace(draw(seed, None), stretch=1.6)
    forces = [np.array([b.force for b in clean_experiment(trial, size).loaded]) for size in (1.0, 0.66)]
    assert np.abs(forces[0] - forces[1]).max() < 5e-4 * np.abs(forces[1]).max()


@pytest.mark.parametrize("name", [n for n in EFFECTS if n != SOLID])
def test_an_effect_changes_the_recording_and_is_not_named(coarse, name):
    """A strong one changes displacements or forces of the null trial, whose noise it shares."""
    trial = plate(name)
    experiment, sealed = make(trial)
    null = clean_experiment(replace(trial, effects=()))
    clean = clean_experiment(trial)
    assert sealed["effects"][0]["name"] == name
    assert name not in json.dumps(experiment.provenance) and experiment.name == f"blind {trial.seed}"
    changed = np.abs(clean.displacements - null.displacements).max() / np.abs(null.displacements).max()
    forces = np.array([[b.force for b in one.loaded] for one in (clean, null)])
    force = np.abs(forces[0] - forces[1]).max() / np.abs(forces[1]).max()
    assert 1e-6 < changed + force < 0.8
    assert experiment.triangles.shape == null.triangles.shape


def test_thickness_is_solved_in_3d(coarse):
    """A sheet of 4 mm by the hole: the surface differs from plane stress by per cents, the forces less."""
    seed = next(s for s in range(100) if draw(s, SOLID).specimen == "plate")
    trial = draw(seed, SOLID)
    hidden = replace(trial.effects[0], amplitudes={"b": 16 / 12}, more={"thickness": 4.0})
    trial = replace(trial, thickness=4.0, effects=(hidden,), stretch=1.3)
    solid, plane = clean_experiment(trial), clean_experiment(replace(trial, effects=()))
    np.testing.assert_array_equal(solid.time, trial.times)
    change = np.abs(solid.displacements - plane.displacements).max() / np.abs(plane.displacements).max()
    assert 1e-3 < change < 0.1
    force = [e.loaded[1].force[-1, 0] for e in (solid, plane)]
    assert force[0] == pytest.approx(force[1], rel=0.05)
    assert len(solid.displacements) == 10


def flat(values):
    return np.concatenate([np.ravel(value) for value in values])


def ellipse(height, s):
    e = np.hypot(s["e1"], s["e2"])
    long, short = (60.0 * s["radius"] * np.exp(sign * e) for sign in (1, -1))
    return SquircularInclusion(
        height,
        60.0 * s["x"],
        60.0 * s["y"],
        long,
        short,
        (angle := np.arctan2(s["e2"], s["e1"]) / 2 % np.pi),
        1 - (1 - np.hypot(s["q1"], s["q2"]) / 3) ** 3,
        np.arctan2(s["q2"], s["q1"]) / 4 - angle,
    )


def test_sheets_take_the_drawn_numbers():
    """Each effect of the material arrives in the sheet with amplitude and shape."""
    expected = {
        "second invariant": lambda a, s, m: MooneyPart(a["c01"]),
        "one fibre family": lambda a, s, m: Fibres(a["k"], (s["angle"],), s["k2"], s["kappa"]),
        "two fibre families": lambda a, s, m: Fibres(
            a["k"], (s["axis"] + s["half"], s["axis"] - s["half"]), s["k2"], s["kappa"]
        ),
        "stiffness gradient": lambda a, s, m: Gradient(a["gx"], a["gy"], 60.0),
        "stiffness field": lambda a, s, m: Patch(m["height"], m["x"], m["y"], m["width"]),
        "inclusion": lambda a, s, m: ellipse(a["a"], s),
        "Mullins softening": lambda a, s, m: Mullins(a["r"], s["m"], s["beta"]),
        "Payne softening": lambda a, s, m: Payne(a["r"], s["x0"]),
    }
    for name, make_addition in expected.items():
        trial = plate(name)
        hidden = trial.effects[0]
        (found,), expected_addition = (
            sheet(trial).additions,
            make_addition(hidden.amplitudes, hidden.shape, hidden.more),
        )
        assert type(found) is type(expected_addition)
        assert flat(astuple(found)) == pytest.approx(flat(astuple(expected_addition)), rel=1e-12)
    trial = plate("compressibility")
    assert sheet(trial).bulk_modulus == pytest.approx(1 / trial.effects[0].amplitudes["beta"])
    trial = plate("permanent set")
    assert sheet(trial).permanent_set == PermanentSet(trial.effects[0].amplitudes["a"])
    trial = plate("viscoelasticity")
    assert sheet(trial).prony == (Prony(trial.effects[0].amplitudes["g"], trial.effects[0].shape["tau"]),)


def test_two_effects(coarse):
    """The stress of the one and the offset of the other: forces differ by the offset, displacements do not."""
    trial = plate("Mullins softening", "force offset")
    assert [hidden.name for hidden in trial.effects] == ["Mullins softening", "force offset"]
    both, one = clean_experiment(trial), clean_experiment(replace(trial, effects=trial.effects[:1]))
    np.testing.assert_allclose(both.displacements, one.displacements)
    step = np.linalg.norm(both.loaded[0].force - one.loaded[0].force, axis=1)
    np.testing.assert_allclose(step, abs(trial.effects[1].amplitudes["f0"]))


@pytest.mark.parametrize(
    ("names", "words"),
    [(("wear",), "unknown"), (("compressibility", "compressibility"), "twice"), ((SOLID, "Mullins softening"), "3D")],
)
def test_impossible_combinations(names, words):
    with pytest.raises(OptionError, match=words):
        draw(0, *names)


def test_files(coarse, tmp_path):
    trial = plate("one fibre family")
    write(trial, tmp_path / "trial")
    assert {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.*")} == {
        "trial/experiment.npz", "trial/sealed/label.json",
    }  # fmt: skip
    sealed = json.loads((tmp_path / "trial/sealed/label.json").read_text())
    assert sealed["effects"][0]["amplitudes"] == trial.effects[0].amplitudes
    experiment = Experiment.load(tmp_path / "trial/experiment.npz")
    np.testing.assert_array_equal(experiment.displacements, make(trial)[0].displacements)
    assert "fibre" not in json.dumps(experiment.provenance)


def test_a_warp_in_the_words_of_the_catalogue(coarse):
    """The stress with the amplitudes of the label is that of the flat sheet, but for waves that are too short."""
    trial = plate("initial warp", seed=0)
    hidden = replace(trial.effects[0], more={"axis": 0, "slope": 0.08, "place": 4.0, "width": 20.0})
    trial = replace(trial, effects=(hidden,))
    warped, flat = clean_experiment(trial), clean_experiment(replace(trial, effects=()))
    effect = next(e for e in CATALOGUE if e.name == "initial warp")
    amplitudes = label(trial)["effects"][0]["amplitudes"]
    addition = Addition(effect, tuple(amplitudes[p.name] for p in effect.amplitudes))
    basis = SingleBasis(0, 3.0, 8)
    c = neo_hooke(basis, 0.3)
    right, wrong, mended = (
        Chain(equilibrium(e, 8.0), basis).residual(c, additions)
        for e, additions in ((flat, ()), (warped, ()), (warped, (addition,)))
    )
    assert np.linalg.norm(mended - right) < 0.2 * np.linalg.norm(wrong - right)
