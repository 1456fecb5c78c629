"""Frames in their own surroundings: states that span a log, and what lies between them."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitting.inverse_load.drift import PastOfFrames
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate
from fitting.inverse_load.estimator import FULL_SCALE, LoadEstimator
from fitting.inverse_load.log.log_estimator import LogEstimator, between, skin_states
from fitting.inverse_load.model.evaluation import NoRestError
from fitting.inverse_load.readings import LogReadings, readings_of
from fitting.surroundings import LogColumn, Surroundings
from suas_jax.acquisition.log.log_file import read_log
from suas_jax.config import SkinSpec, load_skin
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.input_errors import WARMTH
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.simulation.simulated_log import simulate_log, write_simulated_log

SUAS = Path(__file__).parent.parent / "configs/skins/suas.toml"
FRAMES = 21
WARM, DEEP = np.linspace(278.15, 290.15, FRAMES), np.linspace(0.0, 400.0, FRAMES)
SKIN = """\
[geometry]
inner_radius = "57.5 mm"
thickness = "1.5 mm +- 0"
half_angle = "90 deg"
width = "123 mm"
oil_gap = "5 mm +- 0"
[material]
law = "mooney-rivlin"
C1 = "4.9 MPa +- 0"
C2 = "0.54 MPa +- 0"
expansion = "1.6e-4 / K +- 0"
[oil]
model = "compressible"
bulk_modulus = "1.1 GPa"
relative_permittivity = "2.7 +- 0"
expansion = "9.6e-4 / K +- 0"
fill = "1 +- 0"
[wall]
expansion = "7e-5 / K +- 0"
[reference]
temperature = "25 degC"
[electrodes]
capacitance = "parallel-plate"
lsb = "0.05 fF +- 0"
noise = 0.5
layout = "list"
taxels = [ %s ]
"""
ANGLES = (-70, -50, -30, -10, 10, 30, 50, 70)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A skin that grows with warmth, and a scene on it."""
    folder = tmp_path_factory.mktemp("surroundings")
    taxel = '{ angle = "%d deg", axial = "0 mm", diameter = "4 mm" }'
    (folder / "skin.toml").write_text(SKIN % ", ".join(taxel % a for a in ANGLES))
    load = '[[load]]\nkind = "line"\nangle = "10 deg"\nforce = "8 N"\n'
    (folder / "scene.toml").write_text(f'skin = "skin.toml"\n{load}')
    return folder


@pytest.fixture(scope="module")
def spec(folder: Path) -> SkinSpec:
    return load_skin(folder / "skin.toml")


def log_of(temperature: Any = None, depth: Any = None, so: Any = None) -> LogReadings:
    """Readings in some surroundings."""
    columns = (
        None if x is None else LogColumn(np.asarray(x), "c") for x in (temperature, depth)
    )
    so = np.full((FRAMES, 2), 100.0) if so is None else so
    frames = len(so)
    return LogReadings(
        np.arange(frames, dtype=float),
        np.arange(frames),
        so,
        np.zeros(so.shape, bool),
        (),
        np.arange(frames, dtype=float),
        {},
        surroundings=Surroundings(*columns),
    )


def around(spec: SkinSpec) -> tuple[float, float]:
    """Temperature [K] and depth [m] of a state."""
    assert spec.environment is not None
    return float(spec.environment.temperature or np.nan), float(spec.environment.depth or 0.0)


def test_states_span_the_log_and_their_shares_give_each_frame_back(spec: SkinSpec) -> None:
    states = skin_states(spec, log_of(WARM, DEEP), "log")
    at = np.array([around(one) for one in states.specs])
    np.testing.assert_allclose(states.share.sum(1), 1.0)
    np.testing.assert_allclose(states.share @ at, np.stack([WARM, DEEP], 1))
    for k, most in enumerate((5.0, 300.0)):
        nodes = np.unique(at[:, k])
        np.testing.assert_allclose(nodes[[0, -1]], (WARM, DEEP)[k][[0, -1]])
        assert np.diff(nodes).max() <= most
    # Only states that frames lie between, of a path through the grid.
    assert len(at) < len(np.unique(at[:, 0])) * len(np.unique(at[:, 1]))


def test_states_are_as_few_as_their_distance_allows(spec: SkinSpec) -> None:
    for kelvin, count in ((4.9, 2), (10.0, 3), (10.1, 4)):
        warm = WARM[0] + kelvin * np.linspace(0, 1, FRAMES)
        assert len(skin_states(spec, log_of(warm), "log").specs) == count
    # A frame close to one of them still has the share of its neighbour.
    warm[5] = warm[0] + 1e-4 * kelvin
    share = skin_states(spec, log_of(warm), "log").share[5]
    np.testing.assert_allclose(share, [1 - 3e-4, 3e-4, 0, 0], atol=1e-9)


def test_one_state_stands_for_what_hardly_changes(spec: SkinSpec) -> None:
    states = skin_states(spec, log_of(WARM[0] + 0.1 * (WARM - WARM[0])), "log")
    assert states.share.shape == (FRAMES, 1)
    assert around(states.specs[0])[0] == pytest.approx(WARM[0] + 0.6)
    # Depth alone does nothing to oil that does not yield.
    rigid = spec.model_copy(update={"oil": load_skin(SUAS).oil})
    assert len(skin_states(rigid, log_of(depth=DEEP), "log").specs) == 1
    relaxation = RelaxationSpec(g=(0.1,), tau=(1.0,))
    remembers = spec.model_copy(
        update={"material": spec.material.model_copy(update={"relaxation": relaxation})}
    )
    found = skin_states(remembers, log_of(WARM), "log")
    assert len(found.specs) == 1
    assert any("at its mean" in text for text in found.said)


def test_a_zero_ages_until_a_log_ends_that_tells_no_temperature(spec: SkinSpec) -> None:
    record = CalibrationSpec(
        parameters=("environment.temperature",),
        values=(290.0,),
        covariance=((0.25,),),
        taken="2026-01-01T10:00:00+00:00",
    )
    log = replace(log_of(), header={"start_time": "2026-01-01T10:05:00+00:00"})
    log = replace(log, time=np.linspace(7.0, 607.0, FRAMES))  # from 5 to 15 minutes after it
    states = skin_states(spec.model_copy(update={"calibration": record}), log, "log")
    own = states.specs[0].calibration
    assert own is not None
    assert own.covariance[0][0] == pytest.approx(0.25 + WARMTH**2 / 4)
    assert any("0.25 h from its zero" in text for text in states.said)


def test_rows_without_a_temperature_lie_between_their_neighbours(spec: SkinSpec) -> None:
    gaps = WARM.copy()
    gaps[4:9] = np.nan
    whole, broken = (log_of(x) for x in (WARM, gaps))
    broken.time[8:] -= broken.time[8]  # the device has begun again
    whole, broken = (skin_states(spec, log, "log") for log in (whole, broken))
    np.testing.assert_allclose(broken.share, whole.share, atol=1e-12)


def stand_in(rest: np.ndarray, baseline: np.ndarray | None) -> Any:
    return SimpleNamespace(model_rest=rest, rest=baseline)


@pytest.mark.parametrize("baseline", [None, np.array([103.0, 205.0])])
def test_readings_at_rest_are_those_of_every_state(
    spec: SkinSpec, baseline: np.ndarray | None
) -> None:
    """Absolute readings become the state's; those from a baseline lose what warmth does."""
    states = skin_states(spec, log_of(WARM), "log")
    own = np.array([[100.0, 200.0], [110.0, 190.0], [121.0, 181.0], [130.0, 175.0]])
    rest = iter(own)
    begin = states.share[0] @ own
    offset = 0.0 if baseline is None else baseline - begin
    so = states.share @ own + offset
    so[3] = np.nan
    so[5] = 0.0, FULL_SCALE  # as saturated as before
    made = LogEstimator(
        log_of(WARM, so=so), states, lambda spec, name: stand_in(next(rest), baseline)
    )
    frames = np.arange(FRAMES)
    for k in range(len(own)):
        wanted = np.broadcast_to(own[k] if baseline is None else baseline, so.shape).copy()
        wanted[3], wanted[5] = np.nan, so[5]
        np.testing.assert_allclose(made.so(k, frames), wanted)


def estimate(force: float, angle: float = 0.1, **changes: Any) -> LoadEstimate:
    contact = Contact(angle, force, None, np.diag([1e-4, force]), angle)
    given = {"contacts": (contact,), "oil_pressure": 10 * force, "status": "ok"}
    return LoadEstimate(True, **(given | changes))


def test_a_frame_is_asked_of_its_states_with_its_own_past(spec: SkinSpec) -> None:
    """State k finds a force of k + 1 times the first reading."""
    so = np.arange(FRAMES)[:, None] + np.array([100.0, 200.0])
    states = skin_states(spec, log_of(WARM), "log")
    number = iter(range(1, 1 + len(states.specs)))

    def make(spec: SkinSpec, name: str) -> Any:
        k = next(number)

        def estimates(so: Any, stuck: Any, past: Any, done: Any, pressure: Any) -> list:
            np.testing.assert_array_equal(past.moved, so)
            done(len(so))
            return [estimate(k * row[0]) for row in so]

        own: Any = stand_in(np.zeros(2), None)
        own.estimate_frames = estimates
        return own

    # Every second frame, of a prime number: what is done adds up to all of them.
    told, frames = [], np.arange(2, FRAMES, 2)[:7]
    made = LogEstimator(log_of(WARM, so=so), states, make)
    found = made.of_frames(frames, PastOfFrames(None, so[frames]), told.append)
    power = states.share[frames] @ np.log(np.arange(1, 1 + len(states.specs)))
    forces = [e.contacts[0].force for e in found]
    np.testing.assert_allclose(forces, so[frames, 0] * np.exp(power))
    assert told == sorted(told)
    assert (len(told), told[-1]) == (int(states.share[frames].any(0).sum()), len(frames))


def test_the_main_state_is_that_of_most_frames_that_have_one(spec: SkinSpec) -> None:
    states = skin_states(spec, log_of(WARM), "log")
    share = states.share.copy()
    share[: FRAMES // 2] = 0.0  # of a state that is lost
    states = replace(states, share=share)
    made = LogEstimator(log_of(WARM), states, lambda spec, name: stand_in(np.zeros(2), None))
    frames, _ = made.main_frames()
    sizes = [int((states.known & (states.nearest == k)).sum()) for k in range(share.shape[1])]
    assert len(frames) == max(sizes) < FRAMES // 2


def test_forces_between_states_are_exponential_and_the_rest_is_linear() -> None:
    found = between([(0.25, estimate(4.0, 0.1)), (0.75, estimate(8.0, 0.2))])
    contact = found.contacts[0]
    assert contact.force == pytest.approx(4.0**0.25 * 8.0**0.75)
    assert contact.angle == pytest.approx(0.175)
    assert found.oil_pressure == pytest.approx(70.0)
    np.testing.assert_allclose(contact.covariance, np.diag([1e-4, 7.0]))
    bound = between([(0.25, estimate(4.0, at_least=3.0)), (0.75, estimate(8.0, at_least=7.0))])
    assert bound.at_least == pytest.approx(6.0)
    pulls = between([(0.5, estimate(-4.0)), (0.5, estimate(1.0))])
    assert pulls.contacts[0].force == pytest.approx(-1.5)


def test_the_nearest_state_says_how_many_contacts_there_are() -> None:
    two = estimate(5.0, contacts=estimate(5.0).contacts * 2, status="ambiguous")
    found = between([(0.4, two), (0.6, estimate(8.0))])
    assert (found.status, found.contacts[0].force) == ("ok", 8.0)
    assert between([(0.6, two), (0.4, estimate(8.0))]).status == "ambiguous"
    # Of three states, those two that agree are weighed against each other.
    two, slow = replace(two, latency=1.0), estimate(4.0, latency=0.5)
    found = between([(0.3, two), (0.2, slow), (0.5, estimate(8.0))])
    assert found.contacts[0].force == pytest.approx(4.0 ** (2 / 7) * 8.0 ** (5 / 7))
    assert found.latency == 1.5  # of all three
    none = LoadEstimate(False)
    assert between([(0.6, none), (0.4, estimate(8.0))]).contact is False


def test_states_in_which_the_skin_buckles_leave_their_frames_out(spec: SkinSpec) -> None:
    states = skin_states(spec, log_of(WARM), "log")
    lost = states.share[:, -1].copy()
    kept = states.without([False] * 3 + [True])
    assert kept.share.shape == (FRAMES, 3)
    np.testing.assert_array_equal(kept.known, lost <= 0.5)
    np.testing.assert_allclose(kept.share[kept.known].sum(1), 1.0)
    assert f"{(lost > 0.5).sum()} frames" in kept.said[-1]

    def none(spec: SkinSpec, name: str) -> Any:
        raise NoRestError

    with pytest.raises(NoRestError, match="no stable state at rest"):
        LogEstimator(log_of(WARM), states, none)


@pytest.mark.long  # eight estimators; states and what lies between them above
def test_a_log_that_warms_and_sinks_gives_its_forces_back(folder: Path) -> None:
    path = folder / "path.csv"
    path.write_text(
        "# scene: scene.toml\nt_s,loads.0.force_N,temperature_degC,water_depth_m\n"
        "0,8,5,0\n1,8,11,0\n2,8,11,250\n"
    )
    write_simulated_log(simulate_log(path, rate=20.0), folder / "log.csv", path)
    spec = load_skin(folder / "skin.toml")
    readings = readings_of(read_log(folder / "log.csv"), spec, None)

    def estimates(readings: LogReadings) -> list[LoadEstimate]:
        states = skin_states(spec, readings, "log")
        return LogEstimator(readings, states, lambda spec, name: LoadEstimator(spec)).estimate()

    found = estimates(readings)
    force = np.array([e.contacts[0].force for e in found])
    deviation = np.array([e.contacts[0].deviation("force") for e in found])
    assert (np.abs(force - 8.0) < 0.04 + 4 * deviation).all()
    assert deviation.max() < 0.2
    # All of its inputs are exact, and no contact on the same skin in air would read so.
    blind = estimates(replace(readings, surroundings=Surroundings()))
    assert {e.status for e in blind} <= {"model_mismatch", "load_field"}
