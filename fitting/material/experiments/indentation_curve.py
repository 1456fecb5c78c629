"""Indentation curves: a skin's curve under a rigid body, and what its other inputs do to it.

A pad is solved at a few travels if a polynomial through them is as good as all.
"""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from fitting.material.data.errors import DataError
from fitting.material.experiments.skin_curve import SkinCurve, Specimen, ratio_of
from suas_jax.config import SceneSpec, with_inputs, with_solve
from suas_jax.config.fields import Spec
from suas_jax.config.input_errors import stresses_of
from suas_jax.constitutive import AbstractLaw
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.outcomes import NAMES, advice
from suas_jax.mechanics.registry import MODELS
from suas_jax.numerics.lanes import number
from suas_jax.scene.build import Structure
from suas_jax.scene.indentation import IndentationCurve, Point
from suas_jax.scene.parts import law_of
from suas_jax.scene.program import inputs_of, prepared, structure_of
from suas_jax.scene.report import plain
from suas_jax.scene.solve import Solution, solve

ZERO = "zero of the travel"
"""Name of what is not an input of the scene: where the body first touches."""
STEPS = {
    "geometry.thickness": 1e-2,
    "geometry.oil_gap": 1e-2,
    "oil.fill": 1e-4,
    "geometry.mounting": 1e-5,
    ZERO: 1e-5,
}
"""Changes that a person thinks in: relative, or as they are, of the zero [m]."""
_ABSOLUTE = ("oil.fill", "geometry.mounting")
_SHARE = 0.1  # of such a change, from which the derivative is told
_NODES = 13  # travels that stand for more of them, and every second for the error
_SMOOTH = 1e-4  # of the largest reading: largest error by what is between them
_NEAR = 1.4  # factor of the modulus within which the scene's own states are starts


def body_specimen(
    scene: SceneSpec, travel: np.ndarray, channel: np.ndarray, value: np.ndarray
) -> Specimen:
    """The forward model of an indentation curve, and the sizes of its material.

    The scene's own material is only where sizes come from. Each reading has its travel [m],
    channel (0 for the force, 1 for oil pressure) and value [N, Pa], each [n].
    Raises DataError: the skin doesn't bear these travels with the scene's material.
    """
    depth = next(f"load.{i}.depth" for i, load in enumerate(scene.loads) if load.kind == "body")
    deepest = float(np.max(travel))
    spec = with_inputs(with_solve(scene, model="shell"), {depth: deepest})
    found = solve(spec)
    if not found.converged:
        raise DataError(
            f"--scene: pressed {1e3 * deepest:.4g} mm deep with its own material the skin's "
            f"status is {found.report['status']}: {found.report['message']}"
        )
    # A section's travels are lanes: they cost little.
    most = _NODES if scene.geometry.dimension == 3 else len(travel)
    levels, weight = nodes_of(travel, most)
    points = _followed(found.scene, found, depth, levels)
    if len(levels) < len(np.unique(travel)) and not _is_smooth(levels, _readings(points)):
        levels, weight = nodes_of(travel, len(travel))
        points = _followed(found.scene, found, depth, levels)
    scaled, scale = found.scene, 1.0
    for _ in range(2):
        known = _readings(points)
        ratio = ratio_of(value, (weight * known[channel]).sum(1), channel)
        if np.isnan(ratio):
            raise DataError(
                "--data indentation: the model's body touches the skin at no travel of the "
                "file; travel counts from the first touch of the undeformed skin"
            )
        if not ratio > 0.0:
            raise DataError(
                "--data indentation: force or oil pressure has the opposite sign of the "
                "model's; both are positive where the body pushes inwards"
            )
        if 1 / _NEAR < ratio < _NEAR:
            break
        scale *= ratio
        scaled = with_inputs(found.scene, _scaled(found.scene, scale))
        points = _followed(scaled, found, depth, levels, [point.part for point in points])
    known_scene = prepared(scaled, "shell", found.plan.counts)
    curve = SkinCurve(
        known_scene.meshes,
        {path: jnp.asarray(x) for path, x in known_scene.inputs.items()},
        jnp.asarray(levels),
        jax.tree.map(lambda *x: jnp.concatenate(x, -1), *(point.part for point in points)),
        jnp.asarray(weight),
        jnp.asarray(channel),
        structure_of(scaled, wall=found.wall),
    )
    law = jax.tree.map(lambda x: x[..., 0], law_of(scaled, curve.inputs))
    last = plain(points[-1].report)
    ends = last["stretch_max"], 1 / last["stretch_min"]
    return Specimen(
        curve,
        float(law.shear_modulus) * ratio,
        max(ends),
        found.report["error_estimate"] or 0.0,
        *_by_inputs(curve, law),
    )


def nodes_of(travel: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Travels at which to solve, and their weights in readings at others [n, level].

    The readings are a polynomial of the travel's root through Chebyshev's points, which follows
    a contact that begins at a point.

    `travel`: of each reading [m], shape [n]. `most`: up to so many different travels are solved
    as they are.
    """
    levels, lane = np.unique(travel, return_inverse=True)
    if len(levels) <= most:
        return levels, np.eye(len(levels))[lane.reshape(-1)]
    ends = np.sqrt(np.maximum(levels[[0, -1]], 0.0))
    nodes = ends[0] + (ends[1] - ends[0]) * (1 - np.cos(np.linspace(0, np.pi, most))) / 2
    return nodes**2, _between(nodes, np.sqrt(np.maximum(travel, 0.0)))


def _between(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Weights of values at nodes in the polynomial through them [x, node]."""
    from scipy.interpolate import barycentric_interpolate  # slow to import

    return np.asarray(barycentric_interpolate(nodes, np.eye(len(nodes)), x))


def _is_smooth(levels: np.ndarray, readings: np.ndarray) -> bool:
    """Whether a polynomial through every second state finds those between.

    With twice as many nodes its error is squared, relative to the largest reading.
    """
    root = np.sqrt(levels)
    found = readings[:, ::2] @ _between(root[::2], root).T
    apart = np.abs(found - readings).max(1) / np.abs(readings).max(1)
    return bool((apart**2 < _SMOOTH).all())


def _readings(points: list[Point]) -> np.ndarray:
    """Force [N] and oil pressure [Pa] of solved states [2, level]."""
    reports = [plain(point.report) for point in points]
    forces = [next(x["force_N"] for x in r["loads"] if "depth_m" in x) for r in reports]
    return np.array([forces, [report["oil_pressure_Pa"] for report in reports]])


def _scaled(scene: SceneSpec, scale: float) -> dict[str, float]:
    """The stress constants of the scene's material, times a factor."""
    return {path: scale * value for path, value in stresses_of(scene).items()}


def _followed(
    scene: SceneSpec,
    found: Solution,
    depth: str,
    levels: np.ndarray,
    starts: Sequence[State] | None = None,
) -> list[Point]:
    """Solutions at all travels, on the mesh of the deepest one.

    Each starts from the state of the one before, or near a given one.
    Raises DataError: there is none at one of them.
    """
    model = MODELS[scene.geometry.dimension]["shell"]
    curve = IndentationCurve(scene, {depth: 1.0}, model, found.plan, found.wall)
    points = curve.follow(levels, found.plan.counts, starts)
    for level, point in zip(levels, points, strict=True):
        result = int(number(point.outcome["result"]))
        if result:
            raise DataError(
                f"--scene: at {1e3 * level:.4g} mm of travel: {NAMES[result]}. "
                f"{advice(NAMES[result])}"
            )
    return points


def _by_inputs(curve: SkinCurve, law: AbstractLaw) -> tuple[tuple[str, ...], np.ndarray]:
    """What the skin's inputs do to the readings; see `Specimen`.

    By differences: on a pad programs of derivatives take longer to compile than ten solves.
    """
    spec = curve.scene.scene
    tables: dict[str, Spec] = {}
    if spec.oil.trapped and spec.oil.fill is None:
        tables["oil"] = spec.oil.model_copy(update={"fill": 1.0})
    if spec.geometry.mounting is None:
        tables["geometry"] = spec.geometry.model_copy(update={"mounting": 0.0})
    spec = spec.model_copy(update=tables)
    inputs = {path: jnp.asarray(x) for path, x in inputs_of(spec).items()} | curve.inputs
    scene = Structure(spec, wall=curve.scene.wall)
    named = dataclasses.replace(curve, inputs=inputs, scene=scene)
    known = named.readings_of(law)
    names, slopes = [], []
    for name, whole in STEPS.items():
        step = _SHARE * whole
        own = {path for path in inputs if path == name or path.startswith(f"{name}.value.")}
        if name == ZERO:
            changed = dataclasses.replace(named, level=named.level + step)
        elif own:
            relative = name not in _ABSOLUTE
            more = {p: inputs[p] + step * (inputs[p] if relative else 1.0) for p in own}
            changed = dataclasses.replace(named, inputs=inputs | more)
        else:
            continue
        names.append(name)
        slopes.append((changed.readings_of(law) - known) / step)
    return tuple(names), np.stack(slopes, 1)
