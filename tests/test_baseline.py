"""A baseline is the mean of a skin at rest, and of nothing else."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest
from skins import PAPER

from suas_jax.acquisition.baseline import (
    Baseline,
    NotAtRestError,
    common_factor,
    doubt_of_factor,
    read_baseline,
    refuse_loaded,
    rest_of,
    take_baseline,
    write_baseline,
)
from suas_jax.acquisition.log.log_file import SoLog

FRAMES, MODULES, TAXELS = 400, 32, 10
NOISE = 2.0


def log_of(so: np.ndarray, rate: float = 10.0) -> SoLog:
    """A log of frames [frame, module, taxel] at some hertz; its clocks began 7 s before."""
    frames, modules, taxels = so.shape
    seq = np.repeat(np.arange(frames), modules)
    module = np.tile(np.arange(modules), frames)
    rows = np.rint(so).reshape(-1, taxels)
    time = 7 + seq / rate
    return SoLog(Path("a.csv"), {"scale": "0.305 fF"}, time, time, seq, module, rows, {})


def _refusing(refused: bool, words: str) -> contextlib.AbstractContextManager:
    """Expects that a log is refused, or that it is not."""
    return pytest.raises(NotAtRestError, match=words) if refused else contextlib.nullcontext()


@pytest.fixture
def rest(request) -> np.ndarray:
    rng = np.random.default_rng(3)
    level = rng.uniform(150, 14000, (MODULES, TAXELS))
    return level + rng.normal(0, NOISE, (FRAMES, MODULES, TAXELS))


def test_mean_and_noise(rest, tmp_path):
    rest[:, 4, 9] = np.nan
    rest[17, 5] = np.nan
    baseline = take_baseline(log_of(rest))
    expected = np.rint(rest[np.arange(FRAMES) != 17]).mean(axis=0)
    np.testing.assert_allclose(baseline.so[5], expected[5])
    np.testing.assert_allclose(baseline.so[6], np.rint(rest[:, 6]).mean(axis=0))
    spread = baseline.noise[np.isfinite(baseline.noise)]
    # Rounding adds 1/12; the standard deviation of 400 samples is known to 3.5 %.
    assert np.sqrt(np.mean(spread**2)) == pytest.approx(np.sqrt(NOISE**2 + 1 / 12), rel=0.01)
    assert np.isnan(baseline.so[4, 9])
    write_baseline(baseline, tmp_path / "b.json")
    back = read_baseline(tmp_path / "b.json")
    np.testing.assert_allclose(back.so, baseline.so, atol=1e-4)
    assert back.header["scale"] == "0.305 fF"


def test_a_taxel_saturated_throughout_is_silent():
    so = np.full((FRAMES, 1, 3), 1000.0) + np.arange(FRAMES)[:, None, None] % 2
    so[:, 0, 1:] = [65535.0, 0.0]
    baseline = take_baseline(log_of(so))
    np.testing.assert_array_equal(baseline.so, [[1000.5, np.nan, np.nan]])
    with pytest.raises(ValueError, match="every taxel is silent or saturated"):
        take_baseline(log_of(so[..., 1:]))


@pytest.mark.parametrize("seed", range(20))
def test_noise_alone_is_never_refused(seed):
    rng = np.random.default_rng(seed)
    noise = 10 ** rng.uniform(-2, 2)
    frames = int(rng.integers(20, 300))
    take_baseline(log_of(5000 + rng.normal(0, noise, (frames, 8, TAXELS))))


TIME = np.arange(FRAMES)[:, None, None]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (0.02 * TIME, "drifting"),
        (-0.02 * TIME, "drifting"),
        (40.0 * ((TIME > 100) & (TIME < 200)), "loaded"),
        (-6.0 * (TIME > 250), "drifting, or its load changed"),
        (5.0 * np.sin(0.05 * TIME), "loaded"),
    ],
)
def test_a_skin_that_is_not_at_rest_is_refused(rest, change, words):
    rest[:, 7:8, 2:3] += change
    with pytest.raises(NotAtRestError) as error:
        take_baseline(log_of(rest))
    for word in (words, "module 7", "so_3", "within 39.9 s", "--tolerance"):
        assert word in str(error.value)
    take_baseline(log_of(rest), tolerance=100.0)


def test_a_taxel_without_neighbouring_frames_is_judged_as_if_it_had_no_noise(rest):
    rest[1::2, 7, 2] = np.nan
    take_baseline(log_of(rest), tolerance=2.5)
    rest[:, 7, 2] += 40.0 * (np.arange(FRAMES) > 200)
    with pytest.raises(NotAtRestError, match=r"so_3 .* 1\.0 from its mean are allowed"):
        take_baseline(log_of(rest))


def test_all_taxels_that_moved_are_counted(rest):
    rest[:, 7:8, 2:5] += 0.02 * TIME
    rest[:, 9:10, 1:2] += 30.0 * ((TIME > 100) & (TIME < 200))
    with pytest.raises(NotAtRestError, match=r"\(4 taxels moved\)"):
        take_baseline(log_of(rest))


def test_counts_that_never_change_are_at_rest_whatever_is_tolerated():
    baseline = take_baseline(log_of(np.full((40, 2, TAXELS), 5000.0)), tolerance=0.0)
    assert (baseline.so == 5000).all()
    assert (baseline.noise == 0).all()


@pytest.mark.parametrize(("step", "refused"), [(4.0, False), (5.0, True)])
def test_a_tenth_of_the_log_may_differ_by_six_standard_errors(step, refused):
    """Noise of 4 counts without correlation between neighbours: 6 x 4 / sqrt(40) = 3.8."""
    noise = np.tile([4.0, 4.0, -4.0, -4.0], FRAMES // 4)
    so = 5000 + noise + step * ((np.arange(FRAMES) >= 200) & (np.arange(FRAMES) < 240))
    # A tenth differs from the mean of all by nine tenths of the step.
    with _refusing(refused, r"3\.8 from its mean are allowed"):
        take_baseline(log_of(so[:, None, None]))


@pytest.mark.parametrize(
    ("tenths", "refused"),
    [([0, 0, 0, 0, 0, 1, 2, 2, 2, 2], False), ([0, 0, 0, 0, 0, 0, 0, 0, 1, 2], True)],
)
def test_rounding_is_noise_of_a_few_frames(tenths, refused):
    """Means of two rounded counts: 6 / sqrt(12) / sqrt(2) = 1.2; theirs differ by 1.1, 1.7."""
    with _refusing(refused, r"1\.2 from its mean are allowed"):
        take_baseline(log_of(5000.0 + np.repeat(tenths, 2)[:, None, None]))


@pytest.mark.parametrize(
    ("tolerance", "refused"), [(0.0, True), (0.45, True), (0.5, False), (None, False)]
)
def test_what_is_tolerated_may_be_less_than_a_count(tolerance, refused):
    """Half of the log a count higher: every tenth is half a count from the mean."""
    log = log_of(5000.0 + (np.arange(40) >= 20)[:, None, None])
    with _refusing(refused, r"moved by 1\.0 counts"):
        take_baseline(log, tolerance=tolerance)


def test_what_moves_just_as_far_as_is_tolerated_is_not_counted():
    steps = np.array([[1.0, 3.0]]) * (np.arange(40) >= 20)[:, None, None]
    with pytest.raises(NotAtRestError, match=r"so_2 .*\(1 taxels moved\)"):
        take_baseline(log_of(5000.0 + steps), tolerance=0.5)


def test_too_short(rest):
    with pytest.raises(ValueError, match="19 frames; a baseline needs at least 20"):
        take_baseline(log_of(rest[:19]))


def test_a_steady_load_shows_against_an_earlier_baseline(rest):
    before = take_baseline(log_of(rest))
    rest[:, 3, 4] *= 1.1
    loaded = take_baseline(log_of(rest))
    with pytest.raises(NotAtRestError, match=r"module 3, so_5 reads \+10\.0 %"):
        refuse_loaded(loaded, rest_of(before, loaded), tolerance=0.02, source="b.json")
    refuse_loaded(before, rest_of(before, before), tolerance=0.0, source="b.json")


def test_an_earlier_baseline_of_fewer_modules_and_taxels(rest):
    """What both have is compared; a taxel that read zero then says nothing now."""
    earlier = rest[:, :1, :8].copy()
    earlier[:, 0, 3] = 0.0
    before, now = take_baseline(log_of(earlier)), take_baseline(log_of(rest[:, :2]))
    known = rest_of(before, now)
    np.testing.assert_array_equal(known[0, :8], before.so[0])
    assert np.isnan(known[0, 8:]).all()
    assert np.isnan(known[1]).all()
    refuse_loaded(now, known, tolerance=0.02, source="b.json")


def test_modules_are_compared_by_their_numbers():
    def taken(modules: list[int]) -> Baseline:
        so = 1000.0 * np.array(modules)[:, None] + np.arange(3)
        return Baseline(np.array(modules), so, np.ones_like(so), 100, {})

    known = rest_of(taken([2, 5]), taken([1, 2, 3, 5, 8]))
    np.testing.assert_array_equal(known[[1, 3], 0], [2000.0, 5000.0])
    assert np.isnan(known[[0, 2, 4]]).all()


@pytest.mark.parametrize(("tolerance", "share"), [(0.0, 0), (0.25, 256)])
def test_a_count_more_than_what_is_tolerated_is_the_most(tolerance, share):
    rest = np.array([[1024.0, 512.0]])

    def refuse(count: float) -> None:
        just_within = tolerance * 512.0 + 1.0
        so = rest + np.array([[share + count, just_within]])
        taken = Baseline(np.array([4]), so, np.ones_like(so), 100, {})
        refuse_loaded(taken, rest, tolerance=tolerance, source="b.json")

    refuse(1.0)
    allowed = rf"{100 * tolerance + 0.1:.1f} % are allowed \(1 taxels"
    with pytest.raises(NotAtRestError, match=allowed):
        refuse(1.5)


def test_a_pattern_up_to_a_factor(rest):
    baseline = take_baseline(log_of(rest))
    pattern = 0.8 * baseline.so
    factor = common_factor(baseline, pattern, "model")
    assert factor == pytest.approx(1.25, rel=1e-12)
    refuse_loaded(baseline, pattern, tolerance=1e-3, source="model", factor=factor)
    assert doubt_of_factor(factor, "model") == ""
    for doubtful in (2.0, 0.5):
        assert f"read {doubtful:.3g} times" in doubt_of_factor(doubtful, "model")
    for another in (5.0, 0.2, 0.0):
        with pytest.raises(ValueError, match=r"times .*--skin .* from 0\.25 to 4 are allowed"):
            doubt_of_factor(another, "model")
    pattern[2, 2] *= 1.1
    with pytest.raises(NotAtRestError, match=r"module 2, so_3 reads -9\.1 %"):
        refuse_loaded(baseline, pattern, tolerance=0.05, source="model", factor=factor)


def test_the_factor_of_a_pattern_is_that_of_the_taxels_without_load(rest):
    """One load in sixteen taxels' reach doesn't make the other 304 look loaded."""
    baseline = take_baseline(log_of(rest))
    pattern = 0.8 * baseline.so
    pattern[:2, :8] /= 3.0
    factor = common_factor(baseline, pattern, "model")
    with pytest.raises(NotAtRestError, match=r"reads \+200\.0 % .*\(16 taxels deviate\)"):
        refuse_loaded(baseline, pattern, tolerance=0.05, source="model", factor=factor)


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"modules": 1}', '{"format": "suas-baseline"}']
)
def test_no_baseline_is_named(content, tmp_path):
    path = tmp_path / "b.json"
    path.write_text(content)
    with pytest.raises(ValueError, match=r"b\.json"):
        read_baseline(path)


def test_modules_of_a_file_may_have_different_numbers_of_taxels(tmp_path):
    path = tmp_path / "b.json"
    modules = [
        {"module": 3, "so": [1.0, 2.0], "noise": [0.1, None]},
        {"module": 1, "so": [5.0, 6.0, None, 8.0, 9.0], "noise": [0.1] * 5},
    ]
    content = {"format": "suas-baseline", "frames": 40, "modules": modules}
    text = json.dumps(content).ljust(16_000_000)  # as long as a file may be
    path.write_text(text)
    found = read_baseline(path)
    np.testing.assert_array_equal(found.modules, [1, 3])
    nan = np.nan
    np.testing.assert_array_equal(found.so, [[5, 6, nan, 8, 9], [1, 2, nan, nan, nan]])
    np.testing.assert_array_equal(found.noise[1], [0.1, nan, nan, nan, nan])
    assert found.frames == 40
    path.write_text(text + " ")
    with pytest.raises(OSError, match="at most"):
        read_baseline(path)


def test_command(rest, tmp_path, capsys):
    import typer

    from fitting.cli.log import baseline
    from suas_jax.acquisition.log.log_file import LogWriter, log_header

    def written(name: str, so: np.ndarray) -> Path:
        with LogWriter(tmp_path / name, log_header(), taxels=TAXELS) as log:
            for i, frame in enumerate(np.rint(so).astype(int).tolist()):
                for module, row in enumerate(frame):
                    log.write(0.01 * i, 0.01 * i, i, module, row)
        return tmp_path / name

    out = tmp_path / "b.json"
    baseline(written("rest.csv", rest[:50, :2]), out)
    assert len(json.loads(out.read_text())["modules"]) == 2
    with pytest.raises(typer.Exit):
        baseline(tmp_path / "rest.csv", out)
    assert "--overwrite" in capsys.readouterr().err
    pressed = rest[:50, :2] * 1.05
    with pytest.raises(typer.Exit):
        baseline(written("pressed.csv", pressed), tmp_path / "c.json", reference=out)
    assert "the skin was loaded" in capsys.readouterr().err
    assert not (tmp_path / "c.json").exists()


def test_a_baseline_of_another_fluid_is_refused_or_counted_as_such(rest, tmp_path, capsys):
    """Its header named air, and it counted as one of the skin's oil."""
    import typer

    from fitting.cli.log import baseline
    from fitting.inverse_load.zero.skin_estimator import rest_of as rest_in
    from fitting.sensor.logs.data import load_sensor_data
    from fitting.sensor.logs.readings import gathered
    from suas_jax.config import load_skin
    from suas_jax.config.oil import refuse_other_fluid

    skin = Path(__file__).parent.parent / "configs/skins/suas.toml"
    spec, log, out = load_skin(skin), tmp_path / "air.csv", tmp_path / "b.json"
    names = ",".join(f"so_{k + 1}" for k in range(8))
    for head, column in (("# fluid: air\n", ""), ("", ",fluid")):
        rows = [
            f"{i / 10},{i / 10},{i},0" + 8 * f",{75 + i % 2}" + ",air" * bool(column)
            for i in range(40)
        ]
        top = f"# format: suas-so-log\n{head}t_host_s,t_device_s,seq,module,{names}{column}"
        log.write_text("\n".join([top, *rows]) + "\n")
        with pytest.raises(typer.Exit):
            baseline(log, out, skin=skin)
        assert 'its fluid is "air" (permittivity 1.001)' in capsys.readouterr().err
    baseline(log, out)  # no skin is known
    found = read_baseline(out)
    assert found.header["fluid"] == "air"
    with pytest.raises(ValueError, match="the skin filled as the file says"):
        rest_in(spec, out)
    log.write_text(log.read_text().replace(",air", ",oil"))
    _, _, permittivity = gathered(load_sensor_data(spec, [log]), found, False)
    np.testing.assert_array_equal(permittivity, [np.nan, 1.0006])
    for name, own in (("", 2.2), ("Oil", None), ("silicone-oil", 2.35), ("2.3", 2.2)):
        refuse_other_fluid(name, own, "a.csv")
    refuse_other_fluid("silicone-oil", None, "a.csv")
    for name, own in (("silicone-oil", 2.2), ("2.6", 2.2), ("air", None), ("water", 2.2)):
        with pytest.raises(ValueError, match=r"a.csv"):
            refuse_other_fluid(name, own, "a.csv")


SCENE = f"""{PAPER}
[electrodes]
taxels = [ {{ angle = "-30 deg" }}, {{ angle = "0 deg" }}, {{ angle = "30 deg" }} ]
[solve]
model = "shell"
"""
LOAD = '[[load]]\nkind = "line"\nangle = "0 deg"\nforce = "2 N"\ndirection = "radial"\n'


@pytest.mark.long  # the reading of a skin of its own; baselines above
def test_a_steady_load_shows_against_the_model(tmp_path, capsys):
    """Logs of a simulated skin name their scene: rest is accepted, 2 N all the time are not."""
    import typer

    from fitting.cli.log import baseline
    from fitting.cli.simulate import simulate

    for name, load in (("rest", ""), ("pressed", LOAD)):
        scene, log = tmp_path / f"{name}.toml", tmp_path / f"{name}.csv"
        scene.write_text(SCENE + load)
        simulate(scene, log, rate=50.0, duration=2.0)
    baseline(tmp_path / "rest.csv", tmp_path / "rest.json")
    with pytest.raises(typer.Exit):
        baseline(tmp_path / "pressed.csv", tmp_path / "pressed.json")
    message = capsys.readouterr().err
    assert "the skin was loaded: module 0, so_2" in message
    assert "--model-tolerance" in message
