"""A zero from a log: its frames of rest and of known presses."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.drift import ROUNDING, zero_of_readings
from fitting.inverse_load.memory.series import LoadMemory, creeping_load
from fitting.inverse_load.readings import (
    counting_step,
    noise_in_steps,
    noise_of_readings,
    readings_of,
)
from fitting.inverse_load.settings import MODEL_ERROR, PAD_MODEL_ERROR
from fitting.inverse_load.zero.presses import (
    PressedFrames,
    frames_of_presses,
    known_press,
    settled,
)
from fitting.inverse_load.zero.update import PressModel, PressReadings, zero_of
from fitting.inverse_load.zero.zero import KnownPress, Zero
from fitting.sensor.logs.log import AlignedLog, read_aligned
from fitting.surroundings import spec_at
from suas_jax.acquisition.log.log_file import fluid_of, read_log
from suas_jax.config import SkinSpec, input_errors
from suas_jax.config.input_errors import as_assembled
from suas_jax.config.oil import refuse_other_fluid

_SAME = 1e-3  # of the largest force, by which a known force may vary within a press


def zero_from_log(
    spec: SkinSpec,
    log: Path,
    known: Sequence[str] = (),
    inputs: Path | None = None,
    model_error: float | None = None,
    diameter: float | None = None,
) -> Zero:
    """Find what known presses in a log say of a skin's inputs.

    Args:
        spec: the skin.
        log: SO log that begins at rest.
        known: the presses in words, in their order; without any, columns of the log or of
            `inputs` state them.
        inputs: a second file of known inputs.
        model_error: of the model's change of readings, relative; by default as estimates
            of loads take it.
        diameter: of what presses on a pad [m]; None for a fingertip's.

    Raises:
        ValueError: the skin, the log or a press can't be used.
        OSError: a file can't be read.
    """
    pad = spec.geometry.dimension == 3
    if diameter is not None and not pad:
        raise ValueError("a diameter belongs to presses on a pad; leave it out")
    if model_error is None:
        model_error = PAD_MODEL_ERROR if pad else MODEL_ERROR
    read = read_log(log)
    if known:
        readings = readings_of(read, spec, None)
        so = np.where(readings.stuck, np.nan, readings.so)
        time, around = readings.time, readings.surroundings
        began = readings.header.get("start_time", "")
    else:
        refuse_other_fluid(fluid_of(read), spec.oil.relative_permittivity, str(log))
        aligned = read_aligned(spec, read, inputs, None)
        so, time, around = aligned.so.T, aligned.time, aligned.surroundings
        began = aligned.began
    # What creeps counts from the long-term response (`creeping_load`).
    spec = spec_at(spec, around, str(log))[0].responding("long-term")
    errors = input_errors(as_assembled(spec))
    if not len(errors):
        raise ValueError("the skin file states every input as exact: there is nothing to find")
    if known:
        presses = tuple(known_press(text, spec.geometry, diameter) for text in known)
        patterns, touching = PressModel(errors, presses).change()
        noise = noise_of_readings(spec, None)
        try:
            frames = frames_of_presses(so, patterns, noise_in_steps(noise, counting_step(so)))
        except ValueError as error:
            heavy = [press.text for press, t in zip(presses, touching, strict=True) if t]
            if not heavy:
                raise
            raise ValueError(
                f"{error}; under {', '.join(heavy)} the membrane reaches the wall by the skin "
                "file, and readings there hardly tell the force: press with less"
            ) from None
    else:
        presses, frames = _told_in_columns(spec, aligned, diameter)
    found = zero_of(errors, presses, _averaged(spec, so, time, frames), model_error)
    return replace(found, taken=began)


def _told_in_columns(
    spec: SkinSpec, log: AlignedLog, diameter: float | None
) -> tuple[tuple[KnownPress, ...], PressedFrames]:
    """Presses whose forces and places stand in columns of a log."""
    known, pad = log.known.values, spec.geometry.dimension == 3
    kind = "angle" if (0, "angle") in known else "arc"
    needed = ("force", kind, "axial") if pad else ("force", kind)
    others = [f"load {load}: {quantity}" for load, quantity in known if load > 0]
    if others or any((0, quantity) not in known for quantity in needed):
        columns = "load_0_force_N, load_0_angle_deg" + (", load_0_axial_mm" if pad else "")
        raise ValueError(
            f"{log.path}: one load with its force and place is needed in every press (columns "
            f'{columns}); or give --known "500 g at 0 deg{", 20 mm" if pad else ""}"'
            + (f"; found beside it: {', '.join(others)}" if others else "")
        )
    force, place = np.nan_to_num(known[0, "force"]), np.nan_to_num(known[0, kind])
    turned = np.nan_to_num(known.get((0, "direction"), 0 * force))
    if turned.any():
        degrees = np.rad2deg(turned[turned != 0][0])
        raise ValueError(
            f"{log.path}: load_0_direction_deg is {degrees:.3g} deg; "
            "a zero takes forces straight inwards (0 deg): a weight at the crown, or presses "
            "along the normal"
        )
    axial = np.nan_to_num(known[0, "axial"]) if pad else 0 * place
    same = _SAME * np.abs(force).max(initial=0.0)
    loaded = force > same
    moved = (np.abs(np.diff(force)) > same) | (np.abs(np.diff([place, axial])) > 1e-9).any(0)
    parts = np.split(np.arange(len(force)), np.flatnonzero(moved) + 1)
    runs = [run for run in parts if loaded[run[0]] and len(run) >= 3]
    rest = np.arange(int(loaded.argmax())) if loaded.any() else np.zeros(0, int)
    if not runs or len(rest) < 3:
        raise ValueError(
            f"{log.path}: {len(runs)} held presses and {len(rest)} frames of rest before the "
            "first; one press that is held, after 3 frames of rest (force 0, an empty cell is "
            "unknown), is needed at least"
        )
    presses = []
    for at, *_ in runs:
        angle, arc = f"{np.rad2deg(place[at]):.9g} deg", f"arc {1e3 * place[at]:.9g} mm"
        text = f"{force[at]:.9g} N at {angle if kind == 'angle' else arc}"
        text += f", {1e3 * axial[at]:.9g} mm" if pad else ""
        own = known.get((0, "diameter"))
        size = diameter if own is None else float(own[at])
        presses.append(known_press(text, spec.geometry, size))
    return tuple(presses), PressedFrames(
        rest, [settled(run) for run in runs], [int(r[0]) for r in runs]
    )


def _averaged(spec: SkinSpec, so: Floats, time: Floats, frames: PressedFrames) -> PressReadings:
    """Means of the presses' frames, less the mean at rest, and that mean.

    Rounding to steps of several counts is no noise that a mean takes off.
    """
    noise = noise_of_readings(spec, None) ** 2 + ROUNDING
    steps = noise_in_steps(0.0, counting_step(so)) ** 2
    rest, rest_variance = _mean(so[frames.rest], noise, steps)
    # Of the offsets only: without a baseline there is nothing of the model in the zero.
    offset, unsure_offset = zero_of_readings(spec, rest, None, 0.0)
    changes, variances, shares, unsure = [], [], [], []
    memory = LoadMemory.of(spec)
    for began, pressed in zip(frames.began, frames.pressed, strict=True):
        mean, variance = _mean(so[pressed], noise, steps)
        changes.append(mean - rest)
        variances.append(variance + rest_variance)
        share, deviation = _creep(memory, time[pressed] - time[began])
        shares.append(share)
        unsure.append(deviation)
    return PressReadings(
        np.array(changes),
        np.array(variances),
        np.array(shares),
        np.array(unsure),
        rest - offset,
        rest_variance + unsure_offset,
    )


def _creep(memory: LoadMemory | None, since: Floats) -> tuple[float, float]:
    """Mean of `creeping_load` over some frames, and its relative standard deviation."""
    if memory is None:
        return 1.0, 0.0
    share = float(creeping_load(memory, since).mean())
    moved = [
        float(creeping_load(memory._replace(gamma=memory.gamma + by), since).mean()) - share
        for by in memory.errors
    ]
    return share, float(np.linalg.norm(moved)) / share


def _mean(so: Floats, variance: float, steps: float) -> tuple[Floats, Floats]:
    """Mean readings [taxel] and their variance, steps' own added; NaN where nothing was."""
    count = np.isfinite(so).sum(0)
    total = np.nansum(so, 0)
    safe = np.where(count > 0, count, 1)
    return np.where(count > 0, total / safe, np.nan), variance / safe + steps
