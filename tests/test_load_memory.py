"""Memory of a membrane as states: against hereditary integrals, and on simulated logs."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.memory.remembering import Series, response_of
from fitting.inverse_load.memory.series import SHARE_ERROR, LoadMemory, creeping_load
from suas_jax.config import load_skin
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.tolerance import UncertainQuantity
from suas_jax.constitutive.relaxation import Past

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


def test_states_are_the_hereditary_integral_on_jittered_and_missing_frames() -> None:
    rng = np.random.default_rng(1)
    time = np.cumsum(np.concatenate([[0.0], rng.uniform(0.001, 0.05, 30), [7.0, 40.0, 0.01]]))
    stress = np.concatenate([[0.0], rng.normal(size=len(time) - 1)])
    series = Series(jnp.asarray(GAMMA), jnp.asarray(TAU), jnp.zeros((0, 2)))
    past = Past(jnp.zeros(1), jnp.zeros((2, 1)))
    found = []
    for k in range(1, len(time)):
        elapsed = jnp.asarray(time[k] - time[k - 1])
        response = response_of(series, series.gamma, past, elapsed)
        found.append(float(response.share * stress[k] + response.rest[0]))
        past = past.after(series.states, elapsed, jnp.asarray(stress[k : k + 1]))
    slope = np.diff(stress) / np.diff(time)

    def kernel(age: float) -> float:
        return float(1 - (G * -np.expm1(-age / TAU)).sum()) / END

    for k in (1, 5, len(time) - 3, len(time) - 2, len(time) - 1):
        parts = [
            slope[i] * quad(lambda s, k=k: kernel(time[k] - s), time[i], time[i + 1])[0]
            for i in range(k)
        ]
        assert found[k - 1] == pytest.approx(sum(parts), rel=1e-8, abs=1e-8)


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
    # Without its memory the same estimator calls the dent that is left a load.
    plain = estimator.estimate(readings.so[dropped], readings.stuck[dropped])
    ghosts = [c.force for e, f in zip(plain, free, strict=True) if f for c in e.contacts]
    assert max(ghosts) > 0.5
