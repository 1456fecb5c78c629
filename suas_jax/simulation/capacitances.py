"""Capacitances of a skin's taxels: along a load path, and at rest under a scene's loads."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from suas_jax.acquisition.baseline import Baseline
from suas_jax.config import SceneSpec, continuous_inputs
from suas_jax.runtime.compiled import COMPILED, jit
from suas_jax.runtime.settings import configure
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import SPREAD_POINTS, Loads, loads_of, spread_points
from suas_jax.scene.parts import SkinStructure
from suas_jax.scene.skin import Skin, skin_of
from suas_jax.scene.solve import solve
from suas_jax.simulation.load_path import LoadPath, skin_behind
from suas_jax.simulation.pad_frames import (
    NoSolutionError,
    no_solution,
    pad_capacitances,
    pad_path,
    same_mesh,
)
from suas_jax.simulation.remembering import followed_pad, followed_section
from suas_jax.skin.plain import clamped_edge
from suas_jax.skin.section import AbstractSection

# Frames solved in one call, and the shape that is compiled.
_BLOCK = 256
# Of a section's even mesh: with 32, a calibration from such a log is off by two of its
# standard errors.
_ELEMENTS = 128


def capacitances(
    path: LoadPath,  # loads over time
    time: NDArray[np.float64],  # of the frames [s]
    # called with the number of frames done
    progress: Callable[[int], None] = lambda done: None,
) -> NDArray[np.float64]:
    """Capacitance of every taxel along a load path [frame, taxel] [F].

    Raises NoSolutionError: some loads have no equilibrium.
    """
    if path.scene.material.relaxation is not None:
        return _remembering(path, time, progress)
    if path.scene.geometry.dimension == 3:
        return pad_capacitances(path, time, progress)
    scene, moved, run = path.scene, path.surroundings(time), jit(forward)
    (free, held), loads = _section(path, time)
    blocks = []
    for begin in range(0, len(time), _BLOCK):
        index = np.minimum(np.arange(begin, begin + _BLOCK), len(time) - 1)
        block = Loads(*(x[..., index] for x in _fields(loads)))
        here = {k: x[index] for k, x in moved.items()}
        output = run(_at(scene, free, here), block)
        # The program that knows contact is compiled where the membrane reaches the wall.
        if held.wall is not None and bool(jnp.any(output.min_gap < 0)):
            output = run(_at(scene, held, here), block)
        failed = np.flatnonzero(np.asarray(output.result))
        if failed.size:
            raise no_solution(time[index[failed[0]]], output.result[failed[0]])
        blocks.append(np.asarray(output.readings.capacitance).T)
        progress(min(begin + _BLOCK, len(time)))
    return np.concatenate(blocks)[: len(time)]


def _at(scene: SceneSpec, skin: Skin, surroundings: dict[str, NDArray[np.float64]]) -> Skin:
    """The skin in its surroundings, a lane a frame; as it is where these do not change."""
    if not surroundings:
        return skin
    numbers = {path: np.asarray(x, float) for path, x in continuous_inputs(scene).items()}
    found: Skin = COMPILED.run(
        _lanes, SkinStructure(scene), skin, numbers, surroundings, once=True
    )
    return found


@eqx.filter_jit
def _lanes(
    file: SkinStructure, skin: Skin, numbers: dict[str, Array], changed: dict[str, Array]
) -> Skin:
    contact = skin.wall is not None

    def one(changed: dict[str, Array]) -> Skin:
        own = {**numbers, **changed}
        made = skin_of(file.spec, own, contact=contact, elements=_ELEMENTS)
        return jax.tree.map(lambda x: x[..., 0] if eqx.is_array(x) else x, made)

    found: Skin = eqx.filter_vmap(one, out_axes=eqx.if_array(-1))(changed)
    return found


def _section(path: LoadPath, time: NDArray[np.float64]) -> tuple[tuple[Skin, Skin], Loads]:
    """A section without and with its wall, and its loads, a lane a frame."""
    free = skin_of(path.scene, contact=False, elements=_ELEMENTS)
    held = skin_of(path.scene, elements=_ELEMENTS)
    section, end = free.geometry.section, float(free.geometry.half_angle[0])
    loads = _loads(path, time, section)
    if loads.angle.size and float(jnp.max(jnp.abs(loads.angle))) >= end:
        _, edge = clamped_edge(path.scene.geometry, by_arc=not path.scene.geometry.has_angle)
        raise ValueError(f"a load leaves the skin, which ends at {edge}")
    return (free, held), loads


def _remembering(
    path: LoadPath, time: NDArray[np.float64], progress: Callable[[int], None]
) -> NDArray[np.float64]:
    """The same of a material that relaxes, followed along the rows between frames, too."""
    path = dataclasses.replace(path, scene=path.scene.responding("instantaneous"))
    moments = path.moments(time)
    frames = np.searchsorted(time, moments, "right")  # done by then
    follow = _along_pad if path.scene.geometry.dimension == 3 else _along_section
    found = follow(path, moments, lambda done: progress(int(frames[done - 1])))
    return found[np.searchsorted(moments, time)]


def _along_section(
    path: LoadPath, moments: NDArray[np.float64], progress: Callable[[int], None]
) -> NDArray[np.float64]:
    skins, loads = _section(path, moments)
    return followed_section(path.scene, skins, path.times(moments), loads, progress)


def _along_pad(
    path: LoadPath, moments: NDArray[np.float64], progress: Callable[[int], None]
) -> NDArray[np.float64]:
    scene, moved, plans = pad_path(path, moments)
    if not all(same_mesh(plan, plans[0]) for plan in plans):
        raise ValueError(
            "loads move over a pad whose material relaxes, which is not followed: keep their "
            "places, or take `relaxation` out of [material]"
        )
    return followed_pad(scene, plans[0], path.times(moments), moved, progress)


def _fields(loads: Loads) -> tuple[jnp.ndarray, ...]:
    return loads.angle, loads.force, loads.turn, loads.external_pressure


def _loads(path: LoadPath, time: NDArray[np.float64], section: AbstractSection) -> Loads:
    """The scene's loads with what the path moves, a lane a frame."""
    base, values = loads_of(path.scene), path.at(time)
    frames = len(time)
    angle, force, turn, _ = (
        np.array(np.broadcast_to(x, (*x.shape[:-1], frames))) for x in _fields(base)
    )
    pressure, row = np.zeros(frames), 0
    for i, load in enumerate(path.scene.loads):
        if load.kind == "pressure":
            pressure += values.get(f"loads.{i}.pressure_Pa", load.pressure)
            continue
        assert load.kind == "line"  # all there is in plane strain
        if load.spread is not None:
            points = slice(row, row + SPREAD_POINTS)
            if (told := values.get(f"loads.{i}.force_N")) is not None:
                force[points] = spread_points()[1][:, None] * told
            row += SPREAD_POINTS
            continue
        if (told := values.get(f"loads.{i}.angle_deg")) is not None:
            angle[row] = section.from_given_angle(jnp.deg2rad(told))
        elif (told := values.get(f"loads.{i}.arc_m")) is not None:
            angle[row] = section.from_arc(jnp.asarray(told))
        force[row] = values.get(f"loads.{i}.force_N", force[row])
        if load.direction == "vertical":
            turn[row] = section.direction(jnp.asarray(angle[row]))
        if f"loads.{i}.direction_deg" in values:
            turn[row] = np.deg2rad(values[f"loads.{i}.direction_deg"])
        row += 1
    return Loads(*(jnp.asarray(x) for x in (angle, force, turn, pressure)))


def static_state(scene: SceneSpec) -> tuple[NDArray[np.float64], list[float]]:
    """Capacitance of every taxel at rest under a scene's loads [F], and each load's force [N].

    Raises NoSolutionError: the scene has no equilibrium.
    """
    report = solve(scene).report
    if report["status"] != "converged":
        raise NoSolutionError(f"{report['status']}. {report['message']}")
    forces = [load.get("force_N", 0.0) for load in report["loads"]]
    return np.array([taxel["capacitance_F"] for taxel in report["taxels"]]), forces


def rest_pattern(skin: Path, like: Baseline) -> NDArray[np.float64]:
    """Model counts at rest [module, taxel], arranged as in a baseline; NaN where unknown.

    The skin is that of a skin file, a scene or a load path; loads are left out. Raises
    ConfigError: the file can't be used; ValueError: it has no electrodes.
    """
    configure()
    spec = skin_behind(skin)
    tables = {name: getattr(spec, name) for name in type(spec).model_fields}
    report = solve(SceneSpec(**{k: v for k, v in tables.items() if v is not None})).report
    rest = np.full_like(like.so, np.nan)
    if not report.get("taxels"):
        raise ValueError(f"{skin}: no [electrodes]: nothing to compare with")
    for taxel in report["taxels"]:
        row = np.flatnonzero(like.modules == taxel["module"])
        if row.size and taxel["taxel"] <= rest.shape[1]:
            rest[int(row[0]), taxel["taxel"] - 1] = taxel["so"]
    return rest
