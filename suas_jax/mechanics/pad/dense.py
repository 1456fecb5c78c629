"""Temporary: a dense solve."""
import jax, jax.numpy as jnp
from suas_jax.numerics.block_tridiagonal import AbstractTangent, Sweep
class DenseBands(AbstractTangent):
    bands: jax.Array  # offset station dof dof lane
    @property
    def structure(self):
        _, s, d, _, l = self.bands.shape
        return jax.ShapeDtypeStruct((d, s, l), self.bands.dtype)
    def dense(self, lane):
        b = self.bands[..., lane]; _, s, d, _ = b.shape
        out = jnp.zeros((s, d, s, d))
        for o in range(4):
            i = jnp.arange(s - o)
            out = out.at[i, :, i + o, :].add(b[o, : s - o])
            if o: out = out.at[i + o, :, i, :].add(jnp.swapaxes(b[o, : s - o], 1, 2))
        return out.reshape(s * d, s * d)
    def mv(self, x):
        _, s, d, _, L = self.bands.shape
        return jnp.stack([(self.dense(l) @ x[..., l].T.reshape(-1)).reshape(s, d).T for l in range(L)], -1)
    def solve(self, right):
        _, s, d, _, L = self.bands.shape
        out = []; neg = []
        for l in range(L):
            a = self.dense(l); r = jnp.transpose(right[..., l], (2, 0, 1)).reshape(s * d, -1)
            x = jnp.linalg.solve(a, r).reshape(s, d, -1)
            out.append(jnp.transpose(x, (1, 2, 0))); neg.append(jnp.zeros((), jnp.int32))
        return Sweep(jnp.stack(out, -1), jnp.stack(neg), jnp.ones(L))
