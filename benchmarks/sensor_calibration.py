"""Sensor calibration against a truth from other models: bias, bound, coverage.

Truth is the solid finite-element model with the same capacitance formula, and once with
the electrostatic field, so that both models differ from the one that is fitted. Prints the
table of docs/sensor_method.md. Run from the repository's root:

    python benchmarks/sensor_calibration.py [truth] [solid] [field] [coverage] [fluids]

`truth` solves the solid states again and writes tests/data/solid_press.csv.
"""

import csv
import sys
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from fitting.sensor.fit.calibrate import fit_sensor
from fitting.sensor.fit.result import SensorFit
from fitting.sensor.logs.data import LogFile, SensorData
from fitting.sensor.logs.known_loads import KnownLoads
from suas_jax import configure
from suas_jax.config import SceneSpec, SkinSpec, continuous_inputs, load_skin, scene_from_dict

ROOT = Path(__file__).parent.parent
TRUTH = ROOT / "tests/data/solid_press.csv"
SKIN = ROOT / "configs/skins/suas.toml"
ANGLE, PERMITTIVITY, GAP, LSB, NOISE = np.deg2rad(20.0), 2.35, 5.2e-3, 0.305e-15, 2.0
AIR = 1.0006


def true_scene(force: float, mesh: tuple[int, int]) -> SceneSpec:
    """The press, in the solid model."""
    return scene_from_dict(
        {
            "skin": str(SKIN),
            "geometry": {"oil_gap": f"{1e3 * GAP} mm"},
            "oil": {"relative_permittivity": PERMITTIVITY},
            "load": [{"kind": "line", "angle": "20 deg", "force": f"{force} N"}],
            "solve": {"model": "solid", "mesh": list(mesh)},
        }
    )


def solve_truth(mesh: tuple[int, int] = (300, 4)) -> None:
    """Solve the solid under growing force and write what its taxels read."""
    from suas_jax.scene.parts import skin_parts
    from suas_jax.scene.solve import solve
    from suas_jax.sensing.field import field_capacitance

    rows = []
    for force in 18.0 * np.linspace(0.0, 1.0, 19) ** 1.5:
        scene = true_scene(max(force, 1e-6), mesh)
        found = solve(scene)
        electrodes = skin_parts(scene, continuous_inputs(scene)).electrodes
        assert electrodes is not None
        mechanics = found.problem().mechanics
        field = field_capacitance(electrodes, mechanics, found.state.q)
        load = found.report["loads"][0]
        rows.append(
            [load["force_N"], load["displacement_m"], load["inner_displacement_m"]]
            + [taxel["so"] for taxel in found.report["taxels"]]
            + [float(x) / LSB for x in np.asarray(field)[:, 0]]
        )
        print(rows[-1][:5], found.report["status"], flush=True)
    taxels = (len(rows[0]) - 3) // 2
    with TRUTH.open("w", newline="") as file:
        file.write(
            f"# Solid finite-element model, {mesh[0]} x {mesh[1]} elements, of "
            f"{SKIN.relative_to(ROOT)} with gap {GAP} m and relative permittivity "
            f"{PERMITTIVITY}; line load at 20 deg. "
            "so_k: counts of the parallel-plate formula; field_k: of the electrostatic field. "
            "Written by benchmarks/sensor_calibration.py truth\n"
        )
        writer = csv.writer(file)
        writer.writerow(
            ["force_N", "displacement_m", "inner_displacement_m"]
            + [f"{kind}_{k + 1}" for kind in ("so", "field") for k in range(taxels)]
        )
        writer.writerows(rows)


def press(displacement: np.ndarray, *, field: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Force [N] and true continuous counts [taxel, frame] at displacements [m]."""
    with TRUTH.open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    table = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    kind = "field" if field else "so"
    names = [key for key in table if key.startswith(kind + "_")]
    x = table["displacement_m"]
    force = CubicSpline(x, table["force_N"])(displacement)
    return force, np.stack([CubicSpline(x, table[name])(displacement) for name in names])


def experiment(
    spec: SkinSpec,
    so: np.ndarray,
    random: np.random.Generator,
    *,
    displacement: np.ndarray | None = None,
    force: np.ndarray | None = None,
    permittivity: np.ndarray | None = None,
    noise: float = NOISE,
) -> SensorData:
    """Noisy whole counts [taxel, frame] of frames with known inputs."""
    frames = so.shape[1]
    nothing = np.full(frames, np.nan)
    known = np.stack([nothing if x is None else x for x in (force, displacement, permittivity)])
    states, state = np.unique(np.nan_to_num(known, nan=1e9), axis=1, return_inverse=True)
    states[states == 1e9] = np.nan
    zero = np.zeros((1, states.shape[1]))
    inner = np.zeros(1, bool)
    loads = KnownLoads(zero + ANGLE, zero, states[:1], states[1:2], inner, *[zero] * 4)
    counts = np.rint(so + noise * random.standard_normal(so.shape))
    return SensorData(
        spec,
        counts,
        np.arange(frames) / 50.0,
        np.zeros(frames, int),
        state.reshape(-1),
        loads,
        states[2],
        (LogFile("synthetic", "", frames, ("oil",), None),),
        (),
        (),
    )


def line(name: str, fits: list[SensorFit], truth: dict[str, float]) -> None:
    """One line of the table: bias, spread against the bound, coverage."""
    for i, key in enumerate(fits[0].family.names):
        values = np.array([fit.constants[i] for fit in fits])
        errors = np.array([fit.uncertainty.standard_errors[i] for fit in fits])
        z = (values - truth[key]) / errors
        rms = float(np.sqrt(np.mean((values - truth[key]) ** 2)))
        print(
            f"{name:32s} {key:22s} n={len(fits):3d} bias "
            f"{100 * (values.mean() / truth[key] - 1):+.4f} %"
            f"  largest error {100 * np.max(np.abs(values / truth[key] - 1)):.4f} %"
            f"  bound {100 * errors.mean() / truth[key]:.4f} %"
            f"  rms/bound {rms / errors.mean():.3f}"
            f"  in 68 %: {100 * np.mean(np.abs(z) < 1.0):.1f}  in 95 %: "
            f"{100 * np.mean(np.abs(z) < 1.96):.1f}",
            flush=True,
        )


def study(
    count: int,
    *,
    field: bool = False,
    formula: bool = False,
    steps: int = 500,
    like: SensorFit | None = None,
) -> list[SensorFit]:
    """Fit synthetic experiments of 500 frames at known displacement, in steps up to 3 mm."""
    spec = load_skin(SKIN)
    displacement = np.repeat(np.linspace(0.0, 3e-3, steps), 500 // steps)
    _, so = press(displacement, field=field)
    fits = []
    for seed in range(count):
        data = experiment(spec, so, np.random.default_rng(seed), displacement=displacement)
        fits.append(
            fit_sensor(data, field=field and not formula, like=fits[0] if fits else like)
        )
        if seed % 20 == 19:
            print(f"  {seed + 1} of {count}", file=sys.stderr, flush=True)
    return fits


def fluids() -> None:
    """What one static log tells, and what air adds."""
    spec = load_skin(SKIN)
    _, so = press(np.zeros(300))
    random = np.random.default_rng(0)
    zero = np.zeros(300)
    alone = fit_sensor(experiment(spec, so, random, force=zero))
    print("rest, oil:", alone.findings, {k: p.reason for k, p in alone.priors.items()})
    both = fit_sensor(
        experiment(
            spec,
            np.concatenate([so, so / PERMITTIVITY * AIR], 1),
            random,
            force=np.concatenate([zero, zero]),
            permittivity=np.repeat([np.nan, AIR], 300),
        )
    )
    for row in both.tells:
        print("rest, oil and air:", row["logs"], row["standard_errors"])
    line("rest in oil and air", [both], {"relative_permittivity": PERMITTIVITY, "oil_gap": GAP})


def main(parts: list[str]) -> None:
    configure()
    truth = {"relative_permittivity": PERMITTIVITY, "oil_gap": GAP}
    if "truth" in parts:
        solve_truth()
    if "solid" in parts:
        line("solid, 500 frames", study(1), truth)
    if "field" in parts:
        line("solid + field, --field", study(1, field=True), truth)
        line("solid + field, formula", study(1, field=True, formula=True), truth)
    if "coverage" in parts:
        begin = time.perf_counter()
        line("solid, 500 frames", study(200), truth)
        print(f"200 calibrations in {time.perf_counter() - begin:.0f} s")
    if "fluids" in parts:
        fluids()


if __name__ == "__main__":
    main(sys.argv[1:] or ["solid", "field", "coverage", "fluids"])
