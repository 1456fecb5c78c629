"""The public interface: its names, its page, and its refusal of single precision."""

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import suas_jax

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")


def code_blocks(page: str) -> str:
    return "\n".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL))


@pytest.mark.parametrize("package", ["suas_jax", "fitting"])
def test_public_names_are_described(package: str) -> None:
    module = importlib.import_module(package)
    assert f"generated/{package}.md" in PAGE  # which lists what `__all__` has
    assert all(getattr(module, name).__doc__ for name in module.__all__)
    assert set(module.__all__) <= set(dir(module))
    with pytest.raises(AttributeError, match="no attribute 'solv'"):
        module.solv  # noqa: B018


@pytest.mark.parametrize(
    "page",
    [
        "README",
        "docs/design",
        pytest.param("docs/start", marks=pytest.mark.long),
        pytest.param("docs/api", marks=pytest.mark.long),
    ],
)
def test_code_of_the_page_runs(
    page: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def with_effect(*arguments: Any) -> dict[str, float]:
        slopes = gradient(*arguments)
        assert sum(slope != 0.0 for slope in slopes.values()) > 5
        return slopes

    gradient = suas_jax.gradient
    monkeypatch.setattr("suas_jax.gradient", with_effect)
    monkeypatch.chdir(ROOT)
    # The settings of the tests are kept; the caches of a user are left alone.
    monkeypatch.setattr("suas_jax.runtime.settings.configure", lambda: None)
    text = (ROOT / f"{page}.md").read_text(encoding="utf-8")
    blocks = code_blocks(text)
    assert blocks
    exec(compile(blocks, page, "exec"), {"__name__": "page"})
    answers = re.findall(r"```python\n[^`]*```\n\n```text\n([^`]*)```", text)
    if answers:
        assert capsys.readouterr().out == "".join(answers)


UNCONFIGURED = """
import sys
import suas_jax, fitting
assert "jax" not in sys.modules
from suas_jax import load_scene

scene = load_scene("configs/scenes/case_b.toml")
assert "jax" not in sys.modules
from suas_jax import *
from fitting import LoadEstimator, fit_material, fit_sensor

loads = object.__new__(Loads)  # made before float64 was needed
calls = {
    "solve": lambda: solve(scene),
    "sweep": lambda: sweep(scene, forces=[1.0]),
    "gradient": lambda: gradient(None, "oil_pressure_Pa"),
    "skin_of": lambda: skin_of(scene),
    "loads_of": lambda: loads_of(scene),
    "Loads.line": lambda: Loads.line(0.1, 1.0),
    "forward": lambda: forward(None, loads),
    "load_jacobian": lambda: load_jacobian(None, loads),
    "Loads.patch": lambda: Loads.patch(0.1, 0.0, 1.0, 0.01),
    "jit": lambda: jit(forward)(None, loads),
    "LoadEstimator": lambda: LoadEstimator(scene.skin),
    "fit_material": lambda: fit_material([]),
    "fit_sensor": lambda: fit_sensor(None),
}
for name, call in calls.items():
    try:
        call()
    except Float64Error as error:
        assert str(error).splitlines() == [str(error)]
        assert "suas_jax.configure()" in str(error)
    else:
        sys.exit(f"{name} computes in float32")
"""


def test_every_entry_point_refuses_single_precision() -> None:
    done = subprocess.run(
        [sys.executable, "-c", UNCONFIGURED], capture_output=True, text=True, cwd=ROOT
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


BLAS_THREADS = """
import suas_jax
from threadpoolctl import threadpool_info
suas_jax.configure()
print({pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"})
"""


@pytest.mark.skipif(os.cpu_count() == 1, reason="there is one thread in any case")
@pytest.mark.parametrize("wanted", [None, 2])
def test_blas_has_one_thread_unless_told_otherwise(wanted: int | None) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    if wanted is not None:
        environment["OPENBLAS_NUM_THREADS"] = str(wanted)
    program = [sys.executable, "-c", BLAS_THREADS]
    done = subprocess.run(program, capture_output=True, text=True, cwd=ROOT, env=environment)
    assert (done.stdout, done.stderr) == (f"{{{wanted or 1}}}\n", "")


def test_sweep_needs_one_kind_of_levels() -> None:
    scene = suas_jax.load_scene(ROOT / "configs" / "scenes" / "case_b.toml")
    for arguments in ({}, {"forces": [1.0], "oil_pressures": [1.0]}):
        with pytest.raises(TypeError, match="one of forces, oil_pressures and depths"):
            suas_jax.sweep(scene, **arguments)


class Spring(eqx.Module):
    """A pytree with a static part."""

    stiffness: jax.Array
    name: str


def test_jit_compiles_once_and_inside_other_transformations() -> None:
    traces = []

    @suas_jax.jit
    def energy(spring: Spring, x: jax.Array) -> jax.Array:
        traces.append(spring.name)
        return 0.5 * spring.stiffness * x**2

    spring, x = Spring(jnp.array(3.0), "leaf"), jnp.array(2.0)
    assert energy(spring, x) == energy(spring, x) == 6.0
    assert traces == ["leaf"]
    assert jax.grad(energy, 1)(spring, x) == 6.0
    assert suas_jax.jit(jax.grad(energy, 1))(spring, x) == 6.0
    assert jax.jit(lambda x: energy(spring, x))(x) == 6.0
    assert jax.vmap(energy, (None, 0))(spring, jnp.arange(3.0))[2] == 6.0
