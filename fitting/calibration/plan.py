"""Known loads of a guided calibration, in the order in which it asks for them."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from suas_jax.config import SkinSpec, format_quantity, parse_quantity
from suas_jax.config.quantities import DimensionName
from suas_jax.skin.plain import clamped_edge

REST = "rest"
_PARTS = re.compile(r"\s*[,;]\s*")
# Places of the loads where nothing else is asked for, as shares of the half angle.
_PRESSED, _VERIFIED = (-0.5, 0.0, 0.5), (0.22,)


PlaceName = Literal["angle", "arc"]
DIMENSION: dict[PlaceName, DimensionName] = {"angle": "angle", "arc": "length"}
"""What kind of quantity tells a place along the arc."""


def place_name(spec: SkinSpec) -> PlaceName:
    """What tells a place along the arc of a skin."""
    return "angle" if spec.geometry.has_angle else "arc"


def edge_of(spec: SkinSpec) -> tuple[float, str]:
    """That of a skin's right clamp, as a number and for a person."""
    return clamped_edge(spec.geometry, by_arc=place_name(spec) == "arc")


def settable(place: float, by: PlaceName) -> float:
    """The nearest place that a person can set: tenths of a degree, or of a millimetre."""
    unit = math.radians(1) if by == "angle" else 1e-3
    return round(place / unit, 1) * unit


@dataclass(frozen=True)
class Press:
    """A known load."""

    place: float  # where it acts: its angle [rad], or arc [m], as scenes state it
    force: float  # inwards [N]
    axial: float | None = None  # from the middle of a pad [m]; None in plane strain
    by: PlaceName = "angle"  # which of both `place` is

    @property
    def text(self) -> str:
        """In words, such as "at 45 deg with 5 N"."""
        along = (
            "" if self.axial is None else f", {format_quantity(self.axial, 'length')} axially"
        )
        return (
            f"at {format_quantity(self.place, DIMENSION[self.by])}{along} with "
            f"{format_quantity(self.force, 'force')}"
        )

    def report(self) -> dict[str, float]:
        """For `--json`: SI units, angles in degrees."""
        name, scale = ("arc_m", 1.0) if self.by == "arc" else ("angle_deg", math.degrees(1))
        found = {name: scale * self.place, "force_N": self.force}
        return found if self.axial is None else found | {"axial_m": self.axial}


@dataclass(frozen=True)
class Step:
    """A recording of the calibration."""

    name: str  # of its log, without the ending
    press: Press | None = None  # the known load; None at rest
    verifies: bool = False  # whether it is kept out of the fit, to be estimated afterwards


def steps_of(presses: Sequence[Press], verified: Sequence[Press]) -> tuple[Step, ...]:
    """Rest, the presses, and those that verify."""
    return (
        Step(REST),
        *(Step(f"press_{k + 1}", press) for k, press in enumerate(presses)),
        *(Step(f"verify_{k + 1}", press, verifies=True) for k, press in enumerate(verified)),
    )


def usual_presses(spec: SkinSpec, force: float) -> tuple[tuple[Press, ...], tuple[Press, ...]]:
    """Places where nothing else is asked for: three to calibrate, one to verify.

    All presses have the same force [N].
    """
    axial = 0.0 if spec.geometry.dimension == 3 else None
    by = place_name(spec)
    edge, _ = edge_of(spec)
    pressed, verified = (
        tuple(Press(settable(share * edge, by), force, axial, by) for share in shares)
        for shares in (_PRESSED, _VERIFIED)
    )
    return pressed, verified


def press_of(text: str, spec: SkinSpec, option: str) -> Press:
    """A press from the command line: "45 deg, 5 N", on a pad "45 deg, 10 mm, 5 N".

    On paths and splines it begins with an arc, "22 mm, 5 N".

    Raises ValueError: naming what is expected.
    """
    parts = _PARTS.split(text.strip())
    pad, by = spec.geometry.dimension == 3, place_name(spec)
    kind = DIMENSION[by]
    try:
        if len(parts) != 2 + pad:
            raise ValueError("so many quantities are not expected")
        place, force = parse_quantity(parts[0], kind), parse_quantity(parts[-1], "force")
        axial = parse_quantity(parts[1], "length") if pad else None
    except ValueError as error:
        usual = ("45 deg" if by == "angle" else "22 mm") + (", 10 mm" if pad else "") + ", 5 N"
        raise ValueError(f'{option} "{text}": {error}; expected "{usual}"') from None
    half, edge = edge_of(spec)
    if abs(place) >= half or not force > 0:
        raise ValueError(
            f'{option} "{text}": an {by} within {edge} and a force above zero are expected'
        )
    if axial is not None and abs(axial) >= spec.geometry.width / 2:
        raise ValueError(f'{option} "{text}": the axial place is beyond the pad\'s end')
    return Press(place, force, axial, by)
