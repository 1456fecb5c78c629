"""Oil with a bulk modulus: its constant."""

from typing import Literal

from suas_jax.config.fields import file_key
from suas_jax.config.oil import OilSpec
from suas_jax.config.substances import OilBulkModulus


class CompressibleOilSpec(OilSpec):
    """p = -K ln(V / V0), with V0 the film's volume at rest.

    Attributes:
        bulk_modulus: K [Pa].
    """

    model: Literal["compressible"] = file_key('"compressible"', "compressible")
    bulk_modulus: OilBulkModulus = file_key('"1.5 GPa"')
