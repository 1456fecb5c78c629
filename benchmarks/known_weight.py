"""One known weight on many skins: how far forces are off afterwards, and how sure that is.

True skins are drawn from what the file leaves open: filling, mounting, stiffness, thickness,
gap, permittivity, scale. Each is pressed by 10 N at the crown once, `zero_of` takes the
readings, and loads anywhere on it are then found with the zero's inputs and covariance, and
with the file's::

    python benchmarks/known_weight.py --skins 60
    python benchmarks/known_weight.py --skin configs/skins/suas-pad.toml --skins 20
"""

import argparse

import numpy as np

from fitting.inverse_load.drift import ROUNDING
from fitting.inverse_load.settings import MODEL_ERROR, PAD_MODEL_ERROR
from fitting.inverse_load.zero.presses import known_press
from fitting.inverse_load.zero.update import PressModel, PressReadings, zero_of
from fitting.inverse_load.zero.zero import Gaussian, conditioned
from suas_jax import configure
from suas_jax.config import input_errors, load_skin
from suas_jax.config.input_errors import as_assembled

_KNOWN = {2: "10 N at 0 deg", 3: "10 N at 0 deg, 0 mm"}
_FRAMES = 50  # of the weight, and of the rest before it
_LOADS = 6  # found on each skin at a time
_FREE = 1e6  # variance of what is not known
_FORCES = {2: (3, 15), 3: (1, 12)}


def found_loads(
    model: PressModel, change: np.ndarray, weight: np.ndarray, errors: Gaussian
) -> tuple[np.ndarray, np.ndarray]:
    """Loads [load, quantity] and deviations of their forces [load], from their readings."""
    x, count = model.known.copy(), len(errors.mean)
    size = x.shape[1]
    for _ in range(6):
        now = model.at(errors.mean, x)
        step = np.zeros_like(x)
        deviation = np.zeros(len(x))
        for k in range(len(x)):
            prior = Gaussian(
                np.concatenate([errors.mean, x[k]]),
                np.block(
                    [
                        [errors.covariance, np.zeros((count, size))],
                        [np.zeros((size, count)), _FREE * np.eye(size)],
                    ]
                ),
            )
            jacobian = np.concatenate([now.by_error[k], now.by_press[k]]).T
            left = change[k] - now.change[k]
            only = np.concatenate([0 * now.by_error[k], now.by_press[k]]).T
            step[k] = conditioned(prior, prior.mean, only, left, weight[k]).mean[count:] - x[k]
            full = conditioned(prior, prior.mean, jacobian, 0 * left, weight[k])
            deviation[k] = np.sqrt(full.covariance[-1, -1])
        x = x + step
    return x, deviation


def main() -> None:
    """Print errors, intervals and coverage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--skin", default="configs/skins/suas.toml")
    parser.add_argument("--skins", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    configure()
    rng = np.random.default_rng(options.seed)
    spec = load_skin(options.skin)
    errors = input_errors(as_assembled(spec))
    count, pad = len(errors), spec.geometry.dimension == 3
    noise = spec.electrodes.noise**2 + ROUNDING
    model_error = PAD_MODEL_ERROR if pad else MODEL_ERROR
    weighed = (known_press(_KNOWN[spec.geometry.dimension], spec.geometry),)
    truth_of_weight = PressModel(errors, weighed)
    rows = []
    for _ in range(options.skins):
        e = rng.normal(size=count)
        place = np.concatenate([[0.0], rng.uniform(-60, 60, _LOADS - 1)])
        least, most = _FORCES[spec.geometry.dimension]
        force = np.concatenate([[10.0], rng.uniform(least, most, _LOADS - 1)])
        axial = np.concatenate([[0.0], rng.uniform(-40, 40, _LOADS - 1)])
        ends = [f", {z} mm" if pad else "" for z in axial]
        loads = [
            known_press(f"{f} N at {a} deg{end}", spec.geometry)
            for a, f, end in zip(place, force, ends, strict=True)
        ]
        pressed = PressModel(errors, loads)
        try:
            scale_error = 1 + weighed[0].force_deviation / weighed[0].force * rng.normal()
            x = truth_of_weight.known.copy()
            x[:, -1] *= scale_error
            read = truth_of_weight.at(e, x).change
            change = pressed.at(e, pressed.known).change
        except ValueError:  # beyond buckling, or at the wall
            continue
        variance = np.full_like(read, 2 * noise / _FRAMES)
        read = read + np.sqrt(variance) * rng.normal(size=read.shape)
        readings = PressReadings(read, variance, np.ones(1))
        change = change + np.sqrt(noise) * rng.normal(size=change.shape)
        weight = 1 / (noise + (model_error * change) ** 2)
        try:
            zero = zero_of(errors, weighed, readings, model_error)
            for own in (Gaussian(np.zeros(count), np.eye(count)), zero.posterior):
                at, deviation = found_loads(pressed, change, weight, own)
                off = at[:, -1] / force - 1
                rows.append((off, deviation / force, np.arange(_LOADS) == 0))
        except ValueError as error:
            print("left out:", str(error)[:90])
    print(f"{len(rows) // 2} skins")
    for name, part in (("file", rows[::2]), ("zero", rows[1::2])):
        off, deviation = (np.concatenate([row[i] for row in part]) for i in (0, 1))
        near = np.concatenate([row[2] for row in part])
        for where, own in (("at the weight's place", near), ("elsewhere", ~near)):
            inside = np.abs(off[own]) < 1.96 * deviation[own]
            print(
                f"{name}, {where}: median error {100 * np.median(np.abs(off[own])):.2f} %, "
                f"median deviation {100 * np.median(deviation[own]):.2f} %, "
                f"in its 95 % interval {100 * inside.mean():.1f} % of {own.sum()}"
            )


if __name__ == "__main__":
    main()
