"""What a user reads off an equilibrium: displacements, gaps, stretches, stability.

Everything here is a smooth function of the state and the inputs (extremes are taken at
the vertex of a parabola through neighbouring samples), so that any of it can be
differentiated.
"""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool

from suas_jax.config import LineLoadSpec, SceneSpec
from suas_jax.constitutive.stability import drucker_modulus
from suas_jax.equilibrium.balance import Problem, State, volume_residual
from suas_jax.mechanics.base import AbstractMechanics, Profile
from suas_jax.numerics.array_types import Lanes
from suas_jax.scene.parts import SceneParts
from suas_jax.sensing.taxels import taxel_names
from suas_jax.skin.geometry import SkinGeometry, outward

_CRUSHED = 1e-3  # stretch of a fibre below which no material follows its law
SAMPLES = 8  # intervals per element in which extremes are sought


def peak(values: Array, *companions: Array) -> tuple[Lanes, ...]:
    """Largest of a sampled function, each element's samples joined by parabolas.

    Parabolas never reach across an element's end, where solutions may have a kink.

    Args:
        values: samples [sample, element, lane].
        companions: functions to evaluate at the same place.

    Returns:
        The largest value and each companion there, per lane.
    """
    samples, elements, lanes = values.shape
    flat = values.reshape(samples * elements, lanes)
    best = jnp.argmax(flat, 0)
    row = jnp.clip(best // elements, 1, samples - 2)
    element, lane = best % elements, jnp.arange(lanes)

    def local(f: Array) -> tuple[Array, Array, Array]:
        f = jnp.broadcast_to(f, values.shape)
        left, middle, right = (f[row + d, element, lane] for d in (-1, 0, 1))
        return middle, (right - left) / 2, left + right - 2 * middle

    middle, slope, bend = local(values)
    curved = jnp.where(bend < 0, bend, -1.0)
    vertex = jnp.where(bend < 0, -slope / curved, jnp.sign(slope))
    x = jnp.clip(vertex, -1.0, 1.0)
    found = [middle + slope * x + bend * x**2 / 2]
    for companion in companions:
        middle, slope, bend = local(companion)
        found.append(middle + slope * x + bend * x**2 / 2)
    return tuple(found)


def _gap(shape: Profile, geometry: SkinGeometry) -> tuple[Lanes, Lanes]:
    """Smallest gap between inner face and wall [m], and its current polar angle [rad]."""
    x, y = geometry.inner_radius * outward(shape.angle) + shape.inner_displacement
    gap = jnp.sqrt(x**2 + y**2) - geometry.wall_radius
    negative, angle = peak(-gap, jnp.arctan2(x, y))
    return -negative, angle


def _away_from_clamps(mechanics: AbstractMechanics, shape: Profile) -> Profile:
    """Hide the stretches where they diverge, next to the clamps."""
    reach = mechanics.clamp_reach
    first, last = shape.angle[0, 0] + reach, shape.angle[-1, -1] - reach
    keep = (shape.angle >= first) & (shape.angle <= last)
    samples, elements, _ = shape.angle.shape
    lowest, highest = jnp.argmax(keep, 0), samples - 1 - jnp.argmax(keep[::-1], 0)
    nearest = jnp.clip(jnp.arange(samples)[:, None, None], lowest, highest)
    seen = jnp.any(keep, 0)

    def hidden(stretch: Array) -> Array:
        kept = jnp.take_along_axis(stretch, nearest, 0)
        return jnp.where(seen, kept, stretch[:1, elements // 2, None])

    return shape._replace(
        inner_stretch=hidden(shape.inner_stretch), outer_stretch=hidden(shape.outer_stretch)
    )


def _material_stable(problem: Problem, shape: Profile) -> Bool[Array, " lane"]:
    """Drucker stability of the fibres at both faces."""
    stretch = jnp.stack([shape.inner_stretch, shape.outer_stretch])
    modulus = drucker_modulus(problem.mechanics.law, stretch, jnp.ones_like(stretch))
    return jnp.all((modulus > 0) & (stretch > _CRUSHED), (0, 1, 2))


def load_observables(parts: SceneParts, problem: Problem, state: State) -> list[dict[str, Any]]:
    """Position, force and displacement of every load, in the order of the file."""
    lines, pressures = iter(parts.lines), iter(parts.pressures)
    entries: list[dict[str, Any]] = []
    for spec in parts.scene.loads:
        if not isinstance(spec, LineLoadSpec):
            entries.append({"pressure_Pa": next(pressures) * state.factor})
            continue
        load = next(lines)
        shape = problem.mechanics.at_angle(state.q, load.angle)
        along = load.direction

        def component(displacement: Array, along: Array = along) -> Lanes:
            return jnp.sum(displacement[:, 0, 0] * along, 0)

        entries.append(
            {
                "angle_deg": jnp.rad2deg(load.angle),
                "arc_position_m": load.angle * parts.skin.geometry.outer_radius,
                "force_N": load.force * state.factor,
                "displacement_m": component(shape.mid_displacement),
                "inner_displacement_m": component(shape.inner_displacement),
            }
        )
    return entries


def taxel_observables(parts: SceneParts, problem: Problem, state: State) -> dict[str, Array]:
    """What the taxels read, a column a quantity [taxel, lane]; empty without electrodes."""
    electrodes = parts.skin.electrodes
    if electrodes is None:
        return {}
    readings = electrodes.read(problem.mechanics, state.q)
    columns = {
        "angle_deg": jnp.rad2deg(electrodes.taxels.angle),
        "axial_m": electrodes.taxels.axial,
        "gap_m": readings.gap,
        "capacitance_F": readings.capacitance,
        "so": readings.so,
    }
    return {name: jnp.broadcast_to(x, readings.gap.shape) for name, x in columns.items()}


def taxel_rows(scene: SceneSpec, columns: Mapping[str, list[float]]) -> list[dict[str, Any]]:
    """One entry a taxel, with the names that logs and the contract give it."""
    if scene.electrodes is None:
        return []
    names = zip(*taxel_names(scene.electrodes), strict=True)
    rows = zip(*columns.values(), strict=True)
    return [
        {"module": module, "taxel": number, **dict(zip(columns, row, strict=True))}
        for (module, number), row in zip(names, rows, strict=True)
    ]


def observe(parts: SceneParts, problem: Problem, state: State) -> dict[str, Any]:
    """Everything a solve reports about a state, in SI units, with a lane axis.

    Args:
        parts: of the scene.
        problem: its discrete problem on the whole membrane.
        state: the equilibrium.
    """
    geometry = parts.skin.geometry
    shape = problem.mechanics.profile(state.q, SAMPLES)
    gap, gap_angle = _gap(shape, geometry)
    moved = largest_displacement(shape)
    shape = _away_from_clamps(problem.mechanics, shape)
    report = {
        "loads": load_observables(parts, problem, state),
        "oil_pressure_Pa": state.pressure,
        "max_displacement_m": moved,
        "min_gap_m": gap,
        "min_gap_angle_deg": jnp.rad2deg(gap_angle),
        "wall_contact": gap <= 0,
        "strain_energy_J": problem.mechanics.strain_energy(state.q) * geometry.width,
        "stretch_min": -peak(-shape.inner_stretch)[0],
        "stretch_max": peak(shape.inner_stretch)[0],
        "material_stable": _material_stable(problem, shape),
        "volume_residual": volume_residual(problem, state),
        "taxels": taxel_observables(parts, problem, state),
    }
    ambient = parts.ambient_pressure
    if ambient is not None:
        report["ambient_pressure_Pa"] = ambient + jnp.zeros_like(state.pressure)
        report["absolute_oil_pressure_Pa"] = ambient + state.pressure
    return report


def largest_displacement(shape: Profile) -> Lanes:
    """Largest magnitude of the inner face's displacement [m]."""
    square = jnp.sum(shape.inner_displacement**2, 0)
    at_rest = square == 0  # where a square root has no derivative
    return peak(jnp.where(at_rest, 0.0, jnp.sqrt(jnp.where(at_rest, 1.0, square))))[0]
