"""Posterior of any parameters by emcee, with Laplace's approximation beside it.

Nothing here knows what is inferred. A problem is a log-probability of a batch of points,
written in JAX, and a Gaussian to start from. The batch is compiled for one shape, half of
the ensemble: emcee asks for the whole once, then for halves or quarters, which are cut or
padded to it. A point whose log-probability is not finite is impossible, never an error.

A chain is judged by its integrated autocorrelation time tau (Goodman & Weare 2010): it is
called converged when it is 50 tau long for every parameter and tau no longer changes. The
first 2 tau are burn-in.
"""

import dataclasses
import hashlib
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import emcee
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from suas_jax.compiled import OPTIONS

LogProbability = Callable[[Float[Array, "point p"]], Float[Array, " point"]]

MOVES: dict[str, Callable[[], Any]] = {
    "stretch": lambda: None,
    "walk": lambda: emcee.moves.WalkMove(),
    "de": lambda: [(emcee.moves.DEMove(), 0.9), (emcee.moves.DEMove(gamma0=1.0), 0.1)],
    "de-snooker": lambda: [
        (emcee.moves.DEMove(), 0.8),
        (emcee.moves.DESnookerMove(), 0.2),
    ],
}
LONG_ENOUGH = 50.0
_TAU_SETTLED = 0.05
_BURN_IN = 2.0
_DRAWS = 100
_GROUP = "mcmc"
# Laplace and chain agree where means differ by less than this, in standard deviations,
# and standard deviations by less than this factor.
_MEANS_AGREE, _DEVIATIONS_AGREE = 0.5, 1.2
_DIFFERENCE = 0.05
_NEWTON_STEPS = 20


class PosteriorError(ArithmeticError):
    """The posterior can't be sampled; the message says why and what to do."""


class Gaussian(NamedTuple):
    """A normal distribution.

    Attributes:
        mean: shape [p].
        covariance: shape [p, p].
    """

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviations, shape [p]."""
        return np.sqrt(np.diagonal(self.covariance))


@dataclasses.dataclass(frozen=True)
class Settings:
    """How to sample.

    Attributes:
        walkers: size of the ensemble, even and at least twice the number of parameters.
        steps: most steps of the ensemble, resumed ones included.
        moves: how proposals are made, a key of `MOVES`.
        seed: of the random numbers.
        check: steps between two looks at the autocorrelation time.
        stop: whether to stop as soon as the chain has converged.
        chain: HDF5 file in emcee's format that keeps the chain; one that exists is resumed.
    """

    walkers: int = 32
    steps: int = 20_000
    moves: str = "stretch"
    seed: int = 0
    check: int = 200
    stop: bool = True
    chain: Path | None = None

    def __post_init__(self) -> None:
        if self.moves not in MOVES:
            raise ValueError(f"--moves {self.moves}: unknown; allowed: {', '.join(MOVES)}")
        if self.steps < 1 or self.check < 1:
            raise ValueError(f"--steps {self.steps}: at least one is needed")


class Batch:
    """A log-probability compiled for one number of points.

    Several JAX devices share the points evenly, each running the program on its own part:
    there is nothing to communicate.

    Attributes:
        size: points of one evaluation.
        evaluations: how many there were.
        seconds: spent in them, compilation excluded.
    """

    def __init__(self, log_probability: LogProbability, parameters: int, size: int) -> None:
        devices = jax.devices()
        self.size = -(-size // len(devices)) * len(devices)
        self.evaluations, self.seconds = 0, 0.0
        function = log_probability
        if len(devices) > 1:
            mesh = jax.sharding.Mesh(np.array(devices), ("walker",))
            along = jax.sharding.PartitionSpec("walker")
            function = jax.shard_map(
                log_probability, mesh=mesh, in_specs=along, out_specs=along, check_vma=False
            )
        shape = jax.ShapeDtypeStruct((self.size, parameters), jnp.float64)
        options = OPTIONS if devices[0].platform == "cpu" else None
        self._program = jax.jit(function).lower(shape).compile(compiler_options=options)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Log-probability of any number of points [n, p]; -inf where it is not finite."""
        count = len(points)
        filled = np.resize(points, (-(-count // self.size) * self.size, points.shape[1]))
        filled[count:] = points[-1]
        begin = time.perf_counter()
        values = [
            np.asarray(self._program(filled[i : i + self.size]))
            for i in range(0, len(filled), self.size)
        ]
        self.seconds += time.perf_counter() - begin
        self.evaluations += len(filled)
        found = np.concatenate(values)[:count]
        return np.where(np.isfinite(found), found, -np.inf)


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Samples of a posterior and how far they can be trusted.

    Attributes:
        names: of the parameters.
        chain: every step of every walker, shape [step, walker, p].
        log_probability: shape [step, walker].
        tau: integrated autocorrelation time of each parameter, in steps, shape [p].
        tau_change: largest relative change of tau since the look before.
        acceptance: mean fraction of accepted proposals.
        laplace: the Gaussian at the maximum, or None where there is none.
        evaluations: log-probabilities computed in this run.
        seconds: spent on computing them.
    """

    names: tuple[str, ...]
    chain: np.ndarray
    log_probability: np.ndarray
    tau: np.ndarray
    tau_change: float
    acceptance: float
    laplace: Gaussian | None
    evaluations: int
    seconds: float

    @property
    def steps(self) -> int:
        """Length of the chain."""
        return len(self.chain)

    @property
    def length(self) -> float:
        """Length of the chain in autocorrelation times of the slowest parameter."""
        slowest = float(np.max(self.tau))
        return self.steps / slowest if np.isfinite(slowest) and slowest > 0.0 else 0.0

    @property
    def converged(self) -> bool:
        """Whether the chain is long enough and its autocorrelation time known."""
        return self.length >= LONG_ENOUGH and self.tau_change <= _TAU_SETTLED

    @property
    def burn_in(self) -> int:
        """Steps that are left out: two autocorrelation times, at most half of the chain."""
        tau = float(np.max(self.tau))
        if not np.isfinite(tau):
            return self.steps // 2
        return min(int(np.ceil(_BURN_IN * tau)), self.steps // 2)

    @property
    def samples(self) -> np.ndarray:
        """Samples after burn-in, all walkers in a row, shape [n, p]."""
        return self.chain[self.burn_in :].reshape(-1, self.chain.shape[-1])

    @property
    def effective_samples(self) -> np.ndarray:
        """Independent samples of each parameter, shape [p]."""
        kept = (self.steps - self.burn_in) * self.chain.shape[1]
        return kept / np.maximum(np.where(np.isfinite(self.tau), self.tau, np.inf), 1.0)

    def draws(self, count: int = _DRAWS, seed: int = 0) -> np.ndarray:
        """A few samples at random, shape [count, p]."""
        kept = self.samples
        return kept[np.random.default_rng(seed).integers(0, len(kept), count)]

    @property
    def message(self) -> str:
        """Whether the chain can be trusted, with the numbers."""
        slowest = int(np.argmax(np.where(np.isfinite(self.tau), self.tau, np.inf)))
        tau, name = float(self.tau[slowest]), self.names[slowest]
        if not np.isfinite(tau):
            return (
                f"not converged: {self.steps} steps are too few to estimate the "
                f"autocorrelation time of {name}; raise --steps"
            )
        said = (
            f"{self.steps} steps are {self.length:.1f} autocorrelation times "
            f"({tau:.1f} steps for {name}, the slowest; {LONG_ENOUGH:.0f} are needed)"
        )
        if self.converged:
            return f"converged: {said}; acceptance {self.acceptance:.2f}"
        if self.length >= LONG_ENOUGH:
            reason = f"its estimate still changed by {100.0 * self.tau_change:.1f} %"
            advice = f"raise --steps to {2 * self.steps}"
        else:
            reason, advice = "", f"raise --steps to {round_up(1.2 * LONG_ENOUGH * tau)}"
        return f"not converged: {said}{'; ' if reason else ''}{reason}; {advice}"

    @property
    def agreement(self) -> dict[str, Any]:
        """The chain compared with Laplace's approximation."""
        if self.laplace is None:
            return {"agree": False, "message": "there is no interior maximum to expand at"}
        kept = self.samples
        deviation = np.maximum(self.laplace.deviation, 1e-300)
        shift = (kept.mean(axis=0) - self.laplace.mean) / deviation
        ratio = kept.std(axis=0) / deviation
        factor = np.maximum(ratio, 1.0 / np.maximum(ratio, 1e-300))
        # What the finite chain itself leaves open is no disagreement.
        slack = 3.0 / np.sqrt(np.maximum(self.effective_samples, 1.0))
        apart = (np.abs(shift) > _MEANS_AGREE + slack) | (factor > _DEVIATIONS_AGREE + slack)
        bad = [name for name, wrong in zip(self.names, apart, strict=True) if wrong]
        text = (
            f"not Gaussian in {', '.join(bad)}: quote the quantiles of the chain"
            if bad
            else "chain and Laplace's approximation agree"
        )
        return {
            "agree": not bad,
            "shift_in_deviations": dict(zip(self.names, shift.tolist(), strict=True)),
            "deviation_ratio": dict(zip(self.names, ratio.tolist(), strict=True)),
            "message": text,
        }


def sample(
    log_probability: LogProbability,
    start: Gaussian,
    names: Sequence[str],
    settings: Settings | None = None,
    *,
    key: bytes = b"",
    progress: Callable[[int, int, float], None] = lambda step, steps, tau: None,
) -> Posterior:
    """Sample a posterior with emcee's ensemble.

    Args:
        log_probability: of points [n, p], as a JAX function; not finite where impossible.
        start: walkers start from this distribution, such as a least-squares fit's.
        names: of the parameters.
        settings: how to sample.
        key: what the posterior depends on (data, priors); a chain file made with another
            key is not resumed.
        progress: called with steps done, most steps and the slowest autocorrelation time.

    Returns:
        The chain. One that is too short comes back too: `converged` is false and
        `message` has the numbers.

    Raises:
        ValueError: the ensemble is too small, or the chain file belongs to something else.
        PosteriorError: no possible point was found near the start.
    """
    chosen = settings or Settings()
    p = len(names)
    if chosen.walkers < 2 * p or chosen.walkers % 2:
        raise ValueError(
            f"--walkers {chosen.walkers}: an even number of at least {2 * p} is needed for "
            f"{p} parameters"
        )
    batch = Batch(log_probability, p, chosen.walkers // 2)
    gaussian = laplace(batch, start)
    backend = _Chain(chosen, names, key)
    sampler = emcee.EnsembleSampler(
        chosen.walkers,
        p,
        batch,
        moves=MOVES[chosen.moves](),
        vectorize=True,
        backend=backend.memory,
    )
    state = backend.last
    if state is None:
        rng = np.random.default_rng(chosen.seed)
        points = _walkers(batch, gaussian or start, chosen.walkers, rng)
        random = np.random.RandomState(chosen.seed)
        state = emcee.State(points, random_state=random.get_state())
    begin = batch.evaluations, batch.seconds
    while True:
        done = backend.memory.iteration
        tau = _tau(backend.memory, done, p)
        earlier = _tau(backend.memory, max(done - chosen.check, 0), p)
        change = _change(earlier, tau)
        settled = np.max(tau) * LONG_ENOUGH <= done and change <= _TAU_SETTLED
        progress(done, chosen.steps, float(np.max(tau)))
        if done >= chosen.steps or (settled and chosen.stop):
            break
        # Looks are at multiples of `check`, so that a resumed chain stops where an
        # uninterrupted one does.
        more = min(chosen.check - done % chosen.check, chosen.steps - done)
        state = sampler.run_mcmc(state, more, skip_initial_state_check=True)
        backend.save()
    memory = backend.memory
    return Posterior(
        tuple(names),
        memory.get_chain(),
        memory.get_log_prob(),
        tau,
        change,
        float(np.mean(memory.accepted) / memory.iteration),
        gaussian,
        batch.evaluations - begin[0],
        batch.seconds - begin[1],
    )


def laplace(batch: Callable[[np.ndarray], np.ndarray], start: Gaussian) -> Gaussian | None:
    """Expand a log-probability at its maximum.

    Newton's method in the coordinates that make `start` a unit Gaussian, where one step
    length of central differences suits every parameter; the same compiled program does it.

    Args:
        batch: log-probability of points [n, p].
        start: an approximation to begin with.

    Returns:
        The Gaussian of the maximum and its curvature; None where none was found.
    """
    values, vectors = np.linalg.eigh(start.covariance)
    widest = float(np.max(values))
    root = vectors * np.sqrt(np.maximum(values, 1e-24 * widest))
    centre = np.array(start.mean, float)
    value = float(batch(centre[None])[0])
    for _ in range(_NEWTON_STEPS):
        if not np.isfinite(value):
            return None
        slope, curvature = _expansion(batch, centre, root, value)
        if not np.all(np.isfinite(curvature)):
            return None
        size, axes = np.linalg.eigh(-curvature)
        # Uphill even where the surface is not concave, never further than the coordinates
        # are good for.
        ascent = (axes.T @ slope) / np.maximum(np.abs(size), 1e-3)
        step = axes @ np.clip(ascent, -3.0, 3.0)
        lengths = 0.5 ** np.arange(8)
        tried = centre + (lengths[:, None] * step) @ root.T
        found = batch(tried)
        best = int(np.argmax(found))
        if found[best] > value:
            centre, value = tried[best], float(found[best])
        if np.max(size) > 0.0 and np.min(size) > 0.0:
            # The next expansion is taken in the coordinates of this one.
            root = root @ (axes / np.sqrt(size))
            if float(np.max(np.abs(ascent) * np.sqrt(size))) < 1e-2:
                return Gaussian(centre, root @ root.T)
        elif found[best] <= value and np.max(np.abs(step)) < 1e-6:
            return None
    return None


def _expansion(
    batch: Callable[[np.ndarray], np.ndarray],
    centre: np.ndarray,
    root: np.ndarray,
    value: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and Hessian in the coordinates of `root`, by central differences."""
    p, h = len(centre), _DIFFERENCE
    unit = np.eye(p)
    pairs = [(i, j) for i in range(p) for j in range(i)]
    places = [*(h * unit), *(-h * unit)]
    places += [h * (unit[i] + unit[j]) for i, j in pairs]
    places += [-h * (unit[i] + unit[j]) for i, j in pairs]
    found = batch(centre + np.array(places) @ root.T)
    up, down, both, neither = np.split(found, [p, 2 * p, 2 * p + len(pairs)])
    curvature = np.diag((up - 2.0 * value + down) / h**2)
    with np.errstate(invalid="ignore"):  # beyond a bound both are -inf: no curvature is known
        for k, (i, j) in enumerate(pairs):
            mixed = both[k] + neither[k] - up[i] - down[i] - up[j] - down[j] + 2.0 * value
            curvature[i, j] = curvature[j, i] = mixed / (2.0 * h**2)
        return (up - down) / (2.0 * h), curvature


def _walkers(batch: Batch, start: Gaussian, count: int, rng: np.random.Generator) -> np.ndarray:
    """Possible points around the start, drawn ever closer to its mean."""
    points = rng.multivariate_normal(start.mean, start.covariance, count, method="svd")
    for _ in range(20):
        bad = ~np.isfinite(batch(points))
        if not bad.any():
            return points
        again = rng.multivariate_normal(start.mean, start.covariance, count, method="svd")
        points[bad] = start.mean + 0.5 * (again[bad] - start.mean)
        start = Gaussian(start.mean, 0.5 * start.covariance)
    raise PosteriorError(
        f"{int(bad.sum())} of {count} walkers found no possible point near the fitted "
        f"parameters; the fit lies on the border of what the model or the bounds allow"
    )


def _tau(backend: Any, steps: int, p: int) -> np.ndarray:
    """Integrated autocorrelation time after a number of steps; infinite if too few."""
    if steps < 10:
        return np.full(p, np.inf)
    chain = backend.get_chain()[:steps]
    cut = steps // 10  # the ensemble's way from its start is no correlation
    with np.errstate(invalid="ignore", divide="ignore"):
        tau = emcee.autocorr.integrated_time(chain[cut:], tol=0, quiet=True)
    return np.where(np.isfinite(tau) & (tau > 0.0), tau, np.inf)


def _change(before: np.ndarray, after: np.ndarray) -> float:
    if not (np.all(np.isfinite(before)) and np.all(np.isfinite(after))):
        return np.inf
    return float(np.max(np.abs(after / before - 1.0)))


def round_up(value: float) -> int:
    """The next number with two significant digits."""
    unit = 10 ** max(int(np.floor(np.log10(max(value, 1.0)))) - 1, 0)
    return int(-(-value // unit) * unit)


class _Chain:
    """A chain in memory and, if wanted, in a file that is only ever replaced whole.

    HDF5 files that are cut off in writing can't be opened; so a kill loses the steps since
    the last save, and no more.
    """

    def __init__(self, settings: Settings, names: Sequence[str], key: bytes) -> None:
        self.path, self.memory = settings.chain, emcee.backends.Backend()
        self.last: Any = None
        text = repr((tuple(names), settings.walkers, settings.moves, settings.seed))
        self.key = hashlib.sha256(text.encode() + key).hexdigest()
        self.memory.reset(settings.walkers, len(names))
        if self.path is not None and self.path.exists():
            self._load()

    def _load(self) -> None:
        assert self.path is not None
        try:
            stored = emcee.backends.HDFBackend(str(self.path), name=_GROUP, read_only=True)
            with stored.open() as file:
                key = file[_GROUP].attrs.get("key", "")
        except (OSError, KeyError) as error:
            raise ValueError(
                f"--chain {self.path}: not a chain of this program ({error}); choose another "
                f"file or delete it"
            ) from None
        if key != self.key:
            raise ValueError(
                f"--chain {self.path}: this chain belongs to other data, another law, or other "
                f"settings (residual, walkers, moves, seed); choose another file or delete it"
            )
        if stored.iteration == 0:
            return
        memory = self.memory
        memory.chain, memory.log_prob = stored.get_chain(), stored.get_log_prob()
        memory.accepted, memory.iteration = stored.accepted, stored.iteration
        memory.random_state = stored.random_state
        memory.initialized = True
        self.last = memory.get_last_sample()

    def save(self) -> None:
        """Replace the file by the chain so far."""
        if self.path is None:
            return
        memory = self.memory
        beside = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        beside.unlink(missing_ok=True)
        stored = emcee.backends.HDFBackend(str(beside), name=_GROUP)
        stored.reset(*memory.shape)
        stored.grow(memory.iteration, None)
        with stored.open("a") as file:
            group = file[_GROUP]
            group["chain"][...] = memory.get_chain()
            group["log_prob"][...] = memory.get_log_prob()
            group["accepted"][...] = memory.accepted
            group.attrs["iteration"] = memory.iteration
            group.attrs["key"] = self.key
            for i, part in enumerate(memory.random_state):
                group.attrs[f"random_state_{i}"] = part
        os.replace(beside, self.path)
