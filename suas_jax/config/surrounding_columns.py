"""Columns of load paths, histories and logs that say where a skin is."""

from typing import NamedTuple

from suas_jax.config.quantities import ZERO_CELSIUS


class SurroundingColumn(NamedTuple):
    """A column that changes one number of [environment]."""

    key: str  # of [environment]
    zero: float  # of the column's scale [SI]
    low: float  # smallest value that a skin meets, in the column's unit
    high: float  # largest


TEMPERATURE, DEPTH = "temperature_degC", "water_depth_m"
SURROUNDINGS = {
    TEMPERATURE: SurroundingColumn("temperature", ZERO_CELSIUS, -40.0, 120.0),
    DEPTH: SurroundingColumn("depth", 0.0, 0.0, 11e3),
}
