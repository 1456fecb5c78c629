"""Random pads in three dimensions, pressed to their first contact with the wall and beyond.

Thickness 0.5-4 mm, radius 30-100 mm, half angle 45-90 degrees, length 0.5-4 radii, every law
and every oil, one to three patches anywhere, round or rectangular. Every pad must end in
equilibrium with finite numbers, or in a failure with a name, and keep the balance of energy
(see `benchmarks.contact_scenes`). Run: ``python -m benchmarks.pad_scenes [COUNT]``.
"""

import dataclasses
import functools
import sys
import time
from collections import Counter
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from rich.console import Console

from benchmarks.contact_scenes import press
from benchmarks.random_scenes import LAWS, OILS
from suas_jax.config import SceneSpec, continuous_inputs, scene_from_dict
from suas_jax.equilibrium.outcomes import NAMES
from suas_jax.mechanics.model import AbstractPlan
from suas_jax.mechanics.pad.model import PadMesh
from suas_jax.runtime.compiled import OPTIONS
from suas_jax.runtime.settings import configure
from suas_jax.scene.build import Structure, plan_for
from suas_jax.scene.parts import scene_parts
from suas_jax.scene.report import plain

ELEMENTS = (16, 14)
BEYOND = 1.1  # times the load of first contact
_PATCHES = 3
_DISC = (10, 24)  # points along the radius of a disc and around it
_NO_CONTACT = 1e3  # factor on forces of 1 N at which the way to the wall is given up


def sample(rng: np.random.Generator, law: str, oil: str) -> SceneSpec:
    """A random pad; patches that are not wanted carry no force."""
    radius = rng.uniform(30e-3, 100e-3)
    half_angle = np.deg2rad(rng.uniform(45, 90))
    length = radius * rng.uniform(0.5, 4)
    wanted = rng.integers(1, _PATCHES + 1)
    loads = []
    for k in range(_PATCHES):
        size = rng.uniform(2e-3, 0.1 * length, 2)
        reach = half_angle - (size[0] / 2 + 2e-3) / radius
        place = {
            "kind": "patch",
            "angle": f"{rng.uniform(-0.9, 0.9) * reach:.6g} rad",
            "axial": f"{rng.uniform(-0.9, 0.9) * (length / 2 - size.max() / 2 - 2e-3):.6g} m",
            "force": f"{float(k < wanted):g} N",
        }
        extent: dict[str, Any] = {"size": [f"{size[0]:.6g} m", f"{size[1]:.6g} m"]}
        if k == 1:
            extent = {"diameter": f"{size.min():.6g} m"}
        loads.append(place | extent)
    return scene_from_dict(
        {
            "geometry": {
                "inner_radius": f"{radius:.6g} m",
                "thickness": f"{rng.uniform(0.5e-3, 4e-3):.6g} m",
                "half_angle": f"{half_angle:.6g} rad",
                "width": f"{length:.6g} m",
                "oil_gap": f"{rng.uniform(2e-3, 8e-3):.6g} m",
                "ends": "clamped",
            },
            "material": LAWS[law],
            "oil": OILS[oil],
            "load": loads,
            "solve": {"symmetry": False},
        }
    )


@functools.partial(
    eqx.filter_jit, compiler_options={"xla_backend_optimization_level": 1, **OPTIONS}
)
def _press(structure: Structure, plan: AbstractPlan, inputs: dict[str, Array]) -> Any:
    return press(scene_parts(structure.scene, inputs), plan, BEYOND)


def _plan(scene: SceneSpec) -> PadMesh:
    """One program for all pads of a law and an oil: as many points for every patch."""
    mesh = plan_for(scene, "shell", ELEMENTS)
    assert isinstance(mesh, PadMesh)
    spread = tuple(_DISC if disc else ELEMENTS for disc in mesh.plan.discs)
    return PadMesh(dataclasses.replace(mesh.plan, spread=spread))


def _outcome(found: dict[str, Any]) -> str:
    """Name of how the way to the wall ended, or of the state beyond it."""
    if found["way"]:
        return f"{NAMES[found['way']]} before contact"
    return NAMES[found["result"]] if found["touch"] < _NO_CONTACT else "no contact"


def study(count: int, seed: int = 0) -> list[tuple[SceneSpec, dict[str, Any]]]:
    """Press random pads, laws and oils in turn, with a line for each of these pairs."""
    rng = np.random.default_rng(seed)
    outcomes: list[tuple[SceneSpec, dict[str, Any]]] = []
    for law in LAWS:
        for oil in OILS:
            started, first = time.process_time(), len(outcomes)
            for _ in range(-(-count // (len(LAWS) * len(OILS)))):
                scene = sample(rng, law, oil)
                numbers = {
                    k: jnp.asarray(v, float) for k, v in continuous_inputs(scene).items()
                }
                plan = _plan(scene)
                found = plain(_press(Structure(scene), plan, numbers))
                found["result"] = _outcome(found)
                outcomes.append((scene, found))
            results = dict(Counter(found["result"] for _, found in outcomes[first:]))
            seconds = time.process_time() - started
            print(f"{law}, {oil}: {results}, {seconds:.0f} CPU s", flush=True)
    return outcomes


def main() -> None:
    """Print what became of them."""
    configure()
    outcomes = study(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
    console = Console()
    console.print(Counter(found["result"] for _, found in outcomes))
    good = [found for _, found in outcomes if found["result"] == "converged"]
    numbers = [x for found in good for x in jax.tree.leaves(found["report"])]
    console.print(
        f"not finite among converged: {sum(not np.isfinite(x).all() for x in numbers)}; "
        f"largest imbalance {max(f['imbalance'] for f in good):.1e} of the load, "
        f"largest error of the energy balance {max(f['energy_error'] for f in good):.1e}, "
        f"most corrections {max(f['iterations'] for f in good)}"
    )
    for scene, found in outcomes:
        if found["result"] not in ("converged", "no contact"):
            console.print(found["result"], found["touch"], continuous_inputs(scene))


if __name__ == "__main__":
    main()
