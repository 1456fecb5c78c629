"""Relaxation from presses that are held on the skin: the estimate, its errors, refusals."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from fitting.cli.app import app
from fitting.sensor.logs.data import NoCalibration, SensorData, load_sensor_data
from fitting.sensor.relaxation import held_press
from fitting.sensor.relaxation.fit import (
    RelaxationFit,
    _fitted,
    fit_relaxation,
    relaxed,
    unexplained,
)
from fitting.sensor.relaxation.held_press import HeldPress, held_presses
from suas_jax.config import load_skin
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.tolerance import deviation_of

SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"
MOVES = np.array([-0.15, -0.1, 0.02, 0.4, 0.4, 0.02, -0.1, -0.15])  # of the taxels, at 20 N
ONE = RelaxationSpec(g=(0.15,), tau=(20.0,))
TWO = RelaxationSpec(g=(0.10, 0.08), tau=(2.0, 40.0))


def creeping(
    time: np.ndarray, load: np.ndarray, series: RelaxationSpec, stiffness: float = 1.0
) -> np.ndarray:
    """Counts of a skin whose gaps close in proportion to its dent [taxel, time].

    The dent e follows e + sum gamma_i R_i = load, dR_i/dt + R_i/tau_i = de/dt.
    """
    g, tau = np.array(series.g), np.array(series.tau)
    gamma, past, dent = g / (1 - g.sum()), 0 * g, [load[0]]
    for step, now in zip(np.diff(time), load[1:], strict=True):
        x = step / tau
        fade, mean = np.exp(-x), -np.expm1(-x) / x
        new = (now - gamma @ (fade * past) + gamma @ mean * dent[-1]) / (1 + gamma @ mean)
        past = fade * past + mean * (new - dent[-1])
        dent.append(new)
    return np.asarray(160 / (1 - MOVES[:, None] * np.array(dent) / (20 * stiffness)))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The skin of `creeping` in place of the shell."""
    monkeypatch.setattr(
        HeldPress, "readings", lambda press, *at: creeping(press.time, press.load, *at)
    )


def held(
    file: Path,
    series: RelaxationSpec = ONE,
    seed: int = 0,
    hold: float = 120.0,
    rest: float = 40.0,
    noise: float = 2.0,
    place: str = "0",
    warming: float = 0.0,
) -> SensorData:
    """A log of a press of 20 N, with noise and whole counts."""
    time = np.arange(0.0, hold + 2 * rest, 0.25)
    load = np.interp(time, rest + np.array([0.0, 0.25, hold, hold + 0.25]), [0, 20, 20, 0])
    random = np.random.default_rng(seed)
    so = creeping(time, load, series)
    so += warming * (1 + MOVES[:, None]) * -np.expm1(-time / 60)
    so = np.rint(
        so * (1 + 0.02 * random.standard_normal((8, 1)))
        + noise * random.standard_normal(so.shape)
    )
    rows = [
        f"{t},{t},{i},0,{','.join(map(str, so[:, i].astype(int)))},{load[i]},{place}"
        for i, t in enumerate(time)
    ]
    names = ",".join(f"so_{k}" for k in range(1, 9))
    head = "# format: suas-so-log\n# format_version: 1\n# scale: 0.305 fF\n"
    columns = f"t_host_s,t_device_s,seq,module,{names},load_0_force_N,load_0_angle_deg"
    file.write_text("\n".join([head + columns, *rows]) + "\n")
    return load_sensor_data(load_skin(SKIN), [file], joint=True)


def errors(fit: RelaxationFit, truth: RelaxationSpec) -> np.ndarray:
    """Errors of shares and times over their stated deviations."""
    known = np.array([*truth.g, *truth.tau])
    return (fit.constants[:-1] - known) / np.sqrt(np.diagonal(fit.covariance))[:-1]


def test_what_is_gone_of_a_stress_is_the_closed_form() -> None:
    late, early = (0.85 + 0.15 * np.exp(-t / 20.0) for t in (60.0, 0.2))
    assert relaxed(ONE, 60.0, 0.2) == pytest.approx(1 - late / early, rel=1e-14)


def test_means_keep_the_course_of_the_load(tmp_path: Path) -> None:
    data = held(tmp_path / "log.csv")
    (press,) = held_presses(data)
    load = np.nan_to_num(data.loads.force)[0, data.state]
    assert len(press.time) < 0.2 * len(load)
    assert np.abs(np.interp(data.time, press.time, press.load) - load).max() < 0.02 * 20
    assert press.hold == pytest.approx(120.0, abs=0.3)
    assert press.deviation[:, 0] == pytest.approx(np.full(8, np.hypot(2, 0.29)), rel=0.1)


def test_offset_drift_and_gain_of_a_taxel_leave_nothing(tmp_path: Path) -> None:
    (press,) = held_presses(held(tmp_path / "log.csv"))
    model = creeping(press.time, press.load, ONE)
    so = 30 - 0.02 * press.time + 1.3 * model
    drifting = press._replace(so=so)
    assert np.abs(unexplained(drifting, model[None])).max() < 1e-9
    assert np.abs(unexplained(drifting, model[None], drifts=False)).max() > 0.1


def test_a_measured_oil_pressure_is_said_to_be_left_out(tmp_path: Path) -> None:
    """Of any log that `suas fit sensor` reads; the readings are what they are without it."""
    file = tmp_path / "log.csv"
    without = held(file)
    assert not any("oil_pressure_Pa" in text for text in without.warnings)
    *head, names = (lines := file.read_text().splitlines())[:4]
    rows = (f"{line},12.5" for line in lines[4:])
    file.write_text("\n".join([*head, f"{names},oil_pressure_Pa", *rows]) + "\n")
    own = load_sensor_data(load_skin(SKIN), [file], joint=True)
    assert any("oil_pressure_Pa is not used" in text for text in own.warnings)
    np.testing.assert_array_equal(own.so, without.so)


def test_two_terms_are_found_where_there_are_two(quick: None, tmp_path: Path) -> None:
    for truth in (ONE, TWO):
        best, tried = fit_relaxation(held(tmp_path / "log.csv", truth, hold=200.0, rest=100.0))
        assert (best.terms, len(tried)) == (len(truth.g), 1)
        assert np.abs(errors(best, truth)).max() < 2.5
        share, deviation = best.relaxed(100.0, best.window[0])
        assert abs(share - relaxed(truth, 100.0, best.window[0])) < 2.5 * deviation < 0.02


def test_stated_errors_are_those_of_many_draws(quick: None, tmp_path: Path) -> None:
    data = held(tmp_path / "log.csv")
    (press,) = held_presses(data)
    random, clean = np.random.default_rng(0), creeping(press.time, press.load, ONE)
    start, z = np.log([0.2, 10.0, 1.0]), []
    for _ in range(60):
        so = clean + press.deviation * random.standard_normal(clean.shape)
        z.append(errors(_fitted(data, (press._replace(so=so),), start), ONE))
    assert np.sqrt(np.mean(np.square(z), 0)) == pytest.approx(np.ones(2), abs=0.25)
    assert np.all(np.mean(np.abs(z) < 1.96, 0) > 0.88)


def test_a_baseline_that_warms_is_no_relaxation(quick: None, tmp_path: Path) -> None:
    """By 15 counts with 60 s; a steady drift alone leaves the time 6 deviations off."""
    z = []
    for seed in range(6):
        best, _ = fit_relaxation(held(tmp_path / "log.csv", seed=seed, warming=15.0))
        assert (best.terms, best.presses[0].drift_degree > 1) == (1, True)
        z.append(errors(best, ONE))
    assert np.all(np.sqrt(np.mean(np.square(z), 0)) < 1.7)
    assert fit_relaxation(held(tmp_path / "log.csv"))[0].presses[0].drift_degree == 1


def test_what_a_hold_can_t_tell_is_refused_in_words(quick: None, tmp_path: Path) -> None:
    slow = RelaxationSpec(g=(0.2,), tau=(1000.0,))
    with pytest.raises(
        NoCalibration, match=r"a hold of 59.8 s can't tell .*hold the press for"
    ):
        fit_relaxation(held(tmp_path / "log.csv", slow, hold=60.0))
    elastic = RelaxationSpec(g=(1e-6,), tau=(20.0,))
    with pytest.raises(NoCalibration, match="no relaxation is told"):
        fit_relaxation(held(tmp_path / "log.csv", elastic))


def test_logs_of_another_skin_are_refused_whatever_the_gains(
    quick: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(globals(), "MOVES", np.linspace(-0.3, 0.5, 8))
    data = held(tmp_path / "log.csv")
    turned = dataclasses.replace(data, so=data.so[::-1])
    with pytest.raises(NoCalibration, match="in reverse order they would"):
        fit_relaxation(turned)
    load = dataclasses.replace(data.loads, force=1e-3 * data.loads.force)
    with pytest.raises(NoCalibration, match=r"times as much as this skin's .* the load's unit"):
        fit_relaxation(dataclasses.replace(data, loads=load))


def test_a_load_without_a_state_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (press,) = held_presses(held(tmp_path / "log.csv"))
    lost = SimpleNamespace(points=[{"t_s": 60.0, "status": "max_steps"}])
    monkeypatch.setattr(held_press, "history_sweep", lambda *given, **how: lost)
    with pytest.raises(NoCalibration, match=r"under 20 N \(max_steps\): check the load's unit"):
        press.readings(ONE, 1.0)


def test_slow_creep_names_the_drift_that_hides_it(quick: None, tmp_path: Path) -> None:
    slow = RelaxationSpec(g=(0.2,), tau=(90.0,))
    best, _ = fit_relaxation(held(tmp_path / "log.csv", slow, rest=10.0))
    assert any("drift of the baseline" in text for text in best.hidden)


def test_logs_without_one_held_press_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    for said, options in {
        "nothing is held": {"hold": 1.0},
        "begins under load": {"rest": -1.0},
    }.items():
        with pytest.raises(ValueError, match=said):
            held_presses(held(file, **options))  # type: ignore[arg-type]
    held(file)
    lines = file.read_text().splitlines()
    idle = [line.replace(",20.0,0", ",0.0,0") for line in lines]
    file.write_text("\n".join(idle) + "\n")
    with pytest.raises(ValueError, match="stays within 2 % for 0 s"):
        held_presses(load_sensor_data(load_skin(SKIN), [file], joint=True))
    later = [line.removesuffix("0") + "10" if i > 400 else line for i, line in enumerate(lines)]
    file.write_text("\n".join(later) + "\n")
    with pytest.raises(ValueError, match="one load at one place"):
        held_presses(load_sensor_data(load_skin(SKIN), [file], joint=True))


# Compiles the membrane that remembers, and its simulation on an even mesh.
@pytest.mark.long
def test_a_held_press_on_the_skin_tells_its_relaxation(tmp_path: Path) -> None:
    from suas_jax.simulation.simulated_log import simulate_log, write_simulated_log

    relaxing = 'preset = "epdm-paper"\nrelaxation = { g = [0.15], tau = ["20 s"] }'
    text = SKIN.read_text().replace('preset = "epdm-paper"', relaxing)
    (tmp_path / "skin.toml").write_text(text)
    load = '[[load]]\nkind = "line"\nangle = "0 deg"\nforce = "20 N"\n'
    (tmp_path / "scene.toml").write_text(f'skin = "skin.toml"\n{load}')
    rows = "0,0\n40,0\n40.2,20\n160.2,20\n160.4,0\n240,0"
    path = tmp_path / "path.csv"
    path.write_text(f"# scene: scene.toml\nt_s,loads.0.force_N\n{rows}\n")
    log = simulate_log(path, rate=5.0, settings={"noise": 2.0}, seed=4)
    write_simulated_log(log, tmp_path / "log.csv", path)
    target, figure = tmp_path / "found.toml", tmp_path / "fit.png"
    options = ["--fit", "relaxation", "-o", str(target), "--plot", str(figure), "--json"]
    command = ["fit", "sensor", str(SKIN), str(tmp_path / "log.csv"), *options]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    for name, truth, most in (("g.0", 0.15, 0.02), ("tau.0", 20.0, 0.05)):
        error = report["standard_errors"][f"material.relaxation.{name}"]
        assert abs(report["parameters"][f"material.relaxation.{name}"] - truth) < 2.5 * error
        assert error < most * truth
    own = load_skin(target).material.relaxation
    assert own is not None
    assert own.g[0] == pytest.approx(report["parameters"]["material.relaxation.g.0"])
    assert deviation_of(own.g[0]) == pytest.approx(
        report["standard_errors"]["material.relaxation.g.0"], rel=1e-3
    )
    assert figure.stat().st_size > 0
    refused = CliRunner().invoke(app, [*command, "--gap", "taxel", "--overwrite"])
    assert refused.exit_code == 2
    said = " ".join(refused.output.split())
    assert "--gap: not with --fit relaxation" in said
    assert "leave it out" in said
