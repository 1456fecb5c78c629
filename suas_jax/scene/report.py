"""What a solve reports: named quantities in SI units, ready for JSON."""

import math
from typing import Any

import jax
import numpy as np

from suas_jax.config import SceneSpec
from suas_jax.equilibrium.outcomes import NAMES, PATH_ENDS, advice
from suas_jax.scene.observables import taxel_rows
from suas_jax.scene.report_keys import REPORT_KEYS
from suas_jax.sensing.converter import Converter


def plain(tree: dict[str, Any], row: int = 0) -> dict[str, Any]:
    """Arrays to Python numbers, one row of them where they have many."""

    def number(x: Any) -> Any:
        if not isinstance(x, (jax.Array, np.ndarray)):
            return x
        value = np.asarray(x).reshape(-1)[row].item()
        return 0.0 if isinstance(value, float) and value == 0 else value  # never -0

    columns = tree.get("taxels", {})
    others = {name: x for name, x in tree.items() if name != "taxels"}
    numbers: dict[str, Any] = jax.tree.map(number, others)
    if columns:
        count = columns["so"].shape[-2]
        rows = {name: np.asarray(x).reshape(-1, count)[row] for name, x in columns.items()}
        numbers["taxels"] = {name: x.tolist() for name, x in rows.items()}
    return numbers


def report_of(
    scene: SceneSpec,  # what was solved
    observed: dict[str, Any],  # of the state
    outcome: dict[str, Any],  # how it was found
    # of the same skin without loads, where it carries stress then
    rest: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """The report of one state, in the order of the contract."""
    kinds = [{"kind": load.kind} for load in scene.loads]
    loads = [kind | load for kind, load in zip(kinds, observed["loads"], strict=True)]
    taxels = taxel_rows(scene, observed.pop("taxels", {}))
    if "wall" in observed:
        taxels = [_short_circuited(taxel) for taxel in taxels]
    if not observed["wall_contact"] or "wall" not in observed:
        # Without the wall a gap that is open has no tolerance, one that is closed no meaning.
        tolerance = observed.get("gap_tolerance_m", 0.0 if scene.wall.contact else None)
        observed |= {"wall": None, "gap_tolerance_m": tolerance}
    report = {
        **_header(scene, observed | {"loads": loads}, outcome, taxels),
        "iterations": outcome["iterations"],
        "unknowns": outcome["unknowns"],
        "taxels": taxels,
    }
    if rest is not None:
        report["rest"] = rest
    return {key: report[key] for key in REPORT_KEYS if key in report}


# Outcomes that leave no state to call stable: it buckles at rest, or its path was given up.
_UNSETTLED = ("unstable", "max_steps")


def _header(
    scene: SceneSpec,
    report: dict[str, Any],
    outcome: dict[str, Any],
    taxels: list[dict[str, Any]],
) -> dict[str, Any]:
    """Status, message and error estimate, ahead of the observables."""
    status = NAMES[outcome["result"]]
    mesh_error, model_error = report.pop("discretisation_error"), report.pop("model_error")
    # Told apart from the model's own, as no other model knows better.
    model_error += report.pop("penetration_error", 0.0)
    error = mesh_error + model_error
    known = bool(np.isfinite(error)) and status == "converged"
    if report["wall"] is not None:
        own = wall_force_error(report, error) if known else None
        report["wall"] = report["wall"] | {"force_error_N": own}
    message = [advice(status)]
    if status != "converged" and scene.solve.oil_pressure is None and outcome["level"] < 1:
        message.append(f"It carries {outcome['level']:.4g} of the load.")
    if status == "converged":
        message.append(outcome["reason"])
        compared = outcome.get("compared", True)
        message += _remarks(scene, report, error if known else None, compared=compared)
    if status == "converged" or status in PATH_ENDS:
        message += _sway(report["stable"], outcome.get("stable_factor"))
    if status == "converged":
        message += _blind(taxels)
    return {
        "model": outcome["model"],
        "dimension": scene.geometry.dimension,
        "status": status,
        "message": " ".join(filter(None, message)),
        "rtol_met": known and error <= scene.rtol,
        **report,
        "stable": bool(report["stable"]) and status not in _UNSETTLED,
        "stable_factor": outcome.get("stable_factor"),
        "error_estimate": error if known else None,
        "discretisation_error": mesh_error if known else None,
        "model_error": model_error if known else None,
    }


def wall_force_error(report: dict[str, Any], error: float) -> float:
    """Estimated error of the force on the wall [N]: that of the loads at first contact.

    Beyond first contact nearly all further load goes into the wall, so its force misses what
    the load at first contact misses. That load is as wrong as displacements and pressure are
    (`error`, relative), and the share of it, whatever the wall carries.
    """
    loads = sum(abs(load.get("force_N", 0.0)) for load in report["loads"])
    return error * max(loads, report["wall"]["force_N"])


def _remarks(
    scene: SceneSpec,
    report: dict[str, Any],
    error: float | None,  # estimated, relative; None for unknown
    *,
    compared: bool,  # whether both meshes by which it is told have a solution
) -> list[str]:
    """What a user should know about a converged state."""
    remarks = []
    if not scene.loads:
        remarks.append("There is no load: this is the skin at rest.")
    if error is None:
        why = "" if compared else ": of two meshes to compare, this one alone has a solution"
        remarks.append(f"The error could not be estimated{why}.")
    elif error > scene.rtol:
        remarks.append(f"Estimated error {error:.1e} exceeds rtol {scene.rtol:.1e}.")
    if report["wall"] is not None:
        remarks.append(_on_wall(report["wall"]["force_N"], report["wall"]["force_error_N"]))
    elif report["wall_contact"]:
        remarks.append(
            "The inner face has passed the wall, which does not hold it (contact = false): "
            "the state is not valid."
        )
    if any(load["zones"] and not load["contact_resolved"] for load in _bodies(report)):
        remarks.append(
            "A body touches less than the mesh resolves: the errors stated are those of its "
            "force, the width of contact and its largest pressure are not known."
        )
    if not report["material_stable"]:
        remarks.append("The material leaves its stability window (see the stretches).")
    return remarks


def _on_wall(force: float, unsure: float | None) -> str:
    """What the wall carries [N], and how well that is known; None for not at all."""
    if unsure is not None and force <= unsure:
        return (
            "The inner face is at first contact with the wall, to within the estimated error: "
            f"the wall carries from nothing to {force + unsure:.2g} N."
        )
    carried = f"The inner face lies on the wall, which carries {force:.4g} N"
    return f"{carried}." if unsure is None else f"{carried} to {unsure:.2g} N."


def _sway(stable: bool, factor: float | None) -> list[str]:
    """What became of a state that is not stable, or was not, beyond a factor on the loads."""
    share = "" if factor is None else f" from {100 * factor:.3g} % of the load on"
    if not stable:
        return [f"The equilibrium is unstable{share}: a real membrane leaves it."]
    if factor is None:
        return []
    return [
        f"The symmetric equilibrium is unstable{share}: this is one of the two mirror images "
        "to which the skin sways."
    ]


def _bodies(report: dict[str, Any]) -> list[dict[str, Any]]:
    return [load for load in report["loads"] if load["kind"] == "body"]


def _short_circuited(taxel: dict[str, Any]) -> dict[str, Any]:
    """A taxel that nothing parts from the membrane reads full scale."""
    if math.isfinite(taxel["so"]):
        return taxel
    return taxel | {"so": float(Converter().full_scale)}


def _blind(taxels: list[dict[str, Any]]) -> list[str]:
    """Which taxels have no reading, where there are such."""
    blind = sum(not math.isfinite(taxel["capacitance_F"]) for taxel in taxels)
    if not blind:
        return []
    return [
        f"{blind} of {len(taxels)} taxels touch the membrane, or lie under a fold of it: they "
        "have no capacitance, a real converter saturates."
    ]
