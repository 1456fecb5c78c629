"""What a solved solid's figure and its file read: fields at the nodes, and the stations."""

from jaxtyping import Array

from suas_jax.equilibrium.balance import Problem, State
from suas_jax.mechanics.solid.fields import Fields, nodal_fields
from suas_jax.mechanics.solid.solid import Solid


def solid_fields(problem: Problem, state: State, shown: State) -> tuple[Fields, Array]:
    """Fields at the nodes, and the angles of the stations [rad]: for `Solution.read`."""
    del shown
    solid = problem.mechanics
    assert isinstance(solid, Solid)
    return nodal_fields(solid, state.q), solid.angles[:, 0]
