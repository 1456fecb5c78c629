"""Oil with air in it: its constants."""

from typing import Annotated, Literal

from suas_jax.config.fields import PositivePressure, file_key, quantity
from suas_jax.config.oil import OilSpec
from suas_jax.config.substances import OilBulkModulus


class AeratedOilSpec(OilSpec):
    """V/V0 = (1 - f) exp(-p / K) + f p0 / (p0 + p): bubbles that a filling left behind.

    Attributes:
        air_fraction: f, the share of the film's volume at rest that is air.
        ambient_pressure: p0, absolute pressure around the skin, and in the air at rest [Pa].
        bulk_modulus: K of the oil itself [Pa].
    """

    model: Literal["aerated"] = file_key('"aerated"', "aerated")
    air_fraction: Annotated[float, quantity("number", above=0.0, below=1.0)] = file_key("0.01")
    ambient_pressure: PositivePressure = file_key('"101.3 kPa"', 101.3e3)
    bulk_modulus: OilBulkModulus = file_key('"1.5 GPa"', 1.5e9)
