"""The paper's capacitance: plane electrodes."""

from jaxtyping import Array, Float

from suas_jax.sensing.capacitance import AbstractFilmFormula


class ParallelPlate(AbstractFilmFormula):
    """The paper's formula: eps0 eps_r / d per area."""

    def thickness(
        self, gap: Float[Array, "*shape lane"], wall_curvature: Array
    ) -> Float[Array, "*shape lane"]:
        """The gap itself."""
        del wall_curvature
        return gap

    def gap(
        self, thickness: Float[Array, "*shape lane"], wall_curvature: Array
    ) -> Float[Array, "*shape lane"]:
        """The thickness itself."""
        del wall_curvature
        return thickness
