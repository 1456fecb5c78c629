"""Eight simulated hours in the sea, after one known weight: are the stated forces right?

Skins are drawn from what a file leaves open (filling, mounting, stiffness, thickness, gap,
permittivity; expansions to 2 %), and zeroed by a weight at the crown. Then the water warms and
cools by 20 K, the skin goes down to 300 m and back, its readings at rest drift, and loads come
and go. Every log is estimated three ways: each frame in its own surroundings, all at the log's
mean, and all without the columns::

    python -m benchmarks.hours --skins 8 [--kilograms 0.5]
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.pages import write_section
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.log.log_estimator import LogEstimator, SkinStates, skin_states
from fitting.inverse_load.readings import LogReadings, readings_of
from fitting.inverse_load.zero.from_log import zero_from_log
from fitting.inverse_load.zero.skin_estimator import estimator_of
from fitting.inverse_load.zero.zero_file import skin_with_zero, zero_file_of, zero_text
from fitting.surroundings import Surroundings, spec_at
from suas_jax import configure
from suas_jax.acquisition.baseline import take_baseline, write_baseline
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.config import SkinSpec, input_errors, load_skin
from suas_jax.config.input_errors import as_assembled
from suas_jax.simulation.pad_frames import NoSolutionError
from suas_jax.simulation.simulated_log import simulate_log, write_simulated_log

HOURS, RATE, REST, HELD = 8, 0.01, 20, 20  # frames a second; seconds of the zero's log
COLDEST, WARMEST, DEEPEST, DRIFT = 4.0, 24.0, 300.0, 1e-4  # [degC], [m], [counts/s]
KNOTS = 17  # of temperature and depth over the hours
ANGLES = (-70, -50, -30, -10, 10, 30, 50, 70)
SKIN = """\
[geometry]
inner_radius = "57.5 mm"
half_angle = "90 deg"
width = "123 mm"
thickness = "{geometry.thickness} m"
oil_gap = "{geometry.oil_gap} m"
mounting = "{geometry.mounting}"
[material]
law = "mooney-rivlin"
C1 = "{material.C1} Pa"
C2 = "{material.C2} Pa"
expansion = "{material.expansion} / K +- 2 %"
[oil]
model = "compressible"
bulk_modulus = "1.1 GPa"
expansion = "{oil.expansion} / K +- 2 %"
relative_permittivity = {oil.relative_permittivity}
fill = {oil.fill}
[wall]
expansion = "{wall.expansion} / K +- 2 %"
[reference]
temperature = "25 degC"
[electrodes]
capacitance = "parallel-plate"
lsb = "0.305 fF"
noise = 2.0
layout = "list"
taxels = [{taxels}]
"""
DRAWN = {
    "geometry.thickness": 1.5e-3,
    "geometry.oil_gap": 5e-3,
    "geometry.mounting": 0.0,
    "material.C1": 4.9e6,
    "material.C2": 0.54e6,
    "oil.relative_permittivity": 2.7,
    "oil.fill": 1.0,
    "material.expansion": 1.6e-4,
    "oil.expansion": 9.6e-4,
    "wall.expansion": 7e-5,
}


def skin_text(values: dict[str, float]) -> str:
    """A skin file with some values by path."""
    taxel = '{{ angle = "{} deg", axial = "0 mm", diameter = "4 mm" }}'
    text = SKIN.replace("{taxels}", ", ".join(taxel.format(a) for a in ANGLES))
    for path, value in values.items():
        text = text.replace(f"{{{path}}}", f"{value:.9g}")
    return text


def drawn(spec: SkinSpec, random: np.random.Generator) -> dict[str, float]:
    """Inputs of a true skin, within what the file leaves open."""
    errors = input_errors(as_assembled(spec))
    change = random.normal(size=len(errors)) @ errors.directions
    by_path = dict(zip(errors.paths, change.tolist(), strict=True))
    return {path: value + by_path.get(path, 0.0) for path, value in DRAWN.items()}


def written_log(folder: Path, name: str, rows: str, seed: int, rate: float) -> Path:
    """The log of a load path on the true skin."""
    path, log = folder / f"{name}.path.csv", folder / f"{name}.csv"
    path.write_text(f"# scene: true.toml\n{rows}")
    found = simulate_log(path, rate=rate, seed=seed, settings={"drift": DRIFT})
    write_simulated_log(found, log, path)
    return log


def hours_of(random: np.random.Generator) -> str:
    """Eight hours: surroundings that wander, and a new load every ten minutes."""
    end = 3600 * HOURS
    time = np.linspace(0, end, KNOTS)
    warm = np.cumsum(random.normal(size=KNOTS))
    warm = COLDEST + (WARMEST - COLDEST) * (warm - warm.min()) / np.ptp(warm)
    deep = np.cumsum(random.normal(size=KNOTS))
    deep = DEEPEST * (deep - deep.min()) / np.ptp(deep)
    lines = ["t_s,loads.0.force_N,loads.0.angle_deg,temperature_degC,water_depth_m"]
    begin = np.arange(0, end, 600)
    force = np.where(np.arange(len(begin)) % 2, random.uniform(3, 15, len(begin)), 0.0)
    angle = random.uniform(-60, 60, len(begin))
    for t, f, a in zip(begin, force, angle, strict=True):
        for s in (t, t + 599):
            around = np.interp(s, time, warm), np.interp(s, time, deep)
            lines.append(f"{s:g},{f:.6g},{a:.6g},{around[0]:.6g},{around[1]:.6g}")
    return "\n".join(lines) + "\n"


def compared(skin: Path, log: Path, baseline: Path) -> dict[str, np.ndarray]:
    """Errors of forces and their deviations, relative [contact, 2], by way of estimating."""
    spec, file = skin_with_zero(skin)[0], read_log(log)
    readings = readings_of(file, spec, None)
    truth = file.flags["load_0_force_N"].astype(float)

    def make(spec: SkinSpec, name: str) -> LoadEstimator:
        del name
        return estimator_of(spec, baseline, follow_drift=True)

    found = {}
    for name, states in ways(spec, readings).items():
        estimates = LogEstimator(readings, states, make).estimate()
        rows = [
            (e.contacts[0].force / f - 1, e.contacts[0].deviation("force") / f)
            for f, e in zip(truth, estimates, strict=True)
            if f > 0 and len(e.contacts) == 1 and e.status in ("ok", "ok_drifted")
        ]
        found[name] = np.array(rows).reshape(-1, 2)
    return found


def ways(spec: SkinSpec, readings: LogReadings) -> dict[str, SkinStates]:
    """The states of the skin, by what is made of the log's columns."""
    mean, _ = spec_at(spec, readings.surroundings, "log")
    blind = replace(readings, surroundings=Surroundings())
    return {
        "in their own surroundings": skin_states(spec, readings, "log"),
        "at the mean of the log": SkinStates(
            (mean,), ("",), np.ones((len(readings.so), 1)), ()
        ),
        "without the columns": skin_states(spec, blind, "log"),
    }


def main() -> None:
    """Print the table of docs/zero_method.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--skins", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kilograms", type=float, default=1.0)
    options = parser.parse_args()
    configure()
    known, heavy = f"{options.kilograms:g} kg at 0 deg", 9.80665 * options.kilograms
    rows: dict[str, list[np.ndarray]] = {}
    count = 0
    for k in range(options.skins):
        random = np.random.default_rng([options.seed, k])
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            skin = folder / "skin.toml"
            skin.write_text(skin_text(DRAWN))
            truth = drawn(load_skin(skin), random)
            (folder / "true-skin.toml").write_text(skin_text(truth))
            load = '[[load]]\nkind = "line"\nangle = "0 deg"\nforce = "0 N"\n'
            (folder / "true.toml").write_text(f'skin = "true-skin.toml"\n{load}')
            head = "t_s,loads.0.force_N,temperature_degC,water_depth_m\n"
            start = hours_of(random)
            warm, deep = start.splitlines()[1].split(",")[-2:]
            weight = "".join(
                f"{t},{f},{warm},{deep}\n"
                for t, f in ((0, 0), (REST, 0), (REST + 0.1, heavy), (REST + HELD, heavy))
            )
            still = f"0,0,{warm},{deep}\n{REST},0,{warm},{deep}\n"
            try:
                rest = written_log(folder, "rest", head + still, 3 * k, 5.0)
                pressed = written_log(folder, "weight", head + weight, 3 * k + 1, 5.0)
                log = written_log(folder, "hours", start, 3 * k + 2, RATE)
                write_baseline(take_baseline(read_log(rest)), folder / "rest.json")
                zero = zero_from_log(load_skin(skin), pressed, [known])
            except (NoSolutionError, ValueError) as error:
                print(f"skin {k} left out: {str(error)[:100]}")
                continue
            zero_file_of(skin).write_text(zero_text(zero, skin, pressed))
            count += 1
            for way, found in compared(skin, log, folder / "rest.json").items():
                rows.setdefault(way, []).append(found)
                error, deviation = np.abs(found[:, 0]), found[:, 1]
                print(
                    f"skin {k}, {way}: {len(found)} frames, error "
                    f"{100 * np.median(error):.2f} %, +- {100 * np.median(deviation):.2f} %, "
                    f"inside {100 * np.mean(error < 1.96 * deviation):.1f} %",
                    flush=True,
                )
    lines = ["| frames estimated | median error | median 95 % interval | inside it |"]
    lines.append("|---|---|---|---|")
    for way, parts in rows.items():
        error, deviation = np.abs(np.concatenate(parts)).T
        lines.append(
            f"| {way} | {100 * np.median(error):.1f} % | "
            f"+- {196 * np.median(deviation):.1f} % | "
            f"{100 * np.mean(error < 1.96 * deviation):.1f} % of {len(error)} |"
        )
    print(f"{count} skins")
    print("\n".join(lines))
    write_section("zero_method.md", "hours", lines)


if __name__ == "__main__":
    main()
