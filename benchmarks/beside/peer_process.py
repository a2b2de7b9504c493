"""NN-EUCLID in an interpreter of its own: training in pieces, and the stress of its checkpoints.

In: the path of a clone, an interpreter with torch, a folder for checkpoints. Out: loss and CPU time of every epoch, stresses.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SCRIPT = Path(__file__).with_name("nn_euclid_member.py")
SINGLE = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "MKL", "OPENBLAS")}
VERSIONS = "import sys, torch, numpy, pandas; print(sys.version.split()[0], torch.__version__, numpy.__version__, pandas.__version__)"


@dataclass(frozen=True)
class Checkpoints:
    """Of one member: epoch (k,), CPU time (k,) s, stress (k, n, 2, 2), angle of its fibres (k,) degrees (NaN: none)."""

    epoch: NDArray[np.int64]
    cpu_seconds: Array
    stress: Array
    angle: Array


@dataclass(frozen=True)
class Member:
    """One network of NN-EUCLID's ensemble. folder: of its checkpoints."""

    clone: Path
    python: Path
    material: str
    noise: str
    seed: int
    folder: Path

    @property
    def data(self) -> Path:
        """The folder of load steps it is trained on."""
        return self.clone / "fem-data" / f"noise={self.noise}" / self.material

    def train(self, minutes: float, until: int) -> None:
        """Go on for some minutes, or until it has had so many epochs in all."""
        if minutes > 0 and len(self.history()) < until:
            words = [self.clone, self.material, self.noise, self.seed, self.folder]
            self._run("train", *words, "--minutes", minutes, "--until", until)

    def seconds_an_epoch(self, steps: int, epochs: int = 4) -> float:
        """Median CPU time of an epoch with the first load steps, s; the network is thrown away."""
        with tempfile.TemporaryDirectory() as scratch:
            words = [self.clone, self.material, self.noise, self.seed, scratch]
            self._run("train", *words, "--steps", steps, "--until", epochs)
            times = [row["cpu_seconds"] for row in json.loads((Path(scratch) / "history.json").read_text())]
        return float(np.median(np.diff(times)))

    def history(self) -> list[dict[str, float]]:
        """Epoch, loss (with dropout, as it trains) and CPU time so far."""
        path = self.folder / "history.json"
        return json.loads(path.read_text()) if path.exists() else []

    def checkpoints(self, gradients: Array) -> Checkpoints:
        """All checkpoints at F (n, 2, 2), without dropout."""
        with tempfile.TemporaryDirectory() as scratch:
            asked, answered = Path(scratch) / "gradients.npy", Path(scratch) / "stress.npz"
            np.save(asked, gradients.reshape(-1, 4))
            self._run("stress", self.clone, self.material, self.folder, asked, answered)
            with np.load(answered) as found:
                stress, epoch, angle = (found[key] for key in ("stress", "epoch", "angle"))
        time = {int(row["epoch"]): row["cpu_seconds"] for row in self.history()}
        kept = np.array([k for k, e in enumerate(epoch) if int(e) in time])
        shape = (len(kept), -1, 2, 2)
        seconds = np.array([time[int(e)] for e in epoch[kept]])
        return Checkpoints(epoch[kept], seconds, stress[kept].reshape(shape), angle[kept])

    def versions(self) -> dict[str, str]:
        """Of the interpreter and what NN-EUCLID uses, and the commit of the clone where it is one."""
        out = subprocess.run([str(self.python), "-c", VERSIONS], capture_output=True, text=True, check=True).stdout
        found = dict(zip(("python", "torch", "numpy", "pandas"), out.split(), strict=True))
        head = subprocess.run(["git", "-C", str(self.clone), "rev-parse", "HEAD"], capture_output=True, text=True)
        return found | ({"commit": head.stdout.strip()} if head.returncode == 0 else {})

    def _run(self, *words: Any) -> None:
        command = [str(self.python), "-W", "ignore", str(SCRIPT), *map(str, words)]
        done = subprocess.run(command, env=os.environ | SINGLE, capture_output=True, text=True)
        if done.returncode != 0:
            raise SystemExit(f"{' '.join(command)}\n{done.stderr[-2000:]}")
