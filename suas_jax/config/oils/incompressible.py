"""Oil that keeps its volume."""

from typing import ClassVar, Literal

from suas_jax.config.fields import file_key
from suas_jax.config.oil import OilSpec


class IncompressibleOilSpec(OilSpec):
    """dV = 0."""

    model: Literal["incompressible"] = file_key('"incompressible"', "incompressible")

    yields: ClassVar[bool] = False
