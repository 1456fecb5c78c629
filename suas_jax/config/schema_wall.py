"""The wall under the skin: whether it holds the membrane, and how hard it is."""

from __future__ import annotations

from typing import Any

from pydantic import Field, ValidationInfo, field_validator

from suas_jax.config.fields import PositiveLength, PositivePressure, Spec
from suas_jax.config.substances import WallBulkModulus, WallExpansion


class SoftLayerSpec(Spec):
    """A soft layer on the wall, such as a fabric.

    Attributes:
        thickness: of the layer [m].
        stiffness: pressure per strain [Pa].
    """

    thickness: PositiveLength = Field(examples=['"0.5 mm"'])
    stiffness: PositivePressure = Field(examples=['"2 MPa"'])


class WallSpec(Spec):
    """The wall, a cylinder around the skin's axis.

    Attributes:
        contact: whether it holds the membrane; if not, contact is reported only.
        layer: a soft layer on it; None where the wall is rigid.
        expansion: growth of its lengths per kelvin [1/K], or the name of what it is made of;
            the clamps go with it.
        bulk_modulus: of what it is made of, against ambient pressure [Pa].
    """

    contact: bool = Field(default=True, examples=["true"])
    layer: SoftLayerSpec | None = Field(
        default=None, examples=['{ thickness = "0.5 mm", stiffness = "2 MPa" }']
    )
    expansion: WallExpansion | None = Field(default=None, examples=['"7e-5 / K"'])
    bulk_modulus: WallBulkModulus | None = Field(default=None, examples=['"3 GPa"'])

    @field_validator("contact", mode="before")
    @classmethod
    def _true_or_false(cls, value: Any) -> Any:
        if not isinstance(value, bool):
            raise ValueError("true or false is expected")
        return value

    @field_validator("layer")
    @classmethod
    def _only_in_contact(
        cls, layer: SoftLayerSpec | None, info: ValidationInfo
    ) -> SoftLayerSpec | None:
        if layer is not None and info.data.get("contact") is False:
            raise ValueError("has no effect with contact = false; take one of them out")
        return layer
