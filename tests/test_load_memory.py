"""Memory of a membrane as states: against hereditary integrals, and on simulated logs."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from fitting.arrays import Floats
from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.memory.remembering import Series, response_of
from fitting.inverse_load.memory.series import SHARE_ERROR, LoadMemory, creeping_load
from fitting.inverse_load.pad.interpolant import WHOLE, PadInterpolant
from fitting.inverse_load.pad.memory import Answer, Dents, PadMemoryErrors, PadMemoryFollower
from suas_jax.config import load_skin
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.tolerance import UncertainQuantity
from suas_jax.constitutive.relaxation import Past
from tests.stand_ins import explanations
from tests.test_pad_estimation import small_pad
from tests.test_pad_formulas import RADIUS, dent_table

G, TAU = np.array([0.15, 0.10]), np.array([0.5, 10.0])
END = 1 - G.sum()
GAMMA = G / END
SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"


def relaxing(g: tuple[float, ...] = tuple(G), tau: tuple[float, ...] = tuple(TAU)):
    """A skin whose file says how its membrane relaxes."""
    spec = load_skin(SKIN)
    material = spec.material.model_copy(update={"relaxation": RelaxationSpec(g=g, tau=tau)})
    return spec.model_copy(update={"material": material})


def test_load_fields_of_a_membrane_that_remembers_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match="load_fields: the membrane remembers"):
        LoadEstimator(relaxing(), load_fields=True)


def jittered(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times of jittered and missing frames, and a stress at each that is none at first."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(np.concatenate([[0.0], rng.uniform(0.001, 0.05, 30), [7.0, 40.0, 0.01]]))
    return time, np.concatenate([[0.0], rng.normal(size=len(time) - 1)])


def hereditary(time: np.ndarray, stress: np.ndarray, k: int) -> float:
    """Response in frame k to a long-term stress that changes linearly between frames."""
    slope = np.diff(stress) / np.diff(time)

    def kernel(age: float) -> float:
        return float(1 - (G * -np.expm1(-age / TAU)).sum()) / END

    return sum(
        slope[i] * quad(lambda s: kernel(time[k] - s), time[i], time[i + 1])[0]
        for i in range(k)
    )


def test_states_are_the_hereditary_integral_on_jittered_and_missing_frames() -> None:
    time, stress = jittered(1)
    series = Series(jnp.asarray(GAMMA), jnp.asarray(TAU), jnp.zeros((0, 2)))
    past = Past(jnp.zeros(1), jnp.zeros((2, 1)))
    found = []
    for k in range(1, len(time)):
        elapsed = jnp.asarray(time[k] - time[k - 1])
        response = response_of(series, series.gamma, past, elapsed)
        found.append(float(response.share * stress[k] + response.rest[0]))
        past = past.after(series.states, elapsed, jnp.asarray(stress[k : k + 1]))
    for k in (1, 5, len(time) - 3, len(time) - 2, len(time) - 1):
        expected = hereditary(time, stress, k)
        assert found[k - 1] == pytest.approx(expected, rel=1e-8, abs=1e-8)


def test_creep_under_a_constant_load_balances_it_at_all_times() -> None:
    memory = LoadMemory.of(relaxing())
    assert memory is not None
    time = np.concatenate([[0.0], np.geomspace(1e-4, 200.0, 4000)])
    load = creeping_load(memory, time)
    assert load[0] == pytest.approx(END)
    assert load[-1] == pytest.approx(1.0, abs=1e-6)
    states, before = np.full(2, load[0]), load[0]  # a step at once, then a creep
    for k in range(1, len(time)):
        x = (time[k] - time[k - 1]) / memory.tau
        fade, mean = np.exp(-x), -np.expm1(-x) / x
        states, before = fade * states + mean * (load[k] - before), load[k]
        assert load[k] + memory.gamma @ states == pytest.approx(1.0, abs=1e-5)


def test_creep_of_one_term_is_the_retarded_exponential() -> None:
    memory = LoadMemory.of(relaxing((0.2,), (3.0,)))
    assert memory is not None
    time = np.array([0.0, 0.5, 3.0, 10.0])
    assert creeping_load(memory, time) == pytest.approx(1 - 0.2 * np.exp(-time * 0.8 / 3.0))


def test_errors_of_the_shares_are_the_stated_ones_or_a_tenth() -> None:
    assert LoadMemory.of(load_skin(SKIN)) is None

    def gamma(g: np.ndarray) -> np.ndarray:
        return g / (1 - g.sum())

    assumed = LoadMemory.of(relaxing())
    assert assumed is not None
    step = 1e-6
    slope = (gamma(G * (1 + step)) - gamma(G * (1 - step))) / (2 * step)
    assert assumed.errors == pytest.approx(SHARE_ERROR * slope[None], rel=1e-6)
    stated = LoadMemory.of(relaxing((0.15, UncertainQuantity(0.10, 0.02))))
    assert stated is not None
    by = step * np.array([0, 1])
    up = gamma(G + by) - gamma(G - by)
    assert stated.errors == pytest.approx(0.02 * up[None] / (2 * step), rel=1e-6)


def hold_and_slide(folder: Path, skin: Path) -> Path:
    """A log: 10 N are held at 20 degrees, slide to 0, leave, and come again elsewhere."""
    from suas_jax.simulation.simulated_log import simulate_log, write_simulated_log

    (folder / "scene.toml").write_text(
        f'skin = "{skin}"\n[[load]]\nkind = "line"\nangle = "20 deg"\nforce = "10 N"\n'
    )
    rows = [(0, 0, 20), (0.5, 0, 20), (0.6, 10, 20), (5, 10, 20), (7, 10, 0), (7.1, 0, 0)]
    rows += [(8.9, 0, 0), (9, 0, -30), (9.1, 8, -30), (10, 8, -30)]
    lines = "\n".join(",".join(map(str, row)) for row in rows)
    path = folder / "path.csv"
    path.write_text(f"# scene: scene.toml\nt_s,loads.0.force_N,loads.0.angle_deg\n{lines}\n")
    log = simulate_log(path, rate=20.0, settings={"noise": 0.3}, seed=3)
    write_simulated_log(log, folder / "log.csv", path)
    return folder / "log.csv"


# Compiles the estimator of a frame, the membrane that remembers, and the simulation.
@pytest.mark.long
@pytest.mark.parametrize("response", ["long-term", "instantaneous"])  # of `suas solve`
def test_a_relaxing_membrane_tells_true_loads_and_leaves_no_ghost(
    tmp_path: Path, response: str
) -> None:
    from fitting import LoadEstimator, readings_of
    from suas_jax import read_log

    skin = tmp_path / "skin.toml"
    relaxation = 'relaxation = { g = [0.15, 0.10], tau = ["0.5 s", "10 s"] }'
    relaxation += f'\nresponse = "{response}"'
    text = SKIN.read_text().replace(
        'preset = "epdm-paper"', f'preset = "epdm-paper"\n{relaxation}'
    )
    skin.write_text(text)
    log = hold_and_slide(tmp_path, skin)
    spec = load_skin(skin)
    estimator = LoadEstimator(spec)
    readings = readings_of(read_log(log), spec, None)
    dropped = np.random.default_rng(0).random(len(readings.time)) > 0.2  # a fifth is missing
    time = readings.time[dropped]
    found = estimator.estimate(readings.so[dropped], readings.stuck[dropped], time=time)
    held = (time > 0.65) & (time < 7.0) | (time > 9.15)
    assert {e.status for e, h in zip(found, held, strict=True) if h} == {"ok"}
    force = np.array([e.contacts[0].force if e.contacts else 0.0 for e in found])
    truth = np.where(time > 8, 8.0, 10.0)
    assert np.abs(force[held] / truth[held] - 1).max() < 0.03
    free = (time > 7.15) & (time < 8.9)
    assert {e.status for e, f in zip(found, free, strict=True) if f} == {"no_contact"}
    # The dent that is left draws on the oil as it fades.
    drawn = np.array([e.oil_pressure for e, f in zip(found, free, strict=True) if f])
    assert (drawn < -1).all()
    assert drawn[-1] > 0.9 * drawn[0]
    # Without its memory the same estimator calls the dent that is left a load.
    plain = estimator.estimate(readings.so[dropped], readings.stuck[dropped])
    ghosts = [c.force for e, f in zip(plain, free, strict=True) if f for c in e.contacts]
    assert max(ghosts) > 0.5


# --- on a pad ---------------------------------------------------------------------------------


def test_a_place_answers_as_the_hereditary_integral_says() -> None:
    """Equivalents under any loads; under a constant one those of `creeping_load`."""
    memory = LoadMemory.of(relaxing())
    assert memory is not None
    time, load = jittered(2)
    dents = Dents.unpressed(np.zeros((1, WHOLE)), 2)
    for k in range(1, len(time)):
        answer = Answer.of(dents, memory.gamma, memory.tau, time[k] - time[k - 1])
        dents = answer.after(dents, np.array([hereditary(time, load, k)]))
        assert dents.load[0] == pytest.approx(load[k], rel=1e-7, abs=1e-7)
    time = np.concatenate([[0.0], np.geomspace(1e-3, 100.0, 2000)])
    dents = Dents.unpressed(np.zeros((1, WHOLE)), 2)
    for k, t in enumerate(time):
        step = t - time[max(k - 1, 0)]
        dents = Answer.of(dents, memory.gamma, memory.tau, step).after(dents, np.ones(1))
        assert dents.load[0] == pytest.approx(creeping_load(memory, t), abs=1e-5)


def at(angle: float, axial: float, force: float) -> np.ndarray:
    """A disc of the table that presses a place."""
    return np.array([angle, axial, force, 6e-3, 0.0, 0.0, 0.0])


def follower_of(memory: LoadMemory, base: Floats) -> tuple[PadMemoryFollower, PadInterpolant]:
    interpolant = PadInterpolant(dent_table(), RADIUS)
    inputs = SimpleNamespace(names=("gap",), rest=base, unexplained=lambda *_: None)
    inputs.slopes = lambda best, *_: np.ones((len(best), *base.shape))
    selection: Any = SimpleNamespace(forget=lambda: None)
    errors = PadMemoryErrors(inputs, memory)  # type: ignore[arg-type]
    return PadMemoryFollower(memory, interpolant, selection, errors, 2.0), interpolant


def test_a_pad_reads_a_held_load_and_the_dent_that_it_leaves() -> None:
    """Held as the elastic pad under the creeping equivalent; released, under what is left."""
    memory = LoadMemory.of(relaxing())
    assert memory is not None
    base = np.full((1, len(PadInterpolant(dent_table()).rest)), 0.5)
    follower, interpolant = follower_of(memory, base)
    rest = interpolant.rest

    def read(contacts: np.ndarray) -> np.ndarray:
        return interpolant.summed(contacts[None])[0]

    held, other = at(0.1, 4e-3, 8.0), at(-0.2, -8e-3, 5.0)

    def found(*contacts: np.ndarray) -> Explanations:
        x = np.stack(contacts, 1).reshape(1, -1)
        return explanations(x, contacts=len(contacts), q=x[:, None])

    assert not follower.before(0.0).any()
    follower.untouched()
    assert follower.again() is None
    time = np.geomspace(1e-6, 20.0, 120)  # at once, then held
    for t in time:
        shift = follower.before(t)
        follower.after(found(held))
        shift = again if (again := follower.again()) is not None else shift
    load = 8.0 * creeping_load(memory, time[-1])
    creeping = held.copy()
    creeping[2] = load
    np.testing.assert_allclose(shift, read(creeping[None]) - read(held[None]), atol=0.02)
    # The step from held to free is as quick as the frames.
    share = 1 + memory.gamma @ (-np.expm1(-0.05 / TAU) / (0.05 / TAU))
    follower.before(time[-1] + 0.05)
    follower.untouched()
    ghost = follower.again()
    assert ghost is not None
    left = held.copy()
    left[2] = load - 8.0 / share
    np.testing.assert_allclose(ghost, read(left[None]) - rest, atol=0.15)
    assert 0.15 * 8 < left[2] < 0.25 * 8
    assert follower.again() is None
    # Errors: of the inputs, of all shares together by a tenth, and of what dents read.
    rows = follower.errors.rest
    assert follower.errors.names == ("gap", "relaxation 0", "dents")
    np.testing.assert_allclose(rows[0], 0.5)
    np.testing.assert_allclose(rows[2], 0.1 * ghost)
    softer = read(np.array([at(0.1, 4e-3, left[2] * 1.1)])) - read(left[None])
    np.testing.assert_allclose(rows[1], softer, rtol=0.25, atol=0.02)
    slopes = follower.errors.slopes(found(held), 3, 1)[0]
    np.testing.assert_allclose(slopes[1:], rows[1:])
    # Another contact in no time: both dents are read together.
    follower.before(time[-1] + 0.05)
    follower.after(found(other))
    both = follower.again()
    assert both is not None
    quick = other.copy()
    quick[2] /= 1 + memory.gamma.sum()
    expected = read(np.stack([quick, left])) - read(other[None])
    np.testing.assert_allclose(both, expected, atol=0.2)
    # A frame that nothing explains leaves the past as it was; long after, nothing is left.
    follower.before(time[-1] + 0.1)
    follower.after(None)
    assert follower.again() is None
    follower.before(time[-1] + 500.0)
    follower.untouched()
    follower.again()
    assert np.abs(follower.before(time[-1] + 900.0)).max() < 0.01
    # A clock that goes backwards begins anew.
    assert not follower.before(0.0).any()


# Compiles a pad's table and its simulation.
@pytest.mark.long
def test_a_relaxing_pad_tells_true_loads_and_leaves_no_ghost(tmp_path: Path) -> None:
    from fitting import LoadEstimator, readings_of
    from suas_jax import read_log
    from suas_jax.simulation.simulated_log import simulate_log, write_simulated_log

    relaxation = 'relaxation = { g = [0.15, 0.10], tau = ["0.5 s", "10 s"] }'
    skin = small_pad().replace("[oil]", f"{relaxation}\n[oil]")
    (tmp_path / "skin.toml").write_text(skin)
    patch = '[[load]]\nkind = "patch"\nangle = "20 deg"\naxial = "8 mm"\n'
    patch += 'size = ["6 mm", "6 mm"]\nforce = "12 N"\n'
    (tmp_path / "scene.toml").write_text(f'skin = "skin.toml"\n{patch}')
    path = tmp_path / "path.csv"
    rows = "\n".join(("0,0", "1,0", "1.2,12", "15,12", "15.2,0", "18,0"))
    path.write_text(f"# scene: scene.toml\nt_s,loads.0.force_N\n{rows}\n")
    log = simulate_log(path, rate=5.0, settings={}, seed=1)
    write_simulated_log(log, tmp_path / "log.csv", path)
    spec = load_skin(tmp_path / "skin.toml")
    estimator = LoadEstimator(spec, most_contacts=1)
    readings = readings_of(read_log(tmp_path / "log.csv"), spec, None)
    found = estimator.estimate(readings.so, readings.stuck, time=readings.time)
    plain = estimator.estimate(readings.so, readings.stuck)
    time = readings.time
    held, free = (time > 1.3) & (time < 15), (time > 15.3) & (time < 18)
    force, elastic = (
        np.array([e.contacts[0].force if e.contacts else 0.0 for e in x])
        for x in (found, plain)
    )
    assert {e.status for e, h in zip(found, held, strict=True) if h} == {"ok"}
    assert force[held].mean() == pytest.approx(12.0, rel=0.02)
    assert np.abs(force[held] / 12 - 1).max() < 0.08  # of which noise is 3 %
    assert (force[free] > 0).mean() <= 0.1  # false alarms
    # Without its memory the same estimator calls the dent that is left a load.
    assert elastic[free].max() > 1.0
