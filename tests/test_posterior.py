"""Posterior: known distributions, resuming after a kill, short chains, lost workers."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import emcee
import h5py
import jax.numpy as jnp
import numpy as np
import pytest

from fitting.material.report.posterior_files import to_arviz
from fitting.statistics.log_probability import Batch, Gaussian, laplace
from fitting.statistics.posterior import Settings, sample
from suas_jax.runtime import compiled

ROOT = pathlib.Path(__file__).parent.parent
COVARIANCE = np.array([[1.0, 0.8], [0.8, 2.0]])
PRECISION = np.linalg.inv(COVARIANCE)
START = Gaussian(np.zeros(2), 0.1 * np.eye(2))
NAMES = ("a", "b")


def normal(x: jnp.ndarray) -> jnp.ndarray:
    return -0.5 * jnp.einsum("ni,ij,nj->n", x - 3.0, PRECISION, x - 3.0)


@pytest.mark.parametrize("moves", ["stretch", "de-snooker"])
def test_known_gaussian(moves: str) -> None:
    found = sample(normal, START, NAMES, Settings(moves=moves))
    assert found.converged
    error = 4.0 * np.sqrt(np.diagonal(COVARIANCE) / found.effective_samples)
    assert np.all(np.abs(found.samples.mean(axis=0) - 3.0) < error)
    assert np.allclose(np.cov(found.samples.T), COVARIANCE, rtol=0.25)
    assert found.laplace is not None
    assert np.allclose(found.laplace.mean, 3.0, atol=1e-6)
    assert np.allclose(found.laplace.covariance, COVARIANCE, rtol=1e-6)
    assert found.agreement["agree"]


def test_short_chain_is_refused_with_the_numbers() -> None:
    found = sample(normal, START, NAMES, Settings(steps=300))
    assert not found.converged
    tau = emcee.autocorr.integrated_time(found.chain[30:], tol=0, quiet=True).max()
    assert found.message.startswith("not converged: 300 steps are")
    assert f"({tau:.1f} steps for" in found.message
    assert "raise --steps to" in found.message


def test_skewed_posterior_is_not_called_gaussian() -> None:
    found = sample(
        lambda x: jnp.sum(x - jnp.exp(x), 1), Gaussian(np.zeros(1), np.eye(1)), ("x",)
    )
    assert found.converged
    assert not found.agreement["agree"]


def test_walkers_stay_out_of_impossible_points() -> None:
    found = sample(
        lambda x: jnp.where(x[:, 0] > 0.0, -0.5 * x[:, 0] ** 2, jnp.nan),
        Gaussian(np.ones(1), np.eye(1)),
        ("x",),
        Settings(steps=2000, stop=False),
    )
    assert found.chain.min() > 0.0
    assert np.mean(found.samples) == pytest.approx(np.sqrt(2.0 / np.pi), rel=0.1)


def test_laplace_needs_an_interior_maximum() -> None:
    batch = Batch(lambda x: jnp.where(x[:, 0] > 0.0, -x[:, 0], -jnp.inf), 1, 8)
    assert laplace(batch, Gaussian(np.array([0.5]), 0.01 * np.eye(1))) is None


@pytest.mark.parametrize("start", [-3.0, 2.0, 3.0])
def test_laplace_climbs_from_afar(start: float) -> None:
    """Also from where a surface is hollow; curvatures at the maxima are 1 and 2."""
    for surface, variance in (
        (lambda x: x - np.exp(x), 1.0),
        (lambda x: -np.log1p(x**2), 0.5),
        (lambda x: -np.hypot(1.0, x), 1.0),  # from 1 Newton's step leads to -1 and back
    ):
        found = laplace(lambda x, f=surface: f(x[:, 0]), Gaussian(np.array([start]), np.eye(1)))
        assert found is not None
        assert found.mean[0] == pytest.approx(0.0, abs=2e-3)
        assert found.covariance[0, 0] == pytest.approx(variance, rel=0.02)


def test_laplace_climbs_over_a_saddle() -> None:
    found = laplace(
        lambda x: -0.5 * x[:, 0] ** 2 - np.log1p(x[:, 1] ** 2),
        Gaussian(np.array([1.0, 3.0]), np.eye(2)),
    )
    assert found is not None
    np.testing.assert_allclose(found.mean, 0.0, atol=2e-3)
    np.testing.assert_allclose(found.covariance, np.diag([1.0, 0.5]), atol=0.02)


def test_laplace_leaves_a_hollow() -> None:
    found = laplace(
        lambda x: (x**2 - x**4 / 4)[:, 0], Gaussian(np.array([0.05]), 0.1 * np.eye(1))
    )
    assert found is not None
    assert found.mean[0] == pytest.approx(np.sqrt(2.0), abs=2e-3)
    assert found.covariance[0, 0] == pytest.approx(0.25, rel=0.02)


@pytest.mark.parametrize("width", [1e-4, 1e-2, 1.0, 100.0])
def test_laplace_of_three_parameters_from_any_width(width: float) -> None:
    covariance = np.array([[1.0, 0.8, -0.3], [0.8, 2.0, 0.1], [-0.3, 0.1, 0.5]])
    precision, mean = np.linalg.inv(covariance), np.array([3.0, -1.0, 0.2])
    found = laplace(
        lambda x: -0.5 * np.einsum("ni,ij,nj->n", x - mean, precision, x - mean),
        Gaussian(np.zeros(3), width**2 * np.eye(3)),
    )
    assert found is not None
    np.testing.assert_allclose(found.mean, mean, atol=1e-5)
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-5)


@pytest.mark.parametrize("across", [1e-4, 0.0])
def test_laplace_looks_no_further_than_its_start_is_wide(across: float) -> None:
    """Narrow between bounds in one direction, ten thousand times as wide in the other."""

    def peak(x: np.ndarray) -> np.ndarray:
        value = -0.5 * ((x[:, 0] / 100.0) ** 2 + (x[:, 1] / 0.01) ** 2)
        return np.where(np.abs(x[:, 1]) < 0.1, value, -np.inf)

    found = laplace(peak, Gaussian(np.array([50.0, 0.0]), np.diag([1e4, across])))
    assert found is not None
    np.testing.assert_allclose(found.mean / [100.0, 0.01], 0.0, atol=1e-3)
    np.testing.assert_allclose(np.diag(found.covariance), [1e4, 1e-4], rtol=1e-3)


def test_laplace_gives_a_flat_surface_up_at_once() -> None:
    looks = []

    def flat(x: np.ndarray) -> np.ndarray:
        looks.append(len(x))
        return np.zeros(len(x))

    assert laplace(flat, Gaussian(np.zeros(2), np.eye(2))) is None
    assert looks == [1, 6, 8]  # the start, an expansion of two parameters, a line search


def test_one_compiled_shape() -> None:
    traces = []

    def counted(x: jnp.ndarray) -> jnp.ndarray:
        traces.append(x.shape)
        return normal(x)

    sample(counted, START, NAMES, Settings(steps=20, moves="de-snooker"))
    assert traces == [(16, 2)]


PROGRAM = """
import pathlib, sys, time
import jax
jax.config.update("jax_enable_x64", True)
from tests.test_posterior import NAMES, START, Settings, normal, sample
path = pathlib.Path(sys.argv[1])
slow = lambda step, steps, tau: time.sleep(0.3)
settings = Settings(steps=2000, check=100, stop=False, chain=path)
sample(normal, START, NAMES, settings, progress=slow)
"""


def test_a_killed_run_resumes_to_the_same_chain(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As the other process compiles: chains agree to the last digit.
    monkeypatch.delitem(compiled.OPTIONS, "xla_backend_optimization_level")
    path = tmp_path / "chain.h5"
    run = subprocess.Popen([sys.executable, "-c", PROGRAM, str(path)], cwd=ROOT)
    deadline = time.monotonic() + 60.0
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    run.send_signal(signal.SIGKILL)
    run.wait()
    with h5py.File(path) as file:
        before = int(file["mcmc"].attrs["iteration"])
    assert 0 < before < 2000
    settings = Settings(steps=2000, check=100, stop=False)
    whole = sample(normal, START, NAMES, settings)
    resumed = sample(
        normal, START, NAMES, Settings(steps=2000, check=100, stop=False, chain=path)
    )
    assert resumed.steps == 2000
    assert np.array_equal(resumed.chain, whole.chain)
    with pytest.raises(ValueError, match="belongs to other data"):
        sample(normal, START, NAMES, Settings(chain=path), key=b"other")


@pytest.mark.long
def test_devices_share_the_ensemble() -> None:
    program = (
        "import jax; jax.config.update('jax_enable_x64', True)\n"
        "import numpy as np\n"
        "from tests.test_posterior import Batch, normal\n"
        "assert len(jax.devices()) == 2\n"
        "points = np.random.default_rng(0).normal(size=(37, 2))\n"
        "assert np.allclose(Batch(normal, 2, 15)(points), normal(points), rtol=1e-14)\n"
    )
    flags = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=2"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env=os.environ | {"XLA_FLAGS": flags},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr


CLUSTER = """
import multiprocessing, pathlib, sys
from fitting.material.many import calibrate_all, load_jobs
from fitting.workers import LocalWorkers

def main():
    results = pathlib.Path(sys.argv[2])
    said = []
    with LocalWorkers(2, said.append) as workers:
        def kill(done, total, name):
            if done == 3:  # of which the file had one
                multiprocessing.active_children()[0].kill()
        calibrate_all(load_jobs(pathlib.Path(sys.argv[1])), results, workers, kill)
    assert len(said) == 1, said

if __name__ == "__main__":
    main()
"""


def test_samples_are_written_by_either_arviz(tmp_path: pathlib.Path) -> None:
    chain = np.linspace(-1.0, 1.0, 24).reshape(4, 2, 3)  # two constants and log s
    posterior = SimpleNamespace(chain=chain, burn_in=1, log_probability=-chain[..., 0])
    found = SimpleNamespace(
        posterior=posterior,
        fit=SimpleNamespace(family=SimpleNamespace(names=("C1", "C2"))),
        noise_known=False,
        constants=lambda theta: 1e6 * theta[:, :2],
    )
    file = tmp_path / "samples.nc"
    to_arviz(found).to_netcdf(str(file), engine="h5netcdf")  # type: ignore[arg-type]
    kept = chain[1:].swapaxes(0, 1)
    with h5py.File(file) as written:
        np.testing.assert_allclose(written["posterior/C2"], 1e6 * kept[..., 1])
        np.testing.assert_allclose(written["posterior/noise"], np.exp(kept[..., 2]))
        np.testing.assert_allclose(written["sample_stats/lp"], -kept[..., 0])


@pytest.mark.long
def test_a_lost_worker_neither_loses_nor_repeats_results(tmp_path: pathlib.Path) -> None:
    data = ROOT / "configs" / "data" / "treloar1944_uniaxial.csv"
    jobs, results = tmp_path / "jobs.toml", tmp_path / "results.jsonl"
    jobs.write_text(
        "".join(
            f'[[membrane]]\nname = "m{i}"\nlaw = "neo-hookean"\n'
            f'data = {{ uniaxial = "{data if i else "missing.csv"}" }}\n'
            for i in range(8)
        )
    )
    script = tmp_path / "cluster.py"
    script.write_text(CLUSTER)
    results.write_text('{"name": "m7", "status": "converged"}\n{"name": "m6", "st')
    subprocess.run(
        [sys.executable, str(script), str(jobs), str(results)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        check=True,
        timeout=600,
        capture_output=True,
    )
    lines = results.read_text().splitlines()
    found = [json.loads(line) for line in lines if line.endswith("}")]
    assert sorted(row["name"] for row in found) == [f"m{i}" for i in range(8)]
    states = {row["name"]: row["status"] for row in found}
    assert states.pop("m0") == "bad_input"
    assert set(states.values()) == {"converged"}
