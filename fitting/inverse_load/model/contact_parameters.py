"""Parameters of a contact, and their places in a vector."""

from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True)
class ContactParameters:
    """Parameters of a contact, in the order of covariances.

    In a vector of several contacts all of one name stand together: all angles come first.
    """

    # among "angle" [rad], "axial" [m], "force" [N], "diameter" [m], "direction" [rad] and
    # "tilt" [rad]
    names: tuple[str, ...]

    @property
    def per_contact(self) -> int:
        """Number of parameters of a contact."""
        return len(self.names)

    @cached_property
    def places(self) -> int:
        """How many of them, the first ones, say where the contact is."""
        return self.names.index("force")

    def rows(self, name: str, contacts: int) -> slice:
        """Where the values of one name stand in a vector of some contacts."""
        k = self.names.index(name)
        return slice(k * contacts, (k + 1) * contacts)


SECTION = ContactParameters(("angle", "force"))
SECTION_WITH_DIRECTION = ContactParameters(("angle", "force", "direction"))


def pad_parameters(*, diameter: bool, direction: bool) -> ContactParameters:
    """Parameters of a contact on a pad.

    `diameter` says whether the diameter is estimated, `direction` whether turn and tilt of the
    force are.
    """
    names = ("angle", "axial", "force")
    more = ("diameter",) * diameter + ("direction", "tilt") * direction
    return ContactParameters((*names, *more))
