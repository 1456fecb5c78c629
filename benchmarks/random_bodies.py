"""Rigid bodies on sections that nobody has tuned anything for.

    python -m benchmarks.random_bodies [--scenes N] [--seed S] [--kinds KIND ...]

N scenes of each kind (see `KINDS`), solved from rest with the shell on 64 elements and the wall
there: thickness 0.4 to 4 mm, radius 30 to 100 mm, gap 2 to 8 mm, bodies anywhere within 70
degrees of the crown, travels up to 1.02 of the gap. Prints how they end, every scene that ends
neither converged nor with a body on a clamp or squeezed, and what is largest of

- the moment of a round body without friction about its centre, over its force times its radius;
- what the clamps do not take of what bodies, wall, oil and lines do, over the bodies' force;
- without friction, what the skin's potential does not take of the bodies' work, over that work:
  both by central differences of the travels.
"""

import argparse
from collections import Counter
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Console
from rich.table import Table

from benchmarks.random_scenes import LAWS, OILS
from suas_jax import configure
from suas_jax.config import SceneSpec, scene_from_dict
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.numerics.lanes import number
from suas_jax.scene.build import Inputs, Structure, problem_of
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.program import Prepared, prepared, run_program, structure_of

ELEMENTS = (64,)
NAMED = ("body_on_clamp", "squeezed")
STEP = 1e-4  # of the travels


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


class Solved(NamedTuple):
    """How a scene ends."""

    name: str  # of the outcome
    corrections: int
    report: dict[str, Any]
    twist: float  # see the module, zero where it did not converge
    apart: float
    work: float


def solved(scene: SceneSpec) -> Solved:
    """Solve a scene, and check what it ends with."""
    known, static = prepared(scene, "shell", ELEMENTS), structure_of(scene, wall=True)
    report, _, _, state, outcome = run_program(
        static, known.meshes, known.inputs, known.rest, once=True
    )
    name, count = NAMES[int(number(outcome["result"]))], int(number(outcome["iterations"]))
    pressed = any(number(load["force_N"]) for load in _bodies(scene, report))
    if name != "converged" or not pressed:
        return Solved(name, count, report, 0.0, 0.0, 0.0)
    apart, *_ = _sums(static, known.meshes.solved, known.inputs, state)
    work = 0.0
    if not any(body.friction for body in scene.bodies):
        work = _unexplained_work(scene, static, known, state)
    return Solved(name, count, report, twist(scene, report), number(apart), work)


def _bodies(scene: SceneSpec, report: dict[str, Any]) -> list[dict[str, Any]]:
    pairs = zip(scene.loads, report["loads"], strict=True)
    return [load for spec, load in pairs if spec.kind == "body"]


@eqx.filter_jit
def _sums(
    scene: Structure, plan: Any, inputs: Inputs, state: State
) -> tuple[Array, Array, Array]:
    """Forces that nothing takes, over the bodies'; potential; work by a factor on travels."""
    problem = problem_of(scene_parts(scene.scene, inputs), plan, wall=True)
    skin = problem.mechanics
    assert isinstance(skin, Shell)
    net = state.pressure - state.factor * problem.external_pressure
    free = skin.elements.free()

    def others(q: Array) -> Array:
        held = skin.with_bodies(()).contact_energy(q)
        return jnp.sum(held - net * skin.volume_change(q) - state.factor * skin.work(q))

    reaction = (1 - free) * jax.grad(lambda q: jnp.sum(skin.strain_energy(q)))(state.q)
    acting = free * jax.grad(others)(state.q)
    touched = [skin.touched(state.q, body.placed(state.factor)) for body in skin.bodies]
    pushes = jnp.sum(jnp.stack([jnp.sum(x.force, (1, 2)) for x in touched]), 0)
    left = jnp.sum((reaction - acting)[:2], 1) - pushes  # displacements are Cartesian
    size = jnp.sqrt(jnp.sum(pushes**2, 0))
    stored = skin.strain_energy(state.q) + skin.contact_energy(state.q, state.factor)
    work = [
        -jnp.einsum("cgel,cl->l", x.force, body.way)
        for x, body in zip(touched, skin.bodies, strict=True)
    ]
    lines = state.factor * skin.work(state.q)
    return jnp.max(jnp.abs(left), 0) / size, stored - lines, sum(work, 0 * size)


def _unexplained_work(
    scene: SceneSpec, static: Structure, known: Prepared, state: State
) -> float:
    """Part of the work of bodies on a little of their travel that is not in the potential."""
    found = []
    for factor in (1 - STEP, 1 + STEP):
        travels = {
            path: factor * x for path, x in known.inputs.items() if path.endswith(".depth")
        }
        inputs = known.inputs | travels
        near = run_program(static, known.meshes, inputs, state, once=True)[3]
        found.append(number(_sums(static, known.meshes.solved, inputs, near)[1]))
    work = number(_sums(static, known.meshes.solved, known.inputs, state)[2])
    return abs((found[1] - found[0]) / (2 * STEP) / work - 1)


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
    columns = "corrections", "moment", "forces", "work"
    table = Table("kind", "converged", *NAMED, "else", *columns)
    for kind in options.kinds:
        random = np.random.default_rng([options.seed, list(KINDS).index(kind)])
        ends, corrections, largest = Counter[str](), [], np.zeros(3)
        for _ in range(options.scenes):
            scene = sample(random, kind)
            found = solved(scene)
            ends[found.name if found.name in ("converged", *NAMED) else "else"] += 1
            corrections.append(found.corrections)
            largest = np.maximum(largest, found[-3:])
            if found.name not in ("converged", *NAMED):
                print(found.name, scene.geometry, scene.loads, flush=True)
        counts = [str(ends[name]) for name in ("converged", *NAMED, "else")]
        middle = f"{np.median(corrections):.0f}, at most {max(corrections)}"
        row = kind, *counts, middle, *(f"{x:.1e}" for x in largest)
        print(*row, flush=True)
        table.add_row(*row)
    console.print(table)


if __name__ == "__main__":
    main()
