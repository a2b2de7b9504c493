"""`equigap predict`: uniaxial, equi-biaxial and pure-shear curves of a calibrated model.

In: a model file. Out: a table of nominal stress against stretch with 95 % bands where the model file holds an uncertainty,
a figure with the calibrated range marked, a report and a manifest.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.commands.options import add_output, count, output_folder, settings
from studies.errors import OptionError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calibrate.models.network_model import Model

DESCRIPTION = """\
Predict the nominal stress (force over reference area) of the three homogeneous tests at a sheet's stretches:
uniaxial, equi-biaxial and pure shear. In MPa, or in N/mm (stress times thickness) where the thickness of the
calibrated sheet was unknown. What lies beyond the calibrated range is marked: there the model extrapolates.
The table gives the standard deviation and a 95 % band of each stress.
With --test: the forces of another test instead, from its measured displacements; also for extended models of `discover`."""
MARGIN, NO_RANGE, LARGEST = 1.25, 2.0, 20.0
COLUMNS = ("mode", "stretch", "nominal_stress", "I1", "I2", "calibrated")
BAND_COLUMNS = ("standard_deviation", "low_95", "high_95")


@dataclass(frozen=True)
class Curve:
    """A homogeneous test: stretch (k,), nominal stress (k,), invariants (k, 2), calibrated (k,), truth (k,) or None.

    limit: largest stretch within the calibrated range. deviation (k,): standard deviation of the stress, None where the
    model file holds no uncertainty.
    """

    mode: str
    stretch: NDArray[np.float64]
    stress: NDArray[np.float64]
    invariants: NDArray[np.float64]
    calibrated: NDArray[np.bool_]
    limit: float
    truth: NDArray[np.float64] | None = None
    deviation: NDArray[np.float64] | None = None

    @property
    def band(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Lower and upper end (k,) of the 95 % band of the stress, or None."""
        from calibrate.fitting.uncertainty import BAND

        if self.deviation is None:
            return None
        return self.stress - BAND * self.deviation, self.stress + BAND * self.deviation

    @property
    def extrapolates(self) -> bool:
        """Whether the curve leaves the calibrated range."""
        return not self.calibrated.all()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `equigap predict`."""
    parser.add_argument(
        "model", type=Path, metavar="MODEL.json", help="model file of `equigap calibrate` or `discover`"
    )
    parser.add_argument(
        "--test", type=Path, metavar="EXPERIMENT.npz", help="predict the forces of this test instead of curves"
    )
    parser.add_argument(
        "--stretch", type=_stretch, metavar="X", help="largest stretch (default: a quarter beyond the calibrated range)"
    )
    parser.add_argument("--points", type=count, default=101, metavar="N", help="stretches a curve (%(default)s)")
    parser.add_argument(
        "--against", metavar="MATERIAL",
        help="draw a known material beside it: arruda_boyce, neo_hooke, mooney_rivlin, yeoh (as `simulate`)",
    )  # fmt: skip
    parser.add_argument(
        "--parameter", action="append", default=[], metavar="NAME=VALUE", help="of that material, such as mu=0.3"
    )
    add_output(parser, "predict")


def main(args: argparse.Namespace) -> int:
    """Write table, figure, report and manifest. Raises `ModelFileError`, `OptionError`, `OutputFolderError`."""
    from calibrate.models.network_model import Model
    from studies.output import Manifest, open_output_folder, write_csv

    if args.parameter and not args.against:
        raise OptionError("--parameter belongs to --against MATERIAL; name the material")
    if args.test is not None:
        from studies.reports.another_test import main as predict_test

        if args.against or args.stretch:
            raise OptionError("--against and --stretch belong to curves; leave them out where --test is given")
        return predict_test(args)
    model = Model.load(args.model)
    manifest = Manifest(settings=settings(args, "model"), inputs=[args.model])
    key = {**settings(args, "model"), "model": list(manifest.to_dict()["inputs"].values())}
    curves = predict(model, args.stretch, args.points, _truth(args))
    folder = open_output_folder(output_folder(args, "predict"), args.overwrite, key)
    table, picture = folder / "curves.csv", folder / "curves.png"
    columns, rows = _table(curves, model.unit)
    note = f"nominal stress in {model.unit}; calibrated: 1 within the range of the data, 0 where it extrapolates"
    write_csv(table, columns, rows, [" ".join([note + ".", *band_remarks(model)])])
    draw(curves, model, picture, args.against)
    manifest.beside(picture, table, unit=model.unit, calibrated_stretch={c.mode: c.limit for c in curves})
    for line in [*map(range_remark, curves), *band_remarks(model)]:
        print(f"- {line}")
    print(f"curves: {table}\nreport: {_report(folder, model, curves, manifest)}")
    return 0


def predict(model: Model, stretch: float | None = None, points: int = 101, truth: Any = None) -> list[Curve]:
    """Curves of the three modes up to `stretch`, or a quarter beyond what was calibrated.

    truth: d psi / d(I1, I2) (..., 2) of a known material as a function of invariants (..., 2).
    """
    import numpy as np

    from calibrate.equations.deformation_modes import MODES, mode_invariants, nominal_stress

    curves = []
    for mode in MODES:
        limit = calibrated_stretch(model, mode)
        top = stretch or (1 + MARGIN * (limit - 1) if 1 < limit < LARGEST else NO_RANGE)
        x = np.linspace(1.0, top, max(points, 2))
        invariants = mode_invariants(mode, x)
        curves.append(Curve(
            mode, x, model.homogeneous(mode, x), invariants, x <= limit, limit,
            None if truth is None else nominal_stress(truth, mode, x), model.homogeneous_deviation(mode, x),
        ))  # fmt: skip
    return curves


def calibrated_stretch(model: Model, mode: str) -> float:
    """Largest stretch of a mode within the calibrated range; `LARGEST` where the model states none."""
    return min(model.largest_stretch(mode), LARGEST)


def range_remark(curve: Curve) -> str:
    """Where a curve leaves the calibrated range."""
    name, top = curve.mode.replace("_", " "), float(curve.stretch[-1])
    if curve.limit >= LARGEST:
        return f"{name}: the model file states no calibrated range; whether the curve extrapolates is unknown."
    if not curve.extrapolates:
        return f"{name}: within the calibrated range up to its end, a stretch of {top:.3g}."
    return (
        f"{name}: leaves the calibrated range at a stretch of {curve.limit:.3g}; from there to {top:.3g} the model "
        "extrapolates, and the band does not cover what an unseen upturn would do."
    )


def band_remarks(model: Model) -> list[str]:
    """What the bands hold."""
    if model.uncertainty is None:
        return ["The model file holds no uncertainty, so no bands are given; `equigap calibrate` stores one."]
    return [model.uncertainty.meaning()]


def draw(curves: list[Curve], model: Model, path: Path, against: str | None = None) -> None:
    """One panel a mode: solid where calibrated, thin beyond; the known material as a dotted line."""
    from calibrate.equations.deformation_modes import MODES
    from studies.output import style, write_figure

    with style.figure(9.0, 3.3) as figure:
        for axes, curve in zip(figure.subplots(1, 3), curves, strict=True):
            colour = style.MODES[curve.mode]["color"]
            x, stress, inside = curve.stretch, curve.stress, curve.calibrated
            style.mark_range(axes, 1.0, min(curve.limit, float(x[-1])))
            if curve.band is not None:
                axes.fill_between(x, *curve.band, color=colour, alpha=0.25, linewidth=0, label="95 % band")
            axes.plot(
                x, stress, linestyle="--", linewidth=0.9, color=colour, label=None if inside.all() else "extrapolated"
            )
            axes.plot(x[inside], stress[inside], linestyle="-", linewidth=2, color=colour, label="model")
            if curve.truth is not None:
                axes.plot(x, curve.truth, linestyle=":", color="black", label=str(against).replace("_", "-"))
            axes.set(title=MODES[curve.mode].title, xlabel="stretch", xlim=(1.0, x[-1]), ylim=(0, None))
            axes.legend(loc="upper left")
        figure.axes[0].set_ylabel(f"nominal stress, {model.unit}")
        write_figure(path, figure)


def _stretch(text: str) -> float:
    value = float(text)
    if not 1 < value <= LARGEST:
        raise argparse.ArgumentTypeError(f"'{text}' must be a stretch above 1 and at most {LARGEST:g}")
    return value


def _truth(args: argparse.Namespace) -> Any:
    """d psi / d(I1, I2) of the material to compare with, or None."""
    if args.against is None:
        return None
    import jax
    import jax.numpy as jnp

    from studies.commands.simulate import read_material

    material = read_material(args.against, args.parameter)
    slope = jax.vmap(jax.grad(lambda invariants: jnp.asarray(material.energy(invariants[0], invariants[1]))))
    return lambda invariants: slope(jnp.asarray(invariants))


def _table(curves: list[Curve], unit: str) -> tuple[list[str], list[list[Any]]]:
    columns = [f"nominal_stress_{unit}" if name == "nominal_stress" else name for name in COLUMNS]
    columns += [f"{name}_{unit}" for name in BAND_COLUMNS] if curves[0].band is not None else []
    columns += ["compared"] if curves[0].truth is not None else []
    rows: list[list[Any]] = []
    for c in curves:
        parts = [c.stretch, c.stress, *c.invariants.T, c.calibrated.astype(int)]
        parts += [] if c.band is None or c.deviation is None else [c.deviation, *c.band]
        parts += [] if c.truth is None else [c.truth]
        rows += [[c.mode, *(value.item() for value in row)] for row in zip(*parts, strict=True)]
    return columns, rows


def _report(folder: Path, model: Model, curves: list[Curve], manifest: Any) -> Path:
    from studies.output.report import Report

    layers = ", ".join(map(str, model.architecture.layers))
    report = Report("Predicted homogeneous tests", f"PANN of {model.architecture.inputs}, layers ({layers})")
    if model.unit == "N/mm":
        report.paragraph("The thickness of the sheet was unknown: stresses are stress times thickness, in N/mm.")
    caption = "Nominal stress; shaded: stretches within the calibrated range of invariants; dashed: extrapolated."
    report.figure(folder / "curves.png", caption + ("" if model.uncertainty is None else " Bands: 95 %."))
    rows = [[c.mode.replace("_", " "), c.limit if c.limit < LARGEST else None, _at(c, c.limit), _deviation_at(c, c.limit),
             "yes" if c.extrapolates else "no", _at(c, c.stretch[-1]), _deviation_at(c, c.stretch[-1])]
            for c in curves]  # fmt: skip
    columns = ("mode", "calibrated to stretch", f"stress there, {model.unit}", "its standard deviation",
               "curve leaves the range", f"stress at its end, {model.unit}", "its standard deviation")  # fmt: skip
    report.table(columns, rows, "A dash: the model file states no calibrated range, or no uncertainty.")
    for line in [*map(range_remark, curves), *band_remarks(model)]:
        report.paragraph(line)
    report.details(
        "Calibrated range", {k: f"{low:.4g} to {high:.4g}" for k, (low, high) in model.calibrated_range.items()}
    )
    report.details("Versions", manifest.to_dict()["versions"])
    return report.save(folder / "report.html")


def _deviation_at(curve: Curve, stretch: float) -> float | None:
    """Standard deviation of the stress at a stretch; None beyond the curve or where it is unknown."""
    import numpy as np

    if curve.deviation is None or stretch > curve.stretch[-1]:
        return None
    return float(np.interp(stretch, curve.stretch, curve.deviation))


def _at(curve: Curve, stretch: float) -> float | None:
    """Stress at a stretch, by interpolation; None beyond the curve."""
    import numpy as np

    return float(np.interp(stretch, curve.stretch, curve.stress)) if stretch <= curve.stretch[-1] else None
