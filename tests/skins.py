"""Scenes around the paper's skin, and compiled functions that the physics tests share."""

import contextlib
import csv
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from suas_jax.config import SceneSpec, continuous_inputs, scene_from_dict
from suas_jax.equilibrium.balance import Problem, State, Verification, verify
from suas_jax.equilibrium.equilibrium import Equilibrium, equilibrium
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.mechanics.model import AbstractPlan, Counts
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.mechanics.solid.solid import Solid
from suas_jax.scene.build import Structure, build_problem, plan_for
from suas_jax.scene.program import _program, prepared
from suas_jax.skin.circle import Circle
from suas_jax.skin.geometry import SkinGeometry

CASE_B = Path(__file__).parent.parent / "configs" / "scenes" / "case_b.toml"
"""The scene that tests solve whole where any will do: its programs are compiled once."""
DATA = Path(__file__).parent / "data"
WIDTH = 0.123
GEOMETRY: dict[str, Any] = {
    "inner_radius": "57.5 mm",
    "thickness": "1.5 mm",
    "half_angle": "90 deg",
    "width": "123 mm",
    "oil_gap": "5 mm",
}
"""The [geometry] of the paper's skin."""
PAPER = """
[geometry]
inner_radius = "57.5 mm"
thickness = "1.5 mm"
half_angle = "90 deg"
width = "123 mm"
oil_gap = "5 mm"
[material]
preset = "epdm-paper"
[oil]
model = "incompressible"
relative_permittivity = 2.2
"""
"""Text of the paper's skin, without electrodes."""
EPDM = {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"}
LAWS: dict[str, dict[str, Any]] = {
    "mooney-rivlin": EPDM,
    "neo-hookean": {"law": "neo-hookean", "mu": "32.6 MPa"},
    "yeoh": {"law": "yeoh", "C1": "16 MPa", "C2": "-3 MPa", "C3": "5 MPa"},
    "ogden": {
        "law": "ogden",
        "mu": ["31.5 MPa", "60 kPa", "-500 kPa"],
        "alpha": [1.3, 5.0, -2.0],
        "convention": "mu/alpha",
    },
}


MU, ALPHA = np.array([6.3e5, 0.012e5, -0.1e5]), np.array([1.3, 5.0, -2.0])
"""Table I: three terms of Ogden's law [Pa]."""


def ogden(l1: np.ndarray, l2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cauchy stresses of Table I with the third stress free."""
    free = sum(m * (l1 * l2) ** -a for m, a in zip(MU, ALPHA, strict=True))
    first = sum(m * l1**a for m, a in zip(MU, ALPHA, strict=True))
    second = sum(m * l2**a for m, a in zip(MU, ALPHA, strict=True))
    return first - free, second - free


def reference_rows(name: str) -> list[dict[str, str]]:
    """Rows of a table of an independent program; its header says how good they are."""
    lines = (DATA / name).read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def rotation(seed: int) -> np.ndarray:
    """A turn about some axis, as a matrix."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def quick(function: Callable, jit: Callable = eqx.filter_jit) -> Callable:
    """Compile for a few calls, which the compiler's own optimisation would outlast."""
    return jit(function, compiler_options={"xla_backend_optimization_level": 0})


@contextlib.contextmanager
def compilations() -> Iterator[list[str]]:
    """What is compiled meanwhile."""
    found: list[str] = []

    def listen(event: str, *_: object, **__: object) -> None:
        found.extend([event] * ("backend_compile" in event))

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield found
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)


find = quick(equilibrium)


@quick
def inner_displacement(mechanics: Shell | Solid, q: Array, angle: Array) -> Array:
    """Of the inner face at an angle [m]."""
    return mechanics.at_angle(q, angle).inner_displacement[:, 0, 0, 0]


@quick
def check(problem: Problem, state: State) -> Verification:
    """Stability of a state, and its next Newton correction."""
    return verify(problem, state)[0]


def half_cylinder(
    radius: float = 0.0575,
    thickness: float = 0.0015,
    half_angle: float = np.pi / 2,
    width: float = WIDTH,
    oil_gap: float = 0.005,
) -> SkinGeometry:
    """The paper's skin with other dimensions (SI, rad), one lane."""
    numbers = (radius, thickness, half_angle, width, oil_gap)
    radius_, thickness_, half_angle_, width_, gap = (jnp.array([x]) for x in numbers)
    return SkinGeometry(Circle(radius_, thickness_, half_angle_), width_, gap)


def line(angle: float, force: float, **more: Any) -> dict[str, Any]:
    """A line load; angle in degrees, force in newtons."""
    return {"kind": "line", "angle": f"{angle} deg", "force": f"{force} N", **more}


def scene(
    *loads: dict[str, Any],
    material: dict[str, Any] = EPDM,
    oil: dict[str, Any] | None = None,
    oil_pressure: float | None = None,
    **geometry: float,
) -> SceneSpec:
    """The paper's skin with other loads, material, oil or dimensions (SI, angles in rad)."""
    dimensions = {
        "inner_radius": 0.0575,
        "thickness": 0.0015,
        "half_angle": np.pi / 2,
        "width": WIDTH,
        "oil_gap": 0.005,
    } | geometry
    units = {name: "rad" if name == "half_angle" else "m" for name in dimensions}
    table: dict[str, Any] = {
        "geometry": {name: f"{value!r} {units[name]}" for name, value in dimensions.items()},
        "material": material,
        "oil": oil or {"model": "incompressible"},
        "load": list(loads),
    }
    if oil_pressure is not None:
        table["solve"] = {"oil_pressure": f"{oil_pressure!r} Pa"}
    return scene_from_dict(table)


def shaped(
    geometry: Mapping[str, Any], *loads: dict[str, Any], **tables: dict[str, Any]
) -> SceneSpec:
    """The paper's material, thickness, width and gap around a section of another shape.

    Args:
        geometry: its table as in a file, which may have other dimensions.
        loads: tables of the loads.
        tables: others of the scene.
    """
    sizes = {"thickness": "1.5 mm", "width": "123 mm", "oil_gap": "5 mm"}
    rest = {"material": EPDM, "oil": {"model": "incompressible"}, "load": list(loads)}
    return scene_from_dict({**rest, **tables, "geometry": {**sizes, **geometry}})


def problem_of(
    spec: SceneSpec, elements: int, layers: int = 0, *, half: bool = False
) -> Problem:
    """The discrete problem of a scene on a mesh of its own; a solid where it has layers."""
    counts = (elements, layers) if layers else (elements,)
    plan = plan_for(spec, "solid" if layers else "shell", counts)
    return built(spec, plan.reduced() if half else plan)


def built(
    spec: SceneSpec,  # the scene
    plan: AbstractPlan,  # its mesh
    inputs: Mapping[str, Any] | None = None,  # see `build_problem`; those of the scene if None
) -> Problem:
    """The discrete problem of a scene, by one program instead of one for each operation."""
    values = continuous_inputs(spec) if inputs is None else inputs
    arrays = {path: np.asarray(value, float) for path, value in values.items()}
    problem: Problem = _built(Structure(spec), plan, arrays)
    return problem


@quick
def _built(structure: Structure, plan: AbstractPlan, inputs: dict[str, Array]) -> Problem:
    return build_problem(structure.scene, plan, inputs)


def program_text(spec: SceneSpec, model: str, counts: Counts) -> str:
    """The program that `solve` compiles for a scene on a mesh, wall and all, as StableHLO.

    LAPACK's calls for stacks of matrices wait for XLA's threads: two of them at once, on two
    cores, wait for each other for ever. None may be in it.
    """
    _, meshes, inputs, rest = prepared(spec, model, counts)
    arguments = (Structure(spec, wall=True), meshes, inputs, rest, np.asarray(True))
    text = _program.lower(*arguments).as_text()
    assert "stablehlo.while" in text
    return str(text)


def status(result: Equilibrium) -> str:
    """Name of a single lane's outcome."""
    return NAMES[int(result.result[0])]


def converged(problem: Problem) -> Equilibrium:
    """Solve from rest and insist."""
    result = find(problem)
    assert status(result) == "converged"
    assert all(bool(jnp.all(jnp.isfinite(x))) for x in jax.tree.leaves(result.state))
    return result
