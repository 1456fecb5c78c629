"""Cubic B-splines by Bezier extraction, against scipy's."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline

from suas_jax.numerics.bspline import End, SplineAxis, bernstein

BREAKS = np.array([-1.0, -0.7, -0.5, 0.1, 0.4, 1.0])


def values(axis: SplineAxis, breaks: np.ndarray, x: np.ndarray, order: int) -> np.ndarray:
    """Derivatives of all stations' splines at places, from the Bernstein coefficients."""
    element = np.clip(np.searchsorted(breaks, x, side="right") - 1, 0, len(breaks) - 2)
    length = breaks[element + 1] - breaks[element]
    shapes = np.stack(bernstein((x - breaks[element]) / length, order)) / length**order
    matrix = np.asarray(axis.matrix(jnp.asarray(breaks)))
    return np.einsum("ap,aps->ps", shapes, matrix[:, element])


@pytest.mark.parametrize(
    ("order", "left"),
    [(0, [1, 0, 0, 0]), (1, [-3, 3, 0, 0]), (2, [6, -12, 6, 0]), (3, [-6, 18, -18, 6])],
)
def test_polynomials_at_the_ends_of_an_element(order: int, left: list[int]) -> None:
    right = [(-1) ** order * value for value in left[::-1]]
    found = np.stack(bernstein(np.array([0.0, 1.0]), order), 1)
    np.testing.assert_array_equal(found, [left, right])
    np.testing.assert_array_equal(np.stack(bernstein(jnp.asarray([0.0, 1.0]), order), 1), found)


@pytest.mark.parametrize(
    ("multiplicity", "order"),
    [(None, 0), (None, 1), (None, 2), (None, 3), ((1, 2, 1, 2), 1), ((1, 2, 1, 2), 2)],
)
def test_open_splines_are_those_of_scipy(
    multiplicity: tuple[int, ...] | None, order: int
) -> None:
    axis = SplineAxis(5, multiplicity=multiplicity)
    inner = np.repeat(BREAKS[1:-1], multiplicity or (1, 1, 1, 1))
    knots = np.concatenate([[-1.0] * 4, inner, [1.0] * 4])
    np.testing.assert_allclose(axis.knots(jnp.asarray(BREAKS)), knots, atol=1e-15)
    x = np.linspace(-0.999, 0.999, 57)
    count = len(knots) - 4
    wanted = np.stack(
        [BSpline(knots, np.eye(count)[k], 3).derivative(order)(x) for k in range(count)], 1
    )
    # The first and the last control value are not unknowns.
    np.testing.assert_allclose(
        values(axis, BREAKS, x, order), wanted[:, 1:-1], atol=1e-12 * np.abs(wanted).max()
    )
    assert axis.stations == count - 2


@pytest.mark.parametrize(
    ("axis", "parity", "held"),
    [
        (SplineAxis(5), 1, True),
        (SplineAxis(5), 1, False),
        (SplineAxis(5, right="mirror"), -1, True),
        (SplineAxis(5, "mirror", "mirror"), 1, True),
        (SplineAxis(5, multiplicity=(1, 2, 1, 2)), 1, True),
    ],
)
def test_shapes_at_places_are_those_of_the_elements(
    axis: SplineAxis, parity: int, held: bool
) -> None:
    x = np.linspace(-1, 1, 41)
    element = np.clip(np.searchsorted(BREAKS, x, side="right") - 1, 0, 4)
    xi = (x - BREAKS[element]) / np.diff(BREAKS)[element]
    folded = axis.folded(axis.extraction(jnp.asarray(BREAKS), None), parity, held)
    matrix = np.asarray(axis.on_stations(folded))[:, element]
    expected = np.einsum("ap,aps->ps", np.stack(bernstein(xi)), matrix)
    found = axis.shapes_at(BREAKS, x, parity, held)
    np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize("parity", [1, -1])
def test_a_mirrored_end_is_half_of_the_whole(parity: int) -> None:
    half, breaks = SplineAxis(5, right="mirror"), BREAKS
    whole, both = half.unfolded(), np.concatenate([breaks, 2 - breaks[-2::-1]])
    assert whole == SplineAxis(10)
    control = np.random.default_rng(0).normal(size=half.stations)
    if parity < 0:
        control[-1] = 0
    mirrored = np.concatenate([control, parity * control[-2::-1]])
    by_half = np.asarray(half.matrix(jnp.asarray(breaks), parity)) @ control
    by_whole = np.asarray(whole.matrix(jnp.asarray(both))) @ mirrored
    np.testing.assert_allclose(by_half, by_whole[:, :5], atol=1e-14)


def test_the_whole_of_an_axis_with_double_knots() -> None:
    whole = SplineAxis(3, right="mirror", multiplicity=(1, 2)).unfolded()
    assert whole == SplineAxis(6, multiplicity=(1, 2, 1, 2, 1))
    both = SplineAxis(3, "mirror", "mirror", (2, 1)).unfolded()
    assert both == SplineAxis(6, "mirror", "mirror", (2, 1, 1, 1, 2))


def test_control_values_at_the_ends_are_no_stations() -> None:
    np.testing.assert_array_equal(SplineAxis(2).station_of, [[-1, 0, 1, 2], [0, 1, 2, -1]])
    double = SplineAxis(2, multiplicity=(2,))
    np.testing.assert_array_equal(double.station_of, [[-1, 0, 1, 2], [1, 2, 3, -1]])
    np.testing.assert_array_equal(double.first, [0, 2])


@pytest.mark.parametrize("parity", [1, -1])
def test_an_axis_read_from_the_other_end(parity: int) -> None:
    knots = (1, 2, 1, 1)
    axis, other = (
        SplineAxis(5, "mirror", "open", knots),
        SplineAxis(5, "open", "mirror", knots[::-1]),
    )
    breaks, turned = jnp.asarray(BREAKS), -jnp.asarray(BREAKS)[::-1]
    np.testing.assert_allclose(axis.knots(breaks), -other.knots(turned)[::-1], atol=1e-15)
    np.testing.assert_allclose(
        axis.matrix(breaks, parity), other.matrix(turned, parity)[::-1, ::-1, ::-1], atol=1e-14
    )
    np.testing.assert_allclose(
        axis.abscissae(breaks), -other.abscissae(turned)[::-1], atol=1e-15
    )


def test_rows_of_control_values_that_are_no_stations_are_zero() -> None:
    breaks = jnp.asarray(BREAKS)
    for left in ("open", "mirror"):
        axis = SplineAxis(5, left)
        whole, found = (np.asarray(axis.extraction(breaks, p)) for p in (None, -1))
        np.testing.assert_allclose(whole.sum(0), 1.0, rtol=1e-14)
        outer = [(0, 0), (3, 4)]  # control value and element
        assert all(whole[i, :, e].any() and not found[i, :, e].any() for i, e in outer)
        np.testing.assert_array_equal(found[[0, 3], :, 1:4], whole[[0, 3], :, 1:4])
        np.testing.assert_array_equal(axis.extraction(breaks), axis.extraction(breaks, 1))


def test_mirrored_at_both_ends_constants_are_reproduced() -> None:
    axis = SplineAxis(5, "mirror", "mirror")
    coefficients = np.asarray(axis.matrix(jnp.asarray(BREAKS))) @ np.ones(axis.stations)
    np.testing.assert_allclose(coefficients, 1.0, atol=1e-14)


@pytest.mark.parametrize("end", ["open", "mirror"])
def test_stations_of_equal_elements_lie_at_the_breakpoints(end: End) -> None:
    breaks = jnp.arange(6.0)
    np.testing.assert_allclose(SplineAxis(5, end, end).abscissae(breaks), breaks, atol=1e-14)
    # Unequal ones at the means of three knots, those at open ends at the ends.
    places = SplineAxis(3).abscissae(jnp.asarray([0.0, 1.0, 3.0, 9.0]))
    np.testing.assert_allclose(places, [0.0, 4 / 3, 13 / 3, 9.0], rtol=1e-14)


def test_halved_elements_keep_the_continuity_at_the_old_breakpoints() -> None:
    halved = SplineAxis(3, "open", "mirror", (1, 2)).halved()
    assert halved == SplineAxis(6, "open", "mirror", (1, 1, 1, 2, 1))


@pytest.mark.parametrize(
    ("axis", "message"),
    [
        (lambda: SplineAxis(2, right="mirror"), "3 elements"),
        (lambda: SplineAxis(3, multiplicity=(1,)), "2 inner knots"),
        (lambda: SplineAxis(2, multiplicity=(3,)), "multiplicity 1 or 2"),
        (lambda: SplineAxis(4, multiplicity=(1, 2, 3)), "multiplicity 1 or 2, got"),
        (lambda: SplineAxis(0), "1 elements or more, got 0"),
    ],
)
def test_what_has_no_meaning_is_refused(axis: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        axis()  # type: ignore[operator]


@pytest.mark.parametrize("knots", [(1, 1), (2, 2), (1, 2), None])
def test_every_mixture_of_single_and_double_knots_has_a_meaning(
    knots: tuple[int, ...] | None,
) -> None:
    assert SplineAxis(3, multiplicity=knots).stations == 4 + sum(knots or (1, 1)) - 2
    assert SplineAxis(1).stations == 2
    np.testing.assert_array_equal(SplineAxis(1).abscissae(jnp.asarray([2.0, 5.0])), [2.0, 5.0])
