"""What the twin of a test leaves of its discretisation error: `python benchmarks/twin.py`.

In: nothing; the coarse cross of `equigap simulate --quick` and the specimens of the blind trials, solved on meshes of their own. Out:
`docs/results/twin.json`. The chi-square of the true material on noiseless displacements, with the weights of the noise alone: as it is; minus the
residual of a twin, whose law is the true one, neo-Hooke, the base that a diagnosis fits to noisy data, or that with the effects that are there, and
whose grips move as measured, noise included; the remainder is the root of the share that is left by the last. Also of straight triangles, of three points a triangle instead of one, and of a
finer mesh of the twin. Two tests hide an effect that the base of the twin lacks.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.data.triangulation import unique_edges
from calibrate.diagnosis import base_fit, twin, weighted_fit
from calibrate.diagnosis.problem import Part, all_rows
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition, Additions
from calibrate.equations import discretisation_error, kinematics, noise_covariance
from calibrate.equations.basis import SingleBasis
from calibrate.equations.equilibrium import Equilibrium
from calibrate.models.extended_model import ExtendedModel
from forward.loading import Loading
from forward.materials import ArrudaBoyce
from forward.materials.arruda_boyce import COEFFICIENTS
from forward.sheet import additions as laws
from forward.sheet.inelastic import solve_history
from forward.sheet.thin_sheet import Prony, Sheet
from meshes import Cross, Specimen, quads, triangles
from studies.replay.model_law import law_of
from studies.replay.replayed_experiment import replay
from studies.replay.twin_replay import replayed_test, twin_replay
from studies.synthetic import camera
from studies.trials.blind_trial import SPECIMENS

Array = NDArray[np.float64]
RESULTS = Path(__file__).parents[1] / "docs" / "results" / "twin.json"
INCREMENTS, SEED, FINER = 4, 0, 1000  # points of a test, below which its twin is made on a finer mesh, too
RUBBER = Sheet(ArrudaBoyce())
CORNERS = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6  # three points that are exact for squares
BY_NAME = {effect.name: effect for effect in CATALOGUE}
HEAD = [
    "test",
    "points",
    "straight triangles",
    "recovered",
    "three points",
    "minus the twin: true law",
    "neo-Hooke",
    "base",
    "whole model",
    "remainder",
    "rows",
]


@dataclass(frozen=True)
class Case:
    """A test: specimen, nodes of the camera, stretch, standard deviation of the noise over the extent, the sheet and its effects; of its
    own mesh."""

    name: str
    specimen: Specimen
    nodes: int
    stretch: float
    noise: float
    sheet: Sheet = RUBBER
    additions: Additions = ()
    size_factor: float = 1.0

    def solved(self) -> Experiment:
        """Without noise, but with that of the camera stated."""
        extent = max(self.specimen.half_extent)
        pull = Loading.clamped(self.specimen.loaded, (self.stretch - 1) * extent)
        steps = np.arange(1, INCREMENTS + 1)
        mesh = quads(self.specimen, size_factor=self.size_factor)
        solution = solve_history(mesh, self.sheet, pull, steps / INCREMENTS, steps.astype(float), substeps=3)
        seen = camera.observe(solution, triangles(self.specimen, n_nodes=self.nodes), name=self.name)
        return replace(seen, noise=Noise(self.noise * 2 * extent, 0.04 * extent, 1e-4))


CASES = (
    Case("cross", Cross(), 900, 1.6, 5e-4),
    Case("cross, second invariant", Cross(), 900, 1.6, 5e-4, Sheet(ArrudaBoyce(), 1.0, (laws.MooneyPart(0.06),)),
         (Addition(BY_NAME["second invariant"], (0.06,)),)),
    Case("cross, relaxation", Cross(), 900, 1.6, 5e-4, Sheet(ArrudaBoyce(), 1.0, prony=(Prony(0.5, 2.0),)),
         (Addition(BY_NAME["viscoelasticity"], (0.5,), (2.0,)),)),
    Case("plate of the trials", SPECIMENS["plate"], 1400, 1.4, 1e-4, size_factor=0.5),
    Case("wide plate of the trials", SPECIMENS["wide plate"], 1400, 1.4, 1e-4, size_factor=0.5),
    Case("cross of the trials", SPECIMENS["cross"], 1400, 1.4, 1e-4),
)  # fmt: skip


def true_coefficients(basis: SingleBasis, material: ArrudaBoyce) -> Array:
    """Coefficients (n,) of the law that the test was made with."""
    x, terms = basis.spline.sites, enumerate(COEFFICIENTS, 1)
    I1 = 3 + basis.top * x**2
    psi = sum(c * k * (I1 / material.N) ** (k - 1) for k, c in terms) * material.mu
    return np.linalg.solve(basis.spline.matrix(x), psi)


def three_points(system: Equilibrium, basis: SingleBasis, c: Array) -> Array:
    """Internal virtual work (t, 2 v), N, of the recovered quadratic displacements at three points a triangle."""
    points, corners = system.experiment.points, system.experiment.triangles
    middle, _ = discretisation_error.edge_operators(system)
    edges, number = unique_edges(corners)
    m, slopes = len(corners), kinematics.shape_gradients(points, corners)[0]
    linear = kinematics.gradient_operator(points, corners)
    total = np.zeros(system.loads.shape)
    for at in CORNERS:
        parts = [(2 * np.arange(m) + k, number[a], 4 * (at[a] * slopes[:, b, k] + at[b] * slopes[:, a, k]))
                 for a, b in ((0, 1), (1, 2), (2, 0)) for k in range(2)]  # fmt: skip
        rows, columns, values = (np.concatenate(one) for one in zip(*parts, strict=True))
        bend = sp.csr_array((values, (rows, columns)), shape=(2 * m, len(edges)))
        F = kinematics.deformation_gradients(sp.csr_array(linear + bend @ middle), system.experiment.displacements)
        total += np.array([system.matrix(basis, f) @ c for f in F]) / 3
    return total


def noisy(e: Experiment, seed: int) -> Experiment:
    """With noise of the displacements."""
    assert e.noise is not None
    factor = noise_covariance.noise_factor(e, e.noise)
    fields = noise_covariance.sample(factor, np.random.default_rng(seed), e.n_increments)
    return replace(e, displacements=e.displacements + fields)


def fitted_twins(e: Experiment, base: str, additions: Additions = ()) -> list[Array]:
    """Residual (t, 2 v), N, of the twin of a base that was fitted to a noisy test, and of that of a model with effects."""
    problem, fit, _ = twin.with_twins(*base_fit.prepare([e], [all_rows], base=base), twin_replay)
    found = [problem.parts[0].twin]
    if additions:
        _, fit = weighted_fit.fit_with_weights(problem, fit.c, additions)
        found.append(twin.with_own_twins(problem, fit)[0].parts[0].twin)
    return [one for one in found if one is not None]


def row(case: Case) -> dict[str, Any]:
    """Chi-squares of one test."""
    e = case.solved()
    problem, _ = base_fit.prepare([e], [all_rows], with_discrepancy=False)
    basis = replace(problem.basis, top=1.2 * problem.basis.top)
    assert isinstance(basis, SingleBasis) and isinstance(case.sheet.material, ArrudaBoyce)
    c = true_coefficients(basis, case.sheet.material)
    part = problem.parts[0]
    part = replace(part, chain=replace(part.chain, basis=basis))
    r = part.chain.residual(c, case.additions)
    chi = lambda values: float((part.train(values) ** 2).sum())  # noqa: E731
    found: dict[str, Any] = {"test": case.name, "points": len(e.points), "rows": part.train.size, "recovered": chi(r)}
    if not case.additions:
        loads = np.nan_to_num(part.system.loads)
        straight = replace(part.system, linear=True)
        work = np.array([straight.matrix(basis, F) @ c for F in straight.deformation_gradients])
        found |= {"straight": chi(work - loads), "three": chi(three_points(part.system, basis, c) - loads)}
        found |= _true_twins(part, basis, c, r)
        found["neo-Hooke"] = chi(r - fitted_twins(noisy(e, SEED), "neo-Hooke")[0])
    twins = fitted_twins(noisy(e, SEED), "positive", case.additions)
    found |= {name: chi(r - one) for name, one in zip(("base", "whole model"), twins, strict=False)}
    found["remainder"] = float(np.sqrt(found.get("whole model", found["base"]) / found["recovered"]))
    return found


def _true_twins(part: Part, basis: SingleBasis, c: Array, r: Array) -> dict[str, float]:
    """Of twins of the true law, moved without noise: as a diagnosis makes them, finer, and with three points."""
    e = part.experiment
    model = ExtendedModel(basis, c, (), (), e.stress_unit)
    chi = lambda values: float((part.train(values) ** 2).sum())  # noqa: E731
    began = time.process_time()
    replayed = twin_replay(e, model).test
    seconds = time.process_time() - began
    left = r - twin.residual(part, c, replayed)
    seen = replace(part.system, experiment=replayed)
    of_three = three_points(part.system, basis, c) - np.nan_to_num(part.system.loads)
    of_three -= three_points(seen, basis, c) - np.nan_to_num(seen.recorded)
    found = {"true law": left, "three minus twin": of_three}
    if len(e.points) < FINER:
        found["finer"] = r - twin.residual(part, c, refined(e, model))
    return {"seconds": seconds, **{name: chi(values) for name, values in found.items()}}


def refined(e: Experiment, model: ExtendedModel) -> Experiment:
    """The replay on four times as many elements, which a test without noise asks for."""
    found = replay(replace(e, noise=Noise(1e-9)), law_of(model, e))
    assert found.refined == 1
    return replayed_test(e, found)


def table(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """As the page shows it."""
    keys = ("straight", "recovered", "three", "true law", "neo-Hooke", "base", "whole model")
    body = [[one["test"], str(one["points"]), *(f"{one[key]:.{0 if one[key] > 100 else 1}f}" if key in one else "" for key in keys),
             f"{one['remainder']:.2f}", str(one["rows"])] for one in rows]  # fmt: skip
    return [HEAD, *body]


if __name__ == "__main__":
    rows = []
    for case in CASES:
        rows.append(row(case))
        print(rows[-1], flush=True)
    cross = rows[0]
    content = {
        "command": "python benchmarks/twin.py",
        "made": datetime.now(UTC).date().isoformat(),
        "numbers": {
            "before": cross["recovered"], "after": cross["base"], "rows": cross["rows"], "points": cross["points"],
            "three_points": cross["three"], "three_points_after": cross["three minus twin"], "true_after": cross["true law"],
            "finer_after": cross["finer"],
            "neo_hooke_after": cross["neo-Hooke"],
            "remainder_least": min(one["remainder"] for one in rows), "remainder_most": max(one["remainder"] for one in rows),
            "seconds": max(one.get("seconds", 0.0) for one in rows),
        },
        "tables": {"remainder": table(rows)},
    }  # fmt: skip
    RESULTS.write_text(json.dumps(content, indent=1) + "\n")
