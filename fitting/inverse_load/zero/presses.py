"""Known presses, and the frames of a log that hold them.

A press is told in words, ``"500 g at 0 deg"`` or, on a pad, ``"500 g at 0 deg, 20 mm"``, or
stands in the log as `suas fit sensor` reads it: columns `load_0_force_N`, `load_0_angle_deg` or
`load_0_arc_mm` and, on a pad, `load_0_axial_mm`. The log begins at rest; the frames before the
first press are its baseline.
"""

import re
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.inverse_load.zero.zero import KnownPress
from suas_jax.config import GeometrySpec, parse_quantity
from suas_jax.config.quantities import DimensionName
from suas_jax.config.tolerance import deviation_of, is_uncertain_text, parse_uncertain
from suas_jax.skin.plain import angles_at, clamped_edge, plain_geometry

FORCE_ERROR = 2e-3
"""Standard deviation of a known force that states none, relative: of a kitchen scale."""
PLACE_ERROR = 1e-3
"""Standard deviation of a known place that states none, along arc and axis [m]."""
_FINGER = 6e-3  # diameter of what presses on a pad where none is told [m]
_LEAST = 1e-6  # of a known quantity's deviation: rad, m, share of the force
_NEAR = 1e-6  # step over which the model's angle is differentiated by a told place [rad or m]
_KNOWN = re.compile(r"\s*(?P<force>.+?)\s+at\s+(?P<place>[^,]+?)\s*(?:,\s*(?P<axial>.+?)\s*)?")
_GRAMS = re.compile(r"(?<![A-Za-z])(k?)g(?![A-Za-z])")
_EXAMPLE = '"500 g at 0 deg" or "5 N +- 0.05 N at arc 12 mm"; on a pad "500 g at 0 deg, 20 mm"'
_PRESSED, _AT_REST = 0.5, 0.1  # of the change that a press is expected to make
_SEEN = 4.0  # standard deviations of noise that a press is seen by
_FEWEST = 3  # frames of rest, and of a press
_SETTLING, _LEAVING = 1 / 3, 0.1  # shares of a press that are left out at its ends


class PressedFrames(NamedTuple):
    """Frames of a log."""

    rest: NDArray[np.int64]  # those before the first press
    pressed: list[NDArray[np.int64]]  # those of every press, when it has settled
    began: list[int]  # first frame of every press


def known_press(text: str, geometry: GeometrySpec, diameter: float | None = None) -> KnownPress:
    """Read ``--known "FORCE at PLACE"``, on a pad ``"FORCE at PLACE, AXIAL"``.

    Masses weigh 9.80665 m/s^2. Places are angles, or arc lengths of the inner face from its
    middle; along the axis, distances from the middle of the pad.

    The text is a press in words; the diameter is that of what presses on a pad [m], None for a
    fingertip's.
    Raises ValueError: the text can't be understood, or the skin has no such place.
    """
    where = f'--known "{text}"'
    found = _KNOWN.fullmatch(text)
    if found is None:
        raise ValueError(f"{where}: expected FORCE at PLACE, such as {_EXAMPLE}")
    pad = geometry.dimension == 3
    if pad and found["axial"] is None:
        raise ValueError(
            f'{where}: on a pad the place along the axis is needed, too, such as "{text}, 0 mm"'
        )
    if not pad and found["axial"] is not None:
        raise ValueError(
            f"{where}: the skin is in plane strain, where a press has no place along the "
            f'axis; leave ", {found["axial"]}" out'
        )
    force, error = _quantity(_GRAMS.sub(r"\1gf", found["force"]), "force", where)
    if not force > 0:
        raise ValueError(f"{where}: a force above zero is needed, that presses inwards")
    place = found["place"].strip()
    by_arc = place.startswith("arc ") or not place.rstrip(")").endswith(("deg", "rad", "°"))
    if not by_arc and not geometry.has_angle:
        raise ValueError(
            f'{where}: angles mean nothing on geometry.section = "{geometry.section}"; give '
            'the place along the arc, such as "arc 12 mm"'
        )
    at, place_error = _quantity(
        place.removeprefix("arc "), "length" if by_arc else "angle", where
    )
    name, section = "arc" if by_arc else "angle", plain_geometry(geometry).section
    angle, beside = angles_at(geometry, name, np.array([at, at + _NEAR])).tolist()
    if not abs(angle) < float(section.half_angle[0]):
        _, edge = clamped_edge(geometry, by_arc)
        raise ValueError(
            f"{text}: the place is beyond the clamps of the skin, at -{edge} and {edge}"
        )
    if place_error is None:
        place_error = PLACE_ERROR / float(section.size[0])
    else:
        place_error *= (beside - angle) / _NEAR
    error = FORCE_ERROR * force if error is None else error
    deviations = max(place_error, _LEAST), max(error, _LEAST * force)
    told = section.given_angle if geometry.has_angle else section.arc
    place = float(told(jnp.array([angle]))[0])
    press = KnownPress(angle, force, *deviations, text, place)
    if not pad:
        return press
    axial, axial_error = _quantity(found["axial"], "length", where)
    size, half = diameter or _FINGER, float(geometry.width) / 2
    if not abs(axial) + size / 2 < half:
        raise ValueError(
            f"{text}: a disc of {1e3 * size:g} mm at {1e3 * axial:g} mm along the axis "
            f"does not lie on the pad, which ends {1e3 * half:g} mm from its middle"
        )
    axial_error = PLACE_ERROR if axial_error is None else max(axial_error, _LEAST)
    return replace(press, axial=axial, axial_deviation=axial_error, diameter=size)


def _quantity(text: str, kind: DimensionName, where: str) -> tuple[float, float | None]:
    try:
        if not is_uncertain_text(text):
            return parse_quantity(text, kind), None
        value = parse_uncertain(text, kind)
    except ValueError as error:
        raise ValueError(f"{where}: {text}: {error}") from None
    return float(value), deviation_of(value)


def frames_of_presses(so: Floats, patterns: Floats, noise: float) -> PressedFrames:
    """Which frames hold the presses, in their order; the log begins at rest.

    Readings are [frame, taxel] [counts], NaN where missing. Patterns are the changes of
    readings that are expected under every press [press, taxel], and the noise is the standard
    deviation of a reading [counts].
    Raises ValueError: the log has no rest before the first press, or another number of presses.
    """
    first = np.nanmedian(so[:_FEWEST], 0)
    change = np.nan_to_num(so - first)
    size = (patterns**2).sum(1)
    floor = _AT_REST + 3 * noise / np.sqrt(size)  # [press]
    amplitude = change @ patterns.T / size
    pressed = (amplitude > _PRESSED).any(1)
    runs = [run for run in _runs(pressed) if len(run) >= _FEWEST]
    if len(runs) != len(patterns):
        weak = np.flatnonzero(_PRESSED * np.sqrt(size) < _SEEN * noise)
        raise ValueError(
            f"the log holds {len(runs)} presses, but {len(patterns)} are known: give --known "
            "once for each, in their order; a press is a stretch of frames whose readings "
            "change by more than half of what its force should do"
            + "".join(
                f"; press {i + 1} should change readings by {np.abs(patterns[i]).max():.1f} "
                f"counts at most, which noise of {noise:.1f} hides: press harder, or elsewhere"
                for i in weak
            )
        )
    before = np.arange(runs[0][0])
    rest = before[(np.abs(amplitude[before]) < floor).all(1)]
    if len(rest) < _FEWEST:
        raise ValueError(
            f"the log has {len(rest)} frames at rest before the first press, and {_FEWEST} "
            "are needed: readings count from there; record some seconds at rest first"
        )
    return PressedFrames(rest, [settled(run) for run in runs], [int(run[0]) for run in runs])


def settled(run: NDArray[np.int64]) -> NDArray[np.int64]:
    """The part of a press in which it is held: not its first third, nor its last tenth."""
    last = max(int(np.ceil((1 - _LEAVING) * len(run))), int(_SETTLING * len(run)) + 1)
    return run[int(_SETTLING * len(run)) : last]


def _runs(flags: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Stretches of frames in a row that are flagged."""
    at = np.flatnonzero(flags)
    return np.split(at, np.flatnonzero(np.diff(at) > 1) + 1) if at.size else []
