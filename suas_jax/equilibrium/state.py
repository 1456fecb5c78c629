"""A state of equilibrium; what only hands one on needs no JAX."""

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from suas_jax.numerics.array_types import Lanes, StationVector


class State(NamedTuple):
    """Membrane unknowns, oil pressure above ambient [Pa] and factor on the loads."""

    q: "StationVector"
    pressure: "Lanes"
    factor: "Lanes"
