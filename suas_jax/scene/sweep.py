"""Load-displacement curves: levels, columns, and the model and mesh that meet `rtol`."""

import csv
import dataclasses
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from suas_jax.config import SceneSpec, with_inputs, with_solve
from suas_jax.files.writing import write_text
from suas_jax.mechanics.model import AbstractPlan, Counts
from suas_jax.mechanics.registry import MODELS
from suas_jax.runtime.compiled import require_float64
from suas_jax.scene.curve import Curve, SwayedCurve, total_force
from suas_jax.scene.indentation import IndentationCurve
from suas_jax.scene.sway import can_sway
from suas_jax.scene.travel import shares_of_travel

# Observables of a point that go into the table.
_COLUMNS = (
    "oil_pressure_Pa",
    "max_displacement_m",
    "min_gap_m",
    "min_gap_angle_deg",
    "min_gap_arc_m",
    "wall_contact",
    "strain_energy_J",
    "stretch_min",
    "stretch_max",
    "stable",
    "status",
)


class SweepError(ValueError):
    """The sweep can't be made of this scene; the message says why and what to do."""


@dataclasses.dataclass(frozen=True)
class Sweep:
    """A load-displacement curve.

    Attributes:
        points: one report per load, as `suas solve --json` prints them.
        first_contact: load at which the inner face first reaches the rigid wall, or None.
        scene: what was swept.
        film: of a history, whether the oil's film moves in it, and why; None of a curve.
        gradient: of a history, derivatives of the quantity that was asked for, by TOML path.
        shown: of a history, unknowns of the state that each report describes.
        plan: of a history, the mesh that they belong to.
    """

    points: list[dict[str, Any]]
    first_contact: dict[str, float] | None
    scene: SceneSpec
    film: dict[str, Any] | None = None
    gradient: dict[str, float] | None = None
    shown: list[np.ndarray] | None = None
    plan: AbstractPlan | None = None

    def rows(self) -> list[dict[str, Any]]:
        """The curve as a table: total force, each load's entries, the main observables."""
        rows = []
        for point in self.points:
            row = {"t_s": point["t_s"]} if "t_s" in point else {}
            row["force_N"] = total_force(point)
            for i, load in enumerate(point["loads"]):
                row |= {f"loads.{i}.{key}": load[key] for key in load if key != "kind"}
            wall = point["wall"]
            row["wall_force_N"] = wall["force_N"] if wall else 0.0
            rows.append(row | {key: point[key] for key in _COLUMNS if key in point})
        return rows

    def write_csv(self, path: Path) -> None:
        """Write the table; column names carry the SI units."""
        rows = self.rows()
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
        write_text(path, text.getvalue())


def sweep(
    scene: SceneSpec,
    *,
    forces: Sequence[float] | None = None,
    oil_pressures: Sequence[float] | None = None,
    depths: Sequence[float] | None = None,
) -> Sweep:
    """Follow a scene's equilibrium through rising loads, whose pattern is the scene's.

    Args:
        scene: the scene.
        forces: sums of the line loads' magnitudes, in the order to visit [N].
        oil_pressures: instead of forces: all loads are scaled until the oil reaches these
            pressures above ambient, all of one sign, in the order to visit [Pa].
        depths: instead of forces: travels of the body that is pressed in most, those of others
            in proportion, in the order to visit [m].

    Returns:
        A report for each point, and the first contact with the wall if there is one.

    Raises:
        SweepError: the loads can't be scaled so, or the values are not allowed.
        TypeError: not exactly one of forces, oil pressures and depths is given.
        Float64Error: float64 is off.
    """
    require_float64()
    if sum(x is not None for x in (forces, oil_pressures, depths)) != 1:
        raise TypeError("sweep: give one of forces, oil_pressures and depths")
    if depths is not None:
        return depth_sweep(scene, depths)
    if scene.bodies:
        raise SweepError(
            "bodies are pressed by their own depth or force, which is not scaled; sweep their "
            "travel with --depth"
        )
    if forces is not None:
        return force_sweep(scene, forces)
    assert oil_pressures is not None
    return pressure_sweep(scene, oil_pressures)


def force_sweep(scene: SceneSpec, forces: Sequence[float]) -> Sweep:
    """Scale the line loads through given total forces, see `sweep`.

    Raises SweepError: the scene has no force to scale, or forces aren't finite and >= 0.
    """
    lines = {
        f"load.{i}.force": load.force
        for i, load in enumerate(scene.loads)
        if load.kind in ("line", "patch")
    }
    total = sum(abs(force) for force in lines.values())
    if total == 0:
        raise SweepError("there is no load with a force to scale; add [[load]] with force")
    values = _checked(forces, "--force")
    top = float(values.max()) or total
    scaled = with_inputs(scene, {key: f * top / total for key, f in lines.items()})
    scaled = with_solve(scaled, oil_pressure=None)
    return _sweep(scaled, values / top)


def pressure_sweep(scene: SceneSpec, pressures: Sequence[float]) -> Sweep:
    """Scale all loads so that the oil goes through given pressures, see `sweep`.

    Raises SweepError: the oil is vented, no load is there to scale, or signs differ.
    """
    values = np.asarray(pressures, float)
    sign = -1.0 if (values < 0).any() else 1.0
    values = _checked(values, "--oil-pressure", sign)
    largest = values[np.argmax(np.abs(values))]
    if largest == 0:
        raise SweepError("--oil-pressure: at least one pressure must differ from zero")
    wanted = with_solve(scene, oil_pressure=float(largest))
    return _sweep(wanted, values)


def depth_sweep(scene: SceneSpec, depths: Sequence[float]) -> Sweep:
    """Press bodies through given travels, all other loads kept, see `sweep`.

    Every point starts from the one before. Model and mesh are those that the deepest point
    needs; errors are told by a second curve on a coarser mesh. Raises SweepError: no body has a
    depth, or depths aren't finite.
    """
    own = {
        f"load.{i}.depth": load.depth
        for i, load in enumerate(scene.loads)
        if load.kind == "body" and load.depth is not None
    }
    if not own:
        raise SweepError("there is no body with a depth to change; give a [[load]] a depth")
    values = np.asarray(depths, float)
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise SweepError(f"--depth: finite values are needed, got {values}")
    shares = shares_of_travel(own)
    deepest = float(values[np.argmax(np.abs(values))]) or 1e-3
    pressed = with_inputs(scene, {path: share * deepest for path, share in shares.items()})
    curve = IndentationCurve.of(pressed, shares)
    points = curve.points(values)
    return Sweep(points, curve.first_contact(values, points), scene)


def _checked(
    values: Sequence[float] | np.ndarray, option: str, sign: float = 1.0
) -> np.ndarray:
    array = np.asarray(values, float)
    if array.size == 0 or not np.all(np.isfinite(array)) or (sign * array < 0).any():
        raise SweepError(f"{option}: finite values of one sign are needed, got {array}")
    return array


def _sweep(scene: SceneSpec, levels: np.ndarray) -> Sweep:
    rtol, automatic = scene.rtol, scene.solve.model == "auto"
    models = MODELS[scene.geometry.dimension]
    given = {name: model.given(scene) for name, model in models.items()}
    name: str = scene.solve.model
    if automatic:
        name = next((n for n in reversed(given) if given[n] is not None), "shell")
    best = _Attempt.of(scene, name, given[name] or models[name].first_of_sweep(scene), levels)
    while True:
        solid_is_left = automatic and name == "shell" and not given[name]
        solid_is_left = solid_is_left and models["solid"].for_curves
        # A model that has to do is not asked for more than its own error.
        excess = best.error / max(rtol, 0.0 if solid_is_left else 1.1 * best.model_error)
        wrong_model = best.model_error > rtol
        refined = excess > 1 and not (given[name] or (solid_is_left and wrong_model))
        counts = models[name].finer(best.curve.plan.counts, (excess,)) if refined else None
        finer = None if counts is None else _Attempt.of(scene, name, counts, levels)
        if finer is not None and finer.error < best.error:
            best = finer
        elif solid_is_left and (excess > 1 or wrong_model):
            name = "solid"
            best = _Attempt.of(scene, name, models[name].first_of_sweep(scene), levels)
        else:
            return Sweep(best.points, best.curve.first_contact(levels, best.points), scene)


class _Attempt(NamedTuple):
    """A load-displacement curve on one mesh."""

    curve: Curve  # the mesh and the states found
    points: list[dict[str, Any]]  # reports at the levels

    @classmethod
    def of(cls, scene: SceneSpec, model: str, counts: Counts, levels: np.ndarray) -> Self:
        """Follow the curve, and the skin where it sways."""
        curve = Curve(scene, model, counts)
        points = curve.points(levels)
        lost = any(p["status"] == "converged" and not p["stable"] for p in points)
        if lost and can_sway(scene, curve.meshes):
            swayed = SwayedCurve(scene, model, counts)
            found = swayed.points(levels)
            if all(p["status"] == "converged" for p in found):
                return cls(swayed, found)
        return cls(curve, points)

    @property
    def error(self) -> float:
        """Largest of the points' estimates."""
        return self._largest("error_estimate")

    @property
    def model_error(self) -> float:
        """Largest of the points' errors by the model."""
        return self._largest("model_error")

    def _largest(self, key: str) -> float:
        return max((p[key] for p in self.points if p[key] is not None), default=0.0)
