"""Columns of load paths, histories and logs that say where a skin is."""

from typing import NamedTuple

from suas_jax.config.quantities import ZERO_CELSIUS


class SurroundingColumn(NamedTuple):
    """A column that changes one number of [environment]."""

    key: str  # of [environment]
    zero: float  # of the column's scale [SI]
    low: float  # smallest value that a skin meets, in the column's unit
    high: float  # largest

    def beyond(self, *ends: float) -> float | None:
        """The value of some that is farthest beyond what a skin meets; None where none is."""
        worst = max(ends, key=lambda x: abs(x - (self.low + self.high) / 2))
        return None if self.low <= worst <= self.high else worst


TEMPERATURE, DEPTH = "temperature_degC", "water_depth_m"
SURROUNDINGS = {
    TEMPERATURE: SurroundingColumn("temperature", ZERO_CELSIUS, -40.0, 120.0),
    DEPTH: SurroundingColumn("depth", 0.0, 0.0, 11e3),
}
