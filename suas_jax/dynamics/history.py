"""A scene's loads over time, on a membrane whose stress relaxes: see `course`."""

import dataclasses
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from suas_jax.config import SceneSpec, with_solve
from suas_jax.dynamics.course import Course, History
from suas_jax.dynamics.film import LEFT_OUT, Film, film_of
from suas_jax.dynamics.history_gradient import (
    history_gradient,
    point_asked,
    record,
    require_derivatives,
)
from suas_jax.dynamics.pad import outside_of
from suas_jax.dynamics.steps import Moment, at_rest, followed_part, through
from suas_jax.dynamics.tr_bdf2 import Moving
from suas_jax.dynamics.transient import film_at_rest, through_film
from suas_jax.mechanics.model import AbstractPlan, Counts
from suas_jax.mechanics.pad.model import PadMesh
from suas_jax.mechanics.registry import MODELS
from suas_jax.mesh.section import measures
from suas_jax.runtime.compiled import COMPILED, require_float64
from suas_jax.scene.build import Structure, plan_for
from suas_jax.scene.curve import contact_of
from suas_jax.scene.program import inputs_of
from suas_jax.scene.report import plain, report_of
from suas_jax.scene.solve import Solution, solve
from suas_jax.scene.sweep import Sweep, SweepError

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


def history_sweep(
    scene: SceneSpec, history: History, gradient: str | None = None, *, film: bool = True
) -> Sweep:
    """Follow a scene through its history.

    The mesh is that of a curve; with bodies and on pads, that of a solve. Its error and the
    model's are those of the elastic solve of the largest load with the long-term law, which
    also says whether `auto` takes the solid; `time_error` adds those of the time steps.

    Args:
        scene: its material's `relaxation` is its memory, without one it answers at once.
        history: its loads over time.
        gradient: a quantity to differentiate by every continuous input, as a path in the
            report of the last row, or of another one: ``points.3.oil_pressure_Pa``.
        film: whether the oil's film moves where the history is fast enough for it; without it
            the skin is in equilibrium at every moment.

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
    asked = None
    if gradient is not None:
        asked = point_asked(gradient, len(history.time), len(scene.loads))
        require_derivatives(course.scene, moves=False)
    moves = film_of(course) if film else LEFT_OUT
    # Without the film the solid would be further off than the shell is with it.
    largest = course.largest
    errors = _Errors.at(with_solve(largest, model="shell") if moves.included else largest)
    fewer = _fewer(course.scene, errors.plan) if moves.included else None
    if fewer is not None:
        errors = _Errors.at(largest, fewer)
    if asked is not None:
        require_derivatives(course.scene, moves=moves.included)
    follower = _Follower(course, errors, moves, len(history.time) <= _FEW)
    points = follower.points()
    shown = [point.pop("shown") for point in points]
    hits = [p for p in points if p["status"] == "converged" and p["wall_contact"]]
    contact = {"t_s": hits[0]["t_s"], **contact_of(hits[0])} if hits else None
    slopes = None if asked is None else follower.gradient(*asked, points)
    return Sweep(points, contact, course.scaled, moves.report(), slopes, shown, errors.plan)


class _Errors(NamedTuple):
    """A mesh, and what the elastic solve of the largest load says of its errors."""

    plan: AbstractPlan  # the mesh
    mesh: float  # relative error by it; NaN where it is not known
    model: float  # the same by the model
    displacement: float = 0.0  # of the solve [m]

    @classmethod
    def at(cls, scene: SceneSpec, pad_counts: Counts | None = None) -> "_Errors":
        """Errors under a scene's loads; on a pad with some elements."""
        held, models = scene.responding("long-term"), MODELS[scene.geometry.dimension]

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
        found = solve(held) if whole else solved(_first_model(scene))
        unmet = found.converged and not (found.report["model_error"] or 0.0) <= rtol
        if not whole and given == "auto" and found.plan.model == "shell" and unmet:
            found = solved("solid")
        report = found.report
        size = report["max_displacement_m"] if found.converged else scene.geometry.mean_gap
        if found.converged and report["error_estimate"] is not None:
            own = report["discretisation_error"], report["model_error"]
            return cls(found.plan, *own, size)
        return cls(found.plan, np.nan, np.nan, size)


def _first_model(scene: SceneSpec) -> str:
    """The model that a history begins with; `auto` goes from the shell to the solid."""
    solid = scene.solve.model == "solid" or scene.solve.mesh is not None
    return "solid" if solid else "shell"


def _fewer(scene: SceneSpec, plan: AbstractPlan) -> Counts | None:
    """Elements of a pad that moves with no more unknowns than it may; None where it does."""
    model, counts = MODELS[plan.dimension][plan.model], plan.counts
    while plan.dimension == 3 and scene.solve.elements is None:
        part = followed_part(plan_for(scene, plan.model, counts))
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

    def gradient(
        self, row: int, path: str, points: list[dict[str, Any]]
    ) -> dict[str, float] | None:
        """Derivatives of a quantity of a row; None where the history does not reach it."""
        own, course = points[: row + 1], self.course
        if any(p["status"] != "converged" for p in own):
            return None
        wall = course.scene.wall.contact and any(p["wall_contact"] for p in own)
        spec = course.scene.responding("instantaneous")
        known = Structure(spec, wall=wall), self.errors.plan, inputs_of(spec)
        rows = course.block(0, row + 1)
        tolerance = np.asarray(_STEP_SHARE * course.scene.rtol)
        peak: Any = {k: x[np.argmax(np.abs(x))] for k, x in course.values.items()}
        taken = record(known, rows, course.apart, peak, tolerance)
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
        mass, part = outside_of(arc, g.width), followed_part(plan)
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
        spec = course.scene.responding("instantaneous")
        known = Structure(spec, wall=wall), self.errors.plan, inputs_of(spec)
        rows = course.block(first, _BLOCK)
        moves = self.film.included
        if moment is None:
            apart, rest = (jax.tree.map(np.asarray, at) for at in (course.apart, course.rest))
            begin = film_at_rest if moves else at_rest
            more = (rest, self._scale(), self._outside()) if moves else ()
            part = known[0], followed_part(known[1]), known[2]
            moment = COMPILED.run(begin, *part, rows.begin[0], apart, *more, once=True)
        moving = _DRIVEN_SHARE if self.driven else _MOTION_SHARE
        share = moving if moves else _STEP_SHARE
        tolerance = np.asarray(share * course.scene.rtol)
        long = moves or self.errors.plan.solves_long
        effort = {"once": long or self.few, "long": long}
        reports, outcomes, last = COMPILED.run(
            through_film if moves else through, *known, rows, moment, tolerance, **effort
        )
        points, shown = [], np.asarray(outcomes.pop("shown"))
        for i in range(int(rows.told.sum())):
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
