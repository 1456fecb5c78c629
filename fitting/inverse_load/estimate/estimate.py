"""Estimate of the loads in one frame: contacts, covariances and a named status."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.arrays import Floats
from fitting.inverse_load.estimate.load_field import LoadField

# Accuracy beyond which an estimate is called imprecise: standard deviations.
WANTED = {
    "angle": np.deg2rad(2.0),
    "arc": 2e-3,
    "axial": 2e-3,
    "force": 0.2,  # of the force
    "direction": np.deg2rad(10.0),
    "tilt": np.deg2rad(10.0),
}

STATUS = {
    "ok": "The estimate and its covariance hold.",
    "ok_drifted": "The estimate and its covariance hold. The readings at rest have left the "
    "baseline by more than 3 counts, which are taken off: look at the device, or take a new "
    "baseline.",
    "no_contact": "Nothing touches the skin, at the stated false-alarm rate.",
    "drifting": "Nothing touches the skin. Its readings at rest have left the baseline by more "
    "than 3 counts, which are taken off.",
    "imprecise": "The readings leave more open than 2 degrees or mm, 20 % of the force or 10 "
    "degrees of direction (one standard deviation, without the skin file's tolerances).",
    "ambiguous": "Another load explains the readings almost as well: see alternatives, or "
    "field. Or contacts contradict the measured oil pressure, or one of several is wider than "
    "25 mm, as others may lie there.",
    "load_field": "No small number of contacts explains the readings, but a pressure over the "
    "skin does, such as a palm's, a strap's or many fingers': see field.",
    "pull": "Something pulls the skin outwards: the force is negative. Or something presses it "
    "all around: see field, if there is one.",
    "at_edge": "The contact is at the clamp or beyond the taxels, where readings say little: "
    "how far place and force are off is not known.",
    "moving": "The film is still moving: more than 5 % of the readings' change may be motion, "
    "which the covariance counts. A tap is told by its impulse once it is over.",
    "fading": "A light contact fades where a stronger one has ended, as the dent does that is "
    "left in a membrane that relaxes: readings cannot say whether anything touches the skin.",
    "poor_fit": "The model is wrong by more than noise and tolerances explain; the covariance "
    "is scaled up accordingly.",
    "wall_contact": "The membrane lies on the wall, which takes all further load unseen: at "
    "least the force stated acts (95 %).",
    "model_mismatch": "No load on this skin explains the readings: check skin file, "
    "layout and baseline.",
    "saturated": "All taxels are saturated.",
    "too_few_taxels": "Too few taxels have a reading.",
    "coarse": "The frame's time was spent before its search ended, which goes on with the next "
    "frames: contacts are those known so far, of which there may be more or fewer; no error is "
    "stated.",
    "no_convergence": "The fit did not converge.",
    "layout_mismatch": "The readings are of another layout than the skin's.",
    "empty_log": "The log holds no frame.",
}
"""Statuses and what they mean."""

FIELDS = {
    "angle": "angle_rad",
    "arc": "arc_m",
    "axial": "axial_m",
    "force": "force_N",
    "diameter": "diameter_m",
    "direction": "direction_rad",
    "tilt": "tilt_rad",
}
"""Names of a contact's quantities with their units."""

BESIDE = {
    "spread": ("spread_m", "spread_deviation_m"),
    "arc_extent": ("extent_arc_m", "extent_arc_deviation_m"),
    "axial_extent": ("extent_axial_m", "extent_axial_deviation_m"),
    "arc_force": ("tangential_force_N", "tangential_force_deviation_N"),
    "axial_force": ("tangential_force_axial_N", "tangential_force_axial_deviation_N"),
}
"""What is estimated beside them, with its standard deviation: keys in reports."""


@dataclass(frozen=True)
class Contact:
    """One contact."""

    # as scenes state it: of a circle from the symmetry axis, of a path or spline that of the
    # normal [rad]
    angle: float
    force: float  # total, inwards [N]; negative where the skin is pulled
    # counter-clockwise from the inward radial [rad]; None where held radial
    direction: float | None
    # of the parameters that are free, in the order of `names`, SI units and radians; None where
    # the model doesn't hold, and no error can be stated
    covariance: Floats | None
    # along the undeformed outer face, from the symmetry axis [m]
    arc_position: float | None = None
    # the part of the covariance that comes from the skin file's tolerances and calibration, and
    # so is shared by all frames; None where there is none
    systematic: Floats | None = None
    axial: float | None = None  # from the middle of a pad [m]; None in plane strain
    # of a round contact on a pad [m]; None where it was not estimated
    diameter: float | None = None
    # of the force out of the section's plane towards +axial [rad]; None in plane strain, and
    # where held radial
    tilt: float | None = None
    # arc length of the inner face from its middle [m]; None on a circle
    arc: float | None = None
    by_arc: bool = False  # whether the arc is what was estimated, not the angle
    # arc of the outer face that a wide contact presses, and its standard deviation [m]; None
    # where a line explains the readings
    spread: tuple[float, float] | None = None
    # diameter along the arc of the even ellipse whose second moments a contact on a pad has,
    # and its standard deviation [m]; None where the taxels can't tell
    arc_extent: tuple[float, float] | None = None
    axial_extent: tuple[float, float] | None = None  # likewise along the axis
    # force along growing angles, and its standard deviation [N]; None where the taxels can't
    # tell
    arc_force: tuple[float, float] | None = None
    axial_force: tuple[float, float] | None = None  # likewise along the axis

    @property
    def names(self) -> tuple[str, ...]:
        """What was estimated, in the order of the covariance."""
        place = "arc" if self.by_arc else "angle"
        order = (place, "axial", "force", "diameter", "direction", "tilt")
        return tuple(name for name in order if getattr(self, name) is not None)

    @property
    def noise_covariance(self) -> Floats | None:
        """The part of the covariance that comes from the readings' noise."""
        if self.covariance is None or self.systematic is None:
            return self.covariance
        return self.covariance - self.systematic

    def deviation(self, name: str) -> float:
        """Standard deviation of what was estimated, by its name; NaN where unknown."""
        if self.covariance is None:
            return float("nan")
        k = self.names.index(name)
        return float(np.sqrt(max(self.covariance[k, k], 0.0)))

    @property
    def imprecise(self) -> bool:
        """Whether some deviation by the readings' noise is larger than anybody wants.

        What a skin file leaves open is the same in all frames, and no frame's fault.
        """
        if self.noise_covariance is None:
            return True
        sigma = np.sqrt(np.maximum(np.diag(self.noise_covariance), 0.0))
        wanted = WANTED | {"force": WANTED["force"] * abs(self.force), "diameter": np.inf}
        limits = [wanted[name] for name in self.names]
        return bool((sigma > limits).any() or (sigma <= 0).any())


@dataclass(frozen=True)
class Tap:
    """A press that was over before the film had followed it."""

    time: float  # of the last frame before it [s]
    duration: float  # until the skin was at rest again [s]
    place: Contact  # with the steady force that would have moved the skin as much in the mean
    impulse: float  # [N s]
    deviation: float  # its standard deviation [N s]


@dataclass(frozen=True)
class LoadEstimate:
    """What a frame says."""

    # whether anything touches the skin; None where the readings cannot say
    contact: bool | None
    contacts: tuple[Contact, ...] = ()  # the contacts, by angle
    oil_pressure: float = float("nan")  # above ambient [Pa]; NaN where unknown
    # whether the membrane touches the wall; None where that is not known
    wall_contact: bool | None = None
    # weighted squares of the residuals per degree of freedom
    chi2_per_dof: float = float("nan")
    status: str = "no_contact"  # outcome, a key of `STATUS`
    # taxels (positions in the layout) left out as faulty or missing
    left_out: tuple[int, ...] = ()
    # other loads that explain the readings almost as well: another place of one contact, or two
    # contacts in place of a wide one
    alternatives: tuple[Contact, ...] = ()
    latency: float = 0.0  # time of the computation [s]
    # force that acts at least, 95 % sure, where the wall may take more [N]
    at_least: float | None = None
    # of the readings at rest that was taken off, mean and largest over the taxels [counts];
    # None where none is followed
    drift: tuple[float, float] | None = None
    tap: Tap | None = None  # that is over with this frame; None where none is
    # a pressure over the skin that explains the readings as well as contacts do, or better
    field: LoadField | None = None

    @property
    def status_text(self) -> str:
        """The status, with the bound where there is one."""
        if self.at_least is None:
            return self.status
        return f"saturated by wall contact: at least {self.at_least:.4g} N"


def load_type(names: Sequence[str]) -> np.dtype:
    """The type of a load of which some quantities are estimated.

    Its fields are the quantities with their units, such as `angle_rad` and `force_N`, and
    `covariance`, a square of as many rows in their order and units.

    The quantities have their names from `Contact.names`.
    """
    size = len(names)
    fields = [(FIELDS.get(name, name), float) for name in names]
    return np.dtype([*fields, ("covariance", float, (size, size))])


def load_array(contacts: Sequence[Contact], names: Sequence[str]) -> NDArray[np.void]:
    """Contacts as an array [contact] of `load_type(names)`, by angle.

    A quantity that a contact lacks is NaN, and so is what its covariance doesn't state.
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
