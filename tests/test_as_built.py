"""A simulated unit found from ten presses: derivatives, its skin file, forces on it.

Long: shapes with the derivatives of 20 constants, and the estimates of a skin of tables, are
programs of their own; `test_as_built_formulas.py` holds the formulas.
"""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.as_built import ELEMENTS, PLACE_ERROR, SKIN, Unit, summary
from fitting.calibration.next_press import _solver, candidates_of, planned
from fitting.calibration.plan import Press
from fitting.sensor.model.as_built import as_built, as_built_names, is_gain, press_errors
from fitting.sensor.model.constants import SensorFamily, named, starting_values
from fitting.sensor.shapes import scene_states
from suas_jax import configure
from suas_jax.config import continuous_inputs, input_errors, load_skin
from suas_jax.config.input_errors import as_assembled
from tests.test_pad_estimation import ORDERED, small_pad

pytestmark = pytest.mark.long

PRESSES = tuple(Press(np.deg2rad(-67.5 + 15 * k), (5.0, 10.0)[k % 2]) for k in range(10))


def test_readings_by_all_constants_and_errors_of_presses_against_differences() -> None:
    """Beyond the mesh, which follows a press that is solved anew and no derivative."""
    configure()
    spec = as_built(load_skin(SKIN))
    parts = tuple(named(spec, name) for name in as_built_names(spec))
    family = SensorFamily((*parts, *press_errors(spec, len(PRESSES), 5e-4)))
    solver = _solver(spec, PRESSES, family, lambda text: None)
    at = starting_values(family.parts, [solver.stated(name) for name in family.names])
    so = eqx.filter_jit(lambda model, c: model.so(c))
    slope = eqx.filter_jit(lambda model, c: jax.jacfwd(model.so)(c))
    exact = np.asarray(slope(solver.at(at).model, jnp.asarray(at)))
    steps = {"stiffness": 1e-3, "fill": 1e-5, "mounting": 1e-6, "push.3": 1e-4}
    steps |= {f"geometry.{key}.value.1": 1e-6 for key in ("thickness", "oil_gap")}
    steps |= {"electrodes.taxels.3.gain": 1e-3, "place.0": 1e-4, "place.3": 1e-4}
    for name, step in steps.items():
        i = family.names.index(name)
        two = []
        for sign in (1, -1):
            moved = at + sign * step * (np.arange(len(at)) == i)
            two.append(np.asarray(so(solver.at(moved).model, jnp.asarray(moved))))
        found = (two[0] - two[1]) / (2 * step)
        off = np.abs(found - exact[..., i]).max() / np.abs(found).max()
        assert off < (0.02 if name.startswith("place") else 1e-3), name


def test_ten_presses_find_a_unit(tmp_path: Path) -> None:
    configure()
    spec = load_skin(SKIN)
    unit = Unit(SKIN, 0, PRESSES, 20)
    own = unit.calibrated(unit.presses("planned", 10), tmp_path)
    # One joint uncertainty, and nothing assumed beside it.
    errors = input_errors(as_assembled(own))
    assert not errors.assumed
    assert "geometry.thickness.value.4" in errors.paths
    assert own.calibration is not None
    assert not any(name.startswith(("place", "push")) for name in own.calibration.parameters)
    force, *_ = summary([unit.found(own)[1]])
    drawn, *_ = summary([unit.found(spec)[1]])
    assert force < min(3.0, drawn / 2)


def test_ten_planned_presses_find_a_unit_of_a_pad(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Derivatives against differences, a plan, and the calibrated file of a small pad."""
    configure()
    monkeypatch.setattr(scene_states, "PAD_ELEMENTS", (10, 10))
    monkeypatch.setitem(ELEMENTS, 3, (12, 12))
    file = tmp_path / "pad.toml"
    # Half a circle, on which all sections count angles alike.
    file.write_text(small_pad(ORDERED).replace("60 deg", "90 deg"))
    drawing = load_skin(file)
    spec = as_built(drawing)
    presses = (Press(0.3, 6.0, 0.01), Press(-0.4, 4.0, -0.02))
    names = [name for name in as_built_names(spec) if not is_gain(name)]
    parts = *(named(spec, name) for name in names), *press_errors(spec, 2, PLACE_ERROR)
    family = SensorFamily(parts)
    solver = _solver(spec, presses, family, lambda text: None)
    at = starting_values(parts, [solver.stated(name) for name in family.names])
    model = solver.at(at).model
    exact = np.asarray(jax.jit(jax.jacfwd(model.so))(jnp.asarray(at)))
    steps = {"stiffness": 1e-3, "mounting": 1e-6, "geometry.thickness.value.1.2": 1e-6}
    for name, step in {**steps, "place.0": 1e-4, "axial.1": 5e-6, "push.1": 1e-4}.items():
        i = family.names.index(name)
        moved = at[:, None] + step * np.array([1, -1]) * (np.arange(len(at)) == i)[:, None]
        high, low = (np.asarray(solver.at(x).model.so(jnp.asarray(x))) for x in moved.T)
        found = (high - low) / (2 * step)
        off = np.abs(found - exact[..., i]).max() / np.abs(found).max()
        # All that is left is the differences' own error, which falls as their step squared.
        assert off < 1e-5, (name, off)
    plan = planned(candidates_of(drawing, 6.0, PLACE_ERROR), 10)
    assert plan.accuracy[-1] < plan.accuracy[0] / 2
    unit = Unit(file, 0, plan.presses, 1, 1, 6.0)
    own = unit.calibrated(unit.presses("planned", 10), tmp_path)
    record = own.calibration
    assert record is not None
    assert not any(map(is_gain, record.parameters))
    mu = continuous_inputs(own)["material.mu"]
    true = float(unit.skin.law.shear_modulus[0])
    k = record.parameters.index("stiffness")
    error = float(np.sqrt(record.covariance[k][k]))
    assert error < 0.05
    assert abs(mu / true - 1) < 4 * error
