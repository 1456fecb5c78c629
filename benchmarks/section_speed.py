"""What sections other than circles cost: the table of docs/benchmarks.md.

    python -m benchmarks.section_speed

One half-cylinder as a circle, as an ellipse of equal semi-axes, as a path of two arcs and as a
spline through nine of its points: the same equilibria, so times differ by the section's own
work alone. Shell on 32 elements, a line load at 20 degrees, from rest, compiled beforehand; and
a batch of loads that press the membrane against the wall.
Rows take turns, so that a change in the machine's load touches all of them.
"""

import resource
import statistics
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from benchmarks.pages import write_section
from suas_jax import Loads, configure, forward, skin_of
from suas_jax.config import continuous_inputs, scene_from_dict
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.scene.build import build_problem, plan_for

ELEMENTS, LANES, ROUNDS = 32, 256, 15
PRESSES, FORCE = 16, 120.0  # loads that reach the wall, evenly over 60 degrees; of each [N]
RADIUS = 57.5  # mm
ONE = ("one equilibrium", "with its gradient by all inputs")
_TURNS = np.linspace(-np.pi / 2, np.pi / 2, 9)
SECTIONS: dict[str, dict[str, Any]] = {
    "circle": {"inner_radius": f"{RADIUS} mm", "half_angle": "90 deg"},
    "ellipse": {
        "section": "ellipse",
        "inner_semi_axes": [f"{RADIUS} mm", f"{RADIUS} mm"],
        "half_angle": "90 deg",
    },
    "path": {
        "section": "path",
        "path": [{"radius": f"{RADIUS} mm", "angle": "90 deg"}],
        "mirror": True,
    },
    "spline": {
        "section": "spline",
        "points": [
            [f"{RADIUS * np.sin(t):.12f} mm", f"{RADIUS * np.cos(t):.12f} mm"] for t in _TURNS
        ],
    },
}


def calls_of(section: str) -> dict[str, Callable[[], Any]]:
    """What is timed of a section; everything begins with the numbers of its file."""
    scene = scene_from_dict(
        {
            "geometry": SECTIONS[section]
            | {"thickness": "1.5 mm", "width": "123 mm", "oil_gap": "5 mm"},
            "material": {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa"},
            "oil": {"model": "incompressible", "relative_permittivity": 2.2},
            "electrodes": {"taxels": [{"arc": "-10 mm"}]},
            "load": [{"kind": "line", "arc": "20 mm", "force": "15 N"}],
        }
    )
    plan = plan_for(scene, "shell", (ELEMENTS,))
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(scene).items()}

    def pressure(inputs: dict[str, Array]) -> Array:
        found = equilibrium(build_problem(scene, plan, inputs))
        return jnp.where(found.result == 0, found.state.pressure, jnp.nan)[0]

    rng = np.random.default_rng(0)
    lanes = {k: v * jnp.asarray(rng.uniform(0.98, 1.02, LANES)) for k, v in inputs.items()}
    for name in [k for k in inputs if ".points." in k]:  # the same for all: as smooth as before
        lanes[name] = inputs[name] * lanes["geometry.width"] / inputs["geometry.width"]
    options: dict[str, Any] = {"compiler_options": OPTIONS}
    one, slope = jax.jit(pressure, **options), jax.jit(jax.grad(pressure), **options)
    many = jax.jit(jax.vmap(pressure), **options)
    skin, places = skin_of(scene), np.linspace(-np.pi / 6, np.pi / 6, PRESSES)
    free, pressed = (Loads.line(places, np.full(PRESSES, force)) for force in (15.0, FORCE))
    return {
        ONE[0]: lambda: one(inputs),
        ONE[1]: lambda: slope(inputs),
        f"{LANES} sections in a batch": lambda: many(lanes),
        f"{PRESSES} loads, their readings": lambda: forward(skin, free).readings.so,
        f"{PRESSES} loads at the wall": lambda: forward(skin, pressed).wall_force,
    }


def busy() -> float:
    """Processor seconds of this program so far."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print the table, and write it."""
    configure()
    calls = {section: calls_of(section) for section in SECTIONS}
    found = {
        section: {
            name: np.asarray(jax.tree.leaves(jax.block_until_ready(call()))[0])
            for name, call in rows.items()
        }
        for section, rows in calls.items()
    }
    for section, values in found.items():
        for name, value in values.items():
            assert np.isfinite(value).all(), (section, name)
            assert (value > 0).all() or "wall" not in name, (section, name)
    print({section: float(values[ONE[0]]) for section, values in found.items()})
    times: dict[tuple[str, str], list[float]] = {}
    for _ in range(ROUNDS):
        for section, rows in calls.items():
            for name, call in rows.items():
                repeat = 20 if name in ONE else 1
                begin = busy()
                for _ in range(repeat):
                    jax.block_until_ready(call())
                times.setdefault((section, name), []).append((busy() - begin) / repeat)
    lines = ["| | " + " | ".join(SECTIONS) + " |", "|---" * (1 + len(SECTIONS)) + "|"]
    for name in calls["circle"]:
        base = times["circle", name]
        cells = [f"{1e3 * statistics.median(base):.2f} ms"]
        for section in list(SECTIONS)[1:]:
            pairs = zip(times[section, name], base, strict=True)
            cells.append(f"{statistics.median(a / b for a, b in pairs):.2f}")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    print("\n".join(lines))
    write_section("benchmarks.md", "sections", lines)


if __name__ == "__main__":
    main()
