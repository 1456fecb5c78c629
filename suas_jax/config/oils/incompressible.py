"""Oil that keeps its volume."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from suas_jax.config.oil import OilSpec


class IncompressibleOilSpec(OilSpec):
    """dV = 0."""

    model: Literal["incompressible"] = Field(
        default="incompressible", examples=['"incompressible"']
    )

    yields: ClassVar[bool] = False
