"""A pad's deformation on elements half as long: exact, as the finer splines contain it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from suas_jax.mechanics.pad.net import ODD_ARC, ODD_AXIAL, Net, NetTopology
from suas_jax.numerics.bspline import SplineAxis
from suas_jax.skin.section import AbstractSection

# Bernstein coefficients on the left half of an element from those on the whole.
_SPLIT = np.array([[8, 0, 0, 0], [4, 4, 0, 0], [2, 4, 2, 0], [1, 3, 3, 1]]) / 8


def refined(
    net: Net, section: AbstractSection, q: Float[Array, "dof station"]
) -> Float[Array, "dof station"]:
    """The same deformation on elements half as long in both directions.

    Args:
        net: one lane's control net.
        section: the undeformed membrane across the axis.
        q: unknowns.
    """
    old = net.topology
    new = NetTopology(old.arc.halved(), old.axial.halved())
    finer = [_halved(x) for x in (net.angles, net.axial)]
    fine = Net.of(new, section, *(x[:, None] for x in finer)).lane(0)
    # The two directions may change places in the order of elimination.
    coarse, finest = old.ordered(*net.matrices), new.ordered(*fine.matrices)
    arc = _prolongation(coarse[0], finest[0], new.arc, ODD_ARC)
    axial = _prolongation(coarse[1], finest[1], new.axial, ODD_AXIAL)
    x = net.cartesian(q)  # [component, long, across]
    x = x if old.along_arc else jnp.swapaxes(x, 1, 2)
    y = jnp.einsum("cKk,ckm,cMm->cKM", arc, x, axial)
    return fine.local(y if new.along_arc else jnp.swapaxes(y, 1, 2))


def _halved(x: Float[Array, " breakpoint"]) -> Array:
    middle = (x[1:] + x[:-1]) / 2
    woven = jnp.stack([x[:-1], middle], 1).reshape(-1)
    return jnp.concatenate([woven, x[-1:]])


def _prolongation(
    coarse: Float[Array, "3 4 element station"],
    fine: Float[Array, "3 4 element station"],
    axis: SplineAxis,
    parities: tuple[int, int, int],
) -> Float[Array, "3 fine coarse"]:
    """Stations' values on the finer elements from those on the coarser ones.

    Args:
        coarse: Bernstein coefficients by component from the stations' values.
        fine: the same on the finer elements.
        axis: the finer splines.
        parities: of the components.
    """
    halves = np.array([_SPLIT, _SPLIT[::-1, ::-1]])
    split = jnp.einsum("hab,cbes->caehs", halves, coarse)
    a, b = (x.reshape(3, 4 * axis.elements, -1) for x in (fine, split))
    # The finer splines contain the coarser ones: the least squares have no remainder.
    normal = jnp.einsum("crs,crt->cst", a, a) + np.stack([_held(axis, p) for p in parities])
    return jax.vmap(_solved_definite)(normal, jnp.einsum("crs,crt->cst", a, b))


def _solved_definite(
    matrix: Float[Array, "n n"], right: Float[Array, "n m"]
) -> Float[Array, "n m"]:
    """Solution of a symmetric positive definite system, unknown by unknown.

    Without LAPACK: its calls for stacks of matrices hand the work to XLA's threads and wait. On
    two cores, two such calls at once wait for each other for ever.
    """

    def eliminated(k: Int[Array, ""], rows: Array) -> Array:
        row = rows[k] / rows[k, k]
        return (rows - rows[:, k, None] * row).at[k].set(row)

    size = matrix.shape[0]
    rows = jax.lax.fori_loop(0, size, eliminated, jnp.concatenate([matrix, right], 1))
    return rows[:, size:]


def _held(axis: SplineAxis, parity: int) -> np.ndarray:
    """Unit entries for stations on mirror planes, which odd components don't have."""
    held = np.zeros(axis.stations)
    if parity < 0:
        held[0] = axis.left == "mirror"
        held[-1] = axis.right == "mirror"
    return np.diag(held)
