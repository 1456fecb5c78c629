"""Rigid bodies on sections that nobody has tuned anything for.

    python -m benchmarks.random_bodies [--scenes N] [--seed S] [--kinds KIND ...]

N scenes of each kind (see `KINDS`), solved from rest with the shell on 64 elements and the wall
there: thickness 0.4 to 4 mm, radius 30 to 100 mm, gap 2 to 8 mm, bodies anywhere within 70
degrees of the crown, travels up to 1.02 of the gap. Prints how they end, every scene that ends
neither converged nor with a body on a clamp or squeezed, and the largest moment of a round body
without friction about its centre, over its force times its radius.
"""

import argparse
from collections import Counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.random_scenes import LAWS, OILS
from suas_jax import configure
from suas_jax.config import SceneSpec, scene_from_dict
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.numerics.lanes import number
from suas_jax.scene.program import prepared, run_program, structure_of

ELEMENTS = (64,)
NAMED = ("body_on_clamp", "squeezed")


def body(random: np.random.Generator, gap: float, side: int = 0, **keys: Any) -> dict[str, Any]:
    """A body somewhere, or on one side of the crown: a cylinder unless the keys say else."""
    angle = random.uniform(-70, 70) if side == 0 else side * random.uniform(5, 65)
    radius = np.exp(random.uniform(*np.log([2, 60])))
    place = {"angle": f"{angle:.4f} deg", "depth": f"{gap * random.uniform(0.02, 1.02):.5f} mm"}
    shape = keys or {"shape": "cylinder"}
    if shape["shape"] == "cylinder":
        shape = {"radius": f"{radius:.4f} mm"} | shape
    return {"kind": "body"} | place | shape


def _plate(random: np.random.Generator, gap: float) -> list[dict[str, Any]]:
    return [body(random, gap, shape="plate")]


def _wedge(random: np.random.Generator, gap: float) -> list[dict[str, Any]]:
    tip = {"radius": f"{random.uniform(0.5, 5):.3f} mm"}
    opening = f"{random.uniform(40, 150):.2f} deg"
    return [body(random, gap, shape="wedge", opening=opening, **tip)]


def _friction(random: np.random.Generator, gap: float) -> list[dict[str, Any]]:
    return [body(random, gap, shape="cylinder", friction=random.uniform(0.05, 0.6))]


def _line(random: np.random.Generator, gap: float) -> list[dict[str, Any]]:
    force = f"{random.uniform(0, 10):.3f} N"
    line = {"kind": "line", "angle": f"{-random.uniform(5, 65):.3f} deg", "force": force}
    return [body(random, gap, 1), line]


def _pressure(random: np.random.Generator, gap: float) -> list[dict[str, Any]]:
    water = {"kind": "pressure", "pressure": f"{random.uniform(-2, 10):.3f} kPa"}
    return [body(random, gap), water]


KINDS: dict[str, Any] = {
    "cylinder": lambda random, gap: [body(random, gap)],
    "plate": _plate,
    "wedge": _wedge,
    "two cylinders": lambda random, gap: [body(random, gap, 1), body(random, gap, -1)],
    "cylinder and line": _line,
    "cylinder and pressure": _pressure,
    "cylinder, vented": lambda random, gap: [body(random, gap)],
    "friction": _friction,
}


def sample(random: np.random.Generator, kind: str) -> SceneSpec:
    """A scene of a kind."""
    gap, thickness = random.uniform(2, 8), np.exp(random.uniform(*np.log([0.4, 4])))
    geometry = {
        "inner_radius": f"{random.uniform(30, 100):.4f} mm",
        "thickness": f"{thickness:.5f} mm",
        "half_angle": "90 deg",
        "width": "123 mm",
        "oil_gap": f"{gap:.5f} mm",
    }
    tables = {
        "geometry": geometry,
        "material": LAWS["mooney-rivlin"],
        "oil": OILS["vented" if "vented" in kind else "incompressible"],
        "load": KINDS[kind](random, gap),
    }
    return scene_from_dict(tables)


def solved(scene: SceneSpec) -> tuple[str, int, dict[str, Any]]:
    """How a scene ends, after how many corrections, and its report."""
    _, meshes, inputs, rest = prepared(scene, "shell", ELEMENTS)
    static = structure_of(scene, wall=True)
    report, *_, outcome = run_program(static, meshes, inputs, rest, once=True)
    return NAMES[int(number(outcome["result"]))], int(number(outcome["iterations"])), report


def twist(scene: SceneSpec, report: dict[str, Any]) -> float:
    """Largest moment of a round body without friction, over its force times its radius."""
    largest = 0.0
    for spec, load in zip(scene.loads, report["loads"], strict=True):
        if spec.kind == "body" and spec.shape == "cylinder" and spec.friction is None:
            force = number(load["force_N"])
            if force > 0:
                largest = max(largest, abs(number(load["moment_Nm"])) / force / spec.radius)
    return largest


def main() -> None:
    """Print how random scenes end."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=40, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), metavar="KIND")
    options = parser.parse_args()
    configure()
    console = Console(width=110)
    table = Table("kind", "converged", *NAMED, "else", "corrections", "moment")
    for kind in options.kinds:
        random = np.random.default_rng([options.seed, list(KINDS).index(kind)])
        ends, corrections, moment = Counter[str](), [], 0.0
        for _ in range(options.scenes):
            scene = sample(random, kind)
            name, count, report = solved(scene)
            ends[name if name in ("converged", *NAMED) else "else"] += 1
            corrections.append(count)
            if name == "converged":
                moment = max(moment, twist(scene, report))
            elif name not in NAMED:
                print(name, scene.geometry, scene.loads, flush=True)
        counts = [str(ends[name]) for name in ("converged", *NAMED, "else")]
        middle = f"{np.median(corrections):.0f}, at most {max(corrections)}"
        print(kind, *counts, middle, f"{moment:.1e}", flush=True)
        table.add_row(kind, *counts, middle, f"{moment:.1e}")
    console.print(table)


if __name__ == "__main__":
    main()
