"""Loads of rigid bodies with friction, estimated from their readings: docs/load_evidence.md.

    python -m benchmarks.body_touches [--truth FILE] [--seed N]

Cylinders on the paper's section with 40 taxels, balls on the shipped pad with 320: pressed by a
travel at places that are drawn, with friction of 0.5, and dragged by nothing, a little or until
they slide. Readings are those of the shell under the body's own contact, on 96 elements and on
36 x 30, with 2 counts of noise and rounding; the estimate knows lines and discs. The section's
numbers are declared exact, tolerances of the pad are those that are taken where a file states
none. Solving takes some ten seconds a touch on two cores: --truth keeps it.
"""

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.inverse_load import measured, skin_of_taxels, with_tolerances
from benchmarks.pad_touches import SKIN
from fitting.inverse_load.estimator import LoadEstimator
from suas_jax import configure
from suas_jax.config import BodyLoadSpec, SceneSpec, SkinSpec, SolveSpec, load_skin
from suas_jax.scene.solve import solve

_TOUCHES, _DRAWS = 40, 2
_ANGLE, _AXIAL, _TRAVEL = 40.0, 25e-3, (0.8e-3, 3.2e-3)  # largest ones [deg], [m]; range [m]
_RADIUS = (3e-3, 30e-3)  # [m]
_DRAGS = (0.0, 0.05e-3, 0.3e-3)  # [m]
_ELEMENTS: dict[int, Any] = {2: 96, 3: (36, 30)}


def touches(random: np.random.Generator, dimension: int) -> list[dict[str, Any]]:
    """Bodies as scenes have them."""
    found = []
    for k in range(_TOUCHES):
        drag, way = _DRAGS[k % len(_DRAGS)], random.uniform(0, 2 * np.pi)
        own = {
            "shape": "sphere" if dimension == 3 else "cylinder",
            "radius": float(np.exp(random.uniform(*np.log(_RADIUS)))),
            "angle": float(np.deg2rad(random.uniform(-_ANGLE, _ANGLE))),
            "depth": random.uniform(*_TRAVEL),
            "friction": 0.5,
        }
        if dimension == 3:
            own |= {"axial": random.uniform(-_AXIAL, _AXIAL), "drag_axial": drag * np.sin(way)}
            own["drag"] = drag * np.cos(way)
        else:
            own["drag"] = drag * float(np.sign(np.cos(way)))
        found.append(own)
    return found


def solved(spec: SkinSpec, bodies: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What bodies do, where there is an equilibrium: their loads, and readings."""
    skin = {name: getattr(spec, name) for name in spec.model_fields_set}
    elements = _ELEMENTS[spec.geometry.dimension]
    found = []
    for body in bodies:
        how = SolveSpec(model="shell", elements=elements)
        report = solve(SceneSpec(**skin, load=(BodyLoadSpec(**body),), solve=how)).report
        if report["status"] == "converged":
            so = [taxel["so"] for taxel in report["taxels"]]
            found.append({"body": body, "load": report["loads"][0], "so": so})
    return found


def judged(name: str, spec: SkinSpec, rows: list[dict[str, Any]], seed: int) -> None:
    """Print a row of the page's table."""
    pad = spec.geometry.dimension == 3
    every = [row for row in rows for _ in range(_DRAWS)]
    readings = measured(np.array([row["so"] for row in every]), seed)
    statuses: Counter[str] = Counter()
    errors, held, tangents = [], [], []
    for row, estimate in zip(every, LoadEstimator(spec).estimate(readings), strict=True):
        load, body = row["load"], row["body"]
        statuses[f"{len(estimate.contacts)} {estimate.status}"] += 1
        if estimate.status != "ok" or len(estimate.contacts) != 1:
            continue
        (contact,) = estimate.contacts
        # The material that is touched, which has moved along beneath the body.
        touched = (load.get("contact_from_m", 0.0) + load.get("contact_to_m", 0.0)) / 2
        along = contact.arc_position - load["arc_position_m"] - touched
        off = {"angle": along * contact.angle / contact.arc_position}
        off["force"] = contact.force - load["force_N"]
        off |= {"axial": contact.axial - body["axial"]} if pad else {}
        held.append([abs(x) < 1.96 * contact.deviation(key) for key, x in off.items()])
        place = np.hypot(along, off.get("axial", 0.0))
        errors.append([1e3 * place, 100 * abs(off["force"]) / load["force_N"]])
        if contact.arc_force is not None:
            value, deviation = contact.arc_force
            tangents.append(abs(value - load["tangential_force_N"]) < 1.96 * deviation)
    middle, most = np.median(errors, 0), np.max(errors, 0)
    print(
        f"| {name} | {len(every)}: {dict(statuses)} | {middle[0]:.2f}, {most[0]:.1f} mm"
        f" | {middle[1]:.1f}, {most[1]:.0f} % | {100 * np.mean(held):.0f} % |"
        f" {sum(tangents)} of {len(tangents)} |",
        flush=True,
    )


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--truth", type=Path)
    arguments.add_argument("--seed", type=int, default=0)
    given = arguments.parse_args()
    configure()
    skins = {
        "cylinders": with_tolerances(skin_of_taxels(), exact=True),
        "balls": load_skin(SKIN),
    }
    kept = given.truth is not None and given.truth.exists()
    known = json.loads(given.truth.read_text()) if kept else {}
    for name, spec in skins.items():
        if name not in known:
            random = np.random.default_rng(given.seed)
            known[name] = solved(spec, touches(random, spec.geometry.dimension))
            if given.truth is not None:
                given.truth.write_text(json.dumps(known))
        judged(name, spec, known[name], given.seed)


if __name__ == "__main__":
    main()
