"""A table of solved states of one radial contact: where every search for loads begins.

Angles are even over the skin, forces geometric up to the one at which the membrane would
touch the wall, angle by angle. The table is made once a skin, in batches, and kept in the
user's cache folder under a hash of everything it depends on.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats, Rows
from fitting.inverse_load.model.evaluation import (
    NoRestError,
    at_rest,
    in_batches,
    read_program,
    rest_program,
    slopes_program,
)
from fitting.inverse_load.model.kept_key import kept_key
from suas_jax.config import SkinSpec
from suas_jax.equilibrium.state import State
from suas_jax.files.cache_folder import kept_arrays
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.skin import Skin

LANES = 128
"""Lanes of the compiled programs that work through tables."""
_FORCES = 24
_LOWEST = 1 / 200  # smallest force of the table in terms of the largest
_PROBES = 16  # angles at which the largest force is sought
_GAP_LEFT = 0.02  # smallest gap in the table in terms of the film's


@dataclass(frozen=True)
class LoadTable:
    """States under one radial contact, and at rest."""

    angles: Floats  # of the contact [angle, rad]
    forces: Floats  # of the contact [angle, force] [N], ascending
    so: Floats  # readings [angle, force, taxel]; NaN where no state was found
    rest: Floats  # readings at rest [taxel]
    q: Floats  # unknowns of the states [angle, force, dof, station]
    pressure: Floats  # of the oil [angle, force] [Pa]
    # force at which the membrane reaches the wall [angle] [N]; infinite where none does
    first_contact: Floats
    rest_pressure: Floats = field(default_factory=lambda: np.zeros(()))  # of the oil [Pa]
    # derivatives of the readings by angle, force, direction and the square of the arc that is
    # pressed [angle, force, 4, taxel]
    slopes: Floats = field(default_factory=lambda: np.zeros(()))

    @property
    def nodes(self) -> Floats:
        """Readings node by node [angle*force, taxel]."""
        return self.so.reshape(-1, self.so.shape[-1])

    @property
    def signatures(self) -> Floats:
        """Change of readings per newton of a light contact [angle, taxel].

        Those of neighbours where no state was found, as on a skin that nearly buckles.
        """
        found = (self.so[:, 0] - self.rest) / self.forces[:, :1]
        known = np.isfinite(found).all(1)
        rows = [np.interp(self.angles, self.angles[known], own[known]) for own in found.T]
        return np.stack(rows, 1)

    @property
    def steps(self) -> tuple[float, float]:
        """Between neighbouring nodes: angle [rad], logarithm of the force."""
        ratio = self.forces[0, 1] / self.forces[0, 0]
        return float(self.angles[1] - self.angles[0]), float(np.log(ratio))

    @functools.cached_property
    def taylor(self) -> Floats:
        """Readings about every node [angle*force, term, taxel].

        Terms: value, slopes by angle and by log force (in `steps`), then the second
        derivatives angle-angle, angle-force, force-force. Forces are per angle; the
        reference to neighbours at the same force is made by the slope along the force.
        """
        _, step = self.steps
        shift = np.log(self.forces[:, 0])
        drift = np.gradient(shift)[:, None, None] / step  # nodes by which rows are displaced
        by_f = np.gradient(self.so, axis=1)
        ff = np.gradient(by_f, axis=1)
        along = np.gradient(self.so, axis=0)  # at the same node number
        by_a = along - drift * by_f
        af = np.gradient(by_a, axis=1)
        aa = np.gradient(by_a, axis=0) - drift * af
        terms = np.stack([self.so, by_a, by_f, aa, af, ff], 2)
        return np.nan_to_num(terms.reshape(-1, 6, self.so.shape[-1]))

    def start(self, node: Rows) -> State:
        """States of some nodes, a lane each."""
        q = self.q.reshape(-1, *self.q.shape[2:])[node]
        ones = np.ones(len(node))
        pressure = self.pressure.reshape(-1)[node]
        return State(np.moveaxis(q, 0, -1), pressure, ones)  # type: ignore[arg-type]


def edge_margin(skin: Skin) -> float:
    """Angle from a clamp within which no contact is sought [rad]: two thicknesses."""
    geometry = skin.geometry
    return float(2 * geometry.thickness[0] / geometry.mid_size[0])


def table_of(
    spec: SkinSpec, skin: Skin, progress: Callable[[str], None] = lambda text: None
) -> LoadTable:
    """The table of a skin, from the cache where it is there."""

    def built() -> dict[str, Floats]:
        progress("building the table of solved states")
        return vars(build_table(skin))

    return LoadTable(**kept_arrays(table_key(spec, skin), built))


def table_key(spec: SkinSpec, skin: Skin) -> str:
    """Digest of all that the table of a skin depends on."""
    return kept_key(spec, elements=skin.elements)


def build_table(skin: Skin) -> LoadTable:
    """Solve all states of the table.

    Raises NoRestError: the skin has no stable state at rest.
    """
    rest, _, unloaded, failed = _solve(skin, np.zeros(1), np.zeros(1), None)
    if failed[0] or (skin.prestressed and not COMPILED.run(rest_program, skin, unloaded)[0]):
        raise NoRestError
    edge = float(skin.geometry.half_angle[0]) - edge_margin(skin)
    count = 2 * round(np.rad2deg(edge)) + 1
    angles = np.linspace(-edge, edge, max(count, 31))
    cap = _largest_along(skin, angles)
    ladder = np.geomspace(_LOWEST, 1.0, _FORCES)
    forces = cap[:, None] * ladder
    grid = np.repeat(angles[:, None], _FORCES, 1)
    columns: list[tuple[np.ndarray, ...]] = []
    state: State | None = None
    for k in range(_FORCES):  # each force continues the one before
        found = _solve(skin, grid[:, k], forces[:, k], state)
        state = found[2]
        failed = found[3] != 0
        readings = np.where(failed[:, None], np.nan, found[0].T)
        q = np.moveaxis(np.asarray(state.q), -1, 0)
        columns.append((readings, q, np.asarray(state.pressure)))
    so, q, pressure = (np.stack([c[i] for c in columns], 1) for i in range(3))
    touch = first_contacts(skin, angles, forces[:, -1])
    at_rest = np.asarray(unloaded.pressure)[0]
    table = LoadTable(angles, forces, so, rest[:, 0], q, pressure, touch, at_rest)
    return replace(table, slopes=_slopes(skin, table))


def _slopes(skin: Skin, table: LoadTable) -> Floats:
    """See the table's."""
    loads = np.stack([np.repeat(table.angles, _FORCES), table.forces.reshape(-1)], 1)

    def run(loads: Floats, state: State) -> Floats:
        return np.asarray(COMPILED.run(slopes_program, skin, *loads, state))

    slopes = in_batches(run, loads, table.start(np.arange(len(loads))), LANES)
    slopes = slopes.reshape(*table.forces.shape, *slopes.shape[1:])
    return np.where(np.isfinite(table.so)[:, :, None], slopes, np.nan)


def first_contacts(skin: Skin, angles: np.ndarray, below: np.ndarray) -> np.ndarray:
    """Forces of one radial load at which the membrane reaches the wall [N].

    The skin comes without its wall; angles are those of the load [rad]. `below` are forces a
    little less than those of first contact.
    """
    low = below.copy()
    _, gap, _, failed = _solve(skin, angles, low, None)
    high, above = 1.02 * low, np.full(len(low), np.inf)
    for _ in range(40):  # outwards until the gap closes
        wide = ~np.isfinite(above)
        _, further, _, result = _solve(skin, angles, high, None)
        above = np.where(wide & (result == 0) & (further <= 0), high, above)
        if np.isfinite(above).all():
            break
        open_ = ~np.isfinite(above) & (result == 0)
        low = np.where(open_, high, low)
        high = np.where(np.isfinite(above), above, 1.1 * high)
    known = np.isfinite(above) & (failed == 0) & (gap > 0)
    above = np.where(known, above, low)
    for _ in range(20):
        middle = (low + above) / 2
        _, gap, _, _ = _solve(skin, angles, middle, None)
        low, above = np.where(gap > 0, middle, low), np.where(gap > 0, above, middle)
        if (above - low < 1e-4 * above).all():
            break
    return np.where(known, above, np.inf)


def _largest_along(skin: Skin, angles: np.ndarray) -> np.ndarray:
    """Largest forces at angles of which many lie side by side [N]."""
    probes = np.linspace(angles[0], angles[-1], _PROBES)
    cap = np.exp(np.interp(angles, probes, np.log(_largest_forces(skin, probes))))
    # Between probes a membrane may reach the wall: near the clamps, and where its curvature
    # changes. There nothing would be known of first contact.
    past = _solve(skin, angles, cap, None)[1] <= 0
    if past.any():
        cap[past] = _largest_forces(skin, angles[past])
    return cap


def _largest_forces(skin: Skin, angles: np.ndarray) -> np.ndarray:
    """Forces that leave little of the gap, or the last ones that have a state [N]."""
    wanted = _GAP_LEFT * float(skin.geometry.oil_gap[0])
    low, high = np.full(len(angles), 1e-3), np.full(len(angles), np.inf)
    force = low.copy()
    for _ in range(60):
        _, gap, _, result = _solve(skin, angles, force, None)
        fits = (result == 0) & (gap > wanted)
        low, high = np.where(fits, force, low), np.where(fits, high, force)
        open_ = np.isinf(high)
        force = np.where(open_, 2 * low, np.sqrt(low * np.where(open_, 1.0, high)))
        if not open_.any() and (high < 1.05 * low).all():
            break
        if low.max() > 1e9:
            break
    return low


def rest_readings(skin: Skin) -> np.ndarray:
    """Readings of the undeformed skin [taxel] [counts]."""
    return _solve(skin, np.zeros(1), np.zeros(1), None)[0][:, 0]


def _solve(
    skin: Skin, angle: np.ndarray, force: np.ndarray, start: State | None
) -> tuple[np.ndarray, np.ndarray, State, np.ndarray]:
    """Readings, smallest gap, states and results of any number of single loads."""
    parts = []
    for begin in range(0, len(angle), LANES):
        index = np.minimum(np.arange(begin, begin + LANES), len(angle) - 1)
        if start is None:
            state = at_rest(skin, LANES)
        else:
            state = jax.tree.map(lambda x, i=index: x[..., i], start)
        loads = jnp.asarray(angle[index]), jnp.asarray(force[index])
        parts.append(COMPILED.run(read_program, skin, *loads, state))
    joined = jax.tree.map(lambda *x: jnp.concatenate(x, -1)[..., : len(angle)], *parts)
    so, gap, state, result = joined
    return np.asarray(so), np.asarray(gap), state, np.asarray(result)
