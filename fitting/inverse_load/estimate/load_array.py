"""Contacts as a structured NumPy array, its fields named with their units."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fitting.inverse_load.estimate.estimate import Contact

FIELDS = {
    "angle": "angle_rad",
    "axial": "axial_m",
    "force": "force_N",
    "diameter": "diameter_m",
    "direction": "direction_rad",
    "tilt": "tilt_rad",
}
"""Names of a contact's quantities with their units."""


def load_type(names: Sequence[str]) -> np.dtype:
    """The type of a load of which some quantities are estimated.

    Its fields are the quantities with their units, such as `angle_rad` and `force_N`, and
    `covariance`, a square of as many rows in their order and units.

    Args:
        names: of the quantities, as `Contact.names` has them.
    """
    size = len(names)
    fields = [(FIELDS.get(name, name), float) for name in names]
    return np.dtype([*fields, ("covariance", float, (size, size))])


def load_array(contacts: Sequence[Contact], names: Sequence[str]) -> NDArray[np.void]:
    """Contacts as an array [contact] of `load_type(names)`, by angle.

    A quantity that a contact lacks is NaN, and so is what its covariance doesn't state.

    Args:
        contacts: of one frame.
        names: of the quantities.
    """
    loads = np.zeros(len(contacts), load_type(names))
    for load, contact in zip(loads, contacts, strict=True):
        for name in names:
            value = getattr(contact, name)
            load[FIELDS.get(name, name)] = np.nan if value is None else value
        covariance = np.full((len(names), len(names)), np.nan)
        if contact.covariance is not None:
            known = [name for name in names if name in contact.names]
            own = [contact.names.index(name) for name in known]
            here = [names.index(name) for name in known]
            covariance[np.ix_(here, here)] = contact.covariance[np.ix_(own, own)]
        load["covariance"] = covariance
    return loads
