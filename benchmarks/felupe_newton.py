"""Newton's method on a body of FElupe that holds a volume of oil: shared by arch and pad.

FElupe assembles; the system bordered by the oil's volume is written out here, two right-hand
sides a step, with PARDISO (pypardiso) or SciPy's SuperLU, FElupe's default.
"""

from collections.abc import Iterator
from typing import Any

import felupe as fem
import numpy as np
from scipy.sparse.linalg import spsolve

from benchmarks.felupe_wall import Wall

_TOLERANCE = 1e-9  # of a correction, relative to the displacement
_MOST_CORRECTIONS = 25
_MOST_ON_A_PATH = 10
_LEAST_STEP = 1e-3  # of the load


class OilFilledBody:
    """A body with continuous pressures, on one of whose faces trapped oil acts."""

    def __init__(
        self,
        field: Any,  # displacement and pressure
        material: Any,  # gradient and Hessian of the energy, as FElupe takes them
        face: Any,  # displacement on the face that the oil wets
        held: np.ndarray,  # which displacements are held [node, direction]
        far: float,  # displacement at which the iteration is given up [m]
        solver: str,  # ``"pardiso"`` or ``"superlu"``
        *,
        # of the oil, volume lost per pressure [m^3/Pa]; None for vented oil
        compliance: float | None = 0.0,
        wall: Wall | None = None,  # that holds the face, if any
    ) -> None:
        self.compliance, self.wall = compliance, wall
        self.field, self.face, self.solver, self.far = field, face, solver, far
        self.body = fem.SolidBody(material, field)
        self.pressure = fem.SolidBodyPressure(face)
        self.count = sum(f.values.size for f in field.fields)
        self.displacements = held.size
        self.free = np.flatnonzero(~np.pad(held.ravel(), (0, self.count - held.size)))
        self.oil = 0.0
        self._rest_gradient = self._volume_gradient(0.0)

    @property
    def unknowns(self) -> int:
        """Free displacements and pressures, and the oil's pressure."""
        return len(self.free) + 1

    @property
    def displacement(self) -> np.ndarray:
        """Displacement of the nodes [node, direction]."""
        return np.asarray(self.field[0].values)

    def rest(self) -> None:
        """Back to the undeformed body."""
        self._set(np.zeros(self.count + 1))

    def advance(
        self,
        load: np.ndarray,  # nodal forces [node, direction]
        most: int = _MOST_CORRECTIONS,  # after which it is given up
    ) -> int:
        """Find the equilibrium from the present state; number of corrections.

        Raises RuntimeError: none was found.
        """
        force = np.pad(load.ravel(), (0, self.count - load.size))
        u, p = (part.values for part in self.field.fields)
        for correction in range(1, most + 1):
            gradient = self._volume_gradient(1.0)
            residual = self.body.assemble.vector(self.field).toarray().ravel()
            residual = residual - self.oil * gradient - force
            tangent = self.body.assemble.matrix(self.field)
            if self.wall is not None:
                push, stiff = self.wall.assemble(u, self.count)
                residual, tangent = residual + push, tangent + stiff
            stiffness = self.pressure.assemble.matrix(
                self.face, pressure=self.oil, resize=tangent
            )
            # The volume is a polynomial of third degree in the positions: Simpson is exact.
            mean = (self._rest_gradient + 4 * self._volume_gradient(0.5) + gradient) / 6
            volume = mean[: self.displacements] @ u.ravel()
            both = self._solved(tangent - stiffness, np.stack([-residual, gradient], 1))
            first, second = both.T
            change = 0.0
            if self.compliance is not None:
                volume += self.compliance * self.oil
                change = -(volume + gradient @ first) / (gradient @ second + self.compliance)
            move = first + change * second
            u += move[: self.displacements].reshape(u.shape)
            p += move[self.displacements :].reshape(p.shape)
            self.oil += change
            size = np.abs(u).max()
            if not np.isfinite(size) or size > self.far:
                raise RuntimeError("diverged")
            if np.abs(move[: self.displacements]).max() < _TOLERANCE * size:
                return correction
        raise RuntimeError("not converged")

    def follow(self, load: np.ndarray, levels: list[float]) -> Iterator[int]:
        """Pass through equilibria under growing shares of a load, from the body at rest.

        Steps start from the parabola through the last three states, and are halved where the
        iteration fails: mixed elements forgive less than a shell's.

        Yields corrections taken so far, in the equilibrium of each level.
        Raises RuntimeError: the step has become too small.
        """
        reached, step, total = 0.0, levels[0], 0
        past = [(0.0, self._state())]
        for level in levels:
            while reached < level:
                target = min(reached + step, level)
                self._set(_extrapolated(past[-3:], target))
                try:
                    total += self.advance(target * load, _MOST_ON_A_PATH)
                except RuntimeError:
                    total += _MOST_ON_A_PATH
                    step = (target - reached) / 2
                    if step < _LEAST_STEP * levels[-1]:
                        raise
                    continue
                step *= 1.5 if target < level else 1.0
                reached = target
                past.append((target, self._state()))
            yield total

    def _state(self) -> np.ndarray:
        parts = [part.values.ravel() for part in self.field.fields]
        return np.concatenate([*parts, [self.oil]])

    def _set(self, state: np.ndarray) -> None:
        u, p = (part.values for part in self.field.fields)
        u[:] = state[: u.size].reshape(u.shape)
        p[:] = state[u.size : -1].reshape(p.shape)
        self.oil = float(state[-1])

    def _volume_gradient(self, share: float) -> np.ndarray:
        """Derivative of the enclosed volume where a share of the displacement is reached."""
        self.face[0].values[:] = share * self.field[0].values
        force = self.pressure.assemble.vector(self.face, pressure=1.0).toarray().ravel()
        return np.pad(force, (0, self.count - force.size))

    def _solved(self, matrix: Any, right: np.ndarray) -> np.ndarray:
        out = np.zeros_like(right)
        inside = matrix.tocsr()[self.free][:, self.free]
        if self.solver == "pardiso":
            import pypardiso

            out[self.free] = pypardiso.spsolve(inside, right[self.free])
        else:
            out[self.free] = spsolve(inside.tocsc(), right[self.free])
        return out


def _extrapolated(past: list[tuple[float, np.ndarray]], target: float) -> np.ndarray:
    """Lagrange's polynomial through states at their loads."""
    loads = np.array([load for load, _ in past])
    total = np.zeros_like(past[0][1])
    for i, (load, state) in enumerate(past):
        others = np.delete(loads, i)
        total += np.prod((target - others) / (load - others)) * state
    return total
