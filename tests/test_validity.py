"""No state is called an equilibrium that no membrane can be in."""

import json
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import converged, line, problem_of, quick, scene
from typer.testing import CliRunner

from fitting.cli.app import app
from suas_jax.equilibrium.balance import Problem, State
from suas_jax.equilibrium.outcomes import NAMES, advice, index_of
from suas_jax.equilibrium.validity import force_balance, validity

SKIN = pathlib.Path(__file__).parent.parent / "configs" / "skins" / "suas.toml"


@quick
def judged(problem: Problem, state: State, stretch: jax.Array, energy: jax.Array) -> jax.Array:
    return validity(problem, state, force_balance(problem, state), stretch, energy)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return problem_of(scene(line(20.0, 10.0)), 16)


@pytest.fixture(scope="module")
def state(problem: Problem) -> State:
    return converged(problem).state


def name_of(problem: Problem, state: State, stretch: float = 1.0, energy: float = 1.0) -> str:
    stretches, energies = jnp.full(1, stretch), jnp.full(1, energy)
    return NAMES[int(judged(problem, state, stretches, energies)[0])]


def test_an_equilibrium_balances_to_a_thousandth_of_what_is_allowed(
    problem: Problem, state: State
) -> None:
    error, scale = quick(force_balance)(problem, state)
    assert float(error[0]) < 1e-12 * float(scale[0])
    assert name_of(problem, state) == "converged"


@pytest.mark.parametrize(
    ("stretch", "energy", "name"),
    [
        (1.0, np.nan, "outside_material_domain"),
        (1.0, np.inf, "outside_material_domain"),
        (-0.045, np.nan, "outside_material_domain"),
        (-0.045, 1.0, "inverted"),
        (0.0, 1.0, "inverted"),
        (np.nan, 1.0, "inverted"),
    ],
)
def test_energies_and_stretches_that_are_none(
    problem: Problem, state: State, stretch: float, energy: float, name: str
) -> None:
    assert name_of(problem, state, stretch, energy) == name


def test_forces_out_of_balance_are_named(problem: Problem, state: State) -> None:
    """Above and below what rounding explains, by another factor on the loads."""
    for change, name in ((1e-10, "converged"), (1e-6, "unbalanced"), (np.nan, "unbalanced")):
        off = state._replace(factor=state.factor + change)
        assert name_of(problem, off) == name


def test_a_volume_that_is_not_kept_is_named(problem: Problem, state: State) -> None:
    """The film's own volume decides: a micrometre of displacement is far too much."""
    grown = 1 + 1e-4 / np.max(np.abs(np.asarray(state.q)))
    found = name_of(problem, state._replace(q=state.q * grown))
    assert found in ("volume_not_kept", "unbalanced")


def test_every_name_has_its_advice() -> None:
    for name in NAMES[1:]:
        assert len(advice(name)) > 60
        assert NAMES[index_of(name)] == name


def test_the_locking_pole_is_never_jumped(tmp_path: pathlib.Path) -> None:
    """Newton's method once ended here at a stretch of -0.045 without an energy."""
    file = tmp_path / "gent.toml"
    file.write_text(
        f'skin = "{SKIN}"\n'
        '[material]\nlaw = "gent"\nmu = "1 MPa"\nJm = 0.9\n[oil]\nmodel = "vented"\n'
        '[[load]]\nkind = "line"\nangle = "-51 deg"\nforce = "-40000 N"\n'
        '[solve]\nmodel = "shell"\nelements = 48\n[wall]\ncontact = false\n'
    )
    done = CliRunner().invoke(app, ["solve", str(file), "--json"])
    report = json.loads(done.stdout)
    assert done.exit_code == 3
    assert report["status"] in NAMES[1:]
    assert report["strain_energy_J"] is not None  # the domain was not left
    assert report["message"].startswith(advice(report["status"]))
