"""What is hidden in each test, how it is recorded, and which names are right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.distance import cdist

from benchmarks.other_code import laws
from benchmarks.other_code.felupe_sheet import NEAR_HOLES, SIZE, Hole, Law, at_points, mesh, solve

ONE: tuple[Hole, ...] = ((0.0, 0.0, 8.0),)
THREE: tuple[Hole, ...] = ((-24.0, 6.0, 6.0), (4.0, -9.0, 7.0), (28.0, 8.0, 5.0))
POINTS, INTERVAL = 2.2, 2.0  # mm between points; s between pictures
LOAD_CELL = 0.005  # N
ARRANGED = 0.7  # of the distance of points, at holes

Fields = Callable[
    [np.ndarray, np.ndarray, np.ndarray], np.ndarray
]  # points, displacements, times -> as the camera has them
Forces = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Case:
    """path (t,), mm, at times (t,), s (None: `INTERVAL` apart). right: effects whose name is right, none where nothing of the catalogue is. noise: mm of a point, its length, mm, and what stays with the
    pattern, mm. spacing, mm, of the points. stated: options of the import. substeps: of the solution between pictures.
    spoilt: errors (t, n, 2), mm, of a camera that does worse; NaN where nothing was matched."""

    truth: str
    law: Law
    path: np.ndarray
    right: tuple[str, ...] = ()
    null: bool = False
    holes: tuple[Hole, ...] = ONE
    times: np.ndarray | None = None
    substeps: int = 1
    noise: tuple[float, float, float] = (0.004, 0.0, 0.0)
    spacing: float = POINTS
    slit: tuple[float, float] | None = None
    seen: Fields = field(default=lambda p, u, t: u)
    read: Forces = field(default=lambda f, t: f)
    stated: tuple[str, ...] = ()
    spoilt: Callable[[np.ndarray, np.random.Generator], np.ndarray] = field(default=lambda errors, rng: errors)


def ramp(*turns: float, pictures: tuple[int, ...]) -> np.ndarray:
    """From 0 to turning points, mm, with so many pictures on each way."""
    path = [0.0]
    for turn, n in zip(turns, pictures, strict=True):
        path += np.linspace(path[-1], turn, n + 1)[1:].tolist()
    return np.array(path)


def moved_away(p: np.ndarray, u: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Magnified by 0.4 % at the end, in proportion to time and not to load."""
    return (p + u) * (1 + 0.004 * t / t[-1])[:, None, None] - p


def through_a_guide(f: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Friction of 1 % of the largest force and 0.5 % of the force itself, against the motion; none in the reference picture."""
    return f + np.sign(np.diff(f, prepend=f[0])) * (0.01 * f.max() + 0.005 * f)


def with_a_lost_picture(p: np.ndarray, u: np.ndarray, t: np.ndarray) -> np.ndarray:
    """From the ninth on every file has what the next one should."""
    found = u.copy()
    found[9:-1] = u[10:]
    return found


def with_wrong_matches(errors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Student's t with three degrees in place of the normal distribution, one reading in a hundred off by 0.12 mm, and one point in twelve lost in the second half of the test."""
    t, n, _ = errors.shape
    found = 0.75 * errors.std() * rng.standard_t(3, errors.shape)
    wrong = rng.random((t, n)) < 0.01
    found[wrong] += 0.12 * rng.standard_normal((int(wrong.sum()), 2))
    lost = rng.random(n) < 1 / 12
    found[t // 2 :, lost] = np.nan
    found[0] = 0.0
    return found


def lasting(errors: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Four fifths of the error of a picture go on in the next one."""
    found = errors.copy()
    for k in range(1, len(errors)):
        found[k] = 0.8 * found[k - 1] + 0.6 * errors[k]
    return found


HELD = np.concatenate([ramp(30, pictures=(8,)), np.full(7, 30.0), np.linspace(30, 12, 6)[1:]])
HELD_TIMES = np.concatenate([np.arange(9.0), 8 + np.array([1, 3, 6, 12, 25, 50, 100.0]), 108 + np.arange(1.0, 6)])
CYCLE, SHORT = ramp(35, 4, pictures=(11, 9)), ramp(10, 1, pictures=(8, 6))
CASES = {
    "nothing": Case("nothing, Gent", laws.elastic(laws.gent), CYCLE, null=True, holes=THREE),
    "nothing, noise understated": Case(
        "nothing, Gent; 4 um over 2 mm and a pattern of 6 um, 3 um stated", laws.elastic(laws.gent), CYCLE, null=True, holes=THREE,
        noise=(0.004, 2.0, 0.006), stated=("--displacement-std", "0.003", "--correlation-length", "2"),
    ),
    "nothing, few points": Case(
        "nothing, Gent, 10 % of strain", laws.elastic(laws.gent), SHORT, null=True, noise=(0.005, 0.0, 0.0), spacing=3.5
    ),
    "Ogden": Case("Ogden's law, three terms", laws.elastic(laws.ogden), ramp(40, 5, pictures=(11, 9)), ("second invariant", "upturn"), holes=THREE),
    "damage": Case("damage by the energy, two cycles", laws.damaged(), ramp(20, 2, 50, 8, pictures=(6, 5, 9, 6)), ("Mullins softening",)),
    "relaxation": Case(
        "two Maxwell branches, 3 and 60 s; ramp, pause, way back", laws.relaxing(), HELD, ("finite viscoelasticity", "second finite relaxation time", "viscoelasticity", "second relaxation time"), times=HELD_TIMES, substeps=8
    ),
    "fibres": Case("fibres in tension alone, 30 degrees", laws.elastic(laws.reinforced), ramp(30, 3, pictures=(10, 7)), ("one fibre family",), holes=THREE),
    "step": Case("15 % thicker right of an inclined line", laws.elastic(laws.gent, laws.step), ramp(30, pictures=(14,)), ("stiffness field", "inclusion", "stiffness gradient")),
    "ellipse": Case("a softer ellipse in Ogden's law", laws.elastic(laws.ogden, laws.ellipse), ramp(35, pictures=(14,)), ("inclusion", "stiffness field", "second invariant", "upturn"), holes=((-10.0, 2.0, 8.0),)),
    "crack": Case("a crack of 6 mm at the lower edge", laws.elastic(laws.gent), ramp(25, pictures=(14,)), holes=((20.0, 5.0, 7.0),), slit=(-20.0, 6.0), spacing=2.0),
    "camera moved": Case("magnification in proportion to time", laws.elastic(laws.gent), CYCLE, ("magnification drift",), seen=moved_away),
    "load cell drifted": Case(
        "3 % of gain and 3 % of the largest force of drift", laws.elastic(laws.gent), CYCLE, ("force drift",), holes=THREE, read=lambda f, t: 1.03 * f + 0.03 * f.max() * t / t[-1]
    ),
    "warmed": Case("10 % softer with time", laws.elastic(laws.gent, laws.warming), CYCLE, ("stiffness or gain drift",), holes=THREE),
    "picture lost": Case("a picture lost, later ones one interval too early", laws.elastic(laws.gent), CYCLE, holes=THREE, seen=with_a_lost_picture),
    "nothing, wrong matches": Case("nothing, Gent; wrong matches and lost points", laws.elastic(laws.gent), CYCLE, null=True, spoilt=with_wrong_matches),
    "nothing, noise that lasts": Case("nothing, Gent; noise that lasts over pictures", laws.elastic(laws.gent), CYCLE, null=True, holes=THREE, noise=(0.004, 3.0, 0.0), spoilt=lasting),
    "friction": Case("friction of a guide, in part by the force", laws.elastic(laws.gent), CYCLE, ("friction in the load train",), holes=THREE, read=through_a_guide),
}  # fmt: skip


def write(case: Case, folder: Path, seed: int) -> None:
    """As a DIC program exports it: a table of points for each picture, and the record of the machine."""
    rng = np.random.default_rng(seed)
    times = np.arange(len(case.path)) * INTERVAL if case.times is None else case.times
    x, cells = mesh(case.holes, SIZE, NEAR_HOLES, 2, case.slit)
    fine = np.arange((len(times) - 1) * case.substeps + 1) / case.substeps
    whole = np.arange(len(times))
    u, force = solve(x, cells, np.interp(fine, whole, case.path), np.interp(fine, whole, times), case.law)
    u, force = u[:: case.substeps], force[:: case.substeps]
    points, _ = mesh(case.holes, case.spacing, ARRANGED * case.spacing, 1)
    seen = case.seen(points, at_points(x, cells, u, points), times)
    std, length, pattern = case.noise
    fixed, largest = noise(points, max(length, 1.5), pattern, rng), np.abs(seen).max()
    folder.mkdir(parents=True)
    errors = np.zeros(seen.shape)
    for k, one in enumerate(seen[1:], start=1):
        errors[k] = noise(points, length, std, rng) + fixed * np.abs(one).max() / largest
    errors = case.spoilt(errors, np.random.default_rng([seed, 1]))
    for k, measured in enumerate(seen + errors):
        matched = np.isfinite(measured).all(axis=1)
        table = np.column_stack([points, np.nan_to_num(measured), np.where(matched, 0.02, -1.0)])
        np.savetxt(folder / f"img_{k:03d}.csv", table, "%.6f", ",", header="X,Y,U,V,sigma", comments="")
    recorded = case.read(force, times) + LOAD_CELL * rng.standard_normal(len(times))
    record = np.column_stack([times, recorded])
    np.savetxt(folder / "machine.csv", record, "%.5f", ",", header="Time [s],Force [N]", comments="")


def noise(points: np.ndarray, length: float, std: float, rng: np.random.Generator) -> np.ndarray:
    """(n, 2), mm: white, or white numbers on a grid seen through exp(-r^2 / length^2)."""
    if not length:
        return std * rng.standard_normal(points.shape)
    axes = [
        np.arange(a - 3 * length, b + 3 * length, length / 2)
        for a, b in zip(points.min(axis=0), points.max(axis=0), strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    kernel = np.exp(-((cdist(points, grid) / length) ** 2))
    kernel /= np.linalg.norm(kernel, axis=1, keepdims=True)
    return std * kernel @ rng.standard_normal((len(grid), 2))
