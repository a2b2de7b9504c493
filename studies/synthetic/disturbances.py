"""What a camera, its correlation and a load cell get wrong: an exact solution in, the Experiment so observed out.

A camera sees the point x at V_t(x). Its correlation follows a seen point of the reference picture, so that the
reference points are V_0(X), with X the nodes of the camera's mesh on the specimen, and the measured displacements

    u = V_t(X + mean of U) - V_0(W(X)),

where the mean is over a subset, if there is one, and W is where the specimen was before it was flat. Noise is added afterwards (`studies.synthetic.camera`). Each disturbance is one
small class with its amplitude; several act one after the other. `label` names it as the catalogue of effects does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from calibrate.data.experiment import Experiment
from forward.solution import SurfaceSolution
from meshes import Mesh, Specimen
from studies.errors import OptionError
from studies.synthetic.camera import boundaries
from studies.synthetic.specimen_edges import inside, inward

Array = NDArray[np.float64]
PIXELS = (
    12  # along the side of a subset that an edge cuts; an even number, so that none lies on an edge through its middle
)


@dataclass(frozen=True)
class Disturbance:
    """Base: an exact camera and load cell. Raises `OptionError` for amplitudes that are no finite numbers."""

    name: ClassVar[str]

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            if not np.isfinite(value):
                raise OptionError(f"{self.name}: {key} = {value}; give a finite number")

    def points(self, mesh: Mesh) -> Array:
        """Where on the specimen the nodes of the camera's mesh are, (n, 2), mm."""
        return mesh.points

    def displacements(self, solution: SurfaceSolution, specimen: Specimen, X: Array) -> Array | None:
        """Displacements (t, n, 2), mm, that the correlation finds at X (n, 2), mm; None: those of the points."""
        return None

    def before(self, x: Array) -> Array:
        """Where points x (n, 2), mm, from the middle of the specimen, are seen, (n, 2), mm, before it is loaded."""
        return x

    def see(self, x: Array, share: Any, size: float) -> Array:
        """Where points x (..., 2), mm, from the middle of the picture, are seen, (..., 2), mm.

        share: of the loading, 0 to 1; size: largest extent of the specimen, mm.
        """
        return x

    def forces(self, force: Array) -> Array:
        """What a load cell reads, (t, 2), N, of the forces (t, 2), N."""
        return force

    def label(self) -> dict[str, Any]:
        """Name and amplitudes in the convention of the catalogue."""
        return {"name": self.name, "amplitudes": asdict(self), "shape": {}}


@dataclass(frozen=True)
class LensDistortion(Disturbance):
    """A point at x from the middle is seen at x (1 + k |x|^2 / R^2), R half the extent, in every picture."""

    k: float
    name: ClassVar[str] = "lens distortion"

    def see(self, x, share, size):
        return x * (1 + self.k * (x**2).sum(axis=-1, keepdims=True) / (0.5 * size) ** 2)


@dataclass(frozen=True)
class OutOfPlane(Disturbance):
    """The specimen comes nearer as it is loaded: the picture grows by m at the largest load."""

    m: float
    name: ClassVar[str] = "out-of-plane motion"

    def see(self, x, share, size):
        return x * (1 + self.m * share)


@dataclass(frozen=True)
class Rotation(Disturbance):
    """The camera is turned against the load axes, so that it sees everything turned by phi, rad."""

    phi: float
    name: ClassVar[str] = "image rotation"

    def see(self, x, share, size):
        c, s = np.cos(self.phi), np.sin(self.phi)
        return x @ np.array([[c, s], [-s, c]])


@dataclass(frozen=True)
class Scale(Disturbance):
    """Lengths in the picture are too large by the factor 1 + e."""

    e: float
    name: ClassVar[str] = "DIC scale"

    def see(self, x, share, size):
        return x * (1 + self.e)


@dataclass(frozen=True)
class ForceOffset(Disturbance):
    """Every load cell reads f0, N, too much in the direction of its largest force."""

    f0: float
    name: ClassVar[str] = "force offset"

    def forces(self, force):
        sizes = np.linalg.norm(force, axis=1)
        return force + self.f0 * force[sizes.argmax()] / sizes.max()


@dataclass(frozen=True)
class ForceGain(Disturbance):
    """True forces are 1 + g times those that the load cells read."""

    g: float
    name: ClassVar[str] = "force gain"

    def forces(self, force):
        return force / (1 + self.g)


@dataclass(frozen=True)
class Lag(Disturbance):
    """Forces are read dt, s, after the picture. The solution must hold both instants: `schedule` before, `split` after."""

    dt: float
    name: ClassVar[str] = "lag between force and image"

    def schedule(self, factors: Sequence[float] | Array, times: Sequence[float] | Array) -> tuple[Array, Array]:
        """Load factors and times, s, of all pictures and readings, rising; the last straight line is continued.

        factors (t,) at times (t,), s, of the pictures. Raises `OptionError` for a reading before the test begins.
        """
        knots, values = np.concatenate([[0.0], times]), np.concatenate([[0.0], factors])
        late = np.asarray(times) + self.dt
        if late[0] <= 0:
            raise OptionError(f"a lag of {self.dt:g} s reads a force before the test begins at 0 s")
        slope = (values[-1] - values[-2]) / (knots[-1] - knots[-2])
        read = np.where(late > knots[-1], values[-1] + slope * (late - knots[-1]), np.interp(late, knots, values))
        every, first = np.unique(np.concatenate([times, late]), return_index=True)
        return np.concatenate([factors, read])[first], every

    def split(self, solution: SurfaceSolution, times: Sequence[float] | Array) -> SurfaceSolution:
        """Displacements at the pictures, taken at times (t,), s, and forces at the readings."""
        pictures = np.searchsorted(solution.time, times)
        readings = np.searchsorted(solution.time, np.asarray(times) + self.dt)
        return replace(
            solution,
            displacements=solution.displacements[pictures],
            reactions={side: force[readings] for side, force in solution.reactions.items()},
            time=solution.time[pictures],
            energy=solution.energy[pictures],
            iterations=solution.iterations[pictures],
        )


@dataclass(frozen=True)
class SubsetSmoothing(Disturbance):
    """A displacement is fitted to those over a square of `side`, mm, cut off at the specimen's edges.

    affine: the subset may strain (a plane is fitted and read at its middle), as in most programs; else the mean is
    taken, which near an edge belongs to another point. Inside both are the same. Whole subsets are summed over 5 x 5
    Gauss points, those that an edge cuts over the centres of `PIXELS` x `PIXELS` cells.
    """

    side: float
    affine: bool = True
    name: ClassVar[str] = "subset smoothing"

    def displacements(self, solution, specimen, X):
        x, w = np.polynomial.legendre.leggauss(5)
        whole = inside(specimen, (X[:, None] + self._offsets(np.linspace(-1, 1, 9))).reshape(-1, 2))
        whole = whole.reshape(len(X), -1).all(axis=1)
        cells = (2 * np.arange(PIXELS) + 1) / PIXELS - 1
        result = np.empty((len(solution.displacements), *X.shape))
        for nodes, at, weights in (
            (np.flatnonzero(whole), x, np.outer(w, w).ravel()),
            (np.flatnonzero(~whole), cells, np.ones(PIXELS**2)),
        ):
            if len(nodes):
                result[:, nodes] = self._read(solution, specimen, X[nodes], self._offsets(at), weights)
        return result

    def _offsets(self, at: Array) -> Array:
        """Places (q^2, 2), mm, from the middle of a subset; at (q,): from -1 to 1."""
        return 0.5 * self.side * np.array([(a, b) for a in at for b in at])

    def _read(self, solution: SurfaceSolution, specimen: Specimen, X: Array, offsets: Array, weights: Array) -> Array:
        """Displacements (t, n, 2) fitted over the places that lie in the specimen."""
        places = X[:, None] + offsets
        weights = weights * inside(specimen, places.reshape(-1, 2)).reshape(len(X), -1)
        there = weights > 0
        basis = np.concatenate([np.ones((len(offsets), 1)), offsets / self.side], axis=1)[:, : 3 if self.affine else 1]
        gram = np.einsum("nq,qa,qb->nab", weights, basis, basis)
        row = np.linalg.solve(gram, np.eye(basis.shape[1])[:1].T)[..., 0]
        row = np.einsum("na,qa,nq->nq", row, basis, weights)
        owner = np.repeat(np.arange(len(X)), there.sum(axis=1))
        average = sp.csr_array((row[there], (owner, np.arange(len(owner)))), shape=(len(X), len(owner)))
        return np.array([average @ u for u in solution.evaluate(places[there])])

    def label(self):
        return {
            "name": self.name,
            "amplitudes": {"s2": self.side**2 / 12},
            "shape": {},
            "side": self.side,
            "affine": self.affine,
        }


@dataclass(frozen=True)
class UnmeasuredStrip(Disturbance):
    """The measured region ends w, mm, inside the free edges; the nodes further inside make room smoothly."""

    w: float
    name: ClassVar[str] = "unmeasured strip"

    def points(self, mesh):
        return mesh.points + self.w * inward(mesh)


@dataclass(frozen=True)
class Warp(Disturbance):
    """A specimen that was bent in the reference picture, and is flat in all others.

    Along axis (0: x, 1: y) it had the height z = h exp(-(s - place)^2 / (2 width^2)) over its length s, mm; slope is the
    steepest inclination, rad. Seen from above its points are at the integral of the cosine of the inclination.
    """

    axis: int
    slope: float
    place: float
    width: float
    name: ClassVar[str] = "initial warp"

    def inclination(self, s: Array) -> Array:
        """Angle, rad, at lengths s, mm, from the middle."""
        x = (s - self.place) / self.width
        return self.slope * x * np.exp(0.5 - 0.5 * x**2)

    def before(self, x):
        s = np.linspace(x[:, self.axis].min(), x[:, self.axis].max(), 2001)
        lost = CubicSpline(s, 1 - np.cos(self.inclination(s))).antiderivative()
        seen = x.copy()
        seen[:, self.axis] -= lost(x[:, self.axis]) - lost(0.0)
        return seen

    def label(self):
        return {"name": self.name, "amplitudes": {}, "shape": {}, **asdict(self)}


def observe(
    solution: SurfaceSolution,
    specimen: Specimen,
    mesh: Mesh,
    disturbances: Sequence[Disturbance] = (),
    shares: Array | None = None,
    name: str = "synthetic",
) -> Experiment:
    """What is recorded of a solution on the nodes of `mesh` (triangles, whole specimen), before noise.

    shares (t,): of the loading, 1 at the largest, that out-of-plane motion follows; the load factors by default.
    """
    if shares is None:
        factors = np.asarray(solution.description.get("load_factors", solution.time))
        shares = factors / np.abs(factors).max()
    share = np.asarray(shares)[:, None, None]
    X = mesh.points
    for d in disturbances:
        X = X + d.points(mesh) - mesh.points
    smoothed = [u for d in disturbances if (u := d.displacements(solution, specimen, X)) is not None]
    u = smoothed[-1] if smoothed else solution.evaluate(X)
    middle, size = 0.5 * (X.min(axis=0) + X.max(axis=0)), float(np.ptp(X, axis=0).max())
    before, after = X - middle, X - middle + u
    for d in disturbances:
        before = d.before(before)
    forces = dict(solution.reactions)
    for d in disturbances:
        before, after = d.see(before, 0.0, size), d.see(after, share, size)
        forces = {side: d.forces(force) for side, force in forces.items()}
    loaded, free = boundaries(mesh, forces)
    return Experiment(
        name=name,
        points=middle + before,
        triangles=mesh.cells,
        displacements=after - before,
        loaded=loaded,
        free_nodes=free,
        thickness=solution.thickness,
        time=solution.time,
        plane=str(solution.description.get("plane", "stress")),
    )
