"""Load fields: their posterior against closed forms, their model, palms on a section."""

import dataclasses
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from benchmarks.inverse_load import skin_of_taxels, with_tolerances
from fitting.arrays import Floats
from fitting.inverse_load.estimate.place import ContactPlaces, PlaceShift
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.field.fallback import FieldFallback
from fitting.inverse_load.field.fitter import (
    FieldFitter,
    FieldPosterior,
    LinearReadings,
    Scale,
    Scales,
)
from fitting.inverse_load.field.forward import FieldForward, even_nodes
from fitting.inverse_load.fit.section_errors import SectionErrors
from fitting.steps import Budget
from suas_jax.config.schema_calibration import PlaceShiftSpec
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import skin_of

NODES, CHANNELS = 7, 5
SPACING = 4e-3  # [m]
LENGTH, SIZE = 1, 0.2  # of 16 mm; [N]
RADIUS = 59e-3  # of the outer face [m]
RNG = np.random.default_rng(4)
DESIGN = RNG.normal(size=(CHANNELS, NODES))
PLACES = SPACING * np.arange(NODES)[:, None]
POSTERIOR = FieldPosterior(PLACES, area=1e-4)
KERNEL = np.exp(-np.abs(PLACES - PLACES.T) / 16e-3)


def test_evidence_is_that_of_gaussian_forces() -> None:
    target = RNG.normal(size=CHANNELS)
    found = POSTERIOR.scales(LinearReadings(DESIGN, target))
    own = [k for k, scale in enumerate(found.each) if scale.length == LENGTH]
    for k in own[::5]:
        covariance = found.each[k].size ** 2 * DESIGN @ KERNEL @ DESIGN.T + np.eye(CHANNELS)
        expected = multivariate_normal.logpdf(target, np.zeros(CHANNELS), covariance)
        exact = CHANNELS / 2 * np.log(2 * np.pi)  # what the evidence leaves out
        assert found.log_evidence[k] == pytest.approx(expected + exact, rel=1e-6)


def test_likeliest_forces_are_the_posterior_mean_or_zero_where_it_pulls() -> None:
    precision = np.linalg.inv(SIZE**2 * KERNEL)
    normal, scale = DESIGN.T @ DESIGN + precision, Scale(LENGTH, SIZE)
    expected = np.full(NODES, 0.3)
    pushes = LinearReadings(DESIGN, DESIGN @ expected)
    mean = np.linalg.solve(normal, DESIGN.T @ pushes.target)
    assert (mean > 0).all()
    np.testing.assert_allclose(POSTERIOR.likeliest(pushes, scale, 0.0), mean, rtol=1e-6)
    # Where forces would pull, those of Karush, Kuhn and Tucker.
    target = DESIGN @ np.linspace(-3, 3, NODES)
    force = POSTERIOR.likeliest(LinearReadings(DESIGN, target), scale, rate=1.0)
    slope = normal @ force - DESIGN.T @ target + 1.0 / SIZE
    assert (force >= 0).all()
    assert 0 < (force > 0).sum() < NODES
    np.testing.assert_allclose(slope[force > 0], 0, atol=1e-6)
    assert (slope[force == 0] >= 0).all()


def test_forces_that_readings_tell_are_known_to_their_noise_and_to_errors_of_inputs() -> None:
    told, force, error = 100.0, np.full(NODES, 1.0), 0.03  # counts over noise per newton; [N]
    linear = LinearReadings(told * np.eye(NODES), told * force)
    scales = Scales([Scale(LENGTH, SIZE)], np.zeros(1))
    for errors in (np.zeros((0, NODES)), np.full((1, NODES), told * error)):
        samples = POSTERIOR.samples(linear, scales, errors, 2000, np.random.default_rng(1))
        own = np.hypot(1 / told, len(errors) * error)
        np.testing.assert_allclose(samples.mean(0), force, atol=4 * own / np.sqrt(2000) + 5e-3)
        np.testing.assert_allclose(samples.std(0), own, rtol=0.1)


# --- on a section -------------------------------------------------------------------------


def test_sums_of_a_field_hold_what_a_unit_s_presses_leave_open() -> None:
    """Where readings leave nothing open: the scatter of forces, the shift of places."""
    skin = skin_of(skin_of_taxels(8), contact=False)
    shift = PlaceShiftSpec(angles=(0.0,), shifts=(0.0,), covariance=((0.03**2,),))
    along = ContactPlaces.of(skin_of_taxels(8).geometry, skin.geometry, PlaceShift(shift))
    fitter = FieldFitter(skin, np.array([1.4]), along, None, scatter=0.05)
    force = np.exp(-(fitter.nodes.places[:, 0] ** 2))
    sure = SimpleNamespace(samples=lambda *_: np.repeat(force[None], 4000, 0))
    fitter._posterior = sure  # type: ignore[assignment]
    field = fitter.told(SimpleNamespace(force=force, linear=None, scales=None), np.ones(9), 0.0)
    total = force.sum()
    assert field.force.value == pytest.approx(total)
    assert field.force.high / total - 1 == pytest.approx(1.96 * 0.05, rel=0.1)
    assert 1 - field.force.low / total == pytest.approx(1.96 * 0.05, rel=0.1)
    assert (field.angle.high - field.angle.low) / 2 == pytest.approx(1.96 * 0.03, rel=0.1)
    assert field.arc_extent.high == pytest.approx(field.arc_extent.low)


def test_errors_move_a_field_s_channels_together_as_alone() -> None:
    """Any number of errors, under any number of nodes: each does what it does alone."""
    random, errors, nodes, taxels = np.random.default_rng(3), 3, 5, 4
    left = random.normal(size=(nodes, errors, taxels))
    alike = random.normal(size=(nodes, errors, 2))
    membrane = np.array([True, False, True])
    places, force = np.linspace(-1, 1, nodes)[:, None], random.uniform(1, 2, nodes)
    state = random.normal(size=(taxels + 1, nodes)), random.normal(size=taxels + 1)

    def moved(own: list[int]) -> Floats:
        section = object.__new__(SectionErrors)
        section.of_membrane, section.rest = membrane[own], np.zeros((len(own), taxels))
        at = lambda *_: (alike[:, own], left[:, own])  # noqa: E731
        section._changes = SimpleNamespace(at=at)  # type: ignore[assignment]
        return section.under_field(places, force, *state)

    together = moved([0, 1, 2])
    for k in range(errors):
        np.testing.assert_allclose(together[k], moved([k])[0], atol=1e-12)
    assert together[1, -1] == 0.0  # what changes readings alone presses the oil no more
    softer = alike[:, 0, 1]
    gauge, pressure = state[0][-1], state[1][-1]
    less = softer.sum() / force.sum() * pressure
    assert together[0, -1] == pytest.approx(softer @ gauge - less)


@pytest.fixture(scope="module")
def estimator(tmp_path_factory: pytest.TempPathFactory) -> LoadEstimator:
    spec = with_tolerances(skin_of_taxels(), exact=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("field")))
        patch.setattr("fitting.inverse_load.search.table._FORCES", 12)
        return LoadEstimator(spec, most_contacts=1)


def test_oil_hides_a_pressure_that_is_even_all_over(estimator: LoadEstimator) -> None:
    edge = np.atleast_1d(estimator._parts.fitter.edge)
    nodes = even_nodes(estimator.skin, edge, estimator.along)
    model, count = FieldForward(estimator.skin, nodes), len(nodes.places)
    even = model(np.full(count, 10 / count), model.rest())
    one = model(np.where(np.arange(count) == count // 2, 10.0, 0.0), model.rest())
    dent, change = (np.abs(x.so - estimator.model_rest).max() for x in (one, even))
    assert change < 0.05 * dent
    # The derivatives are those of the model, but for what shear adds to them.
    step = np.where(np.arange(count) == count // 3, 1e-3, 0.0)
    moved = model(10 / count + step, even.state)
    slope = np.asarray(even.jacobian)[:, count // 3]
    by_force = (moved.channels - even.channels) / 1e-3
    np.testing.assert_allclose(by_force[:-1], slope[:-1], atol=0.03 * slope[:-1].max())
    assert by_force[-1] == pytest.approx(slope[-1], rel=0.03)


def palm(middle: float, arc: float, force: float, points: int = 40) -> Floats:
    """Angles [rad] and forces [N] of an even pressure over an arc [m] [2, point]."""
    along = (np.arange(points) + 0.5) / points - 0.5
    return np.stack(
        [np.deg2rad(middle) + along * arc / RADIUS, np.full(points, force / points)]
    )


@pytest.mark.long  # a finer mesh; closed forms of sums and the palm are beside it
def test_a_measured_pressure_tells_what_oil_hides(estimator: LoadEstimator) -> None:
    told = dataclasses.replace(estimator, pressure_noise=5.0)
    finer = skin_of(estimator.spec, elements=64, contact=False)
    wide = palm(5, 0.14, 30)  # over 136 degrees
    state = forward(finer, Loads.line(*wide[..., None]))
    so = np.round(np.asarray(state.so).T + np.random.default_rng(2).normal(0, 2, (1, 40)))
    widths = []
    for one in (estimator, told):
        (found,) = one.estimate(so, pressure=np.asarray(state.oil_pressure))
        assert found.field is not None
        assert found.field.force.low < 30 < found.field.force.high
        widths.append(found.field.force.high - found.field.force.low)
    assert widths[1] < 0.3 * widths[0]
    assert found.field.force.value == pytest.approx(30, rel=0.07)
    # Contacts that explain the readings do not hold where the pressure speaks against them.
    finger = forward(finer, Loads.line(np.deg2rad([[20.0]]), [[6.0]]))
    so, pressure = np.asarray(finger.so).T, np.asarray(finger.oil_pressure)
    assert [told.estimate(so, pressure=k * pressure)[0].status for k in (1.0, 1.3)] == [
        "ok",
        "load_field",
    ]


def test_a_palm_is_a_load_field_and_a_finger_is_a_contact(estimator: LoadEstimator) -> None:
    finer = skin_of(estimator.spec, elements=64, contact=False)
    fingers = np.zeros((2, 40))
    fingers[:, 0] = np.deg2rad(20), 6.0
    touches = [palm(3, 0.11, 40), palm(-15, 0.09, 25), fingers]
    angle, force = (np.stack(x, 1) for x in zip(*touches, strict=True))
    so = np.asarray(forward(finer, Loads.line(angle, force)).so).T
    found = estimator.estimate(np.round(so + np.random.default_rng(1).normal(0, 2, so.shape)))
    for estimate, middle, total in zip(found[:2], (3, -15), (40, 25), strict=True):
        assert estimate.status == "load_field"
        assert not estimate.contacts
        field = estimate.field
        assert field is not None
        assert field.preferred_by > 6
        assert field.force.low < total < field.force.high
        assert field.force.value == pytest.approx(total, rel=0.25)
        assert field.angle.low < np.deg2rad(middle) < field.angle.high
    # A live frame whose time is too short for a field says so.
    budget = Budget(1.0)
    edge = np.atleast_1d(estimator._parts.fitter.edge)
    live = partial(
        FieldFallback,
        estimator.skin,
        edge,
        estimator.along,
        None,
        per_contact=2,
        coordinates=1,
        live=True,
    )
    y, weight = estimator.weigh(so[:1])
    best, others = estimator.selection.explain(y, weight)
    told = estimator._parts.assessment.estimates(best, others, np.zeros(so[:1].shape, bool))
    channels = (np.column_stack([x, [0.0]]) for x in (y, weight))
    budget.took("load field", 2.0)
    budget.begin()
    (coarse,) = live(budget=budget).told(told, best, *channels)
    assert coarse.status == "coarse"
    assert coarse.field is None
    # Where a field leaves little of the film, no one knows whether the wall carries some.
    for little_gap, answer in ((0.0, False), (1.0, None)):
        near = live(little_gap=little_gap)
        (felt,) = near.told(told, best, *(np.column_stack([x, [0.0]]) for x in (y, weight)))
        assert felt.wall_contact is answer
    finger = found[2]
    assert finger.status == "ok"
    assert finger.field is None
    (contact,) = finger.contacts
    assert contact.force == pytest.approx(6.0, rel=0.05)
