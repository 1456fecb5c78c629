"""Sensor calibration by loads that are told with an error: bias and coverage.

The truth is the shell, as in the fit, so that nothing but the errors can bias it. Prints the
table of docs/sensor_method.md. Run from the repository's root:

    python -m benchmarks.input_noise [LOGS]
"""

import dataclasses
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from fitting.sensor.fit.calibrate import fit_sensor
from fitting.sensor.logs.data import LogFile, SensorData
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.constants import SensorFamily, named
from fitting.sensor.model.counts import SensorModel, parts_of
from fitting.sensor.shapes.deformations import deform
from suas_jax import configure
from suas_jax.config import continuous_inputs, load_skin

SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"
TRUTH = np.array([2.35, 5.2e-3])  # permittivity, gap [m]
ANGLE, NOISE = np.deg2rad(20.0), 2.0
FORCE = np.concatenate([np.zeros(24), np.linspace(0, 8, 48), np.linspace(8, 0, 48)])
# [N], [m] and [rad]; the last are of forces that are told as radial
ERRORS = ("force", 0.2), ("force", 0.5), ("displacement", 5e-5), ("direction", np.deg2rad(3.0))


def truth(turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts [taxel, frame] and displacements [frame] under forces that are turned [rad]."""
    spec = load_skin(SKIN)
    inputs = {k: jnp.asarray(v, float) for k, v in continuous_inputs(spec).items()}
    geometry, law, oil, _ = parts_of(spec, inputs)
    loads = KnownLoads.pushes(ANGLE + 0 * FORCE[None], FORCE[None])
    shape = deform(dataclasses.replace(loads, turn=turn[None]), geometry, law, oil)
    family = SensorFamily((named(spec, "permittivity"), named(spec, "gap")))
    at, none = jnp.asarray(TRUTH), jnp.full(FORCE.size, jnp.nan)
    model = SensorModel(inputs, shape.face, None, at, none, None, spec, family)
    return np.asarray(model.so(at)), np.where(FORCE > 0, shape.displacement[0], 0.0)


def told_log(
    so: np.ndarray, travel: np.ndarray, kind: str, deviation: float, seed: int
) -> SensorData:
    """A log whose forces, or displacements, are told with an error in every frame."""
    random = np.random.default_rng(seed)
    counts = np.rint(so + NOISE * random.standard_normal(so.shape))
    error = deviation * random.standard_normal(FORCE.size)
    none = np.full((1, FORCE.size), np.nan)
    told = np.where(FORCE > 0, FORCE + error * (kind == "force"), 0.0)[None]
    loads = KnownLoads.pushes(ANGLE + 0 * told, told)
    if kind == "displacement":
        moved = np.where(travel > 0, travel + error, 0.0)[None]
        loads = dataclasses.replace(loads, force=none, displacement=moved)
    frames, file = np.arange(FORCE.size), LogFile("made", "", FORCE.size, ("oil",), None)
    zero = 0 * frames
    return SensorData(
        load_skin(SKIN), counts, frames / 50, zero, frames, loads, none[0], (file,), (), ()
    )


def main() -> None:
    """Fit each log with its errors as the counts show them, and with exact inputs."""
    configure()
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 12
    so, travel = truth(0 * FORCE)
    for kind, deviation in ERRORS:
        exact = {"displacement" if kind == "displacement" else "force": 0.0}
        for name, stated in (("exact", exact), ("as the counts show", None)):
            errors, pulls, shown = [], [], []
            for seed in range(count):
                if kind == "direction":
                    turn = deviation * np.random.default_rng(seed).standard_normal(FORCE.size)
                    so, _ = truth(turn)
                data = told_log(so, travel, kind, deviation, seed)
                fit = fit_sensor(data, model="shell", input_noise=stated)
                off = fit.constants - TRUTH
                errors.append(off / TRUTH)
                pulls.append(off / fit.uncertainty.standard_errors)
                shown.append(fit.input_errors.noise.deviation.get(kind, 0.0))
            bias = 100 * np.mean(errors, 0)
            size = np.sqrt(np.mean(np.square(pulls), 0))
            largest = np.abs(pulls).max(0)
            print(
                f"| {kind} {deviation:g} | {name} ({np.mean(shown):.3g}) | {bias[0]:+.2f} %, "
                f"{bias[1]:+.2f} % | {size[0]:.2f}, {size[1]:.2f} | {largest[0]:.1f}, "
                f"{largest[1]:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
