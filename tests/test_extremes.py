"""Which of equal values is reported: the first, whatever their rounding."""

import jax.numpy as jnp
import numpy as np
import pytest

from suas_jax.numerics.extremes import first_largest


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("rounding", [1e-14, 0.0, -1e-14])
def test_the_first_of_equal_values_is_the_largest(sign: float, rounding: float) -> None:
    value = sign * 3e-3
    values = jnp.array([value - 1e-3, value, value - 1e-9, value * (1 + rounding)])
    assert int(first_largest(values)) == 1


def test_a_larger_value_and_what_is_not_a_number_are_found() -> None:
    values = np.array([[1.0, 1.0, 0.0], [1.0 + 1e-8, np.nan, 0.0], [np.nan, 2.0, 0.0]])
    np.testing.assert_array_equal(first_largest(jnp.asarray(values)), [2, 1, 0])
