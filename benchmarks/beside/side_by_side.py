"""One material and noise: NN-EUCLID, equigap and classical laws on the same data, judged alike.

In: a member of NN-EUCLID (trained as far as it is). Out: a dict of numbers: loss by NN-EUCLID's formula, relative errors of stress and
energy on its six paths (norm of the error over norm of the truth, over all components, gamma to 0.3 and to 1), CPU times.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from beside import classical_fit
from beside.nn_euclid_data import GAMMA, PATHS, SEEN, NodalLoss, path_energy, path_gradients
from beside.peer_process import Member
from beside.published_laws import CLASSICAL, FIBROUS, TRUTHS
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.fitting.calibration import Calibration, Options, calibrate
from studies.commands.import_data import import_experiment

Array = NDArray[np.float64]
Stress = Callable[[Array], Array]
INPUTS = ("I1", "I1I2")


def compare(member: Member, seeds: int, known: dict[str, Any] | None = None) -> dict[str, Any]:
    """All models of one material and noise. known: an earlier answer, of which only NN-EUCLID is evaluated again."""
    experiment = import_experiment(member.data)
    judge = Judge(experiment, member.material)
    models = known["models"] if known else fitted(experiment, judge, member.material, seeds)
    peer = peer_rows(member, judge)
    return {"material": member.material, "noise": member.noise, "models": models, "peer": peer}


def fitted(experiment: Experiment, judge: Judge, material: str, seeds: int) -> list[dict[str, Any]]:
    """The truth, equigap's networks and classical laws."""
    truth, parameters = TRUTHS[material]
    models: list[dict[str, Any]] = [judge.row("truth", lambda F: truth.stress(F, parameters))]
    for inputs in INPUTS:
        models += [ours(experiment, judge, inputs, seed) for seed in range(seeds)]
    fibrous = (FIBROUS,) if material == "Holzapfel" else ()
    return [*models, *classical(experiment, judge, (*CLASSICAL, *fibrous))]


class Judge:
    """The loss and the paths of a test."""

    def __init__(self, experiment: Experiment, material: str) -> None:
        self.loss = NodalLoss(experiment)
        self.paths = {path: path_gradients(path) for path in PATHS}
        law, parameters = TRUTHS[material]
        self.truth = {path: law.stress(F, parameters) for path, F in self.paths.items()}

    @property
    def gradients(self) -> Array:
        """F (n, 2, 2) at which a model is needed: those of the test, then those of the paths."""
        return np.concatenate([self.loss.gradients.reshape(-1, 2, 2), *self.paths.values()])

    def row(self, name: str, stress: Stress, **more: Any) -> dict[str, Any]:
        """Numbers of a model that gives P (n, 2, 2) at F (n, 2, 2)."""
        return self.row_of(name, stress(self.gradients), **more)

    def row_of(self, name: str, P: Array, **more: Any) -> dict[str, Any]:
        """Numbers of a model with P (n, 2, 2) at `gradients`."""
        shape = self.loss.gradients.shape
        size = shape[0] * shape[1]
        equilibrium, sides = self.loss(P[:size].reshape(shape))
        parts = P[size:].reshape(len(PATHS), len(GAMMA), 2, 2)
        found = dict(zip(PATHS, parts, strict=True))
        return {
            "name": name,
            "loss": equilibrium + sides,
            "loss_free": equilibrium,
            "loss_sides": sides,
            "stress_error": {path: self._errors(path, found[path], False) for path in PATHS},
            "energy_error": {path: self._errors(path, found[path], True) for path in PATHS},
            "curves": {path: _component(path, found[path]).tolist() for path in PATHS},
            **more,
        }

    def _errors(self, path: str, P: Array, energy: bool) -> tuple[float, float]:
        """Relative errors up to gamma 0.3, and up to 1."""
        truth, F = self.truth[path], self.paths[path]
        a, b = (path_energy(F, P), path_energy(F, truth)) if energy else (P, truth)
        parts = (GAMMA <= SEEN, GAMMA <= 1)
        inside, whole = (float(np.linalg.norm((a - b)[k]) / np.linalg.norm(b[k])) for k in parts)
        return inside, whole


def _component(path: str, P: Array) -> Array:
    """P12 in simple shear, P22 in pure shear, else P11, as NN-EUCLID shows them."""
    i, j = {"SS": (0, 1), "PS": (1, 1)}.get(path, (0, 0))
    return P[:, i, j]


def ours(experiment: Experiment, judge: Judge, inputs: str, seed: int) -> dict[str, Any]:
    """equigap's network; the time is that of one call, compilation included where it is the first."""
    start = time.process_time()
    found = calibrate(experiment, Options(inputs=inputs, seed=seed))
    seconds = time.process_time() - start
    model = found.model
    return judge.row(
        f"equigap, {inputs}",
        lambda F: model.nominal_stress(F, "strain"),
        seed=seed,
        cpu_seconds=seconds,
        reduced_chi_square=found.reduced_chi_square,
        bulk_modulus=model.bulk_modulus,
        bulk_modulus_deviation=model.bulk_modulus_deviation,
        shear_modulus=float(2 * model.derivatives(np.array([[3.0, 3.0]])).sum()),
    )


def classical(experiment: Experiment, judge: Judge, laws: tuple[Any, ...]) -> list[dict[str, Any]]:
    """Classical laws with the weights of the network of both invariants; their time includes one assembly."""
    found: Calibration = calibrate(experiment, Options(inputs="I1I2", starts=1))
    start = time.process_time()
    weighting = classical_fit.weights_made_anew(found)
    assembly = time.process_time() - start
    rows = []
    for law in laws:
        fit = classical_fit.fit(law, found, weighting)
        parameters = dict(zip(law.names, fit.parameters.tolist(), strict=True))
        rows.append(
            judge.row(
                law.name,
                fit.stress,
                cpu_seconds=assembly + fit.cpu_seconds,
                reduced_chi_square=fit.reduced_chi_square,
                parameters=parameters,
            )
        )
    return rows


def peer_rows(member: Member, judge: Judge) -> list[dict[str, Any]]:
    """NN-EUCLID at each of its checkpoints."""
    if not member.history():
        return []
    found = member.checkpoints(judge.gradients)
    logged = {int(row["epoch"]): row["loss"] for row in member.history()}
    rows = []
    for k, epoch in enumerate(found.epoch.tolist()):
        angle = float(found.angle[k])
        more = {"epoch": epoch, "cpu_seconds": float(found.cpu_seconds[k]), "loss_in_training": logged[epoch]}
        if np.isfinite(angle):
            more["angle"] = angle
        rows.append(judge.row_of("NN-EUCLID", found.stress[k], **more))
    return rows
