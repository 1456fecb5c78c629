"""The posterior of one frame's loads: every mode sampled, and how probable each is.

Readings of a few taxels may be explained by contacts at several places, by a contact at its
mirror place, or by two contacts where one was. Least squares knows one minimum; here all of
the minima that the table shows are fitted, and each is sampled by emcee. Their
probabilities are ratios of evidence by Laplace's approximation::

    Z = exp(-chi2 / 2) (2 pi)^(p/2) sqrt(det C) k! / V^k

with the prior even over place, force and (where free) direction: V is their volume, and k
contacts can't be told by their order. What a calibration leaves open is not in it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.arrays import Flags, Floats
from fitting.inverse_load.estimate.estimate import FIELDS
from fitting.inverse_load.estimate.place import ContactPlaces
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.fit.covariance import covariance_of
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.fit.several_contacts import FELT
from fitting.statistics.chain import Posterior
from fitting.statistics.log_probability import Gaussian
from fitting.statistics.posterior import Settings, sample
from fitting.steps import finished

PROBABLE = 0.01
"""Modes less probable than this are neither sampled nor reported."""
_SINGLE_STARTS = 4
_WORTH_FITTING = 60.0  # chi2, on the table, above its smallest
_STEPS = 6000


@dataclass(frozen=True)
class LoadMode:
    """One explanation of a frame."""

    contacts: int  # their number
    names: tuple[str, ...]  # of what is estimated of a contact
    # all of a name together, by the model's angle [rad], [m], [N]
    parameters: Floats
    covariance: Floats  # with what the fit left out
    chi2: float  # of the fit
    probability: float  # of this mode
    kind: str  # "best", "mirror" (the best one's place mirrored), "place" or "contacts"
    chain: Posterior | None  # samples; None where sampling failed, as `message` says
    message: str  # whether the chain can be trusted
    along: ContactPlaces

    def told(self, name: str, values: Floats) -> Floats:
        """Values of a parameter as scenes state them [rad, m, N]."""
        return self.along.estimated(values) if name == self.along.name else values


def frame_posterior(
    estimator: LoadEstimator,
    so: Floats,  # readings [taxel] [counts]
    faulty: Flags | None = None,  # taxels to leave out [taxel]
    settings: Settings | None = None,  # of the sampler
    progress: Callable[[str], None] = lambda text: None,
    *,
    pressure: float = float("nan"),  # measured of the oil [Pa], on a pad; NaN where it was not
) -> list[LoadMode]:
    """Sample what one frame's readings say about its loads.

    Returns its modes, the most probable first.
    Raises ValueError: nothing touches the skin, or nothing explains the frame.
    """
    faulty = None if faulty is None else faulty[None]
    measured = np.array([pressure])
    estimate = estimator.estimate(so[None], faulty, pressure=measured)[0]
    if not estimate.contacts or estimate.wall_contact:
        raise ValueError(f"there is no load to sample in this frame: {estimate.status}")
    y, weight = estimator.weigh(so[None], faulty, measured)
    if estimator.frames.discrepancy is not None:
        taken_off = estimator.frames.discrepancy.taken_off
        y, weight, *_ = taken_off(estimator.selection, y, weight)
    weight[0, list(estimate.left_out)] = 0.0
    found, probability = likely_modes(estimator, y, weight)
    modes: list[LoadMode] = []
    for i in np.flatnonzero(probability >= PROBABLE):
        one = found.rows(np.array([i]))
        count = int(one.contacts[0])
        progress(f"sampling mode {len(modes) + 1}: {count} contact{'s' * (count > 1)}")
        kind = "best" if not modes else _kind(estimator, modes[0], one)
        modes.append(_sampled(estimator, y, one, float(probability[i]), kind, settings))
    return modes


def likely_modes(
    estimator: LoadEstimator, y: Floats, weight: Floats
) -> tuple[Explanations, Floats]:
    """Distinct fits of one frame and their probabilities, the most probable first.

    Readings are as the model has them [1, channel], with their inverse variances [1, channel];
    see `LoadEstimator.weigh`.
    Raises ValueError: the readings determine no load.
    """
    selection = estimator.selection
    fitter, search = selection.fitter, selection.nodes
    per_contact = fitter.per_contact
    best, _ = selection.explain(y, weight)
    nodes = search.minima(y[0], weight[0], _SINGLE_STARTS, _WORTH_FITTING)
    ys, weights = (np.repeat(x, len(nodes), 0) for x in (y, weight))
    start = search.near(ys, weights, nodes)
    fits = [best, fitter.fit(ys, weights, start, search.states(nodes), 1)]
    if selection.most_contacts > 1 and (weight > 0).sum() > 2 * per_contact:
        pairs = finished(selection.several.pairs.of_two(y[0], weight[0]))
        if pairs:
            ys, weights = (np.repeat(x, len(pairs), 0) for x in (y, weight))
            state = search.states(np.array([node for _, node in pairs]))
            fits.append(fitter.fit(ys, weights, np.array([p for p, _ in pairs]), state, 2))
    rows: list[tuple[float, Explanations]] = []
    for fit in fits:
        for i in range(len(fit)):
            one = fit.rows(np.array([i]))
            known = any(_same(estimator, one, other) for _, other in rows)
            if np.isfinite(one.chi2[0]) and _distinct(estimator, one) and not known:
                rows.append((_log_evidence(estimator, one), one))
    rows.sort(key=lambda row: -row[0])
    if not rows:
        raise ValueError("the readings determine no load")
    log = np.array([value for value, _ in rows])
    probability = np.exp(log - log[0])
    whole = rows[0][1]
    for _, one in rows[1:]:
        whole = whole.joined(one)
    return whole, probability / probability.sum()


def _log_evidence(estimator: LoadEstimator, one: Explanations) -> float:
    count, per_contact = int(one.contacts[0]), estimator.selection.fitter.per_contact
    width = per_contact * count
    covariance = covariance_of(one, per_contact)[0, :width, :width]
    log_det = float(np.linalg.slogdet(covariance)[1])
    spread = (width * math.log(2 * math.pi) + log_det) / 2
    prior = count * math.log(estimator.posterior.volume) - math.log(math.factorial(count))
    # A mode can't be wider than its prior.
    return -float(one.chi2[0]) / 2 + min(spread - prior, 0.0)


def _distinct(estimator: LoadEstimator, one: Explanations) -> bool:
    """Whether every contact is one of its own: apart from the others, and with a force."""
    parameters, count = estimator.selection.fitter.parameters, int(one.contacts[0])
    forces = parameters.rows("force", count)
    covariance = covariance_of(one, parameters.per_contact)[0]
    spread = np.sqrt(np.maximum(np.diag(covariance)[forces], 0.0))
    width = count * parameters.per_contact
    bounded = np.isfinite(covariance[:width, :width]).all()
    felt = count == 1 or bool((np.abs(one.parameters[0, forces]) > FELT * spread).all())
    apart = estimator.posterior.apart(estimator.posterior.places(one.parameters[0], count))
    return bool(bounded and felt and apart)


def _same(estimator: LoadEstimator, a: Explanations, b: Explanations) -> bool:
    posterior, count = estimator.posterior, int(a.contacts[0])
    if count != int(b.contacts[0]):
        return False
    return posterior.same(*(posterior.places(x.parameters[0], count) for x in (a, b)))


def _kind(estimator: LoadEstimator, best: LoadMode, one: Explanations) -> str:
    posterior, count = estimator.posterior, int(one.contacts[0])
    if count != best.contacts:
        return "contacts"
    both = (posterior.places(x, count) for x in (best.parameters, one.parameters[0]))
    return "mirror" if posterior.mirrored(*both) else "place"


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
    # The chain knows what the fit left out of contacts.
    averaged, left_out = estimator.selection.fitter.with_left_out(one, y, still=True)
    covariance = covariance_of(one, per_contact) + (0.0 if left_out is None else left_out)
    parameters, covariance = averaged.parameters[0, :width], covariance[0, :width, :width]
    names = [f"{FIELDS[name]}.{k}" for name in estimator.names for k in range(count)]
    settings = settings or Settings(steps=_STEPS)
    try:
        chain = sample(
            estimator.posterior.log_probability(y[0], one),
            Gaussian(parameters, covariance),
            names,
            settings,
        )
        message = chain.message
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        chain, message = None, f"not sampled: {error}"
    return LoadMode(
        count,
        estimator.names,
        parameters,
        covariance,
        float(one.chi2[0]),
        probability,
        kind,
        chain,
        message,
        estimator.along,
    )
