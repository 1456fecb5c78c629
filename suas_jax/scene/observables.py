"""What a user reads off an equilibrium, as smooth functions of the state and the inputs."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from suas_jax.config import SceneSpec
from suas_jax.equilibrium.balance import Problem, State, volume_residual
from suas_jax.equilibrium.correction import corrected_contact, corrected_touch
from suas_jax.mechanics.base import AbstractMechanics
from suas_jax.scene.contact_zone import body_observables, contact_zone
from suas_jax.scene.parts import SceneParts
from suas_jax.skin.body import Body
from suas_jax.skin.loads import DeadLoad, LineLoad


def place_of(parts: SceneParts, name: str, angle: Array) -> dict[str, Array]:
    """A place as scenes tell it, and by arc length where the section is not a plain circle."""
    section = parts.skin.geometry.section
    found = {f"{name}angle_deg": jnp.rad2deg(section.given_angle(angle))}
    if not parts.scene.geometry.is_circle:
        found[f"{name}arc_m"] = section.arc(angle)
    return found


def load_observables(
    parts: SceneParts,  # of the scene
    problem: Problem,  # to read the state with
    state: State,  # to report
    held: AbstractMechanics,  # the membrane with what it touches
    root: State | None,  # see `observe`
) -> list[dict[str, Any]]:
    """Position, force and displacement of every load, in the order of the file."""
    forces, pressures = iter(parts.forces), iter(parts.pressures)
    bodies = iter(parts.bodies)
    geometry = parts.skin.geometry
    section = geometry.section
    entries: list[dict[str, Any]] = []
    placed: list[DeadLoad | Body] = [
        next(bodies if spec.kind == "body" else forces)
        for spec in parts.scene.loads
        if spec.kind != "pressure"
    ]
    moves = enumerate(placed)
    if placed:
        moved = problem.mechanics.under(state.q, placed)
    for spec in parts.scene.loads:
        if spec.kind == "pressure":
            entries.append({"pressure_Pa": next(pressures) * state.factor})
            continue
        own: dict[str, Any]
        k, load = next(moves)
        if isinstance(load, Body):
            way = -load.frame[-1]
            touch = corrected_touch(held, load, state, root)
            balanced = state if root is None else root
            strip = held.strip(balanced.q, load.placed(state.factor))
            own = body_observables(touch, load, state.factor, geometry, strip)
        else:
            way, own = load.direction(section), {"force_N": load.force * state.factor}
        entry = {
            **place_of(parts, "", load.angle),
            "arc_position_m": geometry.outer_arc(load.angle),
            **own,
            "displacement_m": jnp.sum(moved.mid_displacement[:, k] * way, 0),
            "inner_displacement_m": jnp.sum(moved.inner_displacement[:, k] * way, 0),
        }
        if not problem.mechanics.per_width:
            assert not isinstance(load, LineLoad)
            assert load.axial is not None
            entry["axial_m"] = load.axial + jnp.zeros_like(load.angle)
        entries.append(entry)
    return entries


def taxel_observables(parts: SceneParts, problem: Problem, state: State) -> dict[str, Array]:
    """What the taxels read, a column a quantity [taxel, lane]; empty without electrodes."""
    electrodes = parts.skin.electrodes
    if electrodes is None:
        return {}
    readings = electrodes.read(problem.mechanics, state.q)
    columns = {
        **place_of(parts, "", electrodes.taxels.angle),
        "axial_m": electrodes.taxels.axial,
        "gap_m": readings.gap,
        "capacitance_F": readings.capacitance,
        "so": readings.so,
    }
    return {name: jnp.broadcast_to(x, readings.gap.shape) for name, x in columns.items()}


def short_circuits(
    columns: Mapping[str, Array],  # of `taxel_observables`
    tolerance: Array,  # to which the face on a rigid wall is known [m, lane]
) -> dict[str, Array]:
    """The same, without readings where the wall can't tell a gap from none.

    Between its closed points the face of a membrane on the wall lies nanometres off it: the
    capacitance of such a film is no number, and without series layers a taxel there is a
    short circuit.
    """
    parted = ~(columns["gap_m"] <= tolerance)
    read = {name: jnp.where(parted, columns[name], jnp.nan) for name in ("capacitance_F", "so")}
    return {**columns, **read}


def taxel_rows(scene: SceneSpec, columns: Mapping[str, list[float]]) -> list[dict[str, Any]]:
    """One entry a taxel, with the names that logs and the contract give it."""
    if scene.electrodes is None:
        return []
    names = zip(*scene.electrodes.taxel_names, strict=True)
    rows = zip(*columns.values(), strict=True)
    return [
        {"module": module, "taxel": number, **dict(zip(columns, row, strict=True))}
        for (module, number), row in zip(names, rows, strict=True)
    ]


def observe(
    parts: SceneParts, problem: Problem, state: State, root: State | None = None
) -> dict[str, Any]:
    """Everything a solve reports about a state, in SI units, with a lane axis.

    The problem is on the whole membrane; `root` is the equilibrium that the state is a
    first-order correction of, if it is one.
    """
    held, geometry = problem.mechanics, parts.skin.geometry
    if root is not None:
        problem = dataclasses.replace(problem, mechanics=held.around(root.q))
    mechanics = problem.mechanics
    shape = mechanics.shape(state.q)
    gap, bulge = shape.smallest_gap(geometry), shape.bulge(geometry)
    largest = shape.largest_displacement()
    stretch_min, stretch_max = shape.stretch_range()
    energy = mechanics.stored_energy(state.q)
    taxels = taxel_observables(parts, problem, state)
    report = {
        "loads": load_observables(parts, problem, state, held, root),
        "oil_pressure_Pa": state.pressure,
        "max_displacement_m": largest.value,
        **place_of(parts, "max_displacement_", largest.angle),
        "min_gap_m": gap.value,
        **place_of(parts, "min_gap_", gap.angle),
        "bulge_m": bulge.value,
        **place_of(parts, "bulge_", bulge.angle),
        "wall_contact": gap.value <= 0,
        "strain_energy_J": energy * geometry.width if mechanics.per_width else energy,
        "stretch_min": stretch_min,
        "stretch_max": stretch_max,
        "in_domain": shape.in_domain(mechanics.law),
        "material_stable": shape.material_stable(mechanics.law),
        "volume_residual": volume_residual(problem, state),
        "taxels": taxels,
    }
    if held.wall is not None:
        contact = corrected_contact(held, state, root)
        lowest = jnp.minimum(gap.value, jnp.min(contact.gap, (0, 1)))
        tolerance = jnp.maximum(-lowest, 0.0)
        report |= {
            "wall_contact": jnp.any(contact.gap < 0, (0, 1)),
            "wall": contact_zone(contact, geometry),
            "gap_tolerance_m": tolerance,
        }
        electrodes, layer = parts.scene.electrodes, parts.scene.wall.layer
        if electrodes is not None and not electrodes.layers and layer is None:
            # No more than a thousandth of the film: states next to clamps are known far worse.
            most = 1e-3 * geometry.oil_gap
            report["taxels"] = short_circuits(taxels, jnp.minimum(tolerance, most))
    if problem.prestressed:
        found = state if root is None else root
        report["hoop_force_N_per_m"] = held.hoop_force(found.q)
    places = {"max_displacement": largest, "min_gap": gap, "bulge": bulge}
    report |= {f"{k}_axial_m": x.axial for k, x in places.items() if x.axial is not None}
    ambient = parts.ambient_pressure
    if ambient is not None:
        report["ambient_pressure_Pa"] = ambient + jnp.zeros_like(state.pressure)
        report["absolute_oil_pressure_Pa"] = ambient + state.pressure
    return report
