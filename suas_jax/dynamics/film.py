"""Whether the oil's film moves in a history, or is left out."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from suas_jax.config import ConfigError, SceneSpec, with_solve
from suas_jax.dynamics.course import Course
from suas_jax.dynamics.driven import FACTOR
from suas_jax.dynamics.inertia import densities_of
from suas_jax.dynamics.modes import STATIC_ERROR, modes

# Error by the film's lag that a history without it may have, over the wanted relative error.
_SHARE = 0.1


class Film(NamedTuple):
    """Whether the oil's film moves in a history."""

    included: bool  # whether it does; else the skin is in equilibrium at every moment
    message: str  # the same as a sentence, with the reason
    # below it statics is right to 1 % at rest [Hz]; None where it is not known
    bandwidth: float | None = None

    def report(self) -> dict[str, Any]:
        """As `suas sweep --history --json` prints it."""
        return {
            "included": self.included,
            "message": self.message,
            "bandwidth_Hz": self.bandwidth,
        }


LEFT_OUT = Film(False, "The film's inertia and viscosity are left out, as was asked.")


def film_of(course: Course) -> Film:
    """Decide for a history.

    An equilibrium lags behind its loads by the time that its bandwidth tells, and the more the
    thinner the film is.
    """
    scene = course.scene
    reason = _not_covered(scene) or _jumps(*course)
    if reason is not None:
        return Film(False, f"The film's inertia and viscosity are left out: {reason}.")
    bare = scene.model_copy(update={"loads": ()})
    elements = scene.solve.elements if scene.geometry.dimension == 3 else None
    resting = with_solve(bare, oil_pressure=None, elements=elements)
    bandwidth = modes(resting, 1).bandwidth
    if bandwidth is not None and _lag(bandwidth, *course[1:]) <= _SHARE * scene.rtol:
        slow = f"the history is slow against {bandwidth:.3g} Hz, the bandwidth of statics"
        return Film(False, f"The film's inertia and viscosity are left out: {slow}.", bandwidth)
    return Film(True, "The film's inertia and viscosity are included.", bandwidth)


def _not_covered(scene: SceneSpec) -> str | None:
    try:
        densities_of(scene)
    except ConfigError as error:
        keys = ", ".join(mistake.key for mistake in error.mistakes)
        return f"the scene has no {keys}"
    if scene.geometry.sheets:
        return f"geometry.{scene.geometry.sheets[0]} varies along the axis"
    if not scene.oil.trapped:
        return "vented oil flows through an outlet that no file describes"
    if scene.solve.model == "solid" or scene.solve.mesh is not None:
        return 'they are modelled for shells only: use solve.model = "shell"'
    return None


def _jumps(
    scene: SceneSpec,
    time: Float[np.ndarray, " row"],
    values: Mapping[str, Float[np.ndarray, " row"]],
    rest: Mapping[str, float],
) -> str | None:
    """Why what moves can't follow: a rigid body that is somewhere else at once."""
    driven = any(body.force is None for body in scene.bodies)
    at_once = np.diff(time, prepend=time[0]) == 0
    for key, x in values.items():
        comes = np.diff(x, prepend=rest[key]) > 0
        travel = key.endswith(".depth") or (key == FACTOR and driven)
        if travel and np.any(at_once & comes):
            return (
                "a body's travel jumps, which what has a mass can't follow: give it a time, "
                "beginning with a row of depth 0"
            )
    return None


def _lag(
    bandwidth: float,
    time: Float[np.ndarray, " row"],
    values: Mapping[str, Float[np.ndarray, " row"]],
    rest: Mapping[str, float],
) -> float:
    """Largest error of an equilibrium, relative to the largest value; a jump is fast."""
    behind = STATIC_ERROR / (2 * np.pi * bandwidth)
    took = np.diff(time, prepend=time[0])
    lag = 0.0
    for key, x in values.items():
        change = np.abs(np.diff(x, prepend=rest[key]))
        size, moves = np.max(np.abs(x - rest[key])), change > 0
        if np.any(took[moves] == 0):
            return float(np.inf)
        if np.any(moves):
            lag = max(lag, behind * float(np.max(change[moves] / took[moves])) / size)
    return lag
