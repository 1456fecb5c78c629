"""Posterior of any parameters by emcee, with Laplace's approximation beside it.

Nothing here knows what is inferred. A problem is a log-probability of a batch of points,
written in JAX, and a Gaussian to start from.
"""

import contextlib
import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import emcee
import numpy as np

from fitting.statistics.chain import LONG_ENOUGH, TAU_SETTLED, Posterior
from fitting.statistics.log_probability import (
    Batch,
    Gaussian,
    LogProbability,
    NumpyBatch,
    laplace,
)
from suas_jax.files.command import allow_replacing
from suas_jax.files.ownership import owned
from suas_jax.files.reading import MEGABYTE, check_readable
from suas_jax.files.writing import written

MOVES: dict[str, Callable[[], Any]] = {
    "stretch": lambda: None,
    "walk": lambda: emcee.moves.WalkMove(),
    "de": lambda: [(emcee.moves.DEMove(), 0.9), (emcee.moves.DEMove(gamma0=1.0), 0.1)],
    "de-snooker": lambda: [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)],
}
_GROUP = "mcmc"
_MOST_BYTES = 2000 * MEGABYTE


class PosteriorError(ArithmeticError):
    """The posterior can't be sampled; the message says why and what to do."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """How to sample."""

    walkers: int = 32  # size of the ensemble, even and at least twice the number of parameters
    steps: int = 20_000  # most steps of the ensemble, resumed ones included
    moves: str = "stretch"  # how proposals are made, a key of `MOVES`
    seed: int = 0  # of the random numbers
    check: int = 200  # steps between two looks at the autocorrelation time
    stop: bool = True  # whether to stop as soon as the chain has converged
    # HDF5 file in emcee's format that keeps the chain; one that exists is resumed
    chain: Path | None = None

    def __post_init__(self) -> None:
        if self.moves not in MOVES:
            raise ValueError(f"--moves {self.moves}: unknown; allowed: {', '.join(MOVES)}")
        if self.steps < 1 or self.check < 1:
            raise ValueError(f"--steps {self.steps}: at least one is needed")


def sample(
    log_probability: LogProbability | NumpyBatch,
    start: Gaussian,  # walkers start from this distribution, such as a least-squares fit's
    names: Sequence[str],
    settings: Settings | None = None,
    *,
    key: bytes = b"",
    progress: Callable[[int, int, float], None] = lambda step, steps, tau: None,
) -> Posterior:
    """Sample a posterior with emcee's ensemble.

    `log_probability`: of points [n, p], as a JAX function or evaluated by NumPy; not finite
    where impossible. `key`: what the posterior depends on (data, priors); a chain file made
    with another key is not resumed. The file has one owner: a second sampler is refused.
    `progress`: called with steps done, most steps and the slowest autocorrelation time.
    Returns the chain. One that is too short comes back too: `converged` is false and `message`
    has the numbers.
    Raises ValueError: the ensemble is too small, or the chain file belongs to something else;
    OwnedError: another process writes the chain file; PosteriorError: no possible point was
    found near the start.
    """
    chosen = settings or Settings()
    p = len(names)
    if chosen.walkers < 2 * p or chosen.walkers % 2:
        raise ValueError(
            f"--walkers {chosen.walkers}: an even number of at least {2 * p} is needed for "
            f"{p} parameters"
        )
    batch = log_probability
    if not isinstance(batch, NumpyBatch):
        batch = Batch(batch, p, chosen.walkers // 2)
    with contextlib.nullcontext() if chosen.chain is None else owned(chosen.chain):
        return _sampled(batch, start, _Chain(chosen, names, key), chosen, progress)


def _sampled(
    batch: NumpyBatch,
    start: Gaussian,
    backend: "_Chain",
    chosen: Settings,
    progress: Callable[[int, int, float], None],
) -> Posterior:
    """Steps until the chain has settled, or there are enough."""
    p = len(backend.names)
    gaussian = laplace(batch, start)
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
        settled = np.max(tau) * LONG_ENOUGH <= done and change <= TAU_SETTLED
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
        backend.names,
        memory.get_chain(),
        memory.get_log_prob(),
        tau,
        change,
        float(np.mean(memory.accepted) / memory.iteration),
        gaussian,
        batch.evaluations - begin[0],
        batch.seconds - begin[1],
    )


def _walkers(
    batch: NumpyBatch, start: Gaussian, count: int, rng: np.random.Generator
) -> np.ndarray:
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
    cut = steps // 10  # the ensemble's way from its start is not correlation
    with np.errstate(invalid="ignore", divide="ignore"):
        tau = emcee.autocorr.integrated_time(chain[cut:], tol=0, quiet=True)
    return np.where(np.isfinite(tau) & (tau > 0.0), tau, np.inf)


def _change(before: np.ndarray, after: np.ndarray) -> float:
    if not (np.all(np.isfinite(before)) and np.all(np.isfinite(after))):
        return np.inf
    return float(np.max(np.abs(after / before - 1.0)))


class _Chain:
    """A chain in memory and, if wanted, in a file that is only ever replaced whole.

    HDF5 files that are cut off in writing can't be opened: a kill loses the steps since the
    save.
    """

    def __init__(self, settings: Settings, names: Sequence[str], key: bytes) -> None:
        self.path, self.memory = settings.chain, emcee.backends.Backend()
        self.names = tuple(names)
        self.last: Any = None
        text = repr((self.names, settings.walkers, settings.moves, settings.seed))
        self.key = hashlib.sha256(text.encode() + key).hexdigest()
        self.memory.reset(settings.walkers, len(names))
        if self.path is not None and self.path.exists():
            self._load()

    def _load(self) -> None:
        assert self.path is not None
        try:
            check_readable(self.path, _MOST_BYTES, remember=False)
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
        allow_replacing(self.path)  # it is resumed
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
        with written(self.path) as draft:
            draft.unlink()  # HDF5 makes its files itself
            self._write(draft)

    def _write(self, place: Path) -> None:
        memory = self.memory
        stored = emcee.backends.HDFBackend(str(place), name=_GROUP)
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
