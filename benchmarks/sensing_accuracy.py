"""How far sensing can be trusted, and what it costs: the tables of docs/sensing_method.md.

    python benchmarks/sensing_accuracy.py

1. the paper's numbers: scale, baseline and loaded SO of cases A and B, air against oil;
2. the even mesh of a `Skin` against a fine one, loads from -65 to 65 degrees;
3. the formulas against the electric field in the film;
4. the cost of 320 taxels, alone and in a batch.
"""

import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from suas_jax import configure, jit
from suas_jax.config import ElectrodesSpec, SceneSpec, continuous_inputs, load_scene, with_solve
from suas_jax.equilibrium.equilibrium import equilibrium
from suas_jax.scene.forward import forward, load_jacobian
from suas_jax.scene.loads import Loads
from suas_jax.scene.parts import skin_parts
from suas_jax.scene.skin import Skin, skin_of
from suas_jax.scene.solve import solve
from suas_jax.sensing.capacitance import VACUUM_PERMITTIVITY
from suas_jax.sensing.capacitances.concentric import Concentric
from suas_jax.sensing.converter import PAPER_LSB, Converter
from suas_jax.sensing.field import Film, field_capacitance, wall_charge
from suas_jax.sensing.tiling import tiled_modules

CONFIGS = Path(__file__).parent.parent / "configs"
AIR, OIL = 13675, 18270  # published SO of one taxel under 6.5 N


def paper() -> None:
    print(f"scale: 20 pF / 2^16 = {PAPER_LSB:.4e} F (the paper rounds to 3.05e-16)")
    air, oil = Converter().capacitance([AIR, OIL]) * 1e12
    print(f"SO {AIR} and {OIL}: {air:.3f} and {oil:.3f} pF, ratio {OIL / AIR:.4f}")
    for case in ("a", "b"):
        report = solve(load_scene(CONFIGS / f"scenes/case_{case}.toml")).report
        so = " ".join(f"{taxel['so']:.1f}" for taxel in report["taxels"])
        print(f"case {case.upper()}, 10 kPa, eight 4 mm taxels (160.5 at rest): {so}")
    print("\nair to oil: parameters that give both counts exactly (film d, oil eps)")
    for name, eps in (("mineral", 2.2), ("silicone", 2.7)):
        # One taxel: C = stray + eps0 A / (d / eps + layers), area and gap as one unknown.
        stray = (eps * AIR - OIL) / (eps - 1)
        film = (OIL / AIR - 1) / (OIL / AIR * (1 - 1 / eps))
        print(
            f"  {name:9s} stray alone: {stray:7.0f} counts ({stray * PAPER_LSB * 1e12:.2f} pF, "
            f"{100 * stray / AIR:.0f} % of the reading in air)"
        )
        print(
            f"            layers alone: oil-filled share of the electric thickness in air "
            f"{100 * film:.0f} %, layers the other {100 * (1 - film):.0f} %"
        )
        gap = eps / (OIL / AIR)
        print(
            f"            adhesion alone: the film is {gap:.2f} times as thick in oil as in air"
        )
    print("  Any mixture fits as well: two counts, and stray, layers and gap unknown.")


def mesh() -> None:
    print("\nSkin's even mesh against 512 elements, 61 loads of 15 N from -65 to 65 degrees")
    print("elements   oil pressure   SO at worst   gap, rms of 5 mm")
    spec = load_scene(CONFIGS / "scenes/case_b.toml")
    taxels = [{"angle": a} for a in np.linspace(-1.4, 1.4, 57)]
    spec = with_electrodes(spec, ElectrodesSpec(taxels=taxels))
    loads = Loads.line(np.deg2rad(np.linspace(-65, 65, 61) + 0.37), 15.0)
    run = jit(forward)
    fine = run(skin_of(spec, elements=512), loads)
    for n in (16, 24, 32, 48, 64):
        found = run(skin_of(spec, elements=n), loads)
        pressure = np.max(np.abs(found.oil_pressure / fine.oil_pressure - 1))
        so = np.max(np.abs(found.so / fine.so - 1))
        gap = np.sqrt(np.mean((found.readings.gap - fine.readings.gap) ** 2)) / 5e-3
        print(f"{n:8d} {pressure:14.1e} {so:13.1e} {gap:18.1e}")


def field() -> None:
    print("\nformula / field - 1 for the eight 4 mm taxels of suas.toml, guarded")
    for case in ("a", "b"):
        spec = with_solve(load_scene(CONFIGS / f"scenes/case_{case}.toml"), rtol=1e-5)
        solution = solve(spec)
        mechanics, q = solution.problem().mechanics, solution.state.q
        plane = skin_parts(spec, continuous_inputs(spec)).electrodes
        assert plane is not None
        concentric = eqx.tree_at(lambda e: e.model, plane, Concentric())
        fields = [np.asarray(field_capacitance(plane, mechanics, q, n)) for n in (720, 1440)]
        exact = (4 * fields[1] - fields[0]) / 3
        print(f"  case {case.upper()}: mesh 720 to 1440 changes {change(*fields):.0e}")
        for name, held in (("parallel plate", plane), ("concentric", concentric)):
            found = np.asarray(held.read(mechanics, q).capacitance)
            row = " ".join(f"{100 * x:5.1f}" for x in (found / exact - 1)[:, 0])
            print(f"    {name:15s} {row} %")
    print("  fringe of a bare (unguarded) electrode, per edge, over eps0 eps_r:")
    for width, gap in ((4e-3, 5e-3), (8e-3, 5e-3), (4e-3, 2e-3), (4e-3, 1e-3)):
        wall, n = 1e3, 3200
        angle = np.linspace(-1, 1, n + 1)[:, None] * (width / 2 + 6 * gap) / wall
        step = float(angle[1, 0] - angle[0, 0]) * wall
        driven = np.abs(angle[:, 0]) * wall <= width / 2
        film = Film(jnp.asarray(angle), jnp.full((n + 1, 1), gap), jnp.array([wall]))
        strip = float(jax.jit(wall_charge, static_argnums=2)(film, driven, 14).sum())
        width_meshed = step * (driven.sum() - 1)
        edge = (strip - width_meshed / gap) / 2
        disc = np.pi * width * edge / (np.pi / 4 * width**2 / gap)
        print(
            f"    {1e3 * width:.0f} mm electrode, {1e3 * gap:.0f} mm gap: {edge:.2f}, "
            f"about {100 * disc:.0f} % of a disc's capacitance"
        )


def change(coarse: np.ndarray, fine: np.ndarray) -> float:
    return float(np.max(np.abs(coarse / fine - 1)))


def with_electrodes(spec: SceneSpec, electrodes: ElectrodesSpec) -> SceneSpec:
    return spec.model_copy(update={"electrodes": electrodes})


def cost() -> None:
    print("\nsolution from rest, 32 elements: microseconds a lane, median and fastest")
    base = load_scene(CONFIGS / "scenes/case_b.toml")
    pad = ElectrodesSpec(layout="roboskin", modules=tiled_modules(base.geometry))
    skins = {"8 taxels": skin_of(base), "320 taxels": skin_of(with_electrodes(base, pad))}

    def no_sensing(skin: Skin, loads: Loads) -> Any:
        return equilibrium(skin.problem(loads)).state

    calls: dict[str, tuple[Callable[..., Any], Skin]] = {
        "no taxels": (eqx.filter_jit(no_sensing), skins["8 taxels"])
    }
    for name, skin in skins.items():
        calls[name] = (jit(forward), skin)
        calls[f"{name}, Jacobian"] = (jit(load_jacobian), skin)
    for lanes in (1, 128):
        loads = Loads.line(np.linspace(-1, 1, lanes) + 0.03, np.linspace(5, 15, lanes))
        times: dict[str, list[float]] = {name: [] for name in calls}
        for turn in range(13):
            for name, (call, skin) in calls.items():
                begin = time.perf_counter()
                jax.block_until_ready(call(skin, loads))
                if turn > 1:
                    times[name].append((time.perf_counter() - begin) / lanes)
        without = statistics.median(times["no taxels"])
        for name, seconds in times.items():
            middle = statistics.median(seconds)
            print(
                f"  {lanes:4d} lanes, {name:22s} {1e6 * middle:8.1f}  x {middle / without:.2f}"
            )


if __name__ == "__main__":
    configure()
    print(f"vacuum permittivity {VACUUM_PERMITTIVITY} F/m")
    paper()
    mesh()
    field()
    cost()
