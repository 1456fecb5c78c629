"""What acts on a skin, in lanes: lines on a section, round patches on a pad, a pressure."""

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from suas_jax.config import SceneSpec, continuous_inputs
from suas_jax.numerics.array_types import Lanes
from suas_jax.numerics.polynomials import gauss_legendre
from suas_jax.runtime.compiled import require_float64
from suas_jax.scene.parts import SceneParts, scene_parts
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import LineLoad, LoadPoints, PadLoad

SPREAD_POINTS = 8
"""Point loads that stand for one that is spread over an arc."""


class Loads(eqx.Module):
    """Dead forces, any number at once, and any number of cases side by side in lanes.

    On a section each is a line load over the width, on a pad each is even over a disc of the
    undeformed outer face.

    Attributes:
        angle: where they act (patches: of their centres), from the symmetry axis [rad].
        force: total, positive inwards [N].
        turn: counter-clockwise rotation of the force from the inward radial in the section's
            plane [rad].
        external_pressure: uniform on the outer face, above ambient [Pa].
        axial: of the patches' centres, from the middle of the pad [m]; None of line loads.
        diameter: of the patches [m]; None of line loads.
        tilt: of the force out of the section's plane towards +axial [rad]; None of line loads.
    """

    angle: Float[Array, "load #lane"]
    force: Float[Array, "load #lane"]
    turn: Float[Array, "load #lane"]
    external_pressure: Lanes
    axial: Float[Array, "load #lane"] | None = None
    diameter: Float[Array, "load #lane"] | None = None
    tilt: Float[Array, "load #lane"] | None = None

    @classmethod
    def line(cls, angle: ArrayLike, force: ArrayLike, turn: ArrayLike = 0.0) -> "Loads":
        """Line loads: each argument one value, one a lane, or [load, lane].

        Args:
            angle: [rad].
            force: [N].
            turn: from the inward radial [rad].

        Raises:
            Float64Error: float64 is off.
        """
        require_float64()
        return cls(_rows(angle), _rows(force), _rows(turn), jnp.zeros(1))

    @classmethod
    def patch(
        cls,
        angle: ArrayLike,  # [rad]
        axial: ArrayLike,  # [m]
        force: ArrayLike,  # [N]
        diameter: ArrayLike,  # [m]
        turn: ArrayLike = 0.0,  # from the inward radial [rad]
        tilt: ArrayLike = 0.0,  # out of the section's plane towards +axial [rad]
    ) -> "Loads":
        """Round patches on a pad: each argument one value, one a lane, or [patch, lane].

        Raises Float64Error: float64 is off.
        """
        require_float64()
        given = [_rows(x) for x in (angle, force, turn, axial, diameter, tilt)]
        shape = np.broadcast_shapes(*(x.shape for x in given))
        angle, force, turn, axial, diameter, tilt = (
            x if x.shape == shape else jnp.broadcast_to(x, shape) for x in given
        )
        return cls(angle, force, turn, jnp.zeros(1), axial, diameter, tilt)

    def in_lanes(self) -> "Loads":
        """The same with every array as wide as the widest."""
        lanes = max(x.shape[-1] for x in jax.tree.leaves(self))
        return jax.tree.map(lambda x: jnp.broadcast_to(x, (*x.shape[:-1], lanes)), self)

    def points(self, breaks: Float[Array, "break #lane"], geometry: SkinGeometry) -> LoadPoints:
        """Line loads as points inside elements of a section between breaks [rad].

        Raises ValueError: these are patches.
        """
        if self.axial is not None:
            raise ValueError(
                "patches act on a pad; a section (plane strain) takes `Loads.line`"
            )
        element = jnp.sum(self.angle >= breaks[1:-1, None], 0)
        count = len(breaks) - 1
        select = (np.arange(count)[:, None, None] == element).astype(breaks.dtype)
        start, end = (jnp.sum(select * side[:, None], 0) for side in (breaks[:-1], breaks[1:]))
        line = LineLoad(self.angle, self.force, self.turn)
        force = self.force * line.direction(geometry.section) / geometry.width
        return LoadPoints(select, (self.angle - start) / (end - start), force)

    def discs(self) -> tuple[Array, Array, Array]:
        """Angles [rad], axial positions [m] and diameters [m] of patches.

        Raises ValueError: these are line loads.
        """
        if self.axial is None or self.diameter is None:
            raise ValueError("a pad takes round patches, `Loads.patch`; these are line loads")
        return self.angle, self.axial, self.diameter

    def patches(self) -> list[PadLoad]:
        """Patches as the mechanics of a pad takes them.

        Raises ValueError: these are line loads.
        """
        angle, axial, diameter = self.discs()
        tilt = jnp.zeros_like(self.turn) if self.tilt is None else self.tilt
        numbers = zip(angle, axial, self.force, self.turn, tilt, diameter, strict=True)
        return [PadLoad(a, z, f, t, i, diameter=d) for a, z, f, t, i, d in numbers]


def _rows(x: ArrayLike) -> Array:
    """Numbers as [load, lane]; those that are known without a program of JAX's."""
    if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(x)):
        return jnp.atleast_2d(jnp.asarray(x, float))
    return jnp.asarray(np.atleast_2d(np.asarray(x, float)))


def loads_of(scene: SceneSpec, inputs: Mapping[str, ArrayLike] | None = None) -> Loads:
    """The loads of a scene as `forward` takes them; one that is spread becomes a few points.

    Args:
        scene: its [[load]] tables: lines of a section, or discs of a pad, and pressures.
        inputs: SI values by TOML path that replace the scene's own.

    Raises:
        ConfigError: a body presses on the skin.
        ValueError: a load of a pad is not a disc.
        Float64Error: float64 is off.
    """
    require_float64()
    scene.require_no_bodies("`loads_of`")
    parts = scene_parts(scene, {**continuous_inputs(scene), **(inputs or {})})
    if scene.geometry.dimension == 3:
        return _discs(parts)
    section = parts.skin.geometry.section
    angles, forces, turns = [], [], []
    for load in parts.forces:
        assert isinstance(load, LineLoad)  # all there is in plane strain
        points, weights = np.zeros(1), np.ones(1)
        if load.spread is not None:
            points, weights = spread_points()
        # A vertical force is the inward radial one turned by its angle.
        along = section.direction(load.angle)
        turn = along if load.vertical else load.turn
        half = jnp.zeros(1)
        if load.spread is not None:
            start, end = load.breakpoints(section)
            half = (end - start) / 2
        for x, weight in zip(points, weights, strict=True):
            angles.append(load.angle + x * half)
            forces.append(load.force * weight)
            turns.append(turn + section.direction(angles[-1]) - along)
    angle, force, turn = (_stacked(x) for x in (angles, forces, turns))
    return Loads(angle, force, turn, parts.external_pressure)


def spread_points() -> tuple[np.ndarray, np.ndarray]:
    """Where points stand for a load over an arc, in halves of it, and their shares of it."""
    points, weights = gauss_legendre(SPREAD_POINTS, -1.0, 1.0)
    return points, weights / 2


def _stacked(rows: list[Array]) -> Array:
    return jnp.stack(rows) if rows else jnp.zeros((0, 1))


def _discs(parts: SceneParts) -> Loads:
    """The discs of a pad's scene."""
    columns: list[list[Array]] = [[] for _ in range(6)]
    for load in parts.forces:
        if not isinstance(load, PadLoad) or load.diameter is None:
            raise ValueError(
                "`loads_of` takes round patches of a pad (a diameter); lines and rectangles "
                "are solved by `solve`"
            )
        turn = parts.skin.geometry.section.direction(load.angle) if load.vertical else load.turn
        own = (load.angle, load.axial, load.force, load.diameter, turn, load.tilt)
        for column, number in zip(columns, own, strict=True):
            column.append(number)
    found = Loads.patch(*map(_stacked, columns))
    return dataclasses.replace(found, external_pressure=parts.external_pressure)
