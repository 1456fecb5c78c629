"""Inverse load estimation: where contacts are, how strong, and how sure, from readings.

::

    readings -> contact or not                              `load_detection`
             -> nearest states of a table                   `load_table`
             -> least squares with exact derivatives        `load_model`
             -> number of contacts, faulty taxels, status   here

Readings are compared with the skin's own model in counts. A reading's variance is the
converter's noise, its rounding (1/12), a baseline's own error, and the model's error: the
lumped shell is within MODEL_ERROR of the continuum, in terms of the change from rest.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, SupportsIndex

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi2_distribution

from fitting.load_detection import Detector, threshold
from fitting.load_model import FIT_PROGRAMS, SETTLED, Fit, Target
from fitting.load_table import LANES, LoadTable, edge_margin, table_of
from suas_jax.compiled import COMPILED
from suas_jax.config import SkinSpec
from suas_jax.equilibrium import State
from suas_jax.skin import Skin, skin_of

MODEL_ERROR = 2.5e-3
"""Error of the shell's change of readings, relative (`benchmarks/load_estimation.py`)."""
FULL_SCALE = 65535
MOST_CONTACTS = 3

# Accuracy beyond which an estimate is called imprecise: standard deviations.
WANTED_ANGLE = np.deg2rad(2.0)
WANTED_FORCE = 0.2  # of the force
WANTED_DIRECTION = np.deg2rad(10.0)

_SUSPECT = 2e-3  # chance of chi2 below which other explanations are tried
_POOR = 1e-4  # chance of chi2 below which the fit is called poor
_HOPELESS = 9.0  # chi2 per degree of freedom beyond which no number is given
_OUTLIER = 4.5  # residual in standard deviations of a taxel that is left out
_MOST_OUTLIERS = 0.2  # share of the taxels
_FEWEST_TAXELS = 4
_APART = np.deg2rad(10.0)  # modes closer than this are one
_AMBIGUOUS = 6.0  # difference of chi2 below which a second mode is reported
_PAIR_ANGLES, _PAIR_FORCES = 60, 8
_FIRST_STEPS, _MORE_STEPS = 2, 12
_BLOCK = 2048  # frames whose explanations are sought together
_STATUS = {
    "ok": "The estimate and its covariance hold.",
    "no_contact": "Nothing touches the skin, at the stated false-alarm rate.",
    "imprecise": "The readings hardly determine the load: see the covariance.",
    "ambiguous": "Another load explains the readings almost as well: see alternatives.",
    "at_edge": "The contact is at the clamp or beyond it, where the skin can't tell.",
    "poor_fit": "The model leaves more than noise; the covariance is scaled up by it.",
    "wall_contact": "The membrane reaches the wall, beyond which the model doesn't hold.",
    "model_mismatch": "No load on this skin explains the readings: check skin file, "
    "layout and baseline.",
    "saturated": "All taxels are saturated.",
    "too_few_taxels": "Too few taxels have a reading.",
    "no_convergence": "The fit did not converge.",
}


@dataclass(frozen=True)
class Contact:
    """One contact.

    Attributes:
        angle: from the symmetry axis [rad].
        force: total over the width, inwards [N].
        direction: counter-clockwise from the inward radial [rad]; None where held radial.
        covariance: of angle, force and, where free, direction [rad, N, rad]; None where
            the model doesn't hold, and no error can be stated.
        arc_position: along the undeformed outer face, from the symmetry axis [m].
    """

    angle: float
    force: float
    direction: float | None
    covariance: NDArray[np.float64] | None
    arc_position: float | None = None


@dataclass(frozen=True)
class LoadEstimate:
    """What a frame says.

    Attributes:
        contact: whether anything touches the skin; None where that can't be told.
        contacts: the contacts, by angle.
        oil_pressure: above ambient [Pa]; NaN where unknown.
        wall_contact: whether the membrane touches the wall; None where that can't be told.
        chi2_per_dof: weighted squares of the residuals per degree of freedom.
        status: outcome, a key of `STATUS`.
        left_out: taxels (positions in the layout) left out as faulty or missing.
        alternatives: other loads that explain the readings almost as well.
        latency: time of the computation [s].
    """

    contact: bool | None
    contacts: tuple[Contact, ...] = ()
    oil_pressure: float = float("nan")
    wall_contact: bool | None = None
    chi2_per_dof: float = float("nan")
    status: str = "no_contact"
    left_out: tuple[int, ...] = ()
    alternatives: tuple[Contact, ...] = ()
    latency: float = 0.0


STATUS = dict(_STATUS)
"""Statuses and what they mean."""


@dataclass
class _Best:
    """The best explanation of every frame so far; arrays lead with the frame."""

    score: NDArray[np.float64]
    chi2: NDArray[np.float64]
    contacts: NDArray[np.int64]
    parameters: NDArray[np.float64]  # padded with NaN
    information: NDArray[np.float64]
    promise: NDArray[np.float64]
    pressure: NDArray[np.float64]
    min_gap: NDArray[np.float64]
    so: NDArray[np.float64]
    weight: NDArray[np.float64]


@dataclass(frozen=True)
class Warm:
    """The last frame's solution, to start the next one from.

    Attributes:
        parameters: of one contact.
        so: its readings.
        state: its equilibrium, one lane.
    """

    parameters: NDArray[np.float64]
    so: NDArray[np.float64]
    state: State


@dataclass
class LoadEstimator:
    """Estimates loads on one skin; made once, used for any number of frames.

    Args:
        spec: the skin.
        direction: free the contacts' directions; radial otherwise.
        false_alarm: rate at which noise alone may be called a contact.
        noise: standard deviation of a reading [counts]; the skin file's if None.
        model_error: relative error of the model's change of readings.
        rest: readings at rest [taxel, counts], as a baseline has them: readings count from
            there. None: readings are absolute. NaN: the taxel is not used.
        rest_variance: variance of `rest` [taxel, counts^2].
        most_contacts: contacts to tell apart at most, 1 to 3.
        live: compile for single frames instead of batches.
        progress: called with what is being done.

    Raises:
        ValueError: an argument or the skin's electrodes can't be used.
    """

    spec: SkinSpec
    direction: bool = False
    false_alarm: float = 0.01
    noise: float | None = None
    model_error: float = MODEL_ERROR
    rest: NDArray[np.float64] | None = None
    rest_variance: NDArray[np.float64] | float = 0.0
    most_contacts: int = MOST_CONTACTS
    live: bool = False
    progress: Callable[[str], None] = lambda text: None
    skin: Skin = field(init=False)
    table: LoadTable = field(init=False)
    warm: Warm | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if not 0 < self.false_alarm < 0.5:
            raise ValueError(
                f"false_alarm = {self.false_alarm:g}: a rate above 0 and below 0.5 is needed"
            )
        if not 1 <= self.most_contacts <= MOST_CONTACTS:
            raise ValueError(
                f"most_contacts = {self.most_contacts}: 1 to {MOST_CONTACTS} are possible"
            )
        self.skin = skin_of(self.spec)
        assert self.spec.electrodes is not None
        noise = self.spec.electrodes.noise if self.noise is None else self.noise
        if not (np.isfinite(noise) and noise >= 0):
            raise ValueError(f"noise = {noise}: zero or more counts are needed")
        self.reading_noise = float(noise)
        self._outer_radius = float(self.skin.geometry.outer_radius[0])
        # A converter's rounding is noise, too.
        self._variance = noise**2 + 1 / 12 + np.asarray(self.rest_variance, float)
        self.table = table_of(self.spec, self.skin, self.progress)
        self._detector = Detector(self.table.signatures)
        nodes = self.table.nodes
        self._known = np.all(np.isfinite(nodes), 1)
        self._nodes = np.where(self._known[:, None], nodes, 0.0)
        self._squares = self._nodes**2
        self._node_angle = np.repeat(self.table.angles, self.table.forces.shape[1])
        self._node_force = self.table.forces.reshape(-1)
        self._edge = float(self.skin.geometry.half_angle[0]) - edge_margin(self.skin)
        everywhere = self._detector.test(
            np.zeros((1, self.taxels)), np.full((1, self.taxels), 1.0)
        )
        # What a further contact must gain: as rare as a tenth of a false alarm, and never
        # less than Schwarz's criterion asks for two parameters.
        u = threshold(self.false_alarm / 10, float(everywhere.length[0]))
        self._price = max(u**2, 2 * np.log(self.taxels))
        self._per_contact = 3 if self.direction else 2
        self._pairs: _PairSearch | None = None

    @property
    def taxels(self) -> int:
        """Number of taxels in the layout."""
        return len(self.table.rest)

    def estimate(
        self,
        so: NDArray[np.float64],
        faulty: NDArray[np.bool_] | None = None,
        done: Callable[[int], None] = lambda frames: None,
    ) -> list[LoadEstimate]:
        """Estimate the loads of frames.

        Args:
            so: readings [frame, taxel] [counts]; NaN where missing. Readings of 0 and of
                full scale are saturated and left out.
            faulty: taxels known to be faulty [frame, taxel].
            done: called with the number of frames estimated so far.
        """
        so = np.asarray(so, float)
        if so.ndim != 2 or so.shape[1] != self.taxels:
            raise ValueError(
                f"readings of shape {so.shape}: [frame, {self.taxels}] is needed, one column "
                "a taxel of the layout"
            )
        if faulty is None:
            faulty = np.zeros(so.shape, bool)
        size = 1 if self.live else _BLOCK
        found: list[LoadEstimate] = []
        for begin in range(0, len(so), size):
            part = slice(begin, begin + size)
            found += self._batch(so[part], faulty[part])
            done(len(found))
        return found

    def _batch(self, so: NDArray[np.float64], faulty: NDArray[np.bool_]) -> list[LoadEstimate]:
        begin, compiling = time.perf_counter(), COMPILED.seconds
        y = so if self.rest is None else so - self.rest + self.table.rest
        saturated = (so >= FULL_SCALE) | (so <= 0)
        used = np.isfinite(y) & ~saturated & ~faulty
        y = np.where(used, y, 0.0)
        change = np.where(used, y - self.table.rest, 0.0)
        weight = used / (self._variance + (self.model_error * change) ** 2)
        count = used.sum(1)
        enough = count >= max(_FEWEST_TAXELS, self._per_contact + 1)
        test = self._detector.test(change, weight)
        touched = enough & (test.p_value < self.false_alarm)
        results: list[LoadEstimate] = [LoadEstimate(None)] * len(so)
        chi2_rest = (weight * change**2).sum(1)
        unlike_rest = chi2_distribution.sf(chi2_rest, np.maximum(count, 1)) < _POOR
        for i in np.flatnonzero(~touched):
            ratio = float(chi2_rest[i] / max(int(count[i]), 1))
            results[i] = self._untouched(
                so[i], saturated[i], used[i], bool(enough[i]), ratio, bool(unlike_rest[i])
            )
        index = np.flatnonzero(touched)
        if index.size:
            best, others = self._explain(y[index], weight[index])
            short = ((so >= FULL_SCALE) & ~faulty)[index]
            poor = self._chance(best) < _POOR
            for k, i in enumerate(index):
                results[i] = self._report(best, others[k], k, short[k], bool(poor[k]))
        spent = time.perf_counter() - begin - (COMPILED.seconds - compiling)
        spent /= len(so)
        return [replace(result, latency=spent) for result in results]

    def _untouched(
        self, so: Any, saturated: Any, used: Any, enough: bool, ratio: float, unlike: bool
    ) -> LoadEstimate:
        missing = tuple(np.flatnonzero(~used).tolist())
        if not enough:
            present = np.isfinite(so)
            status = "saturated" if present.any() and saturated[present].all() else ""
            return LoadEstimate(None, status=status or "too_few_taxels", left_out=missing)
        if unlike:
            # Not at rest, and no contact that pushes: another skin, offsets, a pull.
            return LoadEstimate(
                None, chi2_per_dof=ratio, status="model_mismatch", left_out=missing
            )
        return LoadEstimate(False, (), 0.0, False, ratio, "no_contact", missing)

    # --- explanations -----------------------------------------------------------------

    def _explain(self, y: Any, weight: Any) -> tuple[_Best, list[tuple[Any, ...]]]:
        """The best explanation of every frame, and second modes as (chi2, parameters)."""
        first, second = self._search(y, weight)
        states = self.table.start(first)
        parameters = self._near(y, weight, first)
        if self.live and self.warm is not None:
            cost = (weight * (y - self.warm.so) ** 2).sum(1)
            node = (weight * (y - self._nodes[first]) ** 2).sum(1)
            if np.isfinite(cost[0]) and cost[0] < node[0]:
                parameters = self.warm.parameters[None, :2]
                states = self.warm.state
        best = self._fitted(y, weight, parameters, states, 1)
        others: list[tuple[Any, ...]] = [()] * len(y)
        self._second_modes(y, weight, second, best, others)
        doubtful = np.flatnonzero(self._chance(best) < _SUSPECT)
        weak = np.setdiff1d(self._hints(y, best), doubtful)
        doubtful = np.union1d(doubtful, weak)
        if doubtful.size:
            self._more_contacts(y, weight, doubtful, best)
            bad = doubtful[self._chance(best)[doubtful] < _SUSPECT / 10]
            if bad.size:
                self._without_outliers(y, weight, bad, best)
        return best, others

    def _search(self, y: Any, weight: Any) -> tuple[Any, Any]:
        """Nearest node of every frame, and the nearest of those far from it (or -1)."""
        cost = weight @ self._squares.T - 2 * (weight * y) @ self._nodes.T
        cost[:, ~self._known] = np.inf
        first = cost.argmin(1)
        lowest = cost[np.arange(len(y)), first]
        near = np.abs(self._node_angle - self._node_angle[first][:, None]) < _APART
        cost[near] = np.inf
        second = cost.argmin(1)
        close = cost[np.arange(len(y)), second] < lowest + 40.0
        return first, np.where(close, second, -1)

    def _near(self, y: Any, weight: Any, node: Any) -> NDArray[np.float64]:
        """Angle and force near some nodes, by the table's own slopes and curvatures.

        Gauss-Newton on the Taylor polynomial of the readings about the node: it costs
        nothing next to one evaluation of the model, and saves one or two.
        """
        taylor = self.table.taylor[node]  # [frame, term, taxel]
        at = np.zeros((len(y), 2))
        for _ in range(3):
            a, f = at[:, :1], at[:, 1:]
            half = (taylor[:, 3] * a**2 + taylor[:, 5] * f**2) / 2
            model = taylor[:, 0] + taylor[:, 1] * a + taylor[:, 2] * f + half
            residual = y - (model + taylor[:, 4] * a * f)
            by_a = taylor[:, 1] + taylor[:, 3] * a + taylor[:, 4] * f
            by_f = taylor[:, 2] + taylor[:, 5] * f + taylor[:, 4] * a
            aa, af, ff = (
                (weight * p * q).sum(1) for p, q in ((by_a, by_a), (by_a, by_f), (by_f, by_f))
            )
            ga, gf = (weight * by_a * residual).sum(1), (weight * by_f * residual).sum(1)
            determinant = np.maximum(aa * ff * (1 + 1e-6) - af**2, 1e-300)
            step = np.stack([ff * ga - af * gf, aa * gf - af * ga], 1) / determinant[:, None]
            at = np.clip(at + np.nan_to_num(step), -0.7, 0.7)
        angle = self._node_angle[node] + at[:, 0] * self.table.steps[0]
        force = self._node_force[node] * np.exp(at[:, 1] * self.table.steps[1])
        return np.stack([angle, force], 1)

    def _second_modes(self, y: Any, weight: Any, second: Any, best: _Best, others: Any) -> None:
        at = np.flatnonzero(second >= 0)
        if not at.size:
            return
        node = second[at]
        start = self._near(y[at], weight[at], node)
        found = self._fitted(y[at], weight[at], start, self.table.start(node), 1)
        for k, i in enumerate(at):
            apart = abs(found.parameters[k, 0] - best.parameters[i, 0]) > _APART
            if not (apart and np.isfinite(found.chi2[k])):
                continue
            mine = (found.chi2[k], found.parameters[k].copy(), found.information[k].copy())
            if found.chi2[k] < best.chi2[i]:
                old = (best.chi2[i], best.parameters[i].copy(), best.information[i].copy())
                _take(best, i, found, k)
                mine = old
            others[i] = mine

    def _chance(self, best: _Best) -> NDArray[np.float64]:
        """Chance of a chi2 as large, were the explanation right."""
        dof = (best.weight > 0).sum(1) - self._per_contact * best.contacts
        value = np.where(np.isfinite(best.chi2), best.chi2, 1e300)
        return np.asarray(chi2_distribution.sf(value, np.maximum(dof, 1)))

    def _hints(self, y: Any, best: _Best) -> NDArray[np.int64]:
        """Frames whose residuals hold the pattern of one more contact (a score test)."""
        if self.most_contacts < 2:
            return np.zeros(0, np.int64)
        pattern = self.table.signatures
        residual = np.where(best.weight > 0, y - best.so, 0.0)
        along = np.maximum((best.weight * residual) @ pattern.T, 0.0)
        size = best.weight @ (pattern**2).T
        gain = (along**2 / np.maximum(size, 1e-300)).max(1)
        return np.flatnonzero(gain > self._price / 2)

    def _more_contacts(self, y: Any, weight: Any, frames: Any, best: _Best) -> None:
        for count in range(2, self.most_contacts + 1):
            used = (weight[frames] > 0).sum(1)
            frames = frames[used > count * self._per_contact]
            if not frames.size:
                return
            if self._pairs is None:
                self._pairs = _PairSearch(self)
            starts = [self._pairs.starts(y[i], weight[i], best, i, count) for i in frames]
            rows = np.repeat(np.arange(len(frames)), [len(s) for s in starts])
            if not rows.size:
                return
            parameters = np.array([row[0] for s in starts for row in s])
            node = np.array([row[1] for s in starts for row in s])
            at = frames[rows]
            found = self._fitted(y[at], weight[at], parameters, self.table.start(node), count)
            found.score += (count - 1) * self._price
            improved = np.zeros(len(y), bool)
            for k, i in enumerate(at):
                if found.score[k] < best.score[i]:
                    _take(best, i, found, k)
                    improved[i] = True
            frames = np.flatnonzero(improved & (self._chance(best) < 0.05))

    def _without_outliers(self, y: Any, weight: Any, frames: Any, best: _Best) -> None:
        """Faulty taxels: fit the rest of them, and count each against the explanation."""
        most = np.maximum(1, np.floor(_MOST_OUTLIERS * (weight[frames] > 0).sum(1)))
        # First from one contact seen by the 80 % of taxels that it explains best.
        trimmed, nodes = weight[frames].copy(), []
        for k, i in enumerate(frames):
            squares = weight[i] * (y[i] - self._nodes) ** 2
            keep = int((weight[i] > 0).sum() - most[k])
            idle = weight[i] <= 0
            squares[:, idle] = np.inf
            order = np.sort(squares, 1)[:, :keep].sum(1)
            order[~self._known] = np.inf
            nearest = int(order.argmin())
            limit = np.partition(squares[nearest], keep - 1)[keep - 1]
            trimmed[k, squares[nearest] > limit] = 0.0
            nodes.append(nearest)
        node_array = np.array(nodes)
        start = np.stack([self._node_angle[node_array], self._node_force[node_array]], 1)
        states = self.table.start(node_array)
        for _ in range(3):
            found = self._fitted(y[frames], trimmed, start, states, 1)
            trimmed = self._inliers(y[frames], weight[frames], found.so)
            start = np.where(
                np.isfinite(found.parameters[:, :2]), found.parameters[:, :2], start
            )
        self._settle(y, weight, frames, best, found, most)
        # Then from several contacts, less the taxels that stand out from them.
        for count in range(2, self.most_contacts + 1):
            at = frames[(best.contacts[frames] == count)]
            at = at[self._chance(best)[at] < _SUSPECT / 10]
            if not at.size:
                continue
            some = np.maximum(1, np.floor(_MOST_OUTLIERS * (weight[at] > 0).sum(1)))
            width = self._per_contact * count
            for _ in range(2):
                inliers = self._inliers(y[at], weight[at], best.so[at])
                begin = best.parameters[at][:, :width]
                node = self._nearest_node(begin[:, 0], begin[:, count])
                again = self._fitted(y[at], inliers, begin, self.table.start(node), count)
                again.score += (count - 1) * self._price
                self._settle(y, weight, at, best, again, some)

    def _inliers(self, y: Any, weight: Any, so: Any) -> NDArray[np.float64]:
        residual = np.abs(np.where(np.isfinite(so), y - so, np.inf)) * np.sqrt(weight)
        return np.where(residual < _OUTLIER, weight, 0.0)

    def _settle(
        self, y: Any, weight: Any, frames: Any, best: _Best, found: _Best, most: Any
    ) -> None:
        left_out = (weight[frames] > 0).sum(1) - (found.weight > 0).sum(1)
        found.score += left_out * _OUTLIER**2
        for k, i in enumerate(frames):
            if left_out[k] <= most[k] and found.score[k] < best.score[i]:
                _take(best, i, found, k)

    def _nearest_node(self, angle: Any, force: Any) -> NDArray[np.intp]:
        j = np.abs(self.table.angles - np.asarray(angle)[:, None]).argmin(1)
        i = np.abs(np.log(self.table.forces[j] / np.maximum(force, 1e-12)[:, None])).argmin(1)
        node = j * self.table.forces.shape[1] + i
        return np.where(self._known[node], node, j * self.table.forces.shape[1])

    # --- least squares ----------------------------------------------------------------

    def _fitted(self, y: Any, weight: Any, start: Any, state: State, contacts: int) -> _Best:
        """Fit frames from given parameters [frame, parameter] (turns may be left out)."""
        frames, width = len(y), self._per_contact * contacts
        if start.shape[1] < width:
            start = np.concatenate([start, np.zeros((frames, width - start.shape[1]))], 1)
        cap = 3 * self.table.forces[:, -1].max()
        lanes = 1 if self.live else (LANES if contacts == 1 else LANES // 4)
        bounds = [(-self._edge, self._edge), (0.0, cap), (-np.pi / 2, np.pi / 2)]
        sides = np.repeat(np.array(bounds[: self._per_contact]), contacts, 0)
        limits: Any = np.repeat(sides.T[..., None], lanes, -1)

        def run(rows: NDArray[np.intp], first: Any, states: State, steps: int) -> Fit:
            """All rows, a batch of lanes after the other, the last one filled up."""
            parts = []
            for begin in range(0, len(rows), lanes):
                pick = np.minimum(np.arange(begin, begin + lanes), len(rows) - 1)
                index = rows[pick]
                target = Target(y[index].T, weight[index].T, *limits)
                there = jax.tree.map(lambda x, i=pick: x[..., i], states)
                program = FIT_PROGRAMS[contacts]
                fit = COMPILED.run(
                    program, self.skin, target, first[pick].T, there, np.array(steps)
                )
                parts.append(jax.tree.map(np.asarray, fit))
            return jax.tree.map(
                lambda *x: np.concatenate(x, -1)[..., : len(rows)].copy(), *parts
            )

        everything = np.arange(frames)
        states = jax.tree.map(np.asarray, state)
        fit = run(everything, start, states, _FIRST_STEPS)
        # A few lanes need more steps than most: together they fill fewer batches.
        again = np.flatnonzero(np.isfinite(fit.chi2) & ~(fit.promise < SETTLED))
        if again.size:
            states = jax.tree.map(lambda x: x[..., again], fit.evaluation.state)
            more = run(again, fit.parameters.T[again], states, _MORE_STEPS)
            for whole, part in zip(jax.tree.leaves(fit), jax.tree.leaves(more), strict=True):
                whole[..., again] = part
        if self.live and contacts == 1 and np.isfinite(fit.chi2[0]):
            e = fit.evaluation
            self.warm = Warm(np.asarray(fit.parameters)[:, 0], np.asarray(e.so)[:, 0], e.state)
        return self._gathered(fit, weight, contacts)

    def _gathered(self, fit: Fit, weight: Any, contacts: int) -> _Best:
        frames = len(fit.chi2)
        most, width = self._per_contact * self.most_contacts, self._per_contact * contacts
        parameters = np.full((frames, most), np.nan)
        parameters[:, :width] = fit.parameters.T
        information = np.full((frames, most, most), np.nan)
        information[:, :width, :width] = np.moveaxis(np.asarray(fit.information), -1, 0)
        return _Best(
            score=np.array(fit.chi2),
            chi2=np.asarray(fit.chi2),
            contacts=np.full(frames, contacts),
            parameters=parameters,
            information=information,
            promise=np.asarray(fit.promise),
            pressure=np.asarray(fit.evaluation.pressure),
            min_gap=np.asarray(fit.evaluation.min_gap),
            so=np.array(fit.evaluation.so.T),
            weight=weight.copy(),
        )

    # --- reports ----------------------------------------------------------------------

    def _contacts(
        self, parameters: Any, information: Any, count: int, scale: float | None
    ) -> tuple[Contact, ...]:
        width = self._per_contact * count
        covariance = _inverse(information[:width, :width])
        contacts = []
        for k in range(count):
            rows = [k + count * j for j in range(self._per_contact)]
            mine = None if scale is None else covariance[np.ix_(rows, rows)] * scale
            turn = float(parameters[k + 2 * count]) if self.direction else None
            contacts.append(
                Contact(
                    float(parameters[k]),
                    float(parameters[k + count]),
                    turn,
                    mine,
                    float(parameters[k] * self._outer_radius),
                )
            )
        return tuple(sorted(contacts, key=lambda c: c.angle))

    def _report(
        self, best: _Best, other: tuple[Any, ...], i: int, short: Any, poor: bool
    ) -> LoadEstimate:
        count = int(best.contacts[i])
        dof = int((best.weight[i] > 0).sum()) - self._per_contact * count
        ratio = float(best.chi2[i] / max(dof, 1))
        out = tuple(np.flatnonzero(~(best.weight[i] > 0)).tolist())
        if not np.isfinite(best.chi2[i]):
            return LoadEstimate(None, status="no_convergence", left_out=out)
        parameters, information = best.parameters[i], best.information[i]
        angles = parameters[:count]
        taxel = np.asarray(self.skin.electrodes.taxels.angle)[:, 0]
        reach = np.abs(taxel[short][:, None] - angles) if short.any() else np.zeros((0, 1))
        wall = bool(best.min_gap[i] <= 0) or bool((reach < _APART).any())
        if poor and ratio > _HOPELESS:
            unknown = True if wall else None
            return LoadEstimate(
                unknown,
                wall_contact=unknown,
                chi2_per_dof=ratio,
                status="wall_contact" if wall else "model_mismatch",
                left_out=out,
            )
        scale = None if wall else (ratio if poor else 1.0)
        contacts = self._contacts(parameters, information, count, scale)
        alternatives: tuple[Contact, ...] = ()
        if count == 1 and other and other[0] < best.chi2[i] + _AMBIGUOUS:
            alternatives = self._contacts(other[1], other[2], 1, 1.0)
        if wall:
            status = "wall_contact"
        elif best.promise[i] > 0.1:
            status = "no_convergence"
        elif poor:
            status = "poor_fit"
        elif np.abs(angles).max() >= self._edge - 1e-6:
            status = "at_edge"
        elif alternatives:
            status = "ambiguous"
        elif any(_imprecise(contact) for contact in contacts):
            status = "imprecise"
        else:
            status = "ok"
        return LoadEstimate(
            True, contacts, float(best.pressure[i]), wall, ratio, status, out, alternatives
        )


def _inverse(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance from information; what is not determined at all has infinite variance."""
    scale = np.sqrt(np.diag(information))
    known = scale > 0
    covariance = np.diag(np.where(known, 0.0, np.inf))
    d = scale[known]
    small = information[np.ix_(known, known)] / np.outer(d, d)
    # Scaled, its diagonal is one: rounding can't hide a direction but below 1e-12.
    small = np.linalg.inv(small + 1e-13 * np.eye(len(d)))
    covariance[np.ix_(known, known)] = small / np.outer(d, d)
    return covariance


def _imprecise(contact: Contact) -> bool:
    if contact.covariance is None:
        return True
    sigma = np.sqrt(np.maximum(np.diag(contact.covariance), 0.0))
    wanted = [WANTED_ANGLE, WANTED_FORCE * contact.force, WANTED_DIRECTION]
    return bool((sigma > wanted[: len(sigma)]).any() or (sigma <= 0).any())


def _take(best: _Best, i: SupportsIndex, found: _Best, k: SupportsIndex) -> None:
    for name in _Best.__dataclass_fields__:
        getattr(best, name)[i] = getattr(found, name)[k]


class _PairSearch:
    """Starting points of several contacts, their gaps superposed.

    The gap changes almost linearly with the loads, and a reading is almost the gap's
    reciprocal: so with u = 1 / (SO - stray) the change of several contacts is the sum of
    those of each. All pairs of a thinned table are tried by one matrix product.
    """

    def __init__(self, estimator: LoadEstimator) -> None:
        table, skin = estimator.table, estimator.skin
        self._estimator = estimator
        self._stray = np.asarray(skin.electrodes.stray / skin.electrodes.lsb)
        j = np.unique(np.linspace(0, len(table.angles) - 1, _PAIR_ANGLES).round().astype(int))
        i = np.linspace(4, table.forces.shape[1] - 2, _PAIR_FORCES).round().astype(int)
        node = (j[:, None] * table.forces.shape[1] + i).reshape(-1)
        self._node = node[estimator._known[node]]
        self._rest = self._gap(table.rest)
        self._change = self._gap(table.nodes[self._node]) - self._rest
        self._angle = estimator._node_angle[self._node]
        self._force = estimator._node_force[self._node]

    def _gap(self, so: Any) -> Any:
        return 1 / np.maximum(so - self._stray, 1e-3)

    def starts(
        self, y: Any, weight: Any, best: _Best, frame: int, count: int
    ) -> list[tuple[Any, int]]:
        """Parameters and the node of the strongest contact, best first."""
        used = weight > 0
        u = np.where(used, self._gap(np.where(used, y, 1.0)), self._rest)
        slope = u**2  # |du/dSO|
        w = np.where(used, weight / slope**2, 0.0)
        d = u - self._rest
        if count == 2:
            # Errors of the superposition grow with the change: weigh it down by them.
            w = np.where(used, 1 / (1 / np.where(used, w, 1.0) + (0.05 * d) ** 2), 0.0)
            scaled = self._change * np.sqrt(w)
            own = (scaled**2).sum(1) - 2 * self._change @ (w * d)
            cost = own[:, None] + own + 2 * scaled @ scaled.T
            cost[np.abs(self._angle[:, None] - self._angle) < np.deg2rad(4)] = np.inf
            cost[np.tril_indices(len(cost))] = np.inf
            chosen: list[tuple[Any, int]] = []
            for _ in range(3):
                a, b = np.unravel_index(cost.argmin(), cost.shape)
                if not np.isfinite(cost[a, b]):
                    break
                pair = [a, b]
                chosen.append(
                    self._start(self._angle[pair], self._force[pair], self._node[pair])
                )
                near_a = np.abs(self._angle - self._angle[a]) < np.deg2rad(8)
                near_b = np.abs(self._angle - self._angle[b]) < np.deg2rad(8)
                cost[np.ix_(near_a, near_b)] = np.inf
                cost[np.ix_(near_b, near_a)] = np.inf
            return chosen
        known = int(best.contacts[frame])
        if known != count - 1:
            return []
        model = self._gap(np.where(used, best.so[frame], 1.0))
        left = np.where(used, u - model, 0.0)
        cost = (self._change**2) @ w - 2 * self._change @ (w * left)
        chosen = []
        for _ in range(3):
            a = int(cost.argmin())
            angle = np.append(best.parameters[frame, :known], self._angle[a])
            force = np.append(best.parameters[frame, known : 2 * known], self._force[a])
            node = self._estimator._nearest_node(angle, force)
            chosen.append(self._start(angle, force, node))
            cost[np.abs(self._angle - self._angle[a]) < np.deg2rad(8)] = np.inf
        return chosen

    def _start(self, angle: Any, force: Any, node: Any) -> tuple[Any, int]:
        strongest = int(np.argmax(force))
        return np.concatenate([angle, force]), int(node[strongest])
