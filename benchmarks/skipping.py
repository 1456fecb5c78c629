"""What it saves not to compute what a scene does not need: one table of ratios."""

import dataclasses
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from suas_jax.config import SceneSpec, continuous_inputs, load_scene, with_solve
from suas_jax.equilibrium.equilibrium import Problem, equilibrium
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.scene.build import build_problem, plan_for
from suas_jax.scene.parts import skin_parts

SCENES = Path(__file__).parent.parent / "configs" / "scenes"
ROUNDS, BATCH = 9, 200


def _scene(name: str, **changes: Any) -> SceneSpec:
    scene = with_solve(load_scene(SCENES / name), oil_pressure=None)
    return scene.model_copy(update=changes)


def _problem(scene: SceneSpec, elements: int, layers: int = 0, half: bool = False) -> Problem:
    counts = (elements, layers) if layers else (elements,)
    plan = plan_for(scene, "solid" if layers else "shell", counts)
    return build_problem(scene, plan.reduced() if half else plan, continuous_inputs(scene))


def _quick(function: Callable) -> Callable:
    return jax.jit(function, compiler_options=OPTIONS)


def skipping_table() -> list[str]:
    """Markdown: what is skipped, and how much longer it takes not to skip it."""
    scene = _scene("case_a.toml")
    solve = _quick(equilibrium)
    shell, solid = _problem(scene, 32, half=True), _problem(scene, 128, 2, half=True)
    whole = {"shell": _problem(scene, 32), "solid": _problem(scene, 128, 2)}
    vented = dataclasses.replace(shell, oil=_problem(_scene("vented.toml"), 8).oil)
    loads = shell.mechanics.points
    weak = dataclasses.replace(loads, force=0.05 * loads.force)

    def weakly(problem: Problem) -> Problem:
        return dataclasses.replace(
            problem, mechanics=dataclasses.replace(problem.mechanics, points=weak)
        )

    near = solve(shell).state
    slightly = dataclasses.replace(loads, force=1.05 * loads.force)
    next_one = dataclasses.replace(
        shell, mechanics=dataclasses.replace(shell.mechanics, points=slightly)
    )
    near = near._replace(factor=near.factor / 1.05)
    electrodes = skin_parts(scene, continuous_inputs(scene)).electrodes

    def sensed(problem: Problem) -> Any:
        found = equilibrium(problem)
        mechanics = whole["shell"].mechanics
        return found, electrodes.read(mechanics, problem.mechanics.mirrored(found.state.q))

    def at(factor: jax.Array) -> jax.Array:
        points = dataclasses.replace(loads, force=factor * loads.force)
        mechanics = dataclasses.replace(shell.mechanics, points=points)
        return equilibrium(dataclasses.replace(shell, mechanics=mechanics)).state.pressure[0]

    one, many = _quick(at), _quick(jax.vmap(at))
    factors = jnp.linspace(0.1, 1, BATCH)
    rows: list[tuple[str, Callable[[], Any], Callable[[], Any]]] = [
        ("half the arc (shell)", lambda: solve(shell), lambda: solve(whole["shell"])),
        ("half the arc (solid)", lambda: solve(solid), lambda: solve(whole["solid"])),
        (
            "the oil's constraint (vented)",
            lambda: solve(weakly(vented)),
            lambda: solve(weakly(shell)),
        ),
        ("the solid (shell 32 for solid 128 x 2)", lambda: solve(shell), lambda: solve(solid)),
        (
            "the way from rest (warm start at 95 %)",
            lambda: solve(next_one, near),
            lambda: solve(next_one),
        ),
        (
            f"dispatch (batch of {BATCH} for a loop)",
            lambda: many(factors),
            lambda: [one(f) for f in factors],
        ),
    ]
    if electrodes is not None:
        with_taxels = _quick(sensed)
        rows.insert(3, ("the taxels", lambda: solve(shell), lambda: with_taxels(shell)))
    lines = ["| what is skipped | time with it / without it |", "|---|---|"]
    for name, without, including in rows:
        ratios = []
        for call in (without, including):
            jax.block_until_ready(call())
        for _ in range(ROUNDS):
            first, second = _timed(without), _timed(including)
            ratios.append(second / first)
        lines.append(f"| {name} | {statistics.median(ratios):.2g} |")
    return lines


def _timed(call: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - begin
