"""Parts of `LoadEstimator` for contacts on a pad: table, search, fits, posterior.

The table is kept between runs: reading it takes no JAX, solving it does.
"""

import functools
from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.estimate.assessment import LoadAssessment
from fitting.inverse_load.estimate.parts import EstimationParts
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.fit.detection import PadDetector
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.load_posterior import AbstractLoadPosterior
from fitting.inverse_load.fit.systematic import AbstractSystematicErrors
from fitting.inverse_load.memory.series import LoadMemory
from fitting.inverse_load.model.kept_key import kept_key
from fitting.inverse_load.pad.facts import facts_of
from fitting.inverse_load.pad.fitter import AskewFitter, PadFitter
from fitting.inverse_load.pad.input_errors import PadErrors
from fitting.inverse_load.pad.interpolant import PLAIN, PadInterpolant
from fitting.inverse_load.pad.marginal import Told
from fitting.inverse_load.pad.memory import PadMemoryErrors
from fitting.inverse_load.pad.table import FINE, PadResolution, PadTable
from fitting.inverse_load.search.base import AbstractNodeSearch, PairSearch
from fitting.steps import finished
from suas_jax.config import InputErrors, SkinSpec
from suas_jax.equilibrium.state import State
from suas_jax.files.cache_folder import kept_arrays
from suas_jax.runtime.start import before_computing

if TYPE_CHECKING:
    from fitting.statistics.log_probability import NumpyBatch
    from suas_jax.scene.skin import Skin

APART = 12e-3
"""Contacts closer than this are one mode of the search [m]."""
_EVERY = 2  # of the table's places is a node, and of its forces one of those of pairs
_CLOSEST = 6e-3  # contacts of a pair are at least so far apart [m]

_SAME = 1e-3  # distance below which two contacts are the same [m]
_MIRRORS = np.array([[-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])

_DIAMETER = 6e-3  # of the table's discs where it is estimated [m]


class PadNodeSearch(AbstractNodeSearch):
    """The coarse search of one pad.

    The table has states under one radial contact; the radius is that of the outer face [m].
    """

    def __init__(self, table: PadTable, radius: float) -> None:
        # Steps on the interpolant find their way from far.
        coarse = table.thinned(_EVERY)
        loads, channels = coarse.nodes
        rest = np.append(table.rest, 0.0)
        levels = len(loads) // len(coarse.places)
        super().__init__(
            loads,
            channels,
            rest,
            table.places,
            table.signatures,
            table.stray,
            levels=levels,
            separate=APART,
        )
        self._table, self._radius = coarse, radius
        self._grid = (len(coarse.angle), len(coarse.axial))

    def distance(self, a: Floats, b: Floats) -> Floats:
        """Between places on the outer face [..., (angle, axial, ...)] [m]."""
        along = self._radius * (a[..., 0] - b[..., 0])
        return np.asarray(np.hypot(along, a[..., 1] - b[..., 1]))

    def nearest_to(self, parameters: Floats, contacts: int) -> Rows:
        """See the base class."""
        angle, axial, force = (parameters[:, k * contacts] for k in range(3))
        i = np.abs(self._table.angle - angle[:, None]).argmin(1)
        j = np.abs(self._table.axial - axial[:, None]).argmin(1)
        place = i * self._grid[1] + j
        forces = self.loads[:, 2].reshape(-1, self.levels)[place]
        return np.asarray(
            place * self.levels + np.abs(forces - force[:, None]).argmin(1), np.intp
        )

    def near(self, y: Floats, weight: Floats, node: Rows) -> Floats:
        """The nodes' own loads: steps on the interpolant cost nothing."""
        return self.loads[node]

    def states(self, node: Rows) -> State:
        """Empty: fits on the interpolant start from no state."""
        return self.rest_states(len(node))

    def rest_states(self, frames: int) -> State:
        """Empty states of so many frames."""
        none: Any = np.zeros((0, 0, frames))
        zero: Any = np.zeros(frames)
        return State(none, zero, zero)

    def several(self) -> PairSearch:
        """See the base class."""
        index = np.arange(len(self.loads)).reshape(*self._grid, self.levels)
        thinned = index[:, :, 1::_EVERY].reshape(-1)  # 3, 12, 46 and 82 % of the largest
        return PairSearch(self, thinned, closest=_CLOSEST, apart=APART)


class PadPosterior(AbstractLoadPosterior):
    """The posterior of contacts on one pad: even over place and force.

    What is not told is at its most likely for every sample, to first order. Several contacts
    are solved at the mode; what the sum of single ones leaves out there is taken as the same
    for all samples.
    """

    def __init__(self, fitter: PadFitter, nodes: AbstractNodeSearch) -> None:
        super().__init__(nodes, 2, fitter.prior_volume(), _SAME, _MIRRORS)
        self._fitter = fitter

    def log_probability(self, y: Floats, mode: Explanations) -> "NumpyBatch":
        """See the base class."""
        from fitting.statistics.log_probability import NumpyBatch

        count, fitter = int(mode.contacts[0]), self._fitter
        centre = mode.parameters[0, : fitter.per_contact * count]
        pull = bool(centre[fitter.parameters.rows("force", count)][0] < 0)
        correction = fitter.correction(centre, count)
        weight, told = mode.weight[:1], fitter.told
        start = centre[None, : PLAIN * count]
        fit = finished(fitter.fitting(y[None], weight, start, count, correction, pull))
        at, other = told.turned(fit.parameters, count)[0][0], told.columns(count)[1]

        def log_probability(points: Floats) -> Floats:
            whole = told.whole(points, at, count)
            low, high = fitter.squares.bounds(whole, count, pull)
            inside = ((whole >= low) & (whole <= high)).all(1)
            within = np.clip(whole, low, high)
            chi2 = fitter.squares.profiled(y[None], weight, within, count, correction, other)
            return np.where(inside, -chi2 / 2, -np.inf)

        return NumpyBatch(log_probability)


def pad_parts(
    spec: SkinSpec,
    errors: InputErrors,  # of its inputs
    *,
    diameter: float | None,
    direction: bool,  # whether directions are told
    live: bool,  # whether frames come one by one
    most_contacts: int,
    from_rest: bool,  # whether readings count from a baseline
    progress: Callable[[str], None],
    workers: Executor | None,  # that solve the table's states; None: this process
    resolution: PadResolution,  # of the tables
    aside: Executor | None,  # that solves several contacts beside frames; None: their thread
) -> EstimationParts:
    """The parts for a pad.

    The diameter is that of the table's discs, around which contacts' diameters are expected
    [m]; None tells the diameter, too.
    """
    memory = LoadMemory.of(spec)
    if memory is not None:  # beside the table, which knows nothing of it
        material = spec.material.model_copy(update={"relaxation": None})
        spec = spec.model_copy(update={"material": material})
    make_skin = _skin_maker(spec, resolution)
    middle = _table(spec, diameter or _DIAMETER, progress, workers, resolution)
    facts = facts_of(spec, errors, make_skin, middle, max(most_contacts, 2))
    if most_contacts > 1 or not live or aside is not None:
        make_skin()  # what is solved for frames can't be refused in the middle of them
    radius = facts.shape.radius
    interpolant = PadInterpolant(middle, radius)
    told = Told(diameter=diameter is None, direction=direction)
    kind: dict[str, Any] = {"live": live, "most_contacts": most_contacts}
    own = make_skin, facts.shape, interpolant, told
    fitter = PadFitter(*own, **kind, aside=aside)
    nodes = PadNodeSearch(middle, radius)
    detector = PadDetector(nodes.signatures, (len(middle.angle), len(middle.axial)))
    a, z = 0.3 * fitter.edge[0], 0.3 * fitter.edge[1]
    force = 0.3 * float(middle.cap.min())
    one, two = np.array([[a, z, force]]), np.array([[a, -a, z, -z, force, force]])
    single, several = (interpolant(x, k + 1).readings[0, :-1] for k, x in enumerate((one, two)))
    places = ContactPlaces(spec.geometry, facts.arc)
    own_errors = errors.names, facts.effects, middle, radius
    systematic: AbstractSystematicErrors = PadErrors(*own_errors, from_rest=from_rest)
    if memory is not None:
        systematic = PadMemoryErrors(systematic, memory)
    return EstimationParts(
        make_skin,
        facts.line,
        middle,
        middle.rest,
        middle.rest_pressure,
        detector,
        nodes,
        fitter,
        LoadAssessment(fitter, nodes, places, facts.taxels),
        (single, several),
        PadPosterior(fitter, nodes),
        systematic,
        AskewFitter(*own, **kind),
    )


def _skin_maker(spec: SkinSpec, resolution: PadResolution) -> "Callable[[], Skin]":
    """Makes a pad's model once, when it is first needed: frames go without, and without JAX."""

    @functools.cache
    def make() -> "Skin":
        before_computing()
        from suas_jax.scene.skin import skin_of

        return skin_of(spec, elements=resolution.elements, contact=False)

    return make


def table_of_pad(
    spec: SkinSpec, diameter: float, progress: Callable[[str], None], workers: Executor | None
) -> "tuple[Skin, PadTable]":
    """A pad's model and its table of solved states.

    The diameter is that of the contacts [m]. Workers solve the table's states; without them
    (None) this process does.
    """
    return _skin_maker(spec, FINE)(), _table(spec, diameter, progress, workers)


def _table(
    spec: SkinSpec,
    diameter: float,
    progress: Callable[[str], None],
    workers: Executor | None,
    resolution: PadResolution = FINE,
) -> PadTable:
    def shown(done: int, total: int) -> None:
        if done == 1 or done % 10 == 0 or done == total:
            progress(
                f"table of solved states, contacts of {1e3 * diameter:g} mm: "
                f"{done} of {total} columns"
            )

    return pad_table_of(spec, diameter, resolution, progress=shown, workers=workers)


def pad_table_of(
    spec: SkinSpec,  # the pad, with electrodes
    diameter: float,  # of the contacts [m]
    resolution: PadResolution = FINE,  # of the table
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
    workers: Executor | None = None,
) -> PadTable:
    """The table of a pad, from the cache where it is there.

    That of a pad whose thickness or gap differ from side to side is made from an even pad's,
    see `fitting.inverse_load.pad.uneven`. Raises ValueError: its section is not its own mirror
    image.

    `progress` is called with the number of columns solved and their total. Workers solve the
    table (`fitting.workers`); without them (None) this process does, on all cores.
    """
    name = kept_key(spec, diameter=diameter, resolution=resolution)
    how = diameter, resolution, progress, workers
    found = kept_arrays(name, lambda: vars(_made(spec, *how)))
    return PadTable(**{**found, "diameter": float(found["diameter"])})  # type: ignore[arg-type]


def _made(
    spec: SkinSpec,
    diameter: float,
    resolution: PadResolution,
    progress: Callable[[int, int], None],
    workers: Executor | None,
) -> PadTable:
    before_computing()
    from fitting.inverse_load.pad.table_build import build_pad_table
    from fitting.inverse_load.pad.uneven import even_spec, same_places, uneven_table
    from suas_jax.scene.skin import skin_of

    how = diameter, resolution, progress, workers
    skin = skin_of(spec, elements=resolution.elements, contact=False)
    if spec.geometry.mirrored_along_axis and skin.geometry.symmetric:
        return build_pad_table(skin, *how)
    even = even_spec(spec)
    if not skin_of(even, contact=False).geometry.symmetric:
        raise ValueError(
            "geometry.section: loads on a pad are told from a table of a quarter of it, "
            "which takes a section that is its own mirror image"
        )
    table = pad_table_of(even, diameter, resolution, progress=progress, workers=workers)
    return uneven_table(table, (even, spec), skin, same_places(even, spec), progress)
