"""Stress relaxation of a rubber: the generalised Maxwell model beside an elastic law.

The second Piola-Kirchhoff stress S of the instantaneous law, its deviator pulled back, fades by
a Prony series (Simo 1987), in every direction of the undeformed material alike::

    S(t) = ∫ G(t − s) dS₀(s),   G(t) = 1 − Σ g_i (1 − exp(−t/τ_i))

At a strain that is held, the stress is the elastic one times G; after a long time it is that of
the law with all its stress constants times 1 − Σ g_i.

J. C. Simo, On a fully three-dimensional finite-strain viscoelastic damage model, Computer
Methods in Applied Mechanics and Engineering 60 (1987), 153-173.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_SHORT = 1e-6


class PronySeries(eqx.Module):
    """Normalised relaxation modulus, G(t) = 1 − Σ g_i (1 − exp(−t/τ_i)).

    Attributes:
        g: shares of the instantaneous stress that relax, shape [terms].
        tau: relaxation times τ_i [s], shape [terms].
    """

    g: Float[Array, " terms"]
    tau: Float[Array, " terms"]

    @property
    def long_term_share(self) -> Float[Array, ""]:
        """Long-term over instantaneous modulus, 1 − Σ g_i."""
        return 1.0 - jnp.sum(self.g)

    def modulus(self, time: Float[Array, "..."]) -> Float[Array, "..."]:
        """G(t) for times since a step of strain [s], any shape."""
        faded = -jnp.expm1(-time[..., None] / self.tau)
        return 1.0 - jnp.sum(self.g * faded, axis=-1)

    def relaxed(
        self,
        elapsed: Float[Array, " n"],
        begins: Bool[Array, " n"],
        history: Float[Array, "n k"],
    ) -> Float[Array, "n k"]:
        """Convolve stress histories, ∫ G(t − s) dS₀(s), with G.

        Exact for stresses that change linearly between the given times.

        Args:
            elapsed: time since the row before [s], shape [n]; zero is a step.
            begins: where another history begins: the material is at rest before, and the row
                is reached by a step, or held since `elapsed`, shape [n].
            history: S₀, shape [n, k].
        """

        def advance(
            carry: tuple[Array, Array], row: tuple[Array, Array, Array]
        ) -> tuple[tuple[Array, Array], Array]:
            parts, before = carry
            dt, begin, now = row
            parts = jnp.where(begin, 0.0, parts)
            change = now - jnp.where(begin, 0.0, before)
            x = dt / self.tau
            short = x < _SHORT
            safe = jnp.where(short, 1.0, x)
            slope = jnp.where(short, 1.0 - 0.5 * x, -jnp.expm1(-safe) / safe)
            # A first row is reached by a step, and then held.
            share = jnp.where(begin, jnp.exp(-x), slope)
            parts = jnp.exp(-x)[:, None] * parts + (self.g * share)[:, None] * change
            return (parts, now), self.long_term_share * now + jnp.sum(parts, axis=0)

        columns = history.shape[1]
        start = (jnp.zeros((len(self.g), columns)), jnp.zeros(columns))
        _, found = jax.lax.scan(advance, start, (elapsed, begins, history))
        return found
