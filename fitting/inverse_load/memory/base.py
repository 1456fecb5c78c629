"""What estimates ask of a membrane's memory, on a section and on a pad."""

import abc

from fitting.arrays import Floats
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.selection import Selection
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors


class AbstractMemoryFollower(abc.ABC):
    """Follows what the membrane of one skin remembers, frame after frame."""

    selection: Selection  # of what explains a frame, less what the past leaves of it
    errors: AbstractSystematicErrors  # of the inputs and of the memory
    pressure: float  # of the oil in the frame, if nothing presses [Pa]

    @abc.abstractmethod
    def forget(self) -> None:
        """Begin with a membrane that has been at rest for long."""

    @abc.abstractmethod
    def before(self, time: float) -> Floats:
        """Take the time of a frame [s]; return what the past leaves of its readings [channel].

        A clock that goes backwards begins anew.
        """

    @abc.abstractmethod
    def after(self, best: Explanations | None) -> None:
        """Take what explains the frame; None: nothing does."""

    @abc.abstractmethod
    def untouched(self) -> None:
        """Take a frame that nothing presses."""

    def again(self) -> Floats | None:
        """What the past leaves beside the loads that were found; None where that is the same.

        The frame is then explained once more.
        """
        return None
