"""Oil with a bulk modulus: its constant."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from suas_jax.config.oil import OilSpec
from suas_jax.config.substances import OilBulkModulus


class CompressibleOilSpec(OilSpec):
    """p = -K ln(V / V0), with V0 the film's volume at rest.

    Attributes:
        bulk_modulus: K [Pa].
    """

    model: Literal["compressible"] = Field(default="compressible", examples=['"compressible"'])
    bulk_modulus: OilBulkModulus = Field(examples=['"1.5 GPa"'])
