"""Which model and mesh a scene is solved with, found by solving it."""

import functools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from suas_jax.config import SceneSpec, with_solve
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.outcomes import NAMES, PATH_ENDS, index_of
from suas_jax.mechanics.model import AbstractModel, AbstractPlan, Counts
from suas_jax.mechanics.registry import MODELS
from suas_jax.mesh.section import measures
from suas_jax.numerics.lanes import number
from suas_jax.scene.program import (
    inputs_of,
    meshes_of,
    prepared,
    run_program,
    structure_of,
)
from suas_jax.scene.sway import can_sway, shifted, stable_factor, stressed_last
from suas_jax.scene.travel import driven_by_force, on_the_way, travels_of

# Error of the finer of two meshes over their difference, twice what order two leaves.
FINER_SHARE = 2 / 3
# Stations beneath bodies are rounded to this share of a thickness: mirrored ones shall stay so,
# and a travel and its force, which a coarser mesh tells of each other to 1e-3, shall have one
# mesh, as shall slightly different inputs.
_PLACED = 0.02
_NOTHING = 1e-15  # of a pressure, a force, a displacement [SI]: rounding at rest
# Part of rtol that the model may take: some must be left for the mesh.
_MODEL_SHARE = 0.9
# A coarse mesh's estimate so many times that part stays above it on finer meshes.
_HOPELESS = 1.3
# With which errors under bodies have to fall for a finer mesh to be of use: where the zone of
# contact meets the field of a clamp, they hardly do.
_LEAST_ORDER = 0.75
# Failures of the shell that need not be the solid's: its few fibres may leave the faces
# beyond a limit that more layers keep to; it does not know how thin a membrane is squeezed,
# nor how it shears within a thickness of a clamp, which turns a force found there around or
# leaves nothing of it; its elements are longer than the solid's under a body.
_SOLID_KNOWS = {
    "outside_material_domain": "the shell's faces lie beyond the material's limit",
    "squeezed": "a body presses the membrane against the wall",
    "sharp_body": "a body's tip is sharper than the shell's mesh resolves",
    "body_on_clamp": "the shell lies on a body up to a clamped edge",
    "beyond_model": "what the shell leaves out changes a body's force more than it can tell",
}


class Tried(NamedTuple):
    """A mesh, and the state found there on the part of it that is solved."""

    plan: AbstractPlan
    part: State


class Attempt(NamedTuple):
    """One model on one mesh, in arrays."""

    report: dict[str, Any]  # what is observed, errors included
    state: State  # the equilibrium on the whole membrane
    shown: State  # the state that the report describes, see `Solution`
    outcome: dict[str, Any]  # how it was found
    plan: AbstractPlan  # its mesh
    wall: bool  # whether the wall was there
    part: State  # the equilibrium on the part of the mesh that is solved
    coarsest: Tried  # the smallest mesh tried, with or without the wall as this one
    scene: SceneSpec  # what was solved: on the whole mesh where the skin sways

    @property
    def stable(self) -> bool:
        """Whether it is."""
        return bool(number(self.report["stable"]))

    @property
    def converged(self) -> bool:
        """Whether the equilibrium was found."""
        return number(self.outcome["result"]) == 0

    @property
    def mesh_error(self) -> float:
        """Estimated error by the mesh."""
        return number(self.report["discretisation_error"])

    @property
    def model_error(self) -> float:
        """Estimated error by the model."""
        return number(self.report["model_error"])

    @property
    def at_the_wall(self) -> bool:
        """Whether the inner face reaches the wall, or has passed it."""
        return bool(number(self.report["wall_contact"]))

    def model_too_coarse(self, rtol: float) -> bool:
        """Whether no mesh brings the error below rtol; true of an error that is unknown."""
        return not self.model_error < _MODEL_SHARE * rtol

    @property
    def beyond_shell(self) -> bool:
        """Whether it failed in a way that the solid may not."""
        return number(self.outcome["result"]) in [index_of(name) for name in _SOLID_KNOWS]

    def better_than(self, coarser: "Attempt") -> bool:
        """Whether a finer mesh has helped: zones of contact may move from mesh to mesh."""
        worse = self.mesh_error >= coarser.mesh_error
        return self.converged and not (self.wall and coarser.wall and worse)

    def mesh_excess(self, rtol: float) -> float:
        """Error by the mesh over the one allowed; infinite where it is unknown."""
        return self._over(self.mesh_error, rtol)

    def parts_of_excess(self, rtol: float) -> tuple[float, ...]:
        """The same for each mesh that it was compared with; under bodies, for another solve."""
        parts = self.report.get("key_quantities", {}).get("by_mesh")
        if not parts:
            return (self.mesh_excess(rtol),)
        return tuple(self._over(number(part), rtol) for part in parts)

    def _over(self, error: float, rtol: float) -> float:
        left = rtol if self.model_too_coarse(rtol) else rtol - self.model_error
        return error / left if np.isfinite(error) else np.inf


def choose(scene: SceneSpec, *, once: bool) -> tuple[Attempt, str]:
    """Solve with the model that the scene asks for, and say why it is that one.

    Where the symmetric equilibrium is unstable, the one to which the skin sways is returned if
    there is one, on the whole mesh. Of a path that ends, too, it is said where stability does.
    """
    found, reason = _choose(scene, once=once)
    judged = found.converged or NAMES[int(number(found.outcome["result"]))] in PATH_ENDS
    if found.stable or not judged or scene.solve.oil_pressure is not None:
        return found, reason
    name, counts = found.plan.model, found.plan.counts
    reached = number(found.outcome["level"])
    factor = stable_factor(scene, name, counts, reached, wall=found.wall, once=once)
    if found.converged and can_sway(scene, found.plan.meshes()):
        aside = with_solve(scene, symmetry=False, model=name)
        given = MODELS[scene.geometry.dimension][name].given(scene)
        swayed = _attempt(aside, name, given, once=once, aside=True)
        if swayed.converged and swayed.stable:
            found = swayed
    return found._replace(outcome=found.outcome | {"stable_factor": factor}), reason


def _choose(scene: SceneSpec, *, once: bool) -> tuple[Attempt, str]:
    model, rtol = scene.solve.model, scene.rtol
    models = MODELS[scene.geometry.dimension]
    if model != "auto":
        return _attempt(scene, model, models[model].given(scene), once=once), ""
    given = {name: m.given(scene) for name, m in models.items()}
    for name, counts in reversed(given.items()):
        if counts is not None:
            found = _attempt(scene, name, counts, once=once)
            return found, f"The mesh given is that of the {name}."
    shell = _attempt(scene, "shell", None, once=once)
    for result, why in _SOLID_KNOWS.items():
        if number(shell.outcome["result"]) == index_of(result):
            solid = _attempt(scene, "solid", None, once=once, wall=shell.wall, known=shell)
            if solid.converged:
                return solid, f"Solid chosen: {why}."
            return shell, "The solid did not converge."
    if not shell.converged:
        return shell, "The shell did not converge; the solid would follow the same path."
    if not shell.model_too_coarse(rtol) and shell.mesh_excess(rtol) <= 1:
        return shell, _shell_chosen(shell, rtol)
    at_the_wall = shell.at_the_wall and scene.wall.contact
    solid = _attempt(scene, "solid", None, once=once, wall=at_the_wall, known=shell)
    if not solid.converged:
        if np.isnan(shell.mesh_error) or (at_the_wall and not shell.wall):
            alone = with_solve(scene, model="shell")
            shell = _attempt(alone, "shell", None, once=once, wall=at_the_wall)
            shell = shell._replace(scene=scene)
        return shell, f"{_shell_chosen(shell, rtol)} The solid did not converge."
    if not (shell.model_too_coarse(rtol) or solid.mesh_error < shell.mesh_error):
        return shell, f"{_shell_chosen(shell, rtol)} The solid's mesh error is no smaller."
    if solid.wall == shell.wall:
        solid = solid._replace(coarsest=shell.coarsest)
    return solid, f"Solid chosen: {_shell_rejected(shell, rtol)}"


def _shell_rejected(shell: Attempt, rtol: float) -> str:
    if shell.model_too_coarse(rtol):
        stated = f"the corrected shell's model error, estimated as {shell.model_error:.1e},"
        return f"{stated} leaves the mesh too little of rtol {rtol:.1e}."
    stated = f"the mesh error of the shell's finest mesh, estimated as {shell.mesh_error:.1e},"
    return f"{stated} is more than rtol {rtol:.1e} leaves."


def _shell_chosen(shell: Attempt, rtol: float) -> str:
    return (
        f"Corrected shell chosen: its model error is estimated as {shell.model_error:.1e}, "
        f"rtol is {rtol:.1e}."
    )


def _attempt(
    scene: SceneSpec,
    name: str,
    given: Counts | None,
    *,
    once: bool,
    wall: bool = False,
    aside: bool = False,
    known: Attempt | None = None,
) -> Attempt:
    """Solve with one model, on the mesh given or on finer ones until `rtol` is met.

    The wall is left out until the membrane reaches it: a state without it whose gap is open
    is one with it, and most scenes need no program that knows contact. `aside` seeks the
    branch to which a symmetric skin sways. Where bodies touch, and how far forces press them,
    is known from the mesh tried last, or from what is `known`.
    """
    model, rtol = MODELS[scene.geometry.dimension][name], scene.rtol
    counts = given or model.first(scene)
    coarsest: Tried | None = None
    coarser: Attempt | None = None
    wanted: Counts | None = None
    last = 0.0  # error of the mesh before, times its elements to the power of the least order
    # A body that goes so far would go through the wall, were it not there.
    deep = any((body.depth or 0.0) > scene.geometry.mean_gap for body in scene.bodies)
    wall = wall or (scene.wall.contact and deep)
    if scene.bodies:  # whose error is that between two meshes
        wanted, counts = counts, model.coarser(counts)
    while True:
        slid = _slid(scene, coarser or known)
        plan, meshes, inputs, rest = prepared(scene, name, counts, slid)
        static = structure_of(scene, wall=wall)
        program = functools.partial(run_program, static, meshes, once=once)
        begun, slopes = coarser or known, None
        if begun is not None and begun.converged:
            inputs = inputs | travels_of(scene, begun.report)
            slopes = begun.outcome.get("slopes")
        start = (
            None
            if coarser is None
            else carried(model, coarser.state, coarser.plan, meshes.solved)
        )
        if aside and start is None:
            moved = shifted(scene, inputs)
            start = program(moved, rest, judged=False)[3]
        refined = coarser is not None and coarser.converged and coarser.wall == wall
        until_wall = scene.wall.contact and not wall
        run = functools.partial(program, until_wall=until_wall, refined=refined, slopes=slopes)
        solved = run(inputs, start or rest)
        failed = number(solved[-1]["result"]) != 0 and scene.solve.oil_pressure is None
        if failed and start is None:
            solved = stressed_last(scene, inputs, rest, run, solved)
        report, state, shown, part, outcome = solved
        coarsest = coarsest or Tried(plan, part)
        found = Attempt(report, state, shown, outcome, plan, wall, part, coarsest, scene)
        again = coarser is not None and coarser.plan.counts == counts
        if scene.bodies and coarser is not None and coarser.wall == wall and not again:
            before: dict[str, Any] | None = coarser.report
            if driven_by_force(scene):
                before = _at_travels_of(found, scene, coarser, once=once)
            found.outcome["compared"] = before is not None
            error = np.nan if before is None else difference(scene, before, found.report)
            found.report["discretisation_error"] = error
        if coarser is not None and not found.better_than(coarser):
            compared = coarser.mesh_excess(rtol) < np.inf  # else it was to be compared with
            if not compared and found.beyond_shell:
                return found
            coarser.outcome["compared"] = compared
            return coarser
        # Where another model is tried next, a finer mesh of this one is wasted.
        other_next = scene.solve.model == "auto" and name == "shell" and not given
        other_next = other_next and found.converged and found.model_too_coarse(rtol)
        if found.at_the_wall and scene.wall.contact and not (wall or other_next):
            wall, coarsest = True, None
            if scene.bodies:
                wanted, counts = counts, model.coarser(counts)
            continue
        coarser = found
        if other_next and found.model_error > _HOPELESS * _MODEL_SHARE * rtol:
            return found
        if scene.bodies and found.converged and wanted is not None:
            # Two meshes tell an error if both have stations where bodies touch.
            if slid or not any(_slid(scene, found)):
                counts, wanted = wanted, None
            continue
        excess = found.mesh_excess(rtol)
        if given or other_next or not found.converged or excess <= 1:
            return found
        finer = model.finer(counts, found.parts_of_excess(rtol))
        wasted = scene.bodies and 0 < last / counts[0] ** _LEAST_ORDER < excess < np.inf
        if finer is None or wasted:
            return found
        last, counts = excess * counts[0] ** _LEAST_ORDER, finer


def _slid(scene: SceneSpec, found: Attempt | None) -> tuple[float, ...]:
    """Angle from where each body comes in to what it touches [rad]; none if one lies flat."""
    if found is None or not found.converged or scene.geometry.dimension == 3:
        return ()
    thickness = scene.geometry.mean_thickness
    outer = measures(scene).size + thickness / 2
    step = _PLACED * thickness / outer
    slid = []
    for spec, load in zip(scene.loads, found.report["loads"], strict=True):
        if spec.kind == "body":
            ends = number(load["contact_from_m"]), number(load["contact_to_m"])
            if ends[1] - ends[0] > thickness:
                return ()
            slid.append(step * round(sum(ends) / 2 / outer / step))
    return tuple(slid)


def _at_travels_of(
    found: Attempt, scene: SceneSpec, coarser: Attempt, *, once: bool
) -> dict[str, Any] | None:
    """What a coarser mesh reports at the finer one's travels; None without a solution there."""
    meshes = meshes_of(scene, coarser.plan)
    travels, before = (travels_of(scene, at.report) for at in (found, coarser))
    inputs, start = inputs_of(scene) | travels, coarser.part
    static = structure_of(scene, wall=coarser.wall)
    if len(scene.bodies) == 1 and (depth := float(travels.get("load.0.depth", 0.0))):
        start = on_the_way(scene, start, float(before["load.0.depth"]) / depth)
    solved = run_program(static, meshes, inputs, start, once=once, travels_given=True)
    return solved[0] if number(solved[-1]["result"]) == 0 else None


def difference(scene: SceneSpec, a: dict[str, Any], b: dict[str, Any]) -> float:
    """Relative error of the finer of two meshes by what both say of bodies and oil.

    Errors of forces fall with the square of the elements' length at least.
    """
    largest = number(b["max_displacement_m"])
    pairs = [(a["oil_pressure_Pa"], b["oil_pressure_Pa"], number(b["oil_pressure_Pa"]))]
    for spec, old, new in zip(scene.loads, a["loads"], b["loads"], strict=True):
        if spec.kind == "body":
            pairs.append((old["force_N"], new["force_N"], number(new["force_N"])))
        elif spec.kind != "pressure":
            pairs.append((old["displacement_m"], new["displacement_m"], largest))
    pairs.append((a["max_displacement_m"], b["max_displacement_m"], largest))
    sizes = [abs(number(x) - number(y)) / abs(z) for x, y, z in pairs if not abs(z) <= _NOTHING]
    return FINER_SHARE * float(np.max(sizes, initial=0.0))  # NaN where one is


def carried(
    model: AbstractModel, state: State, plan: AbstractPlan, target: AbstractPlan
) -> State | None:
    """A state on one mesh as a start on another one; None where the model can't carry it."""
    q = model.carried(np.asarray(state.q), plan, target)
    return None if q is None else state._replace(q=jnp.asarray(q))
