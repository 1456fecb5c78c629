"""A scene's loads over time, on a membrane whose stress relaxes.

A history is a table::

    t_s,force_N
    0,0
    0.1,20
    60.1,20
    60.2,0

`force_N` is the sum of the loads' magnitudes, as for a curve, `factor` multiplies all loads as
the scene has them, `depth_m` is the travel of the body that is pressed in most and
`temperature_degC` that of the whole skin; one of them at least is needed. What no column names
stays as the scene has it. Between rows everything changes linearly; two rows of one time are a
jump. The skin has been at rest before the first row.
"""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from suas_jax.config import SceneSpec, continuous_inputs, with_inputs, with_solve
from suas_jax.config.csv_table import number_in, read_csv_table
from suas_jax.dynamics.driven import FACTOR, responding
from suas_jax.dynamics.film import Film, film_of
from suas_jax.dynamics.history_gradient import history_gradient, reason_against, record
from suas_jax.dynamics.pad import outside_of
from suas_jax.dynamics.steps import Moment, Rows, at_rest, through
from suas_jax.dynamics.tr_bdf2 import Moving
from suas_jax.dynamics.transient import film_at_rest, moving_part, through_film
from suas_jax.mechanics.model import AbstractPlan, Counts
from suas_jax.mechanics.pad.model import PadMesh
from suas_jax.mechanics.registry import MODELS
from suas_jax.mesh.section import measures
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.precision import require_float64
from suas_jax.scene.build import plan_for
from suas_jax.scene.curve import total_force
from suas_jax.scene.program import inputs_of
from suas_jax.scene.report import plain, report_of
from suas_jax.scene.solve import Solution, solve
from suas_jax.scene.structure import Structure
from suas_jax.scene.sweep import Sweep, SweepError
from suas_jax.scene.travel import driven_by_force

MOST_ROWS = 100_000
_TEMPERATURE, _WARMTH, _FREEZING = "temperature_degC", "environment.temperature", 273.15
_COLUMNS = ("force_N", "factor", "depth_m", _TEMPERATURE)
_CHOICE = f"at least one of force_N (or factor), depth_m and {_TEMPERATURE}"
_NOTHING = {
    "force_N": "there is no load with a force to scale; add [[load]] with force",
    "depth_m": "there is no body with a depth to change; give a [[load]] a depth",
    _TEMPERATURE: "the scene has no temperature to change; give [environment] a temperature",
}
# Rows that one call follows, so that histories of any length share one program.
_BLOCK = 8
_FEW = 40
# Error of the stress that a step may make, over the wanted relative error; of displacements in
# motion, whose errors fade with it.
_STEP_SHARE, _MOTION_SHARE = 0.01, 0.03
# Unknowns of a pad in motion, whose equations have a dense inverse.
_MOST_MOVING = 1_300
# Displacement that counts before there is a larger one, over that of the largest load.
_FIRST_SHARE = 0.01
# The same where a body's travel says how far the skin will be moved; what it hits rings, and a
# step shall not be as short as that.
_DRIVEN_SHARE, _FIRST_DRIVEN = 0.3, 1.0


class History(NamedTuple):
    """Loads over time."""

    time: Float[np.ndarray, " row"]  # of the rows [s], never falling
    columns: dict[str, Float[np.ndarray, " row"]]  # values by name, one for each row


def read_history(file: Path) -> History:
    """Read a history.

    Raises ValueError: a column is missing or unknown, a field is not a number, or time falls;
    OSError: the file can't be read.
    """
    table = read_csv_table(file)
    found = [name for name in table.names if name != "t_s"]
    if "t_s" not in table.names or not _allowed(found) or not table.rows:
        listed = ", ".join(table.names) or "none"
        raise ValueError(
            f"{file}: the columns are {listed}; t_s and {_CHOICE} are needed, and a row"
        )
    if len(table.rows) > MOST_ROWS:
        raise ValueError(f"{file}: {len(table.rows)} rows; at most {MOST_ROWS} are followed")
    rows = np.array([[number_in(text) for text in fields] for _, fields in table.rows])
    for (line, fields), row in zip(table.rows, rows, strict=True):
        if not np.all(np.isfinite(row)):
            raise ValueError(
                f"{file}, line {line}: {','.join(fields)[:80]}: numbers are needed"
            )
    columns = dict(zip(table.names, rows.T, strict=True))
    time = columns.pop("t_s")
    falls = np.flatnonzero(np.diff(time) < 0)
    if len(falls):
        line = table.rows[falls[0] + 1][0]
        raise ValueError(f"{file}, line {line}: t_s is less than in the row before")
    return History(time, columns)


def _allowed(names: Sequence[str]) -> bool:
    """Whether columns go together."""
    known = bool(names) and len(set(names)) == len(names) and set(names) <= set(_COLUMNS)
    return known and not {"factor", "force_N"} <= set(names)


def history_sweep(scene: SceneSpec, history: History, gradient: str | None = None) -> Sweep:
    """Follow a scene through its history.

    The mesh is that of a curve; with bodies and on pads, that of a solve. Its error and the
    model's are those of the elastic solve of the largest load with the long-term law, which
    also says whether `auto` takes the solid; `time_error` adds those of the time steps.

    Args:
        scene: its material's `relaxation` is its memory, without one it answers at once.
        history: its loads over time.
        gradient: a quantity to differentiate by every continuous input, as a path in the
            report of the last row, or of another one: ``points.3.oil_pressure_Pa``.

    Returns:
        A report for each row, with `t_s`.

    Raises:
        SweepError: the scene has nothing that the history could change, or has friction; or
            the history has no derivatives.
        UnknownQuantityError: there is no such quantity to differentiate.
    """
    require_float64()
    if any(body.friction is not None for body in scene.bodies):
        raise SweepError("friction is modelled for monotone loading only: take it out")
    scene = with_solve(scene, oil_pressure=None)
    course = Course.of(scene, history)
    errors = _Errors.at(course.largest)
    changes = course.time, course.values, course.rest
    film = film_of(course.scene, errors.plan, *changes)
    fewer = _fewer(course.scene, errors.plan) if film.included else None
    if fewer is not None:
        errors = _Errors.at(course.largest, fewer)
    follower = _Follower(course, errors, film, len(history.time) <= _FEW)
    asked = None if gradient is None else follower.asked(gradient)
    points = follower.points()
    shown = [point.pop("shown") for point in points]
    hits = [p for p in points if p["status"] == "converged" and p["wall_contact"]]
    contact = None
    if hits:
        contact = {
            "t_s": hits[0]["t_s"],
            "force_N": total_force(hits[0]),
            "oil_pressure_Pa": hits[0]["oil_pressure_Pa"],
            "angle_deg": hits[0]["min_gap_angle_deg"],
        }
    slopes = None if asked is None else follower.gradient(*asked, points)
    return Sweep(points, contact, course.scaled, film.report(), slopes, shown, errors.plan)


class Course(NamedTuple):
    """A scene and how its numbers change."""

    scene: SceneSpec  # at full load
    time: Float[np.ndarray, " row"]  # of the rows [s]
    # of a factor on all loads, or of inputs by their paths; one a row each
    values: dict[str, Float[np.ndarray, " row"]]
    rest: dict[str, float]  # the values before the first row

    @classmethod
    def of(cls, scene: SceneSpec, history: History) -> Self:
        """That of a history: a factor if nothing but all loads change, together.

        Raises SweepError: the scene has nothing that a column changes.
        """
        columns = history.columns
        shares = {name: _driven(scene, name) for name in columns if name != "factor"}
        for name, found in shares.items():
            if not found:
                raise SweepError(_NOTHING[name])
        loads = _load_inputs(scene)
        alone = set().union(*shares.values()) | (set(loads) if "factor" in columns else set())
        others = set(loads) - alone
        together = len(columns) == 1 and not others and not driven_by_force(scene)
        if together and _TEMPERATURE not in columns:
            ((name, values),) = columns.items()
            if name == "factor":
                return cls(scene, history.time, {FACTOR: values}, {FACTOR: 0.0})
            top = float(values[np.argmax(np.abs(values))]) or 1.0
            full = with_inputs(scene, {k: share * top for k, share in shares[name].items()})
            return cls(full, history.time, {FACTOR: values / top}, {FACTOR: 0.0})
        factor = columns.get("factor", np.ones(len(history.time)))
        driven = {key: factor * value for key, value in loads.items()}
        for name, found in shares.items():
            offset = _FREEZING if name == _TEMPERATURE else 0.0
            driven |= {key: share * columns[name] + offset for key, share in found.items()}
        rest = dict.fromkeys(loads, 0.0)
        if _TEMPERATURE in columns:
            rest[_WARMTH] = float(driven[_WARMTH][0])
        return cls(scene, history.time, driven, rest)

    @property
    def scaled(self) -> SceneSpec:
        """The scene by whose inputs derivatives are: at a factor of one, or the largest."""
        return self.scene if FACTOR in self.values else self.largest

    @property
    def largest(self) -> SceneSpec:
        """The scene with the largest value of everything that changes."""
        known = continuous_inputs(self.scene)
        if FACTOR in self.values:
            level = float(np.max(np.abs(self.values[FACTOR])))
            loads = {key: level * known[key] for key in _load_inputs(self.scene)}
            return with_inputs(self.scene, loads)
        middle = {_WARMTH: self.scene.reference.temperature}
        peak = {
            key: float(x[np.argmax(np.abs(x - middle.get(key, 0.0)))])
            for key, x in self.values.items()
        }
        return with_inputs(self.scene, peak)

    def block(self, first: int, count: int) -> tuple[Rows, int]:
        """Some rows, and how many of them there are; the last one is repeated to fill up."""
        index = np.minimum(np.arange(first, first + count), len(self.time) - 1)
        before = np.maximum(index - 1, 0)
        more = np.arange(first, first + count) >= len(self.time)
        begin = np.where(more, self.time[index], self.time[before])
        start = {
            key: np.where(index == 0, self.rest[key], np.where(more, x[index], x[before]))
            for key, x in self.values.items()
        }
        end = {key: x[index] for key, x in self.values.items()}
        found = jax.tree.map(jnp.asarray, (begin, self.time[index], start, end))
        return Rows(*found), int(np.sum(~more))


def _load_inputs(scene: SceneSpec) -> dict[str, float]:
    """Sizes of all loads, by the paths of their inputs."""
    known = continuous_inputs(scene)
    ends = (".force", ".pressure", ".depth")
    return {k: x for k, x in known.items() if k.startswith("load.") and k.endswith(ends)}


def _driven(scene: SceneSpec, column: str) -> dict[str, float]:
    """Which inputs a column changes, and by how much for every unit of it."""
    if column == _TEMPERATURE:
        known = scene.environment is not None and scene.environment.temperature is not None
        return {_WARMTH: 1.0} if known else {}
    loads = _load_inputs(scene)
    if column == "depth_m":
        own = {key: x for key, x in loads.items() if key.endswith(".depth")}
        top = max(map(abs, own.values()), default=0.0)
        return {key: x / top if top else 1.0 for key, x in own.items()}
    total = sum(abs(x) for key, x in loads.items() if key.endswith(".force"))
    # What presses from all sides goes with the forces, as along a curve.
    ends = (".force", ".pressure")
    return {k: x / total for k, x in loads.items() if k.endswith(ends)} if total else {}


class _Errors(NamedTuple):
    """A mesh, and what the elastic solve of the largest load says of its errors."""

    plan: AbstractPlan  # the mesh
    mesh: float  # relative error by it; NaN where it is not known
    model: float  # the same by the model
    displacement: float = 0.0  # of the solve [m]

    @classmethod
    def at(cls, scene: SceneSpec, pad_counts: Counts | None = None) -> "_Errors":
        """Errors under a scene's loads; on a pad with some elements."""
        held, models = responding(scene, "long-term"), MODELS[scene.geometry.dimension]

        def solved(name: str) -> Solution:
            model = models[name]
            counts = model.given(scene) or model.first_of_sweep(scene)
            mesh = counts[0] if len(counts) == 1 else counts
            meshes = {other.setting: None for other in models.values()}
            settings: dict[str, Any] = {**meshes, "model": name, model.setting: mesh}
            return solve(with_solve(held, **settings))

        given, rtol = scene.solve.model, scene.rtol
        # What bodies touch asks for meshes of its own, as finely as a solve finds them.
        pad = scene.geometry.dimension == 3
        if pad and (scene.solve.model == "solid" or scene.solve.mesh):
            raise SweepError(
                '--history follows pads as thin shells: use solve.model = "auto" or "shell", '
                "and elements instead of mesh"
            )
        if pad:
            held = with_solve(held, model="shell", elements=pad_counts or scene.solve.elements)
        whole = bool(scene.bodies) or pad
        found = (
            solve(held)
            if whole
            else solved("solid" if given == "solid" or scene.solve.mesh else "shell")
        )
        unmet = found.converged and not (found.report["model_error"] or 0.0) <= rtol
        if not whole and given == "auto" and found.plan.model == "shell" and unmet:
            found = solved("solid")
        report = found.report
        size = report["max_displacement_m"] if found.converged else scene.geometry.mean_gap
        if found.converged and report["error_estimate"] is not None:
            own = report["discretisation_error"], report["model_error"]
            return cls(found.plan, *own, size)
        return cls(found.plan, np.nan, np.nan, size)


def _fewer(scene: SceneSpec, plan: AbstractPlan) -> Counts | None:
    """Elements of a pad that moves with no more unknowns than it may; None where it does."""
    model, counts = MODELS[plan.dimension][plan.model], plan.counts
    while plan.dimension == 3 and scene.solve.elements is None:
        part = moving_part(scene, plan_for(scene, plan.model, counts))
        if math.prod(part.unknowns_shape) <= _MOST_MOVING:
            break
        counts = model.coarser(counts)
    return None if counts == plan.counts else counts


@dataclasses.dataclass(frozen=True)
class _Follower:
    """Follows one scene on one mesh."""

    course: Course  # the scene, and how it changes
    errors: _Errors  # the mesh, and what it leaves
    film: Film  # whether it moves
    few: bool = True  # whether rows take less time to follow than to compile for speed

    @property
    def driven(self) -> bool:
        """Whether a body's travel moves the skin."""
        return any(body.force is None for body in self.course.scene.bodies)

    def points(self) -> list[dict[str, Any]]:
        """Reports of all rows; with the wall from the block on in which it is reached."""
        points: list[dict[str, Any]] = []
        held, moment = self.course.scene.wall.contact, None
        wall = False
        for first in range(0, len(self.course.time), _BLOCK):
            found, end = self._block(first, moment, wall=wall)
            if not wall and held and any(p["wall_contact"] for p in found):
                wall = True
                found, end = self._block(first, moment, wall=True)
            points += found
            moment = end
        return points

    def asked(self, quantity: str) -> tuple[int, str]:
        """Row and path of a quantity to differentiate.

        Raises SweepError: there is no such row, or the history has no derivatives.
        """
        known = Structure(responding(self.course.scene, "instantaneous")), self.errors.plan
        reason = reason_against(*known, self.film.included)
        if reason is not None:
            raise SweepError(f"--gradient: this history can't be differentiated: {reason}")
        count = len(self.course.time)
        if not quantity.startswith("points."):
            return count - 1, quantity
        number, _, path = quantity.removeprefix("points.").partition(".")
        if not (number.isdecimal() and int(number) < count and path):
            raise SweepError(
                f'--gradient "{quantity[:80]}": points.0 to points.{count - 1} are there, each '
                "with the quantities of `suas solve`, for example "
                f"points.{count - 1}.oil_pressure_Pa"
            )
        return int(number), path

    def gradient(
        self, row: int, path: str, points: list[dict[str, Any]]
    ) -> dict[str, float] | None:
        """Derivatives of a quantity of a row; None where the history does not reach it."""
        own, course = points[: row + 1], self.course
        if any(p["status"] != "converged" for p in own):
            return None
        wall = course.scene.wall.contact and any(p["wall_contact"] for p in own)
        spec = responding(course.scene, "instantaneous")
        known = Structure(spec, wall=wall), self.errors.plan, inputs_of(spec)
        rows, _ = course.block(0, row + 1)
        tolerance = np.asarray(_STEP_SHARE * course.scene.rtol)
        peak: Any = {k: x[np.argmax(np.abs(x))] for k, x in course.values.items()}
        taken = record(known, rows, course.rest, peak, tolerance)
        return None if taken is None else history_gradient(known, taken, path)

    def _scale(self) -> np.ndarray:
        """Displacement that counts before there is a larger one [m]."""
        share = _FIRST_DRIVEN if self.driven else _FIRST_SHARE
        return np.asarray(share * self.errors.displacement)

    def _outside(self) -> np.ndarray:
        """Added mass of the water outside a pad; nothing of a section, which knows its own."""
        plan, spec = self.errors.plan, self.course.scene
        if plan.dimension == 2:
            return np.zeros((0, 0))
        found, g = measures(spec), spec.geometry
        arc = 2 * found.half_angle * (found.size + g.mean_thickness / 2)
        mass, part = outside_of(arc, g.width), moving_part(spec, plan)
        assert isinstance(part, PadMesh)
        for axis, mirrored in enumerate(part.plan.mirrored):
            if mirrored:  # the part has half of what even harmonics sweep, and no odd ones
                odd = np.arange(len(mass)) % 2 == 1
                mass = 2 * np.where(odd[:, None] if axis == 0 else odd, 0.0, mass)
        return mass

    def _block(
        self, first: int, moment: Moment | Moving | None, *, wall: bool
    ) -> tuple[list[dict[str, Any]], Moment | Moving]:
        course = self.course
        spec = responding(course.scene, "instantaneous")
        known = Structure(spec, wall=wall), self.errors.plan, inputs_of(spec)
        rows, count = course.block(first, _BLOCK)
        moves = self.film.included
        if moment is None:
            values = {key: np.asarray(x) for key, x in course.rest.items()}
            begin = film_at_rest if moves else at_rest
            more = (self._scale(), self._outside()) if moves else ()
            moment = COMPILED.run(begin, *known, rows.begin[0], values, *more, once=True)
        moving = _DRIVEN_SHARE if self.driven else _MOTION_SHARE
        share = moving if moves else _STEP_SHARE
        tolerance = np.asarray(share * course.scene.rtol)
        long = moves or self.errors.plan.solves_long
        effort = {"once": long or self.few, "long": long}
        reports, outcomes, last = COMPILED.run(
            through_film if moves else through, *known, rows, moment, tolerance, **effort
        )
        points, shown = [], np.asarray(outcomes.pop("shown"))
        for i in range(count):
            outcome = plain(outcomes, i)
            errors = {
                "discretisation_error": self.errors.mesh,
                "model_error": self.errors.model,
            }
            told = {"model": self.errors.plan.model, "reason": ""}
            report = report_of(course.scene, plain(reports, i) | errors, outcome | told)
            report["strain_energy_J"] = None  # what dissipates is not stored energy
            report |= {"time_error": outcome["time_error"], "time_steps": outcome["steps"]}
            points.append({"t_s": outcome["t_s"], **report, "shown": shown[i]})
        return points, jax.tree.map(jnp.asarray, last)


def history_of(time: Sequence[float], **values: Sequence[float]) -> History:
    """A history from Python: times [s] and any columns that a file may have.

    Raises:
        ValueError: another name, none, or different lengths.
    """
    columns = {name: np.asarray(x, float) for name, x in values.items()}
    if not _allowed(list(columns)) or any(len(x) != len(time) for x in columns.values()):
        raise ValueError(f"a value a time is needed for {_CHOICE}")
    return History(np.asarray(time, float), columns)
