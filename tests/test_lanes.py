"""Batches as lanes: however they are cut, each lane has what it has alone."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import quick

from suas_jax.numerics.lanes import for_some, in_chunks, in_halves

SHARED = jnp.array([[2.0], [-1.0]])


def function(arguments: Any) -> dict[str, jax.Array]:
    """Of shared numbers [row, 1] and numbers of lanes [row, lane]."""
    shared, own = arguments
    return {"sum": jnp.sum(shared * own, 0), "each": jnp.sin(own) + shared}


def halves(arguments: Any) -> Any:
    return in_halves(lambda *both: function(both), *arguments)


def chunks(arguments: Any) -> Any:
    return quick(lambda x: in_chunks(function, x, 4))(arguments)


@pytest.mark.parametrize("lanes", [2, 7, 8, 9])
@pytest.mark.parametrize("cut", [halves, chunks])
def test_lanes_are_those_of_one_call(cut: Callable[[Any], Any], lanes: int) -> None:
    own = jnp.asarray(np.random.default_rng(lanes).normal(size=(2, lanes)))
    expected = function((SHARED, own))
    found = cut((SHARED, own))
    for key, wanted in expected.items():
        np.testing.assert_allclose(found[key], wanted, rtol=1e-14, err_msg=key)


def test_a_batch_of_chunks_is_more_lanes() -> None:
    own = jnp.asarray(np.random.default_rng(0).normal(size=(3, 2, 5)))
    found = quick(jax.vmap(lambda x: in_chunks(function, (SHARED, x), 4)))(own)
    for k in range(3):
        for key, wanted in function((SHARED, own[k])).items():
            np.testing.assert_allclose(found[key][k], wanted, rtol=1e-14, err_msg=key)


@pytest.mark.parametrize("count", [0, 1, 5, 8])
def test_lanes_that_need_nothing_keep_what_they_have(count: int) -> None:
    random = np.random.default_rng(count)
    own, needed = jnp.asarray(random.normal(size=(2, 8))), np.zeros(8, bool)
    needed[random.permutation(8)[:count]] = True
    rest = {"sum": jnp.full(8, 7.0), "each": jnp.full((2, 8), 7.0)}
    some = quick(lambda x, needed: for_some(function, x, needed, rest, 3))
    found, whole = some((SHARED, own), jnp.asarray(needed)), function((SHARED, own))
    for key, wanted in whole.items():
        np.testing.assert_allclose(found[key], np.where(needed, wanted, 7.0), rtol=1e-14)
