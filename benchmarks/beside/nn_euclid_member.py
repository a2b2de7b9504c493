"""One member of NN-EUCLID's ensemble, trained and evaluated by NN-EUCLID's own code in an interpreter that has torch.

NN-EUCLID (Thakolkaran et al. 2022, GPL-3) is no part of this repository: this script runs in a copy of it, whose path it is given,
imports its modules there and calls its training. Nothing of it is changed. Three things are watched from outside, through
torch: the optimiser's loss and the CPU time of every epoch, checkpoints after the learning-rate step, and a limit of minutes or epochs,
after which the same call goes on from the last checkpoint (optimiser, schedule and random numbers included).

    PYTHON nn_euclid_member.py train CLONE MATERIAL NOISE SEED FOLDER [--minutes 12] [--until 500] [--steps 6] [--every 10]
    PYTHON nn_euclid_member.py stress CLONE MATERIAL FOLDER GRADIENTS.npy OUT.npz

`stress` evaluates every checkpoint of FOLDER (without dropout) at deformation gradients (n, 4) [F11, F12, F21, F22] and writes the
first Piola-Kirchhoff stress (n_checkpoints, n, 4) with the stress of the reference state taken off as NN-EUCLID does (its Eq. 8).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import sys
import time
from pathlib import Path
from typing import Any


class Paused(Exception):
    """The limit of minutes or epochs was reached; the checkpoint says where to go on."""


def enter(clone: Path) -> None:
    """Make the modules of a clone importable, from the folder that its relative paths are meant for."""
    import numpy

    if not hasattr(numpy, "math"):
        numpy.math = math  # used by the clone, gone from numpy 1.25 on
    os.chdir(clone / "drivers")
    sys.path[:0] = [str(clone / "drivers"), str(clone)]


def network(material: str) -> Any:
    """The network that its main script chooses for a material: fibres of unknown angle where it has them."""
    import config
    from model import ICNN

    fibres: dict[str, Any] = {"Holzapfel": {"anisotropy_flag": "double", "fiber_type": "mirror"}}.get(material, {})
    return ICNN(
        n_input=config.n_input + (2 if fibres else 0),
        n_hidden=config.n_hidden,
        n_output=config.n_output,
        use_dropout=config.use_dropout,
        dropout_rate=config.dropout_rate,
        **fibres,
    )


def load_steps(material: str, noise: str, count: int | None = None) -> list[Any]:
    """Its data sets, read by its own reader; refuses where a newer pandas makes that reader keep the noise on the boundary."""
    import numpy
    import pandas
    from core import loadFemData

    folder = Path(f"../fem-data/noise={noise}/{material}")
    sets = []
    for step in sorted(int(f.name) for f in folder.iterdir())[:count]:
        data = loadFemData(f"{folder}/{step}")
        table = pandas.read_csv(folder / str(step) / "output_nodes.csv")
        held = table.bcx.values != 0
        if not numpy.array_equal(data.u_nodes[held, 0].detach().numpy(), table.ux_orig.values[held]):
            raise SystemExit("the clone's reader needs pandas < 3: it assigns to columns in a chain")
        sets.append(data)
    return sets


def train(args: argparse.Namespace) -> None:
    """Train by the clone's `train_weak`, going on where an earlier call was paused."""
    import torch
    import train as theirs

    watch = Watch(args.folder, args.minutes, args.until, args.every)
    torch.manual_seed(args.seed)
    model = network(args.material)
    from model import init_weights

    model.apply(init_weights)
    steps = load_steps(args.material, args.noise, args.steps)
    state = watch.resume(model)
    theirs.epochs -= state
    if theirs.epochs <= 0 or state >= args.until:
        return
    watch.attach(model)
    try:
        theirs.train_weak(model, steps, args.material, args.noise)
    except Paused:
        print(f"paused after {watch.history[-1]['epoch']} epochs")
        return
    watch.save()


class Watch:
    """Loss and CPU time of every epoch; checkpoints; the pause."""

    def __init__(self, folder: Path, minutes: float, until: int, every: int) -> None:
        self.folder, self.every, self.until, self.limit = folder, every, until, time.time() + 60 * minutes
        self.history: list[dict[str, float]] = []
        self.state: dict[str, Any] | None = None
        folder.mkdir(parents=True, exist_ok=True)

    def resume(self, model: Any) -> int:
        """Load the last checkpoint into a model; the number of epochs it had."""
        import torch

        path = self.folder / "last.pt"
        if not path.exists():
            return 0
        self.state = torch.load(path, weights_only=False)
        self.history = self.state["history"]
        model.load_state_dict(self.state["model"])
        return len(self.history)

    def attach(self, model: Any) -> None:
        """Let torch's optimiser and schedule report to this watch, and start where the checkpoint ended."""
        import torch

        watch, self.model = self, model
        adam, cyclic = torch.optim.Adam, torch.optim.lr_scheduler.CyclicLR
        self.start = cpu_seconds()
        self.spent = self.history[-1]["cpu_seconds"] if self.history else 0.0
        self.spent_wall = self.history[-1]["wall_seconds"] if self.history else 0.0
        self.start_wall = time.time()

        class Optimiser(adam):
            def step(self, closure: Any = None) -> Any:
                values = super().step(closure)
                watch.loss = float(values[0].detach())
                return values

        class Schedule(cyclic):
            def __init__(self, optimizer: Any, **settings: Any) -> None:
                super().__init__(optimizer, **settings)
                watch.optimiser, watch.schedule = optimizer, self
                if watch.state:
                    optimizer.load_state_dict(watch.state["optimiser"])
                    self.load_state_dict(watch.state["schedule"])
                    torch.set_rng_state(watch.state["random"])
                watch.ready = True

            def step(self, *words: Any) -> None:
                super().step(*words)
                if getattr(watch, "ready", False):
                    watch.epoch()

        torch.optim.Adam, torch.optim.lr_scheduler.CyclicLR = Optimiser, Schedule

    def epoch(self) -> None:
        """Record an epoch; now and then keep the model; pause at the limit."""
        import torch

        number = len(self.history) + 1
        cpu, wall = self.spent + cpu_seconds() - self.start, self.spent_wall + time.time() - self.start_wall
        self.history.append({"epoch": number, "loss": self.loss, "cpu_seconds": cpu, "wall_seconds": wall})
        if number % self.every == 0 or number in (1, 2, 5):
            torch.save(self.model.state_dict(), self.folder / f"epoch-{number:04d}.pt")
        over = time.time() > self.limit or number == self.until
        if over or number % self.every == 0:
            self.save()
        if over:
            raise Paused

    def save(self) -> None:
        """Write the checkpoint and the history, whole or not at all."""
        import torch

        state = {
            "model": self.model.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "schedule": self.schedule.state_dict(),
            "random": torch.get_rng_state(),
            "history": self.history,
        }
        torch.save(state, self.folder / "last.pt.new")
        os.replace(self.folder / "last.pt.new", self.folder / "last.pt")
        (self.folder / "history.json").write_text(json.dumps(self.history))


def cpu_seconds() -> float:
    """Processor time of this process, s."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def stress(args: argparse.Namespace) -> None:
    """Stress of every checkpoint at given deformation gradients, without dropout."""
    import numpy
    import torch

    gradients = numpy.load(args.gradients)
    model = network(args.material)
    model.eval()
    files = sorted(args.folder.glob("epoch-*.pt"))
    found, angles = [], []
    for file in files:
        model.load_state_dict(torch.load(file, weights_only=False))
        found.append(corrected_stress(model, torch.tensor(gradients)))
        angles.append(90 * float(torch.sigmoid(model.alpha)) if model.anisotropy_flag else math.nan)
    numpy.savez(args.out, stress=numpy.array(found), epoch=[int(f.stem[6:]) for f in files], angle=angles)


def corrected_stress(model: Any, gradients: Any) -> Any:
    """P = dW/dF(F) - F dW/dF(1): no stress in the reference state."""
    import torch

    def slope(F: Any) -> Any:
        F = F.clone().requires_grad_(True)
        return torch.autograd.grad(model(F).sum(), F)[0].detach().double().reshape(-1, 2, 2)

    rest = slope(torch.tensor([[1.0, 0.0, 0.0, 1.0]], dtype=torch.float64))[0]
    P = slope(gradients) - gradients.reshape(-1, 2, 2) @ rest
    return P.reshape(-1, 4).numpy()


def main() -> None:
    """Read the command line and do what it says."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("train")
    for name in ("clone", "material", "noise"):
        one.add_argument(name, type=Path if name == "clone" else str)
    one.add_argument("seed", type=int)
    one.add_argument("folder", type=Path)
    one.add_argument("--minutes", type=float, default=1e9)
    one.add_argument("--until", type=int, default=10**9, metavar="EPOCH")
    one.add_argument("--steps", type=int, default=None, help="only the first load steps")
    one.add_argument("--every", type=int, default=10)
    two = commands.add_parser("stress")
    two.add_argument("clone", type=Path)
    two.add_argument("material")
    two.add_argument("folder", type=Path)
    two.add_argument("gradients", type=Path)
    two.add_argument("out", type=Path)
    args = parser.parse_args()
    for name in ("folder", "gradients", "out"):
        if hasattr(args, name):
            setattr(args, name, getattr(args, name).resolve())
    enter(args.clone.resolve())
    {"train": train, "stress": stress}[args.command](args)


if __name__ == "__main__":
    main()
