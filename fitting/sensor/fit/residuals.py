"""The misfit of a skin's model to the counts of all logs, and what it says of the constants."""

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from fitting.sensor.logs.readings import LoggedCounts
from fitting.sensor.model.constants import SensorFamily
from fitting.sensor.model.counts import SensorModel, counts_at
from fitting.statistics.residuals import AbstractResiduals, sensitivity
from suas_jax.runtime.compiled import COMPILED

# Of a constant that is held at its floor: standard deviation relative to its size.
_HELD = 1e-9


@dataclasses.dataclass(frozen=True)
class Prior:
    """What is assumed of a constant."""

    mean: float  # SI
    sd: float  # standard deviation, SI
    reason: str  # why it was needed

    @property
    def given(self) -> bool:
        """Whether the user gave it."""
        return self.reason.startswith("given")


class SensorResiduals(AbstractResiduals):
    """Misfit of the model to the counts of all logs, priors included."""

    family: SensorFamily = eqx.field(static=True)  # the constants
    model: SensorModel  # the counts
    state: Int[Array, " frame"]  # which state a frame is in [frame]
    value: Float[Array, " n"]  # readings, taxel after taxel, then the means of the priors [n]
    inverse_scale: Float[Array, " n"]  # 1 / standard deviation [n]; zero for what is not used
    # orthonormal columns, in units of the noise, of what is taken out of every taxel's readings
    # [taxel, frame, column]
    basis: Float[Array, "taxel frame column"]
    # inverse root of the priors' correlations; None where they are independent
    mixing: Float[Array, "p p"] | None
    # What readings share by the errors of known inputs, see `SharedErrors`: S, M, and what
    # untangles taxels after it; None where known inputs are exact
    shared: (
        tuple[
            Float[Array, "load taxel frame"],
            Float[Array, "state load load"],
            Float[Array, "tk tk"],
        ]
        | None
    ) = None

    def predict(self, constants: Float[Array, " p"]) -> Float[Array, " n"]:
        """LoggedCounts for constants in SI units, and the constants themselves."""
        so = self.model.so(constants)[:, self.state]
        return jnp.concatenate([so.reshape(-1), constants])

    def of_constants(self, constants: Float[Array, " p"]) -> Float[Array, " n"]:
        """Residuals for constants in SI units."""
        return self._of_predicted(self.predict(constants))

    def linearised(
        self, constants: Float[Array, " p"]
    ) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
        """Residuals and their derivatives, which take few tangents; see the base class."""
        so, slopes = self.model.so_with_slopes(constants)
        predicted = jnp.concatenate([so[:, self.state].reshape(-1), constants])
        by = slopes[:, :, self.state].reshape(len(constants), -1)
        r, push = jax.linearize(self._of_predicted, predicted)
        moved = jnp.concatenate([by, jnp.eye(len(constants))], 1)
        return r, jax.vmap(push, out_axes=1)(moved)

    def _of_predicted(self, predicted: Float[Array, " n"]) -> Float[Array, " n"]:
        used = self.inverse_scale > 0.0
        misfit = jnp.where(used, predicted - self.value, 0.0)
        r = misfit * self.inverse_scale
        taxels, frames, columns = self.basis.shape
        if self.mixing is not None:
            prior = self.mixing @ r[taxels * frames :]
            r = jnp.concatenate([r[: taxels * frames], prior])
        if columns == 0 and self.shared is None:
            return r
        data = self._whitened(r[: taxels * frames].reshape(taxels, frames))
        if columns:
            along = jnp.einsum("tfk,tf->tk", self.basis, self._whitened(data))
            if self.shared is not None:
                along = (self.shared[2] @ along.reshape(-1)).reshape(along.shape)
            taken = jnp.einsum("tfk,tk->tf", self.basis, along)
            data = data - self._whitened(taken)
        return jnp.concatenate([data.reshape(-1), r[taxels * frames :]])

    def _whitened(self, r: Float[Array, "taxel frame"]) -> Float[Array, "taxel frame"]:
        if self.shared is None:
            return r
        columns, root, _ = self.shared
        along = jnp.einsum("ktf,tf->fk", columns, r)
        sums = jax.ops.segment_sum(along, self.state, len(root))
        own = jnp.einsum("jkl,jl->jk", root, sums)[self.state]
        return r - jnp.einsum("ktf,fk->tf", columns, own)


@dataclasses.dataclass(frozen=True)
class SensorProblem:
    """What is fitted to what."""

    model: SensorModel  # the counts as a function of the constants
    readings: LoggedCounts  # what was read, and which of it is used
    priors: Mapping[str, Prior]  # by name of the constant
    # of the priors' errors [p, p]; None where they are independent
    correlation: np.ndarray | None = None

    @property
    def family(self) -> SensorFamily:
        """The constants."""
        return self.model.family

    def replace(self, **changes: object) -> "SensorProblem":
        """The same with other readings, priors or model."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    def using(self, used: np.ndarray) -> "SensorProblem":
        """The same with other readings used [taxel, frame]."""
        return self.replace(readings=dataclasses.replace(self.readings, used=used))

    def residuals(
        self, weight: np.ndarray | float = 1.0, held: tuple[int, ...] = ()
    ) -> SensorResiduals:
        """The misfit in units of the noise.

        Each reading has its weight beside its noise [taxel, frame]; the constants at the
        positions `held` are kept at their floors.
        """
        here = self.readings
        inverse = np.where(here.used, np.sqrt(weight) / here.sigma, 0.0)
        means, sds = np.zeros(self.family.size), np.zeros(self.family.size)
        for name, prior in self.priors.items():
            i = self.family.names.index(name)
            means[i], sds[i] = prior.mean, 1 / prior.sd
        for i in held:
            part = self.family.parts[i]
            means[i], sds[i] = part.floor, 1 / (_HELD * part.size)
        value = np.concatenate([np.nan_to_num(here.so).reshape(-1), means])
        basis = here.basis(here.sigma / np.sqrt(np.where(here.used, weight, 1)))
        whitening, shared = here.whitening(weight), None
        if whitening is not None:
            untangling = here.untangling(basis, weight)
            columns, root = jnp.asarray(whitening.columns), jnp.asarray(whitening.root)
            shared = columns, root, jnp.asarray(untangling)
        return SensorResiduals(
            family=self.family,
            model=self.model,
            state=jnp.asarray(here.state),
            value=jnp.asarray(value),
            inverse_scale=jnp.asarray(np.concatenate([inverse.reshape(-1), sds])),
            basis=jnp.asarray(basis),
            mixing=None if self.correlation is None else jnp.asarray(self._mixing()),
            shared=shared,
        )

    def _mixing(self) -> np.ndarray:
        """L^-1 with L L^T the priors' correlations: makes their errors independent."""
        correlation = np.asarray(self.correlation, float)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(correlation)))

    def prior_information(self, constants: np.ndarray) -> np.ndarray:
        """Of the priors, in relative sizes [p, p]."""
        names, sizes = self.family.names, self.relative_sizes(constants)
        inverse = np.array([1 / self.priors[n].sd if n in self.priors else 0.0 for n in names])
        rows = np.diag(sizes * inverse)
        if self.correlation is not None:
            rows = self._mixing() @ rows
        return np.asarray(rows.T @ rows)

    def predicted(self, constants: np.ndarray) -> np.ndarray:
        """Counts without offsets and drift [taxel, frame]."""
        so = COMPILED.run(counts_at, self.model, jnp.asarray(constants), once=True)
        return np.asarray(so)[:, self.readings.state]

    def standardised(
        self, constants: np.ndarray, weight: np.ndarray | float = 1.0, *, whole: bool = False
    ) -> np.ndarray:
        """Predicted less measured counts of all readings present, in units of the noise.

        Offsets, drift and, if not `whole`, what readings share are taken out. They are those of
        the readings that are used, so that outliers among the others stand out; zero where
        nothing is present [taxel, frame].
        """
        here = self.readings
        errors = np.where(here.present, here.so - self.predicted(constants), 0.0)
        if here.extras:
            found, _ = here.taken_out(errors, weight)
            errors = errors - np.einsum("tk,fk->tf", found, here.columns())
        r = np.where(here.present, -errors / here.sigma, 0.0)
        return r if whole or here.input_errors is None else here.whitened(r, weight)

    def relative_sizes(self, constants: np.ndarray) -> np.ndarray:
        """What a constant's error is compared with: its value, or its natural size [p]."""
        return np.where(self.family.positive, np.abs(constants), self.family.sizes)

    def information(
        self, constants: np.ndarray, frames: np.ndarray | None = None
    ) -> np.ndarray:
        """JᵀJ of the readings alone, in relative sizes [p, p].

        The derivatives J are those at the constants, SI [p]. Only the given frames count; all
        of them do by default.
        """
        _, jacobian = sensitivity(self.residuals(), jnp.asarray(constants))
        shape = self.readings.so.shape
        rows = np.asarray(jacobian)[: self.readings.so.size].reshape(*shape, -1)
        rows = rows * self.relative_sizes(constants)
        if frames is not None:
            rows = rows[:, frames]
        return np.asarray(np.einsum("tfi,tfj->ij", rows, rows))


def bounds_of(information: np.ndarray) -> np.ndarray:
    """Cramer-Rao bounds, infinite along null directions [p].

    The Fisher information is in relative sizes [p, p].
    """
    values, vectors = np.linalg.eigh(information)
    largest = max(float(values[-1]), 1e-300)
    null = values < 1e-14 * largest
    safe = np.where(null, 1.0, np.maximum(values, 1e-300))
    variance = (vectors**2) @ np.where(null, 0.0, 1 / safe)
    reached = (vectors**2) @ null.astype(float)
    return np.where(reached > 1e-10, np.inf, np.sqrt(variance))
