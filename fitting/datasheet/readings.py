"""Readings of skins under single contacts, with their slopes, many skins and places at once.

A lane is one contact on one skin; all lanes of a skin and its neighbours share a program.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from fitting.arrays import Floats
from suas_jax import Loads, Skin, forward, skin_of
from suas_jax.config import SkinSpec
from suas_jax.equilibrium.balance import State
from suas_jax.numerics.array_types import Lanes
from suas_jax.runtime.compiled import COMPILED

_CHUNK = 128  # lanes of a call, so that one program serves any number of them

FAR = 4.0
"""Films and membranes between a contact and a taxel that counts as crosstalk."""


class Readings(NamedTuple):
    """What contacts do, arrays of JAX or of NumPy."""

    so: Any  # sensor output [taxel, lane] [counts]
    # its derivatives by the contact's coordinates, the force last; the others are lengths along
    # the outer face [coordinate, taxel, lane] [counts/m, counts/N]
    slope: Any
    gap: Any  # smallest between membrane and wall [lane] [m]
    gap_slope: Any  # its derivative by the force [lane] [m/N]
    pressure: Any  # of the oil [lane] [Pa]
    result: Any  # index of the outcome, 0 where converged [lane]


def read(skin: Skin, loads: Loads, start: State | None = None) -> tuple[Readings, State]:
    """Readings under single radial contacts, and the equilibria; differentiable.

    `start`: neighbouring equilibria, see `forward`.
    """
    loads = loads.in_lanes()
    names = ("angle", "force") if loads.axial is None else ("angle", "axial", "force")

    def of(loads: Loads) -> tuple[tuple[Array, ...], tuple[Array, State]]:
        output = forward(skin, loads, start)
        seen = output.so, output.min_gap, output.oil_pressure
        return seen, (output.result, output.state)

    (so, gap, pressure), push, (result, state) = jax.linearize(of, loads, has_aux=True)
    none = jax.tree.map(jnp.zeros_like, loads)

    def pushed(*by: Array) -> Any:
        moved = {name: jnp.full_like(loads.force, x) for name, x in zip(names, by, strict=True)}
        return push(dataclasses.replace(none, **moved))

    slope, gap_slope, _ = jax.vmap(pushed)(*jnp.eye(len(names)))
    slope = slope.at[0].divide(skin.geometry.outer_rate(loads.angle[0]))
    return Readings(so, slope, gap, gap_slope[-1], pressure, result), state


@eqx.filter_jit
def _read(skin: Skin, angle: Lanes, force: Lanes) -> Readings:
    return read(skin, Loads.line(angle, force))[0]


def far_taxels(skin: Skin, at: Floats) -> np.ndarray:
    """Taxels that contacts should leave alone [taxel, place].

    Contacts are [place, coordinate]; on a section they have an angle alone.
    """
    film = float(skin.geometry.thickness[0] + skin.geometry.oil_gap[0])
    size = np.array([float(skin.geometry.mid_size[0]), 1.0])[: at.shape[1]]
    taxels = skin.electrodes.taxels.places[:, None, : at.shape[1]]
    distance = np.linalg.norm((taxels - at) * size, axis=-1)
    return np.asarray(distance > FAR * film)


def skins_in_lanes(spec: SkinSpec, inputs: dict[str, Any], **settings: Any) -> Skin:
    """Skins that differ in their inputs by TOML path [skin], SI, side by side.

    The membrane passes through the wall. `settings` are those of `skin_of`.
    """
    built = eqx.filter_vmap(lambda own: skin_of(spec, own, contact=False, **settings))(
        {path: jnp.asarray(values, float) for path, values in inputs.items()}
    )
    return _mapped(lambda x: jnp.moveaxis(x[..., 0], 0, -1), built)


def read_all(skins: Skin, which: np.ndarray, angle: np.ndarray, force: np.ndarray) -> Readings:
    """Readings of any number of contacts at angles [lane] [rad], inwards [lane] [N], in NumPy.

    `which` is the skin of each contact, among those side by side.
    """
    count = len(angle)
    found: list[Any] = []
    for start in range(0, count, _CHUNK):
        lanes = np.minimum(np.arange(start, start + _CHUNK), count - 1)
        own = picked(skins, which[lanes])
        found.append(COMPILED.run(_read, own, jnp.asarray(angle[lanes]), force[lanes]))
    return _joined(found, count)


def picked(skins: Skin, which: np.ndarray) -> Skin:
    """Those of skins side by side that every lane is to have [lane]."""
    return _mapped(lambda x: x[..., which], skins)


def _mapped(function: Callable[[Array], Array], skin: Skin) -> Skin:
    """Change every array of a skin."""
    found: Skin = jax.tree.map(lambda x: function(x) if eqx.is_array(x) else x, skin)
    return found


def _joined(parts: Sequence[Readings], count: int) -> Readings:
    columns = zip(*parts, strict=True)
    return Readings(*(np.concatenate(x, -1)[..., :count] for x in columns))
