"""The posterior of one frame's loads: every mode sampled, and how probable each is.

Readings of a few taxels may be explained by contacts at several places, by a contact at its
mirror place, or by two contacts where one was. Least squares knows one minimum; here all of
the minima that the table shows are fitted, and each is sampled by emcee. Their
probabilities are ratios of evidence by Laplace's approximation::

    Z = exp(-chi2 / 2) (2 pi)^(p/2) sqrt(det C) k! / V^k

with the prior even over angle, force and (where free) direction: V is their volume, and k
contacts can't be told by their order. What a calibration leaves open is not in it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.fit.covariance import covariance_of
from fitting.inverse_load.fit.explanation import Explanations, LoadFitter
from fitting.inverse_load.model.evaluation import loads_from
from fitting.inverse_load.search.nearest import APART
from fitting.statistics.chain import Posterior
from fitting.statistics.laplace import Gaussian
from fitting.statistics.posterior import Settings, sample
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.equilibrium import equilibrium

PROBABLE = 0.01
"""Modes less probable than this are neither sampled nor reported."""
_SINGLE_STARTS = 4
_WORTH_FITTING = 60.0  # chi2, on the table, above its smallest
_SAME = np.deg2rad(1.0)  # modes whose contacts lie closer than this are one
_FELT = 2.0  # standard deviations of a force that is there
_STEPS = 6000


@dataclass(frozen=True)
class LoadMode:
    """One explanation of a frame.

    Attributes:
        contacts: their number.
        parameters: of the fit: all angles [rad], all forces [N], all directions [rad].
        covariance: of the fit.
        chi2: of the fit.
        probability: of this mode.
        kind: "best", "mirror" (the best one's place mirrored), "place" or "contacts".
        chain: samples; None where sampling failed, as `message` says.
        message: whether the chain can be trusted.
    """

    contacts: int
    parameters: NDArray[np.float64]
    covariance: NDArray[np.float64]
    chi2: float
    probability: float
    kind: str
    chain: Posterior | None
    message: str


def frame_posterior(
    estimator: LoadEstimator,
    so: NDArray[np.float64],
    faulty: NDArray[np.bool_] | None = None,
    settings: Settings | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> list[LoadMode]:
    """Sample what one frame's readings say about its loads.

    Args:
        estimator: of the skin.
        so: readings [taxel] [counts].
        faulty: taxels to leave out [taxel].
        settings: of the sampler.
        progress: called with what is being done.

    Returns:
        Its modes, the most probable first.

    Raises:
        ValueError: nothing touches the skin, or nothing explains the frame.
    """
    faulty = None if faulty is None else faulty[None]
    estimate = estimator.estimate(so[None], faulty)[0]
    if not estimate.contacts or estimate.wall_contact:
        raise ValueError(f"there is no load to sample in this frame: {estimate.status}")
    y, weight = estimator.weigh(so[None], faulty)
    weight[0, list(estimate.left_out)] = 0.0
    found, probability = likely_modes(estimator, y, weight)
    modes: list[LoadMode] = []
    for i in np.flatnonzero(probability >= PROBABLE):
        one = found.rows(np.array([i]))
        progress(f"sampling mode {len(modes) + 1}: {int(one.contacts[0])} contacts")
        kind = "best" if not modes else _kind(modes[0], one)
        modes.append(_sampled(estimator, y, one, float(probability[i]), kind, settings))
    return modes


def likely_modes(
    estimator: LoadEstimator, y: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[Explanations, NDArray[np.float64]]:
    """Distinct fits of one frame and their probabilities, the most probable first.

    Args:
        estimator: of the skin.
        y: readings as the model has them [1, taxel], see `LoadEstimator.weigh`.
        weight: their inverse variances [1, taxel].

    Raises:
        ValueError: the readings determine no load.
    """
    selection, fitter = estimator.selection, _section_fitter(estimator)
    per_contact = fitter.per_contact
    best, _ = selection.explain(y, weight)
    nodes = _single_starts(estimator, y, weight)
    ys, weights = (np.repeat(x, len(nodes), 0) for x in (y, weight))
    start = selection.nodes.near(ys, weights, nodes)
    fits = [best, fitter.fit(ys, weights, start, estimator.table.start(nodes), 1)]
    if selection.most_contacts > 1 and (weight > 0).sum() > 2 * per_contact:
        pairs = selection.pairs.of_two(y[0], weight[0])
        if pairs:
            ys, weights = (np.repeat(x, len(pairs), 0) for x in (y, weight))
            state = estimator.table.start(np.array([node for _, node in pairs]))
            fits.append(fitter.fit(ys, weights, np.array([p for p, _ in pairs]), state, 2))
    cap = 3 * estimator.table.forces[:, -1].max()
    volume = 2 * fitter.edge * cap * (np.pi if per_contact == 3 else 1.0)
    rows: list[tuple[float, Explanations]] = []
    for fit in fits:
        for i in range(len(fit)):
            one = fit.rows(np.array([i]))
            known = any(_same(one, other) for _, other in rows)
            if np.isfinite(one.chi2[0]) and _distinct(one, per_contact) and not known:
                rows.append((_log_evidence(one, per_contact, volume), one))
    rows.sort(key=lambda row: -row[0])
    if not rows:
        raise ValueError("the readings determine no load")
    log = np.array([value for value, _ in rows])
    probability = np.exp(log - log[0])
    whole = rows[0][1]
    for _, one in rows[1:]:
        whole = whole.joined(one)
    return whole, probability / probability.sum()


def _section_fitter(estimator: LoadEstimator) -> LoadFitter:
    """The fitter of a skin in plane strain.

    Raises:
        ValueError: the skin is a pad.
    """
    fitter = estimator.selection.fitter
    if not isinstance(fitter, LoadFitter):
        raise ValueError("posteriors are sampled in plane strain only; see the covariances")
    return fitter


def _single_starts(estimator: LoadEstimator, y: Any, weight: Any) -> NDArray[np.intp]:
    """Nodes at the table's lowest minima along the angle."""
    search, table = estimator.selection.nodes, estimator.table
    forces = table.forces.shape[1]
    cost = search.costs(y, weight).reshape(-1, forces)
    lowest = cost.min(1)
    chosen: list[int] = []
    limit = lowest.min() + _WORTH_FITTING
    while len(chosen) < _SINGLE_STARTS and lowest.min() < limit:
        k = int(lowest.argmin())
        chosen.append(k * forces + int(cost[k].argmin()))
        lowest[np.abs(table.angles - table.angles[k]) < APART] = np.inf
    return np.array(chosen)


def _log_evidence(one: Explanations, per_contact: int, volume: float) -> float:
    count = int(one.contacts[0])
    width = per_contact * count
    covariance = covariance_of(one, per_contact)[0, :width, :width]
    log_det = float(np.linalg.slogdet(covariance)[1])
    spread = (width * math.log(2 * math.pi) + log_det) / 2
    prior = count * math.log(volume) - math.log(math.factorial(count))
    # A mode can't be wider than its prior.
    return -float(one.chi2[0]) / 2 + min(spread - prior, 0.0)


def _distinct(one: Explanations, per_contact: int) -> bool:
    """Whether every contact is one of its own: apart from the others, and with a force."""
    count = int(one.contacts[0])
    angle, force = one.parameters[0, :count], one.parameters[0, count : 2 * count]
    covariance = covariance_of(one, per_contact)[0]
    spread = np.sqrt(np.maximum(np.diag(covariance)[count : 2 * count], 0.0))
    apart = np.diff(np.sort(angle))
    bounded = np.isfinite(covariance[: count * per_contact, : count * per_contact]).all()
    felt = count == 1 or bool((np.abs(force) > _FELT * spread).all())
    return bool(bounded and felt and (apart > APART / 2).all())


def _same(a: Explanations, b: Explanations) -> bool:
    count = int(a.contacts[0])
    if count != int(b.contacts[0]):
        return False
    apart = np.sort(a.parameters[0, :count]) - np.sort(b.parameters[0, :count])
    return bool((np.abs(apart) < _SAME).all())


def _kind(best: LoadMode, one: Explanations) -> str:
    count = int(one.contacts[0])
    if count != best.contacts:
        return "contacts"
    mirrored = np.sort(-best.parameters[:count]) - np.sort(one.parameters[0, :count])
    return "mirror" if (np.abs(mirrored) < APART).all() else "place"


def _sampled(
    estimator: LoadEstimator,
    y: Any,
    one: Explanations,
    probability: float,
    kind: str,
    settings: Settings | None,
) -> LoadMode:
    count, per_contact = int(one.contacts[0]), estimator.selection.fitter.per_contact
    width = per_contact * count
    parameters = one.parameters[0, :width]
    covariance = covariance_of(one, per_contact)[0, :width, :width]
    names = [
        f"{name}.{k}"
        for name in ("angle_rad", "force_N", "direction_rad")[:per_contact]
        for k in range(count)
    ]
    settings = settings or Settings(steps=_STEPS)
    try:
        chain = sample(
            _log_probability(estimator, y, one),
            Gaussian(parameters, covariance),
            names,
            settings,
        )
        message = chain.message
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        chain, message = None, f"not sampled: {error}"
    chi2 = float(one.chi2[0])
    return LoadMode(count, parameters, covariance, chi2, probability, kind, chain, message)


def _log_probability(
    estimator: LoadEstimator, y: Any, one: Explanations
) -> Callable[[Float[Array, "point p"]], Float[Array, " point"]]:
    """Likelihood of loads under an even prior inside the bounds."""
    count, skin = int(one.contacts[0]), estimator.skin
    fitter = _section_fitter(estimator)
    pull = bool(one.parameters[0, count] < 0)
    low, high = (x[..., 0] for x in fitter.limits(count, 1, pull))
    state, reading, weight = one.state, jnp.asarray(y[0]), jnp.asarray(one.weight[0])

    def log_probability(points: Float[Array, "point p"]) -> Float[Array, " point"]:
        lanes = points.shape[0]
        inside = jnp.all((points >= low) & (points <= high), 1)
        problem = skin.problem(loads_from(jnp.clip(points, low, high).T, count))
        near = State(*(jnp.repeat(jnp.asarray(x), lanes, -1) for x in state))
        found = equilibrium(problem, near)
        so = skin.electrodes.read(problem.mechanics, found.state.q).so
        residual = jnp.where(weight[:, None] > 0, reading[:, None] - so, 0.0)
        chi2 = jnp.sum(weight[:, None] * residual**2, 0)
        return jnp.where(inside & (found.result == 0), -chi2 / 2, -jnp.inf)

    return log_probability
