"""Bodies that are pressed by a force: the travel at which they carry it.

A solve takes travels; forces grow with them. Close to a power law, they are met by Newton's
method in the logarithms of both, whose derivatives Broyden's formula learns on the way.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from suas_jax.config import SceneSpec
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.outcomes import index_of
from suas_jax.numerics.lanes import number
from suas_jax.scene.structure import Inputs

_TOLERANCE = 1e-11  # of a force
_LOOSE = 1e-9  # where rounding leaves no more
_MOST_RUNS = 60
_FIRST = 0.25  # travel to begin with, in thicknesses
_POWER = 1.5  # with which a force grows with the travel, at first sight
_LONGEST = 1.5  # step of a logarithm

Solved = tuple[dict[str, Any], State, State, State, dict[str, Any]]


def driven_by_force(scene: SceneSpec) -> list[int]:
    """Which loads are bodies that are pressed by a force."""
    return [
        i
        for i, load in enumerate(scene.loads)
        if load.kind == "body" and load.force is not None
    ]


def travels_of(scene: SceneSpec, report: dict[str, Any]) -> dict[str, np.ndarray]:
    """The travels that a report found, as inputs of the scene's program [m]."""
    return {
        f"load.{i}.depth": np.asarray(number(report["loads"][i]["depth_m"]))
        for i in driven_by_force(scene)
    }


def under_forces(
    scene: SceneSpec, inputs: Inputs, start: State, run: Callable[[Inputs, State], Solved]
) -> Solved:
    """Solve a scene whose bodies carry given forces.

    Args:
        scene: the scene.
        inputs: its numbers; travels among them are where to begin.
        start: state to begin with.
        run: solves the scene with given travels.
    """
    paths = {i: f"load.{i}" for i in driven_by_force(scene)}
    wanted = {i: number(inputs[f"{path}.force"]) for i, path in paths.items()}
    loaded = [i for i in paths if wanted[i] > 0]
    target = np.log([wanted[i] for i in loaded])
    first = _FIRST * scene.geometry.mean_thickness
    travel = np.array([number(inputs.get(f"{paths[i]}.depth", first)) for i in loaded])
    x = np.log(np.where(travel > 0, travel, first))
    slope = np.eye(len(loaded)) * _POWER
    best: tuple[float, Solved] | None = None
    before: tuple[np.ndarray, np.ndarray] | None = None
    for _ in range(_MOST_RUNS):
        travels = {f"{path}.depth": np.zeros(()) for path in paths.values()}
        travels |= {
            f"{paths[i]}.depth": np.asarray(value)
            for i, value in zip(loaded, np.exp(x), strict=True)
        }
        found = run({**inputs, **travels}, start)
        forces = np.array([number(found[0]["loads"][i]["force_N"]) for i in loaded])
        if number(found[-1]["result"]) != 0 or not np.all(forces > 0):
            # Not touched yet, or too far at once.
            other = x + np.where(forces > 0, -1.0, 1.0) if before is None else before[0]
            x = other if before is None else (x + other) / 2
            continue
        start, y = found[3], np.log(forces)
        error = float(np.max(np.abs(y - target), initial=0.0))
        if best is None or error < best[0]:
            best = error, found
        elif best[0] < _LOOSE:
            break
        if error < _TOLERANCE:
            break
        if before is not None:
            dx, dy = x - before[0], y - before[1]
            slope = slope + np.outer(dy - slope @ dx, dx) / (dx @ dx)
        before = x, y
        step = np.linalg.solve(slope, target - y)
        x = x + np.clip(step, -_LONGEST, _LONGEST)
    if best is None:
        return found
    error, found = best
    if error > _LOOSE:
        found[-1]["result"] = np.asarray([index_of("no_convergence")])
    return found
