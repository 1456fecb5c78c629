"""What the dimensions of a skin consist of, whatever its section.

The kinds of section are the files of `suas_jax.config.sections`; the curve of each is the file
of the same name in `suas_jax.skin.sections`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self, cast

from pydantic import Field, ValidationInfo, model_validator

from suas_jax.config.fields import AsList, PositiveLength, Quantity, Spec, quantity

_Fraction = Annotated[float, quantity("number", at_least=0.0)]


class AlongSpec(Spec):
    """A length that varies along the arc, smoothly through the values of a table.

    Attributes:
        arc: places as fractions of the inner face's arc, from 0 at the left clamp to 1.
        value: the length at each of them [m].
    """

    arc: Annotated[tuple[_Fraction, ...], AsList] = Field(examples=["[0, 0.5, 1]"])
    value: Annotated[tuple[PositiveLength, ...], AsList] = Field(
        examples=['["1.2 mm", "1.5 mm", "1.2 mm"]']
    )

    @model_validator(mode="after")
    def _a_value_for_each_place(self) -> Self:
        if len(self.arc) != len(self.value) or len(self.arc) < 2:
            raise ValueError(
                f"{len(self.arc)} places (arc) and {len(self.value)} values: as many of both "
                "are needed, at least two"
            )
        rising = all(a < b for a, b in zip(self.arc, self.arc[1:], strict=False))
        if self.arc[0] != 0 or self.arc[-1] != 1 or not rising:
            raise ValueError("arc must rise from 0 to 1, for example [0, 0.5, 1]")
        return self

    @property
    def mirrored(self) -> bool:
        """Whether the right half is the mirror image of the left one."""
        places = zip(self.arc, self.arc[::-1], strict=True)
        return self.value == self.value[::-1] and all(
            math.isclose(a, 1 - b, abs_tol=1e-12) for a, b in places
        )

    @property
    def mean(self) -> float:
        """Of the values joined by straight lines [m]."""
        pairs = zip(self.arc, self.arc[1:], self.value, self.value[1:], strict=False)
        return sum((b - a) * (u + v) / 2 for a, b, u, v in pairs)


_LENGTH = quantity("length", above=0.0)


def _length_or_table(value: Any, info: ValidationInfo) -> float | AlongSpec:
    if isinstance(value, dict | AlongSpec):
        return AlongSpec.model_validate(value, context=info.context)
    number: float = cast(Any, _LENGTH.func)(value, info)
    return number


LengthAlong = Annotated[
    float | AlongSpec,
    Quantity(_length_or_table, dimension="length", rules=_LENGTH.rules),
]

Mismatch = Annotated[float, quantity("number", above=-0.5, below=0.5)]


class GeometrySpec(Spec):
    """Dimensions of a skin whose cross-section is a curve clamped at both straight edges.

    Attributes:
        section: kind of curve.
        thickness: of the membrane along its normal [m], or a table along the arc.
        width: extent along the axis [m].
        oil_gap: distance from the membrane's inner face to the rigid wall along the normal
            [m], or a table along the arc.
        ends: whether the two curved ends are clamped too, so that the membrane is solved in
            three dimensions, or slide, which is plane strain.
        mounting: length of the membrane along the arc over that of its seat, less one.
        mounting_axial: the same along the axis, in three dimensions.
    """

    section: str
    thickness: LengthAlong = Field(examples=['"1.5 mm"'])
    width: PositiveLength = Field(examples=['"123 mm"'])
    oil_gap: LengthAlong = Field(examples=['"5 mm"'])
    ends: Literal["sliding", "clamped"] = Field(default="sliding", examples=['"clamped"'])
    mounting: Mismatch | None = Field(default=None, examples=['"0.05 %"'])
    mounting_axial: Mismatch | None = Field(default=None, examples=['"0.05 %"'])

    has_angle: ClassVar[bool] = True

    @property
    def dimension(self) -> int:
        """3 where the curved ends are clamped, else 2 (plane strain)."""
        return 3 if self.ends == "clamped" else 2

    @property
    def is_circle(self) -> bool:
        """Whether the section is a circle of one thickness and gap."""
        return False

    def circle(self, what: str) -> Any:
        """The `CircleSpec` that this is, for what knows no other section.

        Args:
            what: works with circles alone; begins the message.

        Raises:
            ValueError: the section is another one.
        """
        raise ValueError(
            f"{what} works with circles of one thickness and gap alone, and geometry.section "
            f'= "{self.section}" or a table along its arc makes this skin another one'
        )

    @property
    def mean_thickness(self) -> float:
        """Of the membrane [m]."""
        t = self.thickness
        return t.mean if isinstance(t, AlongSpec) else t

    @property
    def mean_gap(self) -> float:
        """From the inner face to the wall [m]."""
        return self.oil_gap.mean if isinstance(self.oil_gap, AlongSpec) else self.oil_gap
