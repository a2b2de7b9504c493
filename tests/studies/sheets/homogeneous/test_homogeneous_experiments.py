"""Homogeneous tests as Experiments: one exact equation for every stress that was measured, and the measured data."""

import numpy as np
import pytest

from calibrate import errors
from calibrate.data import load_path
from calibrate.data.experiment import Experiment
from calibrate.effects import SecondInvariant, Viscosity
from calibrate.effects.chain import Chain
from calibrate.equations import reduction
from calibrate.equations.basis import basis_for
from calibrate.equations.equilibrium import best_shear_modulus, equilibrium, neo_hooke
from calibrate.equations.virtual_fields import virtual_fields
from calibrate.fitting.calibration import Options, calibrate
from calibrate.fitting.network_fit import convex_spline
from studies import cli
from studies.importers import measured_data
from studies.sheets.homogeneous import homogeneous_experiments as tests
from studies.sheets.homogeneous import homogeneous_loops, homogeneous_sheet

MU = 0.4
STRETCH = np.array([0.8, 0.9, 1.2, 1.6, 2.1, 3.0])
# nominal stress of neo-Hooke, mu (stretch - stretch^-n)
POWER = {"uniaxial": 2, "pure_shear": 3, "equibiaxial": 5}


def neo_hookean(mode, **options):
    return tests.curve("made up", mode, STRETCH, MU * (STRETCH - STRETCH ** -POWER[mode]), **options)


@pytest.fixture
def table(tmp_path, monkeypatch):
    """Write one data file below an empty data folder."""
    monkeypatch.setenv(measured_data.VARIABLE, str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def write(relative, text):
        path = tmp_path / relative
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("mode", POWER)
@pytest.mark.parametrize("spacing", [None, 30.0])
def test_neo_hooke_gives_its_modulus_exactly(mode, spacing):
    """mu (l - l^-n) has the modulus mu whatever the grid of the virtual fields."""
    modulus, correlation = best_shear_modulus(equilibrium(neo_hookean(mode), spacing))
    assert modulus == pytest.approx(MU, rel=1e-10)
    assert correlation == pytest.approx(1, abs=1e-12)


def basis():
    return basis_for("I1", np.array([np.diag([3.5, 3.5])]))


@pytest.mark.parametrize(("mode", "rows"), [("uniaxial", 1), ("pure_shear", 1), ("equibiaxial", 2)])
def test_every_measured_stress_is_one_equation(mode, rows):
    """No equation but force = stress x 10 mm^2: nothing inside, nothing counted twice."""
    system = equilibrium(neo_hookean(mode))
    assert (system.fields.boundary >= 0).all()
    known = np.isfinite(system.loads)
    assert (known.sum(axis=1) == rows).all()
    stress = MU * (STRETCH - STRETCH ** -POWER[mode])
    np.testing.assert_allclose(system.loads[known].reshape(-1, rows), 10 * stress[:, None].repeat(rows, axis=1))
    predicted = np.array([system.matrix(basis(), F) @ neo_hooke(basis(), MU) for F in system.deformation_gradients])
    np.testing.assert_allclose(predicted[known], system.loads[known], rtol=1e-10)


def test_the_deformation_is_that_of_the_mode():
    for mode in POWER:
        F = equilibrium(neo_hookean(mode)).deformation_gradients
        lateral = {"uniaxial": STRETCH**-0.5, "pure_shear": np.ones(6), "equibiaxial": STRETCH}[mode]
        np.testing.assert_allclose(F[..., 0, 0], STRETCH[:, None].repeat(F.shape[1], axis=1), rtol=1e-12)
        np.testing.assert_allclose(F[..., 1, 1], lateral[:, None].repeat(F.shape[1], axis=1), rtol=1e-12)
        np.testing.assert_allclose(F[..., [0, 1], [1, 0]], 0, atol=1e-12)


def test_pure_shear_leaves_the_lateral_force_open():
    experiment = neo_hookean("pure_shear")
    names = [b.name for b in experiment.loaded]
    assert names == ["left", "right", "bottom", "top"]
    assert np.isnan(experiment.loaded[3].force).all()
    assert np.isfinite(experiment.loaded[1].force[:, 0]).all()
    assert np.isnan(homogeneous_sheet.stresses(experiment)[:, 1]).all()


def test_a_strip_pulled_along_y_is_the_same_test():
    along, across = (neo_hookean("uniaxial", axis=a) for a in "xy")
    np.testing.assert_allclose(homogeneous_sheet.stretches(across)[:, ::-1], homogeneous_sheet.stretches(along))
    np.testing.assert_allclose(homogeneous_sheet.stresses(across)[:, 1], homogeneous_sheet.stresses(along)[:, 0])
    assert best_shear_modulus(equilibrium(across))[0] == pytest.approx(MU, rel=1e-10)


@pytest.mark.parametrize("mode", POWER)
def test_force_noise_is_the_variance_of_an_equation(mode):
    """With next to no displacement noise the whitened modulus has the variance of least squares; equi-biaxial tension
    counts one reading once although it has two forces."""
    std = 0.03
    experiment = neo_hookean(mode, uncertainty=tests.noise(std, 1e-9))
    assembled = reduction.assemble(equilibrium(experiment), basis())
    quadratic = assembled.quadratic(assembled.weights(neo_hooke(basis(), MU)))
    c = neo_hooke(basis(), 1.0)
    information = np.sum((STRETCH - STRETCH ** -POWER[mode]) ** 2) / std**2
    assert c @ quadratic.Q @ c == pytest.approx(information, rel=1e-6)


def test_stretch_noise_is_the_slope_times_its_deviation(monkeypatch):
    """In a strip an error of stretch moves the force by d stress / d stretch x 10 mm^2, at constant lateral stretch, and
    an independent lateral error by its own slope: the whole is the norm of the two."""
    monkeypatch.setattr(load_path, "LINE", 0.0)  # in every increment, none is interpolated
    experiment = neo_hookean("uniaxial", uncertainty=tests.noise(0.0, 0.01))
    system = equilibrium(experiment)
    assembled = reduction.assemble(system, basis())
    c = neo_hooke(basis(), MU)
    load = assembled.weighted_equations(assembled.weights(c))[1].reshape(len(STRETCH), -1)[:, 0]
    for white, x, force in zip(load, STRETCH, system.loads[:, 1], strict=True):
        y = x**-0.5
        along, across = 1 + 3 / (x**4 * y**2), 2 / (x**3 * y**3)  # of P = mu (x - 1 / (x^3 y^2))
        assert abs(force / white) == pytest.approx(10 * MU * 0.01 * np.hypot(along, across), rel=1e-6)


def test_the_chain_agrees_and_has_signatures():
    time = np.linspace(1.0, 6.0, 6)
    system = equilibrium(neo_hookean("uniaxial", time=time))
    c = neo_hooke(basis(), 0.3)
    chain = Chain(system, basis())
    known = np.isfinite(system.loads)
    expected = np.array([system.matrix(basis(), F) @ c for F in system.deformation_gradients]) - system.loads
    np.testing.assert_allclose(np.asarray(chain.residual(c))[known], expected[known], atol=1e-12)
    # dP / dc01 in uniaxial tension is that of Mooney-Rivlin, 2 (1 - l^-3)
    second = chain.signature(c, SecondInvariant(), ())[0][known]
    np.testing.assert_allclose(second, 20 * (1 - STRETCH**-3.0), rtol=1e-9)
    assert np.isfinite(chain.signature(c, Viscosity(), (2.0,))[0][known]).all()


def test_the_spline_fit_finds_neo_hooke():
    """From the noise-weighted loss alone, force error far below the noise."""
    system = equilibrium(neo_hookean("pure_shear", uncertainty=tests.noise(1e-3, 1e-4)))
    assembled = reduction.assemble(system, basis())
    assert assembled.noise_is_known
    c = convex_spline(assembled.quadratic(assembled.weights(assembled.first_guess())), "I1")
    known = np.isfinite(system.loads)
    predicted = np.array([system.matrix(basis(), F) @ c for F in system.deformation_gradients])
    np.testing.assert_allclose(predicted[known], system.loads[known], rtol=1e-5)


@pytest.mark.slow
def test_the_whole_calibration_runs():
    experiment = neo_hookean("uniaxial", uncertainty=tests.noise(1e-3, 1e-4))
    result = calibrate(experiment, Options(layers=(2,), starts=2))
    assert result.summary()["relative_force_error"] < 2e-3


def test_rest_is_left_out_and_kept_when_it_carries_stress():
    stretch = np.array([1.0, 1.5, 1.2, 1.0, 1.4])
    experiment = tests.curve("cycle", "uniaxial", stretch, np.array([0.0, 0.3, 0.1, -0.05, 0.2]), tests.noise(0.1, 0.1))
    np.testing.assert_allclose(homogeneous_sheet.stretches(experiment)[:, 0], stretch[1:])
    assert homogeneous_sheet.stresses(experiment)[2, 0] == pytest.approx(-0.05)


@pytest.mark.parametrize(("stretch", "mode", "error"), [
    ([1.1, -1.2, 1.3, 1.4, 1.5], "uniaxial", errors.InvalidDeformationError),
    ([1.1, 1.2, 1.3, 1.4, 1.5], "torsion", errors.ConfigError),
])  # fmt: skip
def test_impossible_curves_are_named(stretch, mode, error):
    with pytest.raises(error):
        tests.curve("made up", mode, np.array(stretch), np.ones(5))


def test_units_are_checked():
    with pytest.raises(errors.UnitsError, match="force"):
        tests.curve("in Pa", "uniaxial", STRETCH, 1e6 * (STRETCH - STRETCH**-2), tests.noise(0.1, 0.1))


def test_scatter_is_the_standard_deviation_about_a_smooth_curve():
    rng = np.random.default_rng(0)
    x = np.linspace(1, 5, 4000)
    assert tests.scatter(x, np.sin(x) + 0.02 * rng.standard_normal(x.size)) == pytest.approx(0.02, rel=0.05)
    assert tests.scatter(x, x**3) < 1e-10
    residuals = homogeneous_sheet.local_residuals(x, rng.standard_normal(x.size), 5, 2)
    assert np.std(residuals) == pytest.approx(1, rel=0.05)


def test_thinning_keeps_the_ends_and_the_reversals():
    time = np.linspace(0, 10, 1001)
    stretch = 1 + np.abs(((time + 2.5) % 5) - 2.5) / 2.5
    chosen = homogeneous_sheet.evenly(time, stretch, stretch**2, 60)
    assert len(chosen) <= 60
    assert {0, 250, 500, 750, 1000} <= set(chosen.tolist())


def test_no_free_and_no_inner_node_leaves_the_loaded_boundaries():
    fields = virtual_fields(neo_hookean("uniaxial"), 1.0)
    np.testing.assert_array_equal(fields.boundary, [0, 1])
    np.testing.assert_allclose(fields.values.toarray().sum(axis=1), 1)


def test_two_transcriptions_give_their_difference_as_noise(table):
    """The second table has stresses 3 % larger and stretches 0.02 larger: sqrt 2 times the deviation of either."""
    x = np.linspace(1.1, 3.0, 12)
    y = MU * (x - x**-2)
    table("dammass_kalina_treloar_brain/treloarData/treloar_0.csv", rows([1.0, *x], [0.0, *y], ","))
    for k, short in enumerate(("ET", "PS"), 1):
        table(f"dammass_kalina_treloar_brain/treloarData/treloar_{k}.csv", rows(x, y, ","))
        table(f"chongran_zhao_homogeneous/Treloar_1944/{short}/stress_stretch.txt", rows(y, x, " "))
    table("chongran_zhao_homogeneous/Treloar_1944/UT/stress_stretch.txt", rows(1.03 * y, x + 0.02, " "))
    stretch, stress = tests.transcription("uniaxial")
    assert stretch == pytest.approx(1.4826 * 0.02 / np.sqrt(2))
    assert stress == pytest.approx(1.4826 * 0.03 / np.sqrt(2))
    noise = tests.treloar("uniaxial", "treloar-b").noise
    assert (noise.displacement_std, noise.force_std_relative) == pytest.approx((10 * stretch, stress))
    loop = {loop.name: loop for loop in homogeneous_loops.treloar_loops()}["treloar-second-invariant"]
    seen = [homogeneous_sheet.stretches(e)[:, 0] for e in (loop.training[1], loop.held_out[0])]
    np.testing.assert_allclose(np.sort(np.concatenate(seen)), x)


def rows(first, second, delimiter):
    return "".join(f"{a:.9f}{delimiter}{b:.9f}\n" for a, b in zip(first, second, strict=True))


def test_biaxial_points_are_split_by_their_number(table):
    """Neo-Hooke at three stretches 1 with six stretches 2 each, of which the first has a free edge."""
    lines = ["lambda1,lambda2,P1_MPa,P2_MPa"]
    for x in (1.5, 2.0, 2.5):
        for y in np.linspace(x**-0.5, x, 6):
            p1, p2 = MU * (x - 1 / (x**3 * y**2)), MU * (y - 1 / (y**3 * x**2))
            lines.append(f"{x},{y:.12f},{p1:.12f},{max(p2, 0) if p2 > 1e-9 else 0.0:.12f}")
    table("kawabata_jl/kawabata1981_biaxial.csv", "\n".join(lines) + "\n")
    everything, training, held_out = (tests.kawabata_biaxial(s) for s in tests.SPLITS)
    assert (everything.n_increments, training.n_increments, held_out.n_increments) == (18, 9, 9)
    both = [{tuple(x) for x in homogeneous_sheet.stretches(e).round(9)} for e in (training, held_out)]
    assert not both[0] & both[1]
    assert np.isnan(homogeneous_sheet.stresses(everything)[:, 1]).sum() == 3
    assert np.isfinite(homogeneous_sheet.stresses(held_out)).all()
    assert best_shear_modulus(equilibrium(everything))[0] == pytest.approx(MU, rel=1e-9)
    I1 = [np.sum(x**2) + np.prod(x) ** -2.0 for x in homogeneous_sheet.stretches(everything)]
    assert (np.diff(I1) > -1e-9).all(), "a table of states must not look like unloading"


def test_hnbr50_records_become_increments(table):
    """Columns stress, force, strain in %, strain, time, length; two rows at one time are averaged."""
    strain = np.concatenate([np.linspace(0, 100, 150), np.linspace(99, 20, 120)])
    time = 60.0 * np.arange(strain.size) / strain.size
    time[11] = time[10]
    stress = MU * ((1 + strain / 100) - (1 + strain / 100) ** -2.0)
    text = "# Messlaenge: 15.000\n" + "".join(
        f"{p:.6f}\t{170 * p:.6f}\t{e:.6f}\t{e:.6f}\t{t:.6f}\t260\n"
        for p, e, t in zip(stress, strain, time, strict=True)
    )
    table("miehe_goktepe_hnbr50/Fig7_CM+SG05_visco2_2.dat", text)
    experiment = tests.hnbr50("fast", increments=80)
    assert experiment.n_increments <= 80
    assert (np.diff(experiment.time) > 0).all()
    assert experiment.time[0] > 0
    stretch = homogeneous_sheet.stretches(experiment)[:, 0]
    assert stretch.max() == pytest.approx(2.0)
    assert stretch[-1] == pytest.approx(1.2)
    assert best_shear_modulus(equilibrium(experiment))[0] == pytest.approx(MU, rel=1e-3)
    with pytest.raises(errors.DataNotFoundError, match="visco1"):
        tests.hnbr50("slow")


def test_a_record_of_straight_lines_needs_no_more_points_than_their_ends():
    """A ramp and a hold, in steps that are exact in binary."""
    time = np.arange(200.0)
    stretch = 1 + np.minimum(time, 128) / 128
    chosen = homogeneous_sheet.evenly(time, stretch, stretch - 1, 120)
    assert len(chosen) <= 120 and {0, 128, 199} <= set(chosen)
    np.testing.assert_array_equal(np.interp(time, time[chosen], stretch[chosen]), stretch)


@pytest.mark.parametrize(("delimiter", "comma"), [(";", True), (";", False), ("\t", False)])
def test_a_file_may_have_other_delimiters_and_decimal_commas(tmp_path, delimiter, comma):
    x = np.linspace(1.1, 2, 9)
    rows = [delimiter.join(f"{value:.9f}" for value in row) for row in zip(x, MU * (x - x**-2), strict=True)]
    text = "\n".join(rows).replace(".", "," if comma else ".")
    (tmp_path / "pull.csv").write_text(f"stretch{delimiter}stress\n{text}\n")
    pull = tests.from_file(tmp_path / "pull.csv")
    assert best_shear_modulus(equilibrium(pull))[0] == pytest.approx(MU, rel=1e-7)


def test_files_of_both_forms(tmp_path):
    (tmp_path / "pull.csv").write_text(
        "time,stretch,stress\n" + "".join(f"{i},{x},{MU * (x - x**-2)}\n" for i, x in enumerate(np.linspace(1, 2, 9)))
    )
    pull = tests.from_file(tmp_path / "pull.csv")
    np.testing.assert_allclose(pull.time, np.arange(1, 9))
    assert best_shear_modulus(equilibrium(pull))[0] == pytest.approx(MU, rel=1e-9)
    (tmp_path / "biaxial.csv").write_text("lambda1,lambda2,P1_MPa,P2_MPa\n1.5,1.2,0.3,0.2\n1.8,1.2,0.5,\n")
    biaxial = tests.from_file(tmp_path / "biaxial.csv")
    np.testing.assert_allclose(homogeneous_sheet.stresses(biaxial), [[0.3, 0.2], [0.5, np.nan]])
    rows = "".join(f"{x},{0.5 - x}\n" for x in np.linspace(1.1, 2, 9))
    for name, text, error in (
        ("turned", f"stretch,stress\n{rows}", errors.ForceSignError),
        ("short", "stretch,stress\n" + rows.replace("1.1,", "-1.1,"), errors.InvalidDeformationError),
    ):
        (tmp_path / f"{name}.csv").write_text(text)
        with pytest.raises(error, match=f"{name}.csv: "):
            tests.from_file(tmp_path / f"{name}.csv")
    (tmp_path / "wrong.csv").write_text("stretch,force\n1.5,0.3\n")
    with pytest.raises(errors.FileFormatError, match="stress"):
        tests.from_file(tmp_path / "wrong.csv")


def test_the_command_writes_an_experiment(tmp_path):
    source = tmp_path / "pull.csv"
    source.write_text("stretch,stress\n" + "".join(f"{x},{MU * (x - x**-2)}\n" for x in np.linspace(1.1, 2, 9)))
    assert cli.main(["homogeneous", str(source), "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "report.html").read_text().count("<img") == 1
    written = Experiment.load(tmp_path / "out" / "experiment.npz")
    assert best_shear_modulus(equilibrium(written))[0] == pytest.approx(MU, rel=1e-9)
    assert cli.main(["homogeneous", "no-such-test", "-o", str(tmp_path / "other")]) == 2
