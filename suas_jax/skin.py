"""The whole forward model: a skin and its loads to sensor output.

    skin -> geometry, law, oil, electrodes        (built once)
    loads -> equilibrium -> gap -> capacitance -> SO

Unlike `solve`, which makes a mesh for one scene and estimates its error, a `Skin` has one
fixed mesh for loads anywhere on the arc: a load lies inside an element and slides from
one to the next, so one compiled program serves every load, in batches, and derivatives
by a load's angle are exact for that mesh.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from suas_jax._types import Lanes
from suas_jax.config import LineLoadSpec, SceneSpec, SkinSpec, structure
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium import Problem, State, equilibrium
from suas_jax.geometry import SkinGeometry
from suas_jax.loads import LineLoad, LoadPoints
from suas_jax.mechanics.shell import Shell
from suas_jax.oil import AbstractOil
from suas_jax.sensing import Electrodes


class Loads(eqx.Module):
    """Line loads on a skin, a number of them at once and any number of cases in lanes.

    Attributes:
        angle: where they act, from the symmetry axis [rad].
        force: total over the width, positive inwards [N].
        turn: counter-clockwise rotation of the force from the inward radial [rad].
    """

    angle: Float[Array, "load #lane"]
    force: Float[Array, "load #lane"]
    turn: Float[Array, "load #lane"]


class Skin(eqx.Module):
    geometry: SkinGeometry
    law: AbstractLaw
    oil: AbstractOil
    electrodes: Electrodes
    stations: np.ndarray

    def problem(self, loads: Loads) -> Problem:
        angles = self.stations[:, None] * self.geometry.half_angle
        inside = jnp.clip(
            jnp.sum(loads.angle >= angles[1:-1, None], 0), 0, len(self.stations) - 2
        )
        select = (jnp.arange(len(self.stations) - 1)[:, None, None] == inside).astype(float)
        start = jnp.sum(select * angles[:-1, None], 0)
        end = jnp.sum(select * angles[1:, None], 0)
        line = LineLoad(loads.angle, loads.force, loads.turn)
        force = loads.force * line.direction / self.geometry.width
        points = LoadPoints(select, (loads.angle - start) / (end - start), force)
        shell = Shell.build(self.geometry, self.law, angles, points, symmetric=False)
        return Problem(shell, self.oil, jnp.zeros(1), None)
