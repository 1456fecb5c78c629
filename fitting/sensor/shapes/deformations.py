"""The membrane's shape in every known state of an experiment.

Known is a load's place and either its force or its displacement. Where the displacement is
known the force is found: Newton's method, with the derivative that the equilibrium gives.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.shapes.press import Meshes, Press, Response, respond
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.equilibrium import State
from suas_jax.equilibrium.outcomes import NAMES, advice
from suas_jax.mechanics.section import NormalFace
from suas_jax.runtime.compiled import COMPILED
from suas_jax.skin.circle import Circle
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.oil import AbstractOil
from suas_jax.skin.section import AbstractSection

# Most and fewest states solved in one call: few sizes, few compiled programs.
_BLOCK, _FEWEST = 256, 8
_NEWTON = 25
_ACCURACY = 1e-10  # of a displacement that is met [m]
_FIRST_FORCE = 1e-3  # N


class NoDeformation(ArithmeticError):  # noqa: N818
    """A known state has no equilibrium; the message says which and why."""


@dataclasses.dataclass(frozen=True)
class Deformed:
    """Solved states."""

    press: Press  # the states
    force: np.ndarray  # on each load, given or found [load, state, N]
    displacement: np.ndarray  # of each load [load, state, m]
    pressure: np.ndarray  # of the oil [state, Pa]
    face: NormalFace  # the deformed inner faces
    state: State  # the equilibria, to start neighbouring ones from


def deform(
    loads: KnownLoads, geometry: SkinGeometry, law: AbstractLaw, oil: AbstractOil
) -> Deformed:
    """Find the shape of the membrane in every state.

    Raises NoDeformation: a state has no equilibrium, or its displacement is not met.
    """
    half_angle = float(geometry.half_angle[0])
    kinks = [float(x[0]) for x in geometry.section.breakpoints]
    meshes = Meshes.under(loads.angle, half_angle, _layer(geometry, law, loads), kinks)
    inner = jnp.asarray(loads.inner, float)[:, None]
    press = Press(meshes, jnp.asarray(loads.angle), jnp.asarray(loads.turn), inner)
    count = loads.states
    size = min(_BLOCK, max(_FEWEST, 1 << (count - 1).bit_length()))
    parts = []
    for begin in range(0, count, size):
        index = np.minimum(np.arange(begin, begin + size), count - 1)
        parts.append(_solve(press.take(index), loads.take(index), geometry, law, oil))
    force = np.concatenate([f for f, _ in parts], -1)[:, :count]
    found = [r for _, r in parts]

    def joined(*xs: Array) -> np.ndarray:
        return np.concatenate(xs, -1)[..., :count]

    state = jax.tree.map(joined, *(r.state for r in found))
    pressure = joined(*(r.pressure for r in found))
    face = jax.tree.map(joined, *(r.face for r in found))
    moved = joined(*(r.displacement for r in found))
    return Deformed(press, force, moved, pressure, face, state)


def _layer(geometry: SkinGeometry, law: AbstractLaw, loads: KnownLoads) -> float:
    """Decay length of the boundary layers as an angle [rad]: an order of magnitude.

    sqrt(D / N) with the bending stiffness D = mu t^3 / 3 and the tension N of the tent that
    a displacement d of the arch's order makes, as in `suas_jax.scene.build.decay_angle`.
    """
    radius, thickness = float(geometry.mid_size[0]), float(geometry.thickness[0])
    mu = float(np.asarray(law.shear_modulus).reshape(-1)[0])
    force = np.nanmedian(np.abs(loads.force)) if np.isfinite(loads.force).any() else np.nan
    if not np.isfinite(force) or force <= 0:
        return min(1.0, 2.0 * np.sqrt(thickness / radius))
    tension = 3 * force / float(geometry.width[0])
    return float(min(1.0, np.sqrt(mu * thickness**3 / (3 * tension)) / radius))


def _solve(
    press: Press, loads: KnownLoads, geometry: SkinGeometry, law: AbstractLaw, oil: AbstractOil
) -> tuple[np.ndarray, Response]:
    """Forces that meet what is known, and the equilibria under them."""
    wanted = np.isfinite(loads.displacement)
    force = np.where(wanted, _FIRST_FORCE * np.sign(loads.displacement), loads.force)
    force = np.nan_to_num(force)
    # By NumPy, as JAX compiles a program for every operation outside of one.
    rest = jax.eval_shape(
        lambda: press.problem(geometry, law, oil, jnp.asarray(force)).mechanics.rest()
    )
    count = loads.states
    zero = jnp.asarray(np.zeros(count))
    start = State(jnp.asarray(np.zeros((*rest.shape[:-1], count))), zero, zero)

    def run(force: np.ndarray, start: State) -> Response:
        response: Response = COMPILED.run(
            respond, press, geometry, law, oil, jnp.asarray(force), start, once=True
        )
        return response

    found = run(force, start)
    if not wanted.any():
        _insist(found, loads, force, geometry.section)
        return force, found
    good, good_found = force, found
    step = np.ones(count)
    for _ in range(_NEWTON):
        missing = np.where(
            wanted, loads.displacement - np.asarray(good_found.displacement), 0.0
        )
        if np.max(np.abs(missing)) < _ACCURACY:
            break
        # Loads whose force is known keep it: their rows and columns drop out.
        compliance = np.moveaxis(np.asarray(good_found.compliance), -1, 0)
        both = wanted.T[:, :, None] & wanted.T[:, None, :]
        matrix = np.where(both, compliance, 0.0)
        diagonal = np.einsum("skk->sk", matrix)
        diagonal[~wanted.T] = 1.0
        change = np.linalg.solve(matrix, missing.T[..., None])[..., 0].T
        force = good + step * change
        found = run(force, good_found.state)
        fine = (np.asarray(found.result) == 0) & np.isfinite(found.displacement).all(0)
        error = np.where(wanted, loads.displacement - np.asarray(found.displacement), 0.0)
        closer = fine & (np.abs(error).max(0) <= np.abs(missing).max(0) + _ACCURACY)
        good = np.where(closer, force, good)
        good_found = jax.tree.map(
            lambda new, old: np.where(closer, new, old),  # noqa: B023
            found,
            good_found,
        )
        step = np.where(closer, np.minimum(1.0, 2 * step), step / 4)
    missing = np.where(wanted, loads.displacement - np.asarray(good_found.displacement), 0.0)
    worst = int(np.argmax(np.abs(missing).max(0)))
    if np.abs(missing[:, worst]).max() > 1e3 * _ACCURACY:
        k = int(np.argmax(np.abs(missing[:, worst])))
        where = place_text(geometry.section, loads.angle[k, worst])
        raise NoDeformation(
            f"load {k} at {where}: no force moves the membrane by "
            f"{1e3 * loads.displacement[k, worst]:.4g} mm (the nearest that was reached is "
            f"{1e3 * float(good_found.displacement[k, worst]):.4g} mm); check the "
            "column's unit and sign, and that the load is one the skin can carry"
        )
    return good, good_found


def place_text(section: AbstractSection, angle: float) -> str:
    """A place as scenes tell it [rad]: of a circle its angle, else the arc from the middle."""
    if isinstance(section, Circle):
        return f"{np.rad2deg(angle):.4g} deg"
    return f"arc {1e3 * float(section.arc(jnp.array([angle]))[0]):.4g} mm"


def _insist(
    found: Response, loads: KnownLoads, force: np.ndarray, section: AbstractSection
) -> None:
    failed = np.flatnonzero(np.asarray(found.result))
    if not failed.size:
        return
    at = failed[0]
    name = NAMES[int(found.result[at])]
    where = ", ".join(
        f"{force[k, at]:.4g} N at {place_text(section, loads.angle[k, at])}"
        for k in range(len(force))
    )
    raise NoDeformation(f"{where}: {name}; check the columns' units. {advice(name)}")
