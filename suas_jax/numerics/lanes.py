"""Batches as lanes: many problems side by side in one call.

Every array of the mechanics ends in a lane axis. A batch made by `jax.vmap` becomes more
lanes of one call instead of an axis of every operation. Many lanes go through the call in
chunks, or one by one where a lane's own arrays are large.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, PyTree

Arguments = TypeVar("Arguments")
Result = TypeVar("Result")


def on_cpu() -> bool:
    """Whether programs run on the processor, whose caches limit how many lanes go together."""
    return jax.default_backend() == "cpu"


def number(lane: ArrayLike) -> float:
    """The value of the only lane; by NumPy, as JAX compiles programs for an index."""
    return float(np.ravel(lane)[0])


def mix(matrix: np.ndarray, x: Array) -> Array:
    """Apply a constant matrix to the leading axis: one product for all elements and lanes."""
    flat = jnp.asarray(matrix) @ x.reshape(x.shape[0], -1)
    return flat.reshape(matrix.shape[0], *x.shape[1:])


def in_chunks(solve: Callable[[Arguments], Result], arguments: Arguments, chunk: int) -> Result:
    """Call a function of lanes for all lanes, a chunk at a time.

    `solve`: takes and returns pytrees of arrays that end in a lane axis. `arguments`: its
    argument; a lane axis of length one is shared by all lanes. `chunk`: most lanes in one call.
    """

    @jax.custom_batching.custom_vmap
    def call(arguments: Arguments) -> Result:
        leaves, tree = jax.tree.flatten(arguments)
        lanes = max(x.shape[-1] for x in leaves)
        if lanes <= chunk:
            return solve(arguments)
        chunks = -(-lanes // chunk)
        size = -(-lanes // chunks)

        def split(x: Array) -> Array:
            padded = jnp.concatenate([x, x[..., : chunks * size - lanes]], -1)
            return jnp.moveaxis(padded.reshape(*x.shape[:-1], chunks, size), -2, 0)

        shared = [x.shape[-1] == 1 for x in leaves]
        own = [split(x) for x, s in zip(leaves, shared, strict=True) if not s]

        def one(own: list[Array]) -> Result:
            chunked = iter(own)
            mixed = [x if s else next(chunked) for x, s in zip(leaves, shared, strict=True)]
            return solve(jax.tree.unflatten(tree, mixed))

        def join(x: Array) -> Array:
            x = jnp.moveaxis(x, 0, -2)
            return x.reshape(*x.shape[:-2], chunks * size)[..., :lanes]

        return jax.tree.map(join, jax.lax.map(one, own))

    @call.def_vmap
    def _(size: int, batched: Any, arguments: Arguments) -> tuple[Result, PyTree]:
        lanes = max(x.shape[-1] for x in jax.tree.leaves(arguments))
        merged = jax.tree.map(lambda x, b: _merge(x, b, size, lanes), arguments, batched[0])

        def unmerge(x: Array) -> Array:
            return jnp.moveaxis(x.reshape(*x.shape[:-1], size, lanes), -2, 0)

        found = jax.tree.map(unmerge, call(merged))
        return found, jax.tree.map(lambda _: True, found)

    return call(arguments)


def in_halves(call: Callable[..., Result], *arguments: Any) -> Result:
    """Call a compiled function for all lanes, half of them in a second thread.

    Its loops over few lanes hardly use a second core by themselves.

    `call`: takes and returns pytrees of arrays that end in a lane axis. `arguments`: known
    numbers; a lane axis of length one is shared by all lanes.
    """
    lanes = lane_count(arguments)
    size = -(-lanes // 2)  # of both, so that one program serves them

    def part(begin: int) -> Result:
        def cut(x: Any) -> Any:
            own = eqx.is_array(x) and x.ndim and x.shape[-1] == lanes
            return x[..., begin : begin + size] if own else x

        return call(*jax.tree.map(cut, arguments))

    with ThreadPoolExecutor(2) as threads:
        first, last = threads.map(part, (0, lanes - size))
    again = 2 * size - lanes
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b[..., again:]], -1), first, last)


def for_some(
    # takes and returns pytrees of arrays that end in a lane axis
    solve: Callable[[Arguments], Result],
    arguments: Arguments,  # of `solve`; a lane axis of length one is shared by all lanes
    needed: Bool[Array, " lane"],  # which lanes
    rest: Result,  # what the others have
    width: int,  # lanes in one call
) -> Result:
    """Call a function of lanes for those that need it: the others cost nothing.

    Without derivatives in reverse mode.
    """
    lanes = needed.shape[-1]
    order, count = jnp.argsort(~needed), jnp.sum(needed)
    width = min(width, lanes)

    def some(call: Array, found: Result) -> Result:
        # The last call may go round some lane more than once.
        chosen = order[jnp.minimum(call * width + jnp.arange(width), count - 1)]
        own = jax.tree.map(lambda x: x if x.shape[-1] == 1 else x[..., chosen], arguments)
        return jax.tree.map(lambda a, x: a.at[..., chosen].set(x), found, solve(own))

    return jax.lax.fori_loop(0, -(-count // width), some, rest)


def _merge(x: Array, batched: bool, size: int, lanes: int) -> Array:
    """Move a batch axis into the lanes; what is not batched stays shared."""
    if batched:
        x = jnp.moveaxis(x, 0, -2)
        x = jnp.broadcast_to(x, (*x.shape[:-1], lanes))
        return x.reshape(*x.shape[:-2], size * lanes)
    if x.shape[-1] == 1:
        return x
    x = jnp.broadcast_to(x[..., None, :], (*x.shape[:-1], size, lanes))
    return x.reshape(*x.shape[:-2], size * lanes)


def lane_count(tree: Any) -> int:
    """Number of lanes of the arrays in a tree, which come last and may be of length one."""
    return max(x.shape[-1] for x in jax.tree.leaves(eqx.filter(tree, eqx.is_array)))


def by_lane(module: Any, function: Callable[..., Any], *arguments: Array) -> Any:
    """Call a function of one lane's module and arguments, lane after lane.

    `module`: its arrays have a lane axis at the end. `function`: of the module, its lane axes
    of length one, and of arguments without lanes. `arguments`: with a lane axis at the end.
    Returns what the function returns, with a lane axis at the end.
    """
    lanes = lane_count((module, arguments))
    arrays, static = eqx.partition((module, arguments), eqx.is_array)

    def one(arrays: Any) -> Any:
        own, rest = eqx.combine(arrays, static)
        return function(own, *(x[..., 0] for x in rest))

    if lanes == 1:
        return jax.tree.map(lambda x: x[..., None], one(arrays))

    def chosen(lane: Array) -> Any:
        def pick(x: Array) -> Array:
            index = lane if x.shape[-1] > 1 else 0
            return jax.lax.dynamic_slice_in_dim(x, index, 1, -1)

        return one(jax.tree.map(pick, arrays))

    found = jax.lax.map(chosen, jnp.arange(lanes))
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), found)
