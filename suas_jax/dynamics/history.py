"""A scene's loads over time, on a membrane whose stress relaxes.

A history is a table::

    t_s,force_N
    0,0
    0.1,20
    60.1,20
    60.2,0

`force_N` is the sum of the loads' magnitudes, as for a curve, `factor` multiplies all loads as
the scene has them; one of them is needed. Between rows it changes linearly; two rows of one
time are a jump. The skin has been at rest before the first row.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from suas_jax.config import SceneSpec, continuous_inputs, with_inputs, with_solve
from suas_jax.config.csv_table import number_in, read_csv_table
from suas_jax.dynamics.steps import Moment, Rows, at_rest, through
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.registry import MODELS
from suas_jax.runtime.compiled import COMPILED
from suas_jax.runtime.precision import require_float64
from suas_jax.scene.curve import total_force
from suas_jax.scene.program import inputs_of
from suas_jax.scene.report import plain, report_of
from suas_jax.scene.solve import Solution, solve
from suas_jax.scene.structure import Structure
from suas_jax.scene.sweep import Sweep, SweepError
from suas_jax.skin.prestress import is_prestressed

MOST_ROWS = 100_000
_COLUMNS = ("force_N", "factor")
# Rows that one call follows, so that histories of any length share one program.
_BLOCK = 8
_FEW = 40
# Error of the stress that a step may make, over the wanted relative error.
_STEP_SHARE = 0.01


class History(NamedTuple):
    """Loads over time.

    Attributes:
        time: of the rows [s], never falling.
        name: of the column.
        values: one for each row.
    """

    time: Float[np.ndarray, " row"]
    name: str
    values: Float[np.ndarray, " row"]


def read_history(file: Path) -> History:
    """Read a history.

    Raises:
        ValueError: a column is missing or unknown, a field is no number, or time falls.
        OSError: the file can't be read.
    """
    table = read_csv_table(file)
    known = ("t_s", *_COLUMNS)
    unknown = [name for name in table.names if name not in known]
    found = [name for name in _COLUMNS if name in table.names]
    if unknown or "t_s" not in table.names or len(found) != 1 or not table.rows:
        listed = ", ".join(table.names) or "none"
        raise ValueError(
            f"{file}: the columns are {listed}; t_s and one of {' and '.join(_COLUMNS)} are "
            "needed, and at least one row"
        )
    if len(table.rows) > MOST_ROWS:
        raise ValueError(f"{file}: {len(table.rows)} rows; at most {MOST_ROWS} are followed")
    rows = np.array([[number_in(text) for text in fields] for _, fields in table.rows])
    for (line, fields), row in zip(table.rows, rows, strict=True):
        if not np.all(np.isfinite(row)):
            raise ValueError(
                f"{file}, line {line}: {','.join(fields)[:80]}: numbers are needed"
            )
    time, values = (rows[:, table.names.index(name)] for name in ("t_s", found[0]))
    falls = np.flatnonzero(np.diff(time) < 0)
    if len(falls):
        line = table.rows[falls[0] + 1][0]
        raise ValueError(f"{file}, line {line}: t_s is less than in the row before")
    return History(time, found[0], values)


def history_sweep(scene: SceneSpec, history: History) -> Sweep:
    """Follow a scene through its history.

    The mesh is that of a curve. Its error and the model's are those of the elastic solve of the
    largest load with the long-term law, which also says whether `auto` takes the solid;
    `time_error` adds those of the time steps.

    Args:
        scene: in plane strain; its material's `relaxation` is its memory, without one it
            answers at once.
        history: its loads over time.

    Returns:
        A report for each row, with `t_s`.

    Raises:
        SweepError: the loads can't be scaled so, or the skin carries stress at rest.
        ValueError: the scene is three-dimensional.
        Float64Error: float64 is off.
    """
    require_float64()
    scene.require_plane_strain("a history")
    scene.require_no_bodies("a history")
    if is_prestressed(scene):
        raise SweepError(
            "a history begins free of stress: take out what gives the skin stress at rest "
            "([oil] fill, [geometry] mounting, [environment] temperature and depth)"
        )
    levels = _levels(scene, history)
    scene = with_solve(scene, oil_pressure=None)
    errors = _Errors.at(scene, float(np.max(np.abs(levels))))
    points = _Follower(scene, errors, len(levels) <= _FEW).points(history.time, levels)
    hits = [p for p in points if p["status"] == "converged" and p["wall_contact"]]
    contact = None
    if hits:
        contact = {
            "t_s": hits[0]["t_s"],
            "force_N": total_force(hits[0]),
            "oil_pressure_Pa": hits[0]["oil_pressure_Pa"],
            "angle_deg": hits[0]["min_gap_angle_deg"],
        }
    return Sweep(points, contact, scene)


def _levels(scene: SceneSpec, history: History) -> np.ndarray:
    """Factors on all loads."""
    if history.name == "factor":
        return history.values
    total = sum(abs(load.force) for load in scene.loads if load.kind in ("line", "patch"))
    if total == 0:
        raise SweepError("there is no load with a force to scale; add [[load]] with force")
    levels: np.ndarray = history.values / total
    return levels


class _Errors(NamedTuple):
    """A mesh, and what the elastic solve of the largest load says of its errors.

    Attributes:
        plan: the mesh.
        mesh: relative error by it; NaN where it is not known.
        model: the same by the model.
    """

    plan: AbstractPlan
    mesh: float
    model: float

    @classmethod
    def at(cls, scene: SceneSpec, level: float) -> "_Errors":
        """Errors under a factor on the loads."""
        inputs = continuous_inputs(scene)
        loads = {
            key: level * value
            for key, value in inputs.items()
            if key.startswith("load.") and key.endswith((".force", ".pressure"))
        }
        held = with_inputs(_responding(scene, "long-term"), loads)

        def solved(name: str) -> Solution:
            model = MODELS[2][name]
            counts = model.given(scene) or model.first_of_sweep(scene)
            mesh = counts[0] if len(counts) == 1 else counts
            meshes = {other.setting: None for other in MODELS[2].values()}
            settings: dict[str, Any] = {**meshes, "model": name, model.setting: mesh}
            return solve(with_solve(held, **settings))

        given, rtol = scene.solve.model, scene.rtol
        found = solved("solid" if given == "solid" or scene.solve.mesh else "shell")
        unmet = found.converged and not (found.report["model_error"] or 0.0) <= rtol
        if given == "auto" and found.plan.model == "shell" and unmet:
            found = solved("solid")
        report = found.report
        if found.converged and report["error_estimate"] is not None:
            return cls(found.plan, report["discretisation_error"], report["model_error"])
        return cls(found.plan, np.nan, np.nan)


def _responding(scene: SceneSpec, response: str) -> SceneSpec:
    """The scene with one of its material's two elastic responses."""
    if scene.material.relaxation is None:
        return scene
    material = scene.material.model_copy(update={"response": response})
    return scene.model_copy(update={"material": material})


@dataclasses.dataclass(frozen=True)
class _Follower:
    """Follows one scene on one mesh.

    Attributes:
        scene: the scene.
        errors: the mesh, and what it leaves.
        few: whether rows take less time to follow than to compile for speed.
    """

    scene: SceneSpec
    errors: _Errors
    few: bool = True

    def points(self, time: np.ndarray, levels: np.ndarray) -> list[dict[str, Any]]:
        """Reports of all rows; with the wall from the block on in which it is reached."""
        begin, first = np.append(time[0], time[:-1]), np.append(0.0, levels[:-1])
        rows = np.stack([begin, time, first, levels])
        points: list[dict[str, Any]] = []
        wall, moment = False, None
        for k in range(0, len(time), _BLOCK):
            own = rows[:, k : k + _BLOCK]
            found, end = self._block(own, moment, wall=wall)
            if not wall and self.scene.wall.contact and any(p["wall_contact"] for p in found):
                wall = True
                found, end = self._block(own, moment, wall=True)
            points += found
            moment = end
        return points

    def _block(
        self, rows: np.ndarray, moment: Moment | None, *, wall: bool
    ) -> tuple[list[dict[str, Any]], Moment]:
        spec = _responding(self.scene, "instantaneous")
        known = Structure(spec, wall=wall), self.errors.plan, inputs_of(spec)
        if moment is None:
            moment = COMPILED.run(at_rest, *known, rows[0, 0], once=True)
        count = rows.shape[1]
        end = rows[1::2, -1:]  # the last row again, without duration
        after = np.concatenate([end[:1], end[:1], end[1:], end[1:]])
        filled = np.concatenate([rows, np.repeat(after, _BLOCK - count, 1)], 1)
        tolerance = np.asarray(_STEP_SHARE * self.scene.rtol)
        reports, outcomes, last = COMPILED.run(
            through, *known, Rows(*filled), moment, tolerance, once=self.few
        )
        points = []
        for i in range(count):
            outcome = plain(outcomes, i)
            errors = {
                "discretisation_error": self.errors.mesh,
                "model_error": self.errors.model,
            }
            told = {"model": self.errors.plan.model, "reason": ""}
            report = report_of(self.scene, plain(reports, i) | errors, outcome | told)
            report["strain_energy_J"] = None  # what dissipates is no stored energy
            report |= {"time_error": outcome["time_error"], "time_steps": outcome["steps"]}
            points.append({"t_s": outcome["t_s"], **report})
        return points, jax.tree.map(jnp.asarray, last)


def history_of(time: Sequence[float], **values: Sequence[float]) -> History:
    """A history from Python: times [s] and one of `force_N` and `factor`.

    Raises:
        ValueError: another name, not one name, or different lengths.
    """
    ((name, given),) = values.items() or (("", ()),)
    if name not in _COLUMNS or len(given) != len(time):
        raise ValueError(f"a value a time is needed, {' or '.join(_COLUMNS)}")
    return History(np.asarray(time, float), name, np.asarray(given, float))
