"""The table of classical laws beside the network: a `Review` in, columns and rows, and a record for the manifest, out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.fitting.calibration import relative_force_error
from calibrate.fitting.classical_fit import Candidate, ClassicalFit, Comparison
from studies.output.words import plus_minus
from studies.reports.calibration.fit_review import Review

Mask = NDArray[np.bool_]
UNKNOWN = 10.0  # standard deviations over a parameter, from which it is not identified


def classical_table(view: Review, found: Comparison) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows: the network, then every law."""
    columns = [
        "law",
        "parameters",
        "values",
        "chi-square less the network's",
        "BIC less the network's",
        "force error, %",
        "held-out force error, %",
        "stable",
    ]
    rows = []
    for candidate in (found.network, *found.laws):
        held = force_error(view, candidate, ~view.fitted)
        fit = candidate.fit
        rows.append([
            candidate.name, f"{candidate.numbers:.3g}", "" if fit is None else values(fit, view.model.unit, found.scale),
            f"{candidate.chi_square:+.4g}", f"{candidate.criterion:+.4g}", _share(force_error(view, candidate, view.fitted)),
            "none held out" if held is None and view.fitted.all() else _share(held), "yes" if fit is None else _state(fit),
        ])  # fmt: skip
    return columns, rows


def curve_laws(found: Comparison, unit: str) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows for curves of homogeneous tests, which have no forces: the network, then every law."""
    rows = []
    for c in (found.network, *found.laws):
        text, state = ("", "yes") if c.fit is None else (values(c.fit, unit, found.scale), _state(c.fit))
        rows.append([c.name, f"{c.numbers:.3g}", text, f"{c.chi_square:+.4g}", f"{c.criterion:+.4g}", state])
    return ["law", "parameters", "values", "chi-square less the network's", "BIC less the network's", "stable"], rows


def curve_laws_record(found: Comparison, unit: str) -> dict[str, Any]:
    """Everything in the table of curves, for a manifest."""
    laws = [_law_record(c, c.fit, found.scale) for c in found.laws if c.fit is not None]
    return _head(found, unit) | {"laws": laws}


def terminal_lines(found: Comparison | None, unit: str) -> Iterator[str]:
    """Laws with their BIC and values, the best first, for a terminal; nothing where none was fitted."""
    for c in sorted(found.laws if found else (), key=lambda c: c.criterion):
        assert found is not None
        assert c.fit is not None
        state = "" if c.fit.reason.is_success else f", {_state(c.fit)}"
        yield f"  {c.name}: {values(c.fit, unit, found.scale)}; BIC {c.criterion:+.1f}{state}"


def classical_record(view: Review) -> dict[str, Any] | None:
    """Everything in the table, for a manifest; None where nothing was fitted."""
    found = view.classical
    if found is None:
        return None
    laws = [_record(view, c, c.fit, found.scale) for c in found.laws if c.fit is not None]
    return _head(found, view.model.unit) | {"laws": laws}


def _head(found: Comparison, unit: str) -> dict[str, Any]:
    return {
        "verdict": str(found.verdict),
        "equations": found.equations,
        "scale": found.scale,
        "unit": unit,
        "effective_parameters_of_the_network": found.network.numbers,
    }


def _record(view: Review, candidate: Candidate, fit: ClassicalFit, scale: float) -> dict[str, Any]:
    errors = {
        "force_error": force_error(view, candidate, view.fitted),
        "held_out_force_error": force_error(view, candidate, ~view.fitted),
    }
    return _law_record(candidate, fit, scale) | errors


def _law_record(candidate: Candidate, fit: ClassicalFit, scale: float) -> dict[str, Any]:
    limits = zip(fit.values.items(), fit.deviations(scale), strict=True)
    return {
        "law": candidate.name,
        "parameters": {name: {"value": _finite(x), "standard_deviation": _finite(d)} for (name, x), d in limits},
        "chi_square_difference": candidate.chi_square,
        "bic_difference": candidate.criterion,
        "stability": fit.stability,
        "reason": str(fit.reason),
    }


def force_error(view: Review, candidate: Candidate, increments: Mask) -> float | None:
    """Relative force error over some increments; None where there are none, or no force is met."""
    if not increments.any() or view.model.level_is_nominal:
        return None
    if candidate.fit is None:
        return view.force_error(increments)
    loads = view.system.loads[:, np.tile(view.system.fields.boundary >= 0, 2)]
    return relative_force_error({"all": view.classical_forces[candidate.name][increments]}, {"all": loads[increments]})


def values(fit: ClassicalFit, unit: str, scale: float) -> str:
    """'mu = 0.270 +- 0.010 MPa, N = 21.0 +- 2.0'; that a parameter is not identified, where its deviation is larger than itself by far."""
    parts, unknown = [], []
    for p, (name, x), d in zip(fit.law.parameters, fit.values.items(), fit.deviations(scale), strict=True):
        if not np.isfinite(x):
            parts.append(f"{name} not seen")
        else:
            unknown += [name] if d > UNKNOWN * abs(x) else []
            known = f"{x:.4g}" if d > UNKNOWN * abs(x) else plus_minus(x, d)
            parts.append(f"{name} = {known}{' ' + unit if p.modulus else ''}")
    return ", ".join(parts) + (f" ({' and '.join(unknown)} not identified)" if unknown else "")


def _state(fit: ClassicalFit) -> str:
    if not fit.reason.is_success:
        return f"did not converge ({fit.reason})"
    return "yes" if fit.stability > 0 else "no"


def _share(error: float | None) -> str:
    return "not known" if error is None else f"{100 * error:.3g}"


def _finite(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None
