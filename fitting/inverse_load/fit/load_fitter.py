"""What fits loads to readings, whatever the dimension: least squares for frames on one skin.

The number of contacts is given; `fitting.inverse_load.fit.selection` finds it. A skin in plane
strain has its fitter in `section_fitter`, a pad in `fitting.inverse_load.pad.fitter`.
"""

import abc

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.model.contact_parameters import ContactParameters
from suas_jax.equilibrium.equilibrium import State


class AbstractLoadFitter(abc.ABC):
    """Least squares for any number of frames, on one skin.

    Attributes:
        parameters: of a contact.
        live: whether frames come one by one.
    """

    parameters: ContactParameters
    live: bool

    @property
    def per_contact(self) -> int:
        """Number of parameters of a contact."""
        return self.parameters.per_contact

    @abc.abstractmethod
    def fit(
        self,
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        start: NDArray[np.float64],
        state: State,
        contacts: int,
        *,
        pull: bool = False,
    ) -> Explanations:
        """Fit frames.

        Args:
            y: readings [frame, taxel] [counts].
            weight: inverse variances [frame, taxel].
            start: parameters [frame, parameter]; those after the forces may be left out.
            state: equilibria near there, a lane a frame.
            contacts: their number.
            pull: seek forces that pull outwards instead of those that push.
        """

    @abc.abstractmethod
    def inside(self, parameters: NDArray[np.float64], contacts: int) -> NDArray[np.float64]:
        """Parameters [frame, parameter] with those beyond their bounds on them."""

    def screened(
        self,
        frames: NDArray[np.intp],
        y: NDArray[np.float64],
        weight: NDArray[np.float64],
        start: NDArray[np.float64],
        contacts: int,
        to_beat: NDArray[np.float64],
    ) -> NDArray[np.intp]:
        """Starting points of several contacts that are worth a fit, all unless told otherwise.

        Args:
            frames: of the starting points; a frame may have several [start].
            y: readings [start, taxel].
            weight: inverse variances [start, taxel].
            start: parameters [start, parameter].
            contacts: their number.
            to_beat: chi2 of a fit that would be no better than what is known [start].
        """
        return np.arange(len(start))
