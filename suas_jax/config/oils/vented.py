"""Oil that is free to flow in and out."""

from typing import ClassVar, Literal

from suas_jax.config.fields import file_key
from suas_jax.config.oil import OilSpec


class VentedOilSpec(OilSpec):
    """p = 0, no constraint on the volume."""

    model: Literal["vented"] = file_key('"vented"', "vented")

    trapped: ClassVar[bool] = False
    yields: ClassVar[bool] = False
