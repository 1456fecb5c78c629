"""What the dimensions of a skin consist of; kinds of section: `suas_jax.config.sections`."""

import itertools
import math
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self, cast

from pydantic import ValidationInfo, model_validator

from suas_jax.config.fields import AsList, PositiveLength, Quantity, Spec, file_key, quantity

_SHARE = quantity("number", at_least=0.0)


def _place(value: object, info: ValidationInfo) -> float:
    """A place along the arc or the axis, which may be written as an angle or a length."""
    try:
        share: float = _SHARE.func(value, info)  # type: ignore[call-arg]
    except ValueError:
        raise ValueError(
            "places are fractions of the way between the clamps, from 0 to 1"
        ) from None
    return share


_Fraction = Annotated[float, Quantity(_place, rules=_SHARE.rules)]


class _AlongArc(Spec):
    """What `AlongSpec` and `SheetSpec` share: places along the arc, and a value at each."""

    arc: Annotated[tuple[_Fraction, ...], AsList] = file_key("[0, 0.5, 1]")
    value: Any

    @property
    def mirrored(self) -> bool:
        """Whether the right half is the mirror image of the left one."""
        return bool(self.value == self.value[::-1]) and _even(self.arc)


class AlongSpec(_AlongArc):
    """A length that varies along the arc, smoothly through the values of a table.

    Attributes:
        arc: places as fractions of the inner face's arc, from 0 at the left clamp to 1.
        value: the length at each of them [m].
    """

    value: Annotated[tuple[PositiveLength, ...], AsList] = file_key(
        '["1.2 mm", "1.5 mm", "1.2 mm"]'
    )

    @model_validator(mode="after")
    def _a_value_for_each_place(self) -> Self:
        _check_places("arc", self.arc, len(self.value), "values")
        return self

    @property
    def mean(self) -> float:
        """Of the values joined by straight lines [m]."""
        return _mean(self.arc, self.value)


class SheetSpec(_AlongArc):
    """A length that varies along the arc and along the axis of a pad.

    Attributes:
        arc: places as fractions of the inner face's arc, from 0 at the left clamp to 1.
        axial: places as fractions of the pad's length, from 0 at its end towards -axial to 1.
        value: a row for each place along the arc, of the lengths at the places along the
            axis [m].
    """

    axial: Annotated[tuple[_Fraction, ...], AsList] = file_key("[0, 1]")
    value: Annotated[tuple[Annotated[tuple[PositiveLength, ...], AsList], ...], AsList] = (
        file_key('[["1.2 mm", "1.3 mm"], ["1.5 mm", "1.5 mm"], ["1.2 mm", "1.3 mm"]]')
    )

    @model_validator(mode="after")
    def _a_value_for_each_place(self) -> Self:
        _check_places("arc", self.arc, len(self.value), "rows of values")
        for k, row in enumerate(self.value):
            _check_places("axial", self.axial, len(row), f"values in row {k} (from 0)")
        return self

    @property
    def mirrored_along_axis(self) -> bool:
        """Whether the half towards +axial is the mirror image of the other one."""
        return all(row == row[::-1] for row in self.value) and _even(self.axial)

    @property
    def mean(self) -> float:
        """Of the values joined by straight lines [m]."""
        return _mean(self.arc, [_mean(self.axial, row) for row in self.value])


def _check_places(key: str, places: Sequence[float], count: int, what: str) -> None:
    if len(places) != count or count < 2:
        raise ValueError(
            f"{len(places)} places ({key}) and {count} {what}: as many of both are needed, at "
            "least two"
        )
    rising = all(a < b for a, b in itertools.pairwise(places))
    if places[0] != 0 or places[-1] != 1 or not rising:
        raise ValueError(f"{key} must rise from 0 to 1, for example [0, 0.5, 1]")


def _even(places: Sequence[float]) -> bool:
    """Whether places are their own mirror image."""
    pairs = zip(places, places[::-1], strict=True)
    return all(math.isclose(a, 1 - b, abs_tol=1e-12) for a, b in pairs)


def _mean(places: Sequence[float], values: Sequence[float]) -> float:
    pairs = zip(itertools.pairwise(places), itertools.pairwise(values), strict=True)
    return sum((b - a) * (u + v) / 2 for (a, b), (u, v) in pairs)


_LENGTH = quantity("length", above=0.0)


def _length_or_table(value: Any, info: ValidationInfo) -> float | AlongSpec | SheetSpec:
    if isinstance(value, SheetSpec) or (isinstance(value, dict) and "axial" in value):
        return SheetSpec.model_validate(value, context=info.context)
    if isinstance(value, dict | AlongSpec):
        return AlongSpec.model_validate(value, context=info.context)
    number: float = cast(Any, _LENGTH.func)(value, info)
    return number


LengthAlong = Annotated[
    float | AlongSpec | SheetSpec,
    Quantity(_length_or_table, dimension="length", rules=_LENGTH.rules),
]

Mismatch = Annotated[float, quantity("number", above=-0.5, below=0.5)]


class GeometrySpec(Spec):
    """Dimensions of a skin whose cross-section is a curve clamped at both straight edges.

    Attributes:
        section: kind of curve.
        thickness: of the membrane along its normal [m], or a table along the arc, and along
            the axis where the ends are clamped.
        width: extent along the axis [m].
        oil_gap: distance from the membrane's inner face to the rigid wall along the normal
            [m], or a table as of the thickness.
        ends: whether the two curved ends are clamped too, so that the membrane is solved in
            three dimensions, or slide, which is plane strain.
        mounting: length of the membrane along the arc over that of its seat, less one.
        mounting_axial: the same along the axis, in three dimensions.
    """

    section: str
    thickness: LengthAlong = file_key('"1.5 mm"')
    width: PositiveLength = file_key('"123 mm"')
    oil_gap: LengthAlong = file_key('"5 mm"')
    ends: Literal["sliding", "clamped"] = file_key('"clamped"', "sliding")
    mounting: Mismatch | None = file_key('"0.05 %"', None)
    mounting_axial: Mismatch | None = file_key('"0.05 %"', None)

    has_angle: ClassVar[bool] = True

    @property
    def dimension(self) -> int:
        """3 where the curved ends are clamped, else 2 (plane strain)."""
        return 3 if self.ends == "clamped" else 2

    @property
    def is_circle(self) -> bool:
        """Whether the section is a circle of one thickness and gap."""
        return False

    @property
    def mean_thickness(self) -> float:
        """Of the membrane [m]."""
        return self.thickness if isinstance(self.thickness, float) else self.thickness.mean

    @property
    def mean_gap(self) -> float:
        """From the inner face to the wall [m]."""
        return self.oil_gap if isinstance(self.oil_gap, float) else self.oil_gap.mean

    @property
    def sheets(self) -> tuple[str, ...]:
        """Keys of what varies along the axis too."""
        keys = ("thickness", "oil_gap")
        return tuple(key for key in keys if isinstance(getattr(self, key), SheetSpec))

    def require_no_sheets(self, what: str) -> None:
        """Refuse tables along the axis for `what`, which begins the message.

        Raises ValueError: there is one.
        """
        if self.sheets:
            raise ValueError(
                f"{what} takes tables along the arc only; take axial out of "
                f"geometry.{self.sheets[0]}"
            )

    @property
    def mirrored_along_axis(self) -> bool:
        """Whether the half towards +axial is the mirror image of the other one."""
        return all(getattr(self, key).mirrored_along_axis for key in self.sheets)
