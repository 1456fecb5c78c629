"""Formulas of load estimation on a pad against closed forms: tolerances, spline, steps."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from fitting.inverse_load.check.changed_input import ElectricalFit
from fitting.inverse_load.pad import stiffening
from fitting.inverse_load.pad.columns import Column, _reach, largest_forces
from fitting.inverse_load.pad.facts import PadShape
from fitting.inverse_load.pad.fitter import AskewFitter, PadFitter
from fitting.inverse_load.pad.input_errors import InputEffects, PadErrors, Stiffening
from fitting.inverse_load.pad.interpolant import Correction, PadInterpolant, extents
from fitting.inverse_load.pad.marginal import Told, beside
from fitting.inverse_load.pad.pad_least_squares import PRIOR, PadFit, PadLeastSquares, step_of
from fitting.inverse_load.pad.parts import PadNodeSearch, pad_table_of
from fitting.inverse_load.pad.rest import GapLine, gap_line
from fitting.inverse_load.pad.solved import SolvedContacts, near, patch_points
from fitting.inverse_load.pad.spline import SplineBasis, TensorSpline
from fitting.inverse_load.pad.stiffening import effects_of
from fitting.inverse_load.pad.table import LEVELS, PadTable, grid, reciprocal
from fitting.inverse_load.pad.table_build import (
    _between,
    _mended,
    force_surplus,
    mirror_images,
    mirrored,
)
from fitting.inverse_load.pad.uneven import (
    PROBES,
    _by_reach,
    _changed,
    _read,
    _step,
    contacts_alike,
    force_shares,
)
from fitting.steps import finished
from suas_jax.config import InputErrors, SkinSpec, load_skin, scene_from_dict
from suas_jax.config.geometry import SheetSpec
from suas_jax.config.input_errors import scaled_input, value_of
from suas_jax.equilibrium.equilibrium import State
from suas_jax.scene.skin import skin_of
from suas_jax.sensing.capacitance import VACUUM_PERMITTIVITY
from tests.stand_ins import explanations

SKIN = """
[geometry]
inner_radius = "55 mm"
thickness = "5 mm"
half_angle = "60 deg"
width = "100 mm"
oil_gap = "5 mm"
ends = "clamped"
[material]
law = "mooney-rivlin"
C1 = "300 kPa"
C2 = "100 kPa"
C3 = "0 Pa"
[oil]
model = "incompressible"
relative_permittivity = 2.0
[electrodes]
lsb = "0.1 fF"
stray = "20 fF"
layers = [{ thickness = "0.1 mm", relative_permittivity = 4.0 }]
taxels = [
  { angle = "-10 deg", axial = "5 mm", diameter = "4 mm" },
  { angle = "10 deg", axial = "5 mm", diameter = "4 mm" },
  { angle = "0 deg", axial = "-5 mm", diameter = "6 mm" },
]
"""
AREA = np.pi / 4 * np.array([4e-3, 4e-3, 6e-3]) ** 2
GAP, PERMITTIVITY, LAYER, LSB, STRAY = 5e-3, 2.0, 0.1e-3 / 4.0, 0.1e-15, 200.0
# 1 / (SO - stray) = a + b w of parallel plates.
BY_GAP = LSB / (VACUUM_PERMITTIVITY * AREA * PERMITTIVITY)
AT_REST = BY_GAP * GAP + LAYER * LSB / (VACUUM_PERMITTIVITY * AREA)


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> SkinSpec:
    place: Path = tmp_path_factory.mktemp("pad") / "skin.toml"
    place.write_text(SKIN)
    return load_skin(place)


def linear_table(
    *, diameter: float = 8e-3, slope: float = 1.0, stray: float = 0.0, taxels: int = 3
) -> PadTable:
    """A table in which u falls in proportion to the force, by a share that depends on place.

    u = 1e-3 - slope 1e-5 F (1 + angle + 20 axial) (1 + taxel), p = 100 F; the largest force
    is 10 N (1 + axial).
    """
    angle, axial = np.linspace(-0.4, 0.4, 7), np.linspace(-0.04, 0.04, 7)
    cap = 10.0 * np.exp(np.broadcast_to(axial, (7, 7)))
    force = cap[..., None] * LEVELS
    place = 1 + angle[:, None, None] + 20 * axial[:, None]
    share = (place * force)[..., None] * (1 + np.arange(taxels))
    rest = np.full(taxels, stray + 1e3)
    return PadTable(
        angle,
        axial,
        cap,
        np.full((7, 7), np.inf),
        1e-3 - slope * 1e-5 * share,
        100.0 * force,
        0.01 * np.broadcast_to(LEVELS, force.shape),
        rest,
        np.full(taxels, stray),
        1e-6 * np.array([1.0, -2.0])[:, None] * np.ones((*force.shape, 2, taxels + 1)),
        angle,
        axial,
        diameter,
    )


# --- the table of a pad that is not its own mirror image ---


def misfit(table: PadTable, places: np.ndarray, force: np.ndarray, found: Column) -> float:
    """Root mean square of what `force_shares` leaves, over that of the change from rest."""
    share = force_shares(table, places, force, found)
    loads = np.column_stack(
        [np.repeat(places, force.shape[1], 0), (force * (1 + share)).reshape(-1)]
    )
    so = PadInterpolant(table)(loads, 1).readings[:, :-1].reshape(found.so.shape)
    good = np.isfinite(found.so) & found.found[..., None]
    left, change = (np.where(good, found.so - x, 0.0) for x in (so, table.rest))
    return float(np.sqrt(np.sum(left**2) / np.sum(change**2)))


def test_a_lopsided_pad_has_no_table() -> None:
    geometry = {
        "section": "path",
        "path": [{"line": "12 mm"}, {"radius": "30 mm", "angle": "80 deg"}, {"line": "9 mm"}],
        "start": "70 deg",
        "thickness": "1.5 mm",
        "oil_gap": "5 mm",
        "width": "100 mm",
        "ends": "clamped",
    }
    oil = {"model": "incompressible", "relative_permittivity": 2.2}
    electrodes = {"taxels": [{"arc": "0 mm"}]}
    material = {"law": "neo-hookean", "mu": "1 MPa"}
    tables = {"geometry": geometry, "material": material, "oil": oil, "electrodes": electrodes}
    with pytest.raises(ValueError, match="its own mirror image"):
        pad_table_of(scene_from_dict(tables).skin, 6e-3)


def test_a_softer_unit_is_the_even_pad_under_more_force_with_taxels_of_its_own() -> None:
    """U = 2e-3 - 2e-5 k F (1 + angle + 20 axial) (1 + taxel), k = 0.9 of the even pad's."""
    table, softness = linear_table(), 0.9
    rest = np.full(3, 1e-3)
    of_even = GapLine(np.zeros(3), rest, np.ones(3))
    of_unit = GapLine(np.full(3, 5.0), 2 * rest, np.full(3, 2.0))

    def read(loads: Any) -> Any:
        angle, axial, force = loads.T
        place = softness * force * (1 + angle + 20 * axial)
        return 5 + 1 / (2e-3 - 2e-5 * place[:, None] * np.array([1, 2, 3]))

    places = grid(np.array([-0.3, 0.1]), np.array([-0.02, 0.03]))
    force = 8.0 * LEVELS[LEVELS != 0] * np.ones((4, 1))
    loads = np.column_stack([np.repeat(places, force.shape[1], 0), force.reshape(-1)])
    so = of_unit.seen_by(of_even, read(loads).reshape(*force.shape, 3))
    found = Column(so, 0 * force, 0 * force, np.ones(force.shape, bool))
    np.testing.assert_allclose(
        force_shares(table, places, force, found), softness - 1, atol=1e-6
    )
    assert misfit(table, places, force, found) < 1e-6
    own = np.array([0.0, 0.0, softness - 1, 1.0])
    alike = np.tile(own, (*PROBES, len(LEVELS) - 1))
    nodes = np.linspace(-0.4, 0.4, PROBES[0]), np.linspace(-0.04, 0.04, PROBES[1])
    unit = PadInterpolant(
        _changed(table, (of_even, of_unit), TensorSpline.through(nodes, alike))
    )
    seen = unit(loads, 1).readings
    np.testing.assert_allclose(seen[:, :-1], read(loads), rtol=1e-6)
    np.testing.assert_allclose(seen[:, -1], 100 * loads[:, 2], rtol=1e-6)


def test_a_unit_that_reads_another_contact_is_told_which() -> None:
    """Taxels that see places differently: 2 mm and 10 mrad away, 5 % softer, more pressure."""
    even = linear_table()
    force = even.cap[..., None] * LEVELS
    by_angle, by_axial = np.array([1.0, -1.0, 0.5]), np.array([5.0, 10.0, -10.0])
    place = 1 + even.angle[:, None, None] * by_angle + even.axial[:, None] * by_axial
    even = dataclasses.replace(even, u=1e-3 - 1e-5 * force[..., None] * place[:, :, None])
    places = grid(np.array([-0.2, 0.1]), np.array([-0.02, 0.01]))
    force = 8.0 * LEVELS[LEVELS != 0] * np.ones((4, 1))
    own = np.array([0.01, 2e-3, 0.05, 1.1])
    there = places + own[:2]
    seen = 1 + there[:, :1] * by_angle + there[:, 1:] * by_axial
    so = 1 / (1e-3 - 1e-5 * 1.05 * force[..., None] * seen[:, None])
    found = Column(so, 110 * force, 0 * force, np.ones(force.shape, bool))
    radius, step = 0.06, np.array([0.5e-3 / 0.06, 0.5e-3])

    def unlikely(x: np.ndarray, k: int, j: int) -> np.ndarray:
        load = np.append(places[k] + x[:2], force[k, j] * (1 + x[2]))
        left = so[k, j] - PadInterpolant(even)(load[None], 1).readings[0, :-1]
        return np.append(left / (0.01 * np.linalg.norm(so[k, j] - even.rest)), x[:2] / step)

    alike = contacts_alike(even, places, force, found, radius)
    for k, j in ((0, 0), (2, 6)):
        best = least_squares(unlikely, np.zeros(3), x_scale=[*step, 0.1], args=(k, j)).x
        np.testing.assert_allclose(alike[k, j, :3], best, rtol=1e-3)
        by_readings, left = _step(
            found, *_read(PadInterpolant(even), places, force, alike[..., :3])[:2], radius
        )
        there = alike[k, j, :3] + by_readings[k, j]
        np.testing.assert_allclose(there, own[:3], rtol=0.1)  # one step, without the prior
        assert np.abs(left[k, j]).max() < 1e-2 * np.abs(so[k, j] - even.rest).max()
    np.testing.assert_allclose(alike[..., 3], 1.1, rtol=1e-6)


def test_errors_of_a_table_grow_towards_its_edges() -> None:
    """Exponentials of a bilinear form, that of the middles of the parts, on all four sides."""
    rate = np.array([2.0, 3.0])
    at = grid((np.arange(3) + 0.5) / 3, (np.arange(2) + 0.5) / 2)
    error = np.exp(at @ rate).reshape(3, 2)
    table = dataclasses.replace(linear_table(), place_error=1e-4 * error, force_error=error)
    share = np.array([[0.1, -0.2], [-0.7, 0.3], [1.0, 1.0]])
    angle, axial = (share * [table.angle[-1], table.axial[-1]]).T
    place, force = table.errors_at(angle, axial)
    np.testing.assert_allclose(force, np.exp(np.abs(share) @ rate), rtol=1e-12)
    np.testing.assert_allclose(place, 1e-4 * force, rtol=1e-12)
    assert not np.any(linear_table().errors_at(angle, axial))
    off = np.zeros((6, 4, 3, 1))
    off[0, 3] = off[2, 1] = 2.0  # at an edge of both, nearest to the middle
    off[..., 2, :] = 50.0  # at the wall, where one reading says everything
    expected = np.zeros((3, 2))
    expected[2, 1] = expected[0, 0] = 1.0
    np.testing.assert_allclose(_by_reach(off), expected)


# --- errors of the inputs -----------------------------------------------------------------


def test_line_of_the_gap_is_that_of_parallel_plates(spec: SkinSpec) -> None:
    stray, rest, slope = gap_line(spec, {})
    np.testing.assert_allclose(stray, STRAY, rtol=1e-12)
    np.testing.assert_allclose(rest, AT_REST, rtol=1e-12)
    np.testing.assert_allclose(slope, BY_GAP, rtol=1e-9)
    _, rest, slope = gap_line(
        spec, {"geometry.oil_gap": 4e-3, "oil.relative_permittivity": 4.0}
    )
    np.testing.assert_allclose(slope, BY_GAP / 2, rtol=1e-9)
    np.testing.assert_allclose(rest, AT_REST - BY_GAP * (GAP - 4e-3 / 2), rtol=1e-9)


def test_line_of_a_gap_that_is_a_table_is_the_same(spec: SkinSpec) -> None:
    gap = SheetSpec(arc=(0.0, 1.0), axial=(0.0, 1.0), value=((GAP, GAP), (GAP, GAP)))
    geometry = spec.geometry.model_copy(update={"oil_gap": gap})
    found = gap_line(spec.model_copy(update={"geometry": geometry}), {})
    for own, expected in zip(found, gap_line(spec, {}), strict=True):
        np.testing.assert_allclose(own, expected, rtol=1e-9)


def test_a_gap_that_is_a_table_is_compared_with_a_log_as_one_number(spec: SkinSpec) -> None:
    """All values of the table change by one factor; so does a thickness."""
    gap = SheetSpec(arc=(0.0, 1.0), axial=(0.0, 1.0), value=((GAP, GAP), (GAP, GAP)))
    geometry = spec.geometry.model_copy(update={"oil_gap": gap})
    tabled = spec.model_copy(update={"geometry": geometry})
    u = 0.7 * AT_REST
    fit = explanations([[0.1, 0.0, 3.0]], so=np.append(STRAY + 1 / u, 0.0))
    estimator: Any = SimpleNamespace(spec=tabled, rest=None)
    found = ElectricalFit(estimator, fit.so, fit.so, fit).slopes("geometry.oil_gap")
    wider = 1 / (u + 0.01 * BY_GAP * GAP)
    np.testing.assert_allclose(found[0, :-1], (wider - 1 / u) / 0.01, rtol=1e-6)
    assert scaled_input(tabled, "geometry.oil_gap", 1.1) == {
        f"geometry.oil_gap.value.{i}.{k}": pytest.approx(1.1 * GAP)
        for i in range(2)
        for k in range(2)
    }
    for path in ("geometry.thickness", "electrodes.lsb"):
        assert scaled_input(tabled, path, 1.1) == {path: 1.1 * value_of(spec, path)}


ERRORS = {  # path: (deviation, d stray, da, db / b, relative change of stiffness)
    "geometry.oil_gap": (5e-5, 0.0, BY_GAP * 5e-5, 0.0, 0.0),
    "oil.relative_permittivity": (0.1, 0.0, -0.05 * BY_GAP * GAP, -0.05, 0.0),
    "electrodes.lsb": (2e-18, -0.02 * STRAY, 0.02 * AT_REST, 0.02, 0.0),
    "electrodes.stray": (1e-15, 10.0, 0.0 * AREA, 0.0, 0.0),
    "material.C1": (40e3, 0.0, 0.0 * AREA, 0.0, 0.1),
    "material.C2": (-20e3, 0.0, 0.0 * AREA, 0.0, -0.05),
    "geometry.thickness": (5e-4, 0.0, 0.0 * AREA, 0.0, 0.1 * 1.5),
}


def _stiffened(spec: SkinSpec, steps: dict[str, float], *_: object) -> np.ndarray:
    by = [1.5 * step / value_of(spec, path) for path, step in steps.items()]
    return np.broadcast_to(by, (2, 2, 2, len(by)))


def errors_of(
    spec: SkinSpec, *, from_rest: bool = False, by_table: tuple[float, float] = (0.0, 0.0)
) -> PadErrors:
    """Errors of every input of the pad above; those of a dimension stiffen by its power 1.5."""
    paths = tuple(ERRORS)
    sizes = np.diag([x[0] for x in ERRORS.values()])
    errors = InputErrors(paths, sizes, paths, (), spec)
    table: Any = SimpleNamespace(
        rest=STRAY + 1 / AT_REST,
        stray=np.full(3, STRAY),
        diameter=6e-3,
        errors_at=lambda angle, axial: [x + 0 * angle for x in by_table],
        angle=np.array([-1.0, 1.0]),
        axial=np.array([-0.02, 0.02]),
        largest=lambda angle, axial: (np.log(10.0) + 0 * angle[:, None],),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stiffening, "_solved", _stiffened)
        patch.setattr(stiffening, "kept_arrays", lambda name, make: make())
        skin = skin_of(spec, contact=False)
        effects = effects_of(errors, skin, table, slots=1)
    return PadErrors(
        errors.names, effects, table, PadShape.of(skin).radius, from_rest=from_rest
    )


@pytest.fixture(scope="module")
def errors(spec: SkinSpec) -> PadErrors:
    return errors_of(spec)


@pytest.mark.parametrize("path", ERRORS)
def test_error_of_a_pad_s_input_moves_readings_as_plates_and_stiffness_do(
    errors: PadErrors, path: str
) -> None:
    """DSO = dstray - (SO - stray)^2 (da + db / b (u - a)) - n F dSO/dF."""
    _, stray, constant, relative, stiffer = ERRORS[path]
    u, force, by_force, pressure = 0.7 * AT_REST, 3.0, np.array([5.0, 6.0, 7.0, 80.0]), 500.0
    jacobian = np.zeros((1, 3, 4))
    jacobian[0, 2] = by_force
    best = explanations(
        [[0.1, 0.0, force]],
        so=np.append(STRAY + 1 / u, pressure),
        jacobian=jacobian,
        pressure=np.array([pressure]),
    )
    found = errors.slopes(best, 3, 1)[0, list(ERRORS).index(path)]
    expected = stray - (constant + relative * (u - AT_REST)) / u**2
    expected = np.append(expected - stiffer * force * by_force[:3], 0.0)
    expected[3] = stiffer * (pressure - force * by_force[3])
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-9)
    at_rest = np.append(stray - constant / AT_REST**2, 0.0)
    np.testing.assert_allclose(errors.rest[list(ERRORS).index(path)], at_rest, rtol=1e-5)


def test_readings_from_a_baseline_are_moved_by_the_change_alone(
    spec: SkinSpec, errors: PadErrors
) -> None:
    best = explanations([[0.0, 0.0, 0.0]], so=np.append(STRAY + 2 / AT_REST, 0.0))
    best = dataclasses.replace(best, jacobian=np.zeros((1, 3, 4)))
    from_rest = errors_of(spec, from_rest=True)
    assert not from_rest.rest.any()
    absolute = errors.slopes(best, 3, 1)
    np.testing.assert_allclose(from_rest.slopes(best, 3, 1), absolute - errors.rest, rtol=1e-9)


def test_forces_of_all_contacts_stiffen_together(errors: PadErrors) -> None:
    """Of two contacts the forces stand fifth and sixth."""
    jacobian = np.arange(24.0).reshape(1, 6, 4)
    best = explanations(
        [[0.0, 0.1, 0.0, 0.0, 2.0, 3.0]],
        contacts=2,
        so=np.append(STRAY + 1 / AT_REST, 0.0),
        jacobian=jacobian,
    )
    found = errors.slopes(best, 3, 2)[0, list(ERRORS).index("material.C1")]
    np.testing.assert_allclose(
        found, -0.1 * (2.0 * jacobian[0, 4] + 3.0 * jacobian[0, 5]), rtol=1e-5
    )


def test_model_and_mesh_leave_half_a_per_cent_and_a_twentieth_of_a_millimetre(
    errors: PadErrors,
) -> None:
    one = explanations([[0.3, 0.01, 8.0]])
    radius = 60e-3
    expected = np.array([5e-5 / radius, 5e-5, 0.04]) ** 2
    found = errors.unexplained(one, 3)
    assert found is not None
    np.testing.assert_allclose(found[0], np.diag(expected), rtol=1e-12)
    two = explanations([[0.3, 0.1, 0.0, 0.0, 8.0, 2.0]], contacts=2)
    found = errors.unexplained(two, 3)
    assert found is not None
    expected = np.array([5e-5 / radius, 5e-5 / radius, 5e-5, 5e-5, 0.04, 0.01]) ** 2
    np.testing.assert_allclose(np.diag(found[0]), expected, rtol=1e-12)
    # Of a contact 26 mm long, the sum of discs leaves out as much more.
    long = np.array([[[[26e-3, 1e-3], [7e-3, 1e-3]]]])
    found = errors.unexplained(explanations([[0.3, 0.01, 8.0]], beside=long), 3)
    assert found is not None
    place = np.hypot(5e-5, 0.02 * 20e-3)
    expected = np.array([place / radius, place, np.hypot(5e-3, 2 * 20e-3) * 8.0])
    np.testing.assert_allclose(np.sqrt(np.diag(found[0])), expected, rtol=1e-9)


def test_what_a_table_leaves_open_of_an_uneven_pad_widens_its_contacts(spec: SkinSpec) -> None:
    errors = errors_of(spec, by_table=(1e-4, 0.02))
    found = errors.unexplained(explanations([[0.3, 0.01, 8.0]]), 3)
    assert found is not None
    place, force = np.hypot(5e-5, 1e-4), np.hypot(5e-3, 0.02)
    expected = np.array([place / 60e-3, place, 8 * force])
    np.testing.assert_allclose(np.sqrt(np.diag(found[0])), expected, rtol=1e-12)


def test_a_dimension_stiffens_as_less_force_does(
    spec: SkinSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A membrane whose displacement is F / t^3, under which rest moves, too."""
    begun = []

    def contact(
        skin: Any, load: np.ndarray, diameter: float, slots: int, near: Any = None
    ) -> tuple[np.ndarray, float]:
        thickness = float(skin.geometry.thickness[0]) / 5e-3
        begun.append((load[2], near))
        force = load[2] * (1 - 3 * (thickness - 1))
        so = force * (1 + load[0] + load[1]) * np.array([1.0, 2.0, np.nan]) + 7 * thickness
        return np.append(so, 100 * load[2]), load[2]

    monkeypatch.setattr(stiffening, "solved_contact", contact)
    nodes = np.array([0.0, 0.4]), np.array([0.0, 0.01]), np.array([[[1.0, 8.0]] * 2] * 2)
    step = 1e-4  # of the thickness [m]
    skin = skin_of(spec, contact=False)
    found = stiffening._solved(spec, {"geometry.thickness": step}, skin, nodes, 6e-3, 1)
    np.testing.assert_allclose(found, np.full((2, 2, 2, 1), 3 * step / 5e-3), rtol=1e-9)
    own = [*nodes[2].ravel(), 0.0]
    assert begun == [x for f in own for x in ((f, None), (0.98 * f, f), (f, f))]


def test_errors_of_constants_alone_need_no_solved_states(spec: SkinSpec) -> None:
    errors = InputErrors(("material.C1",), np.array([[40e3]]), ("C1",), (), spec)
    table: Any = SimpleNamespace(
        angle=np.array([-1.0, 1.0]),
        axial=np.array([-0.02, 0.02]),
        diameter=6e-3,
        largest=lambda angle, axial: (np.log(10.0) + 0 * angle[:, None],),
    )
    skin = skin_of(spec, contact=False)
    constants = {"material.C1": errors.directions[:, 0]}
    found = stiffening.stiffening_of(errors, constants, skin, table, 1)
    np.testing.assert_allclose(found.at(*np.array([[0.3], [0.01], [4.0]])), 0.1, rtol=1e-6)


def test_stiffening_is_linear_between_places_and_forces() -> None:
    """Of a change a + b |angle| + c |axial| + d F, for forces whose range differs by place."""
    angle, axial = np.array([0.0, 0.6]), np.array([0.0, 0.03])
    force = np.array([[[1.0, 9.0], [1.0, 8.0]], [[0.5, 7.0], [0.5, 6.0]]])

    def change(a: Any, z: Any, f: Any) -> Any:
        return -0.2 + 0.1 * a + 2.0 * z + 0.005 * f

    nodes = np.meshgrid(angle, axial, indexing="ij")
    solved = change(nodes[0][..., None], nodes[1][..., None], force)[..., None]
    errors = Stiffening(
        np.array([0.1, 0.0]), np.array([[0.0], [5.0]]), angle, axial, force, solved
    )
    places = np.array([0.0, -0.6, 0.6, 0.3]), np.array([-0.03, 0.0, 0.03, 0.0])
    loads = np.array([3.0, 0.5, 2.0, 5.0])
    found = errors.at(*places, loads)
    np.testing.assert_allclose(found[:, 0], 0.1)
    expected = 5 * change(np.abs(places[0]), np.abs(places[1]), loads)
    np.testing.assert_allclose(found[:, 1], expected, rtol=1e-12)
    # Beyond the solved states their change is kept.
    beyond = errors.at(np.array([0.9]), np.array([0.0]), np.array([20.0]))[0, 1]
    assert beyond == pytest.approx(5 * change(0.6, 0.0, 7.0))


# --- spline -------------------------------------------------------------------------------


def test_spline_of_cubics_is_exact_inside_and_beyond_its_nodes() -> None:
    nodes = np.array([-1.0, -0.3, 0.1, 0.7, 1.0, 2.0])
    x = np.array([-1.5, -1.0, -0.5, 0.1, 0.5, 1.99, 2.0, 2.5])

    def cubic(x: np.ndarray) -> np.ndarray:
        return 1 - 2 * x + 3 * x**2 - 0.5 * x**3

    spline = TensorSpline.through((nodes,), cubic(nodes)[:, None])
    value, slope = spline(x)
    np.testing.assert_allclose(value[:, 0], cubic(x), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(slope[:, 0, 0], -2 + 6 * x - 1.5 * x**2, rtol=1e-10, atol=1e-10)


def test_basis_sums_to_one_everywhere() -> None:
    basis = SplineBasis(np.linspace(0.0, 1.0, 7) ** 2)
    first, (value, slope) = basis.at(np.linspace(0.0, 1.0, 23))
    np.testing.assert_allclose(value.sum(1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(slope.sum(1), 0.0, atol=1e-10)
    assert first.min() == 0
    assert first.max() == 7 - 4


@pytest.mark.parametrize("share", [-1.5, 0.4, 0.999, 1.001, 3.0])
def test_means_over_intervals_have_no_kinks(share: float) -> None:
    """Slopes are those of the means, of either sign of the variance and across knots."""
    basis = SplineBasis(np.linspace(0.0, 1.0, 9))
    variance = share * basis._least
    values = np.sin(np.arange(9.0))

    def means(x: np.ndarray, variance: float) -> np.ndarray:
        first, rows = basis.over(x, np.full(len(x), variance))
        columns = first[:, None] + np.arange(rows.shape[2])
        return np.asarray((rows * values[columns]).sum(2))

    x, small = np.linspace(0.2, 0.8, 101), 1e-6
    _, by_place, by_variance = means(x, variance)
    across = (means(x + small, variance)[0] - means(x - small, variance)[0]) / (2 * small)
    np.testing.assert_allclose(by_place, across, atol=1e-6)
    step = 1e-5 * basis._least
    along = (means(x, variance + step)[0] - means(x, variance - step)[0]) / (2 * step)
    np.testing.assert_allclose(by_variance, along, atol=1e-3 * np.abs(along).max())
    if share < 1:  # the second derivative's steps at knots would show in slopes by the variance
        assert np.abs(np.diff(by_variance, 2)).max() < 0.1 * np.ptp(by_variance)


def test_spline_in_three_variables_has_a_slope_in_each() -> None:
    axes = np.linspace(-1, 1, 4), np.linspace(0, 2, 5), np.linspace(-2, 1, 6)
    a, b, c = np.meshgrid(*axes, indexing="ij")
    values = np.stack([a**2 * b + c, a * b**3 * c**2], -1)
    x, y, z = np.array([0.3, -0.9]), np.array([1.7, 0.2]), np.array([-1.1, 0.6])
    value, slope = TensorSpline.through(axes, values)(x, y, z)
    np.testing.assert_allclose(value, np.stack([x**2 * y + z, x * y**3 * z**2], 1), rtol=1e-10)
    expected = [
        np.stack([2 * x * y, x**2, np.ones(2)], 1),
        np.stack([y**3 * z**2, 3 * x * y**2 * z**2, 2 * x * y**3 * z], 1),
    ]
    np.testing.assert_allclose(slope, np.stack(expected, 2), rtol=1e-9)


# --- table --------------------------------------------------------------------------------


def test_signatures_are_changes_per_newton_of_a_light_contact() -> None:
    table = linear_table(stray=50.0)
    found = table.signatures.reshape(7, 7, 4)
    place = 1 + table.angle[:, None] + 20 * table.axial
    np.testing.assert_allclose(found[..., 3], 100.0, rtol=1e-12)
    for taxel in range(3):
        # dSO = -du / u^2 with u = 1e-3 at rest
        np.testing.assert_allclose(found[..., taxel], 10.0 * place * (1 + taxel), rtol=1e-9)


def test_nodes_hold_light_states_and_the_table_s_own() -> None:
    table = linear_table(stray=50.0)
    loads, channels = table.nodes
    levels = np.array([0.015, 0.03, 0.06, *LEVELS[LEVELS > 0]])
    assert loads.shape == (7 * 7 * 9, 3)
    np.testing.assert_allclose(loads[:9, :2], np.tile([-0.4, -0.04], (9, 1)))
    np.testing.assert_allclose(loads[9, :2], [-0.4, table.axial[1]])
    np.testing.assert_allclose(loads[-9:, 2], 10 * np.exp(0.04) * levels, rtol=1e-12)
    angle, axial, force = loads.T
    u = 1e-3 - 1e-5 * force * (1 + angle + 20 * axial)
    np.testing.assert_allclose(channels[:, 0], 50.0 + 1 / u, rtol=1e-9)
    np.testing.assert_allclose(channels[:, 3], 100 * force, rtol=1e-9)


def test_thinned_table_keeps_its_outermost_places() -> None:
    table = dataclasses.replace(linear_table(), angle=np.arange(7.0), axial=np.arange(7.0))
    for every, i, j in ((2, [0, 2, 4, 6], [0, 2, 4, 6]), (4, [0, 4, 6], [0, 4, 6])):
        thin = table.thinned(every)
        assert thin.angle.tolist() == i
        assert thin.axial.tolist() == j
        np.testing.assert_array_equal(thin.u, table.u[np.ix_(i, j)])
        np.testing.assert_array_equal(thin.cap, table.cap[np.ix_(i, j)])
        np.testing.assert_array_equal(thin.pressure, table.pressure[np.ix_(i, j)])
        np.testing.assert_array_equal(thin.surplus, table.surplus[np.ix_(i, j)])
        np.testing.assert_array_equal(thin.first_contact, table.first_contact[np.ix_(i, j)])


def test_reciprocals_of_forces_and_back() -> None:
    force = np.array([4.0, np.inf, 0.0, -2.0, np.nan, 1e-10])
    expected = [0.25, 0.0, np.inf, np.inf, np.inf, np.inf]
    np.testing.assert_array_equal(reciprocal(force), expected)
    np.testing.assert_allclose(reciprocal(reciprocal(np.array([4.0, np.inf]))), [4.0, np.inf])


def test_force_of_first_contact_is_interpolated_by_its_reciprocal() -> None:
    """Infinite where the membrane can't reach the wall; bilinear between four places."""
    table = linear_table()
    corner = np.full((7, 7), np.inf)
    corner[1, 2], corner[1, 3], corner[2, 2], corner[2, 3] = 2.0, 4.0, 5.0, 10.0
    table = dataclasses.replace(table, first_contact=corner)
    a, z = table.angle, table.axial
    angle = np.array([a[1], a[1] + 0.25 * (a[2] - a[1]), a[6], a[1]])
    axial = np.array([z[2], z[2] + 0.5 * (z[3] - z[2]), z[6], z[3]])
    found = table.first_contact_at(angle, axial)
    between = 0.75 * (0.5 / 2 + 0.5 / 4) + 0.25 * (0.5 / 5 + 0.5 / 10)
    np.testing.assert_allclose(found, [2.0, 1 / between, 1e9, 4.0], rtol=1e-9)


def test_force_on_the_mesh_grows_by_the_surplus_of_its_level() -> None:
    table = linear_table()
    angle, axial = np.array([0.1, 0.1, 0.1]), np.array([0.0, 0.0, 0.0])
    force = np.array([5.0, 10.0, 30.0])  # the largest is 10 N
    expected = force * (1 + 0.01 * np.array([0.5, 1.0, 1.0]))
    np.testing.assert_allclose(table.force_on_mesh(angle, axial, force), expected, rtol=1e-9)


# --- interpolant --------------------------------------------------------------------------


def test_contacts_add_up_in_reciprocal_readings() -> None:
    table = linear_table(stray=50.0)
    interpolant = PadInterpolant(table)
    x = np.array([[0.1, -0.2, 0.01, -0.02, 3.0, 2.0]])
    found = interpolant(x, 2)
    taxel = 1 + np.arange(3)
    fall = 1e-5 * (3.0 * (1 + 0.1 + 0.2) + 2.0 * (1 - 0.2 - 0.4)) * taxel
    u = 1e-3 - fall
    np.testing.assert_allclose(found.readings[0, :3], 50.0 + 1 / u, rtol=1e-8)
    np.testing.assert_allclose(found.readings[0, 3], 500.0, rtol=1e-8)
    np.testing.assert_allclose(found.change[0, :3], -fall, rtol=1e-7)
    by_u = -1 / u**2
    slopes = -1e-5 * by_u * np.array([[3.0], [2.0], [60.0], [40.0], [1.3], [0.4]]) * taxel
    np.testing.assert_allclose(found.jacobian[0, :, :3], slopes, rtol=1e-7)
    np.testing.assert_allclose(found.jacobian[0, 4:, 3], 100.0, rtol=1e-8)
    np.testing.assert_allclose(found.jacobian[0, :4, 3], 0.0, atol=1e-4)
    change = np.array([1e-5, 2e-5, 3e-5, 7.0])
    moved = interpolant(x, 2, Correction(x[0], change, 1.0))
    np.testing.assert_allclose(moved.readings[0, :3], 50 + 1 / (u + change[:3]), rtol=1e-8)
    np.testing.assert_allclose(moved.readings[0, 3], 507.0, rtol=1e-8)
    np.testing.assert_allclose(moved.change, found.change, rtol=1e-12)


def test_last_slope_goes_on_beyond_the_table_and_a_closed_gap_has_none() -> None:
    interpolant = PadInterpolant(linear_table())
    found = interpolant(np.array([[0.0, 0.0, 20.0]]), 1)  # twice the largest force
    np.testing.assert_allclose(found.readings[0, 0], 1 / (1e-3 - 20e-5), rtol=1e-7)
    closed = interpolant(np.array([[0.0, 0.0, 200.0]]), 1)
    np.testing.assert_allclose(closed.readings[0, :3], 1e6, rtol=1e-9)  # a thousandth of u
    assert not closed.jacobian[0, :, :3].any()
    np.testing.assert_allclose(closed.readings[0, 3], 20e3, rtol=1e-7)


def test_the_forces_of_a_table_follow_a_pull_that_hardens() -> None:
    """As a soft pad's does: a single pull at -0.15 leaves 13 %, one at -0.3 6 %."""
    share = np.linspace(LEVELS[0], 0.06, 40)
    values, exact = (np.arcsinh(6 * x) / 6 for x in (LEVELS, share))
    found = TensorSpline.through((LEVELS,), values[:, None]).values(share)[:, 0]
    np.testing.assert_allclose(found, exact, rtol=0.03)


def test_states_that_are_not_found_lie_on_the_line_of_lighter_ones() -> None:
    level = int(np.flatnonzero(LEVELS == 0)[0])
    line = 5.0 + 3.0 * LEVELS
    for missing in ([0], [-1], [-2, -1], [level - 1], [level + 1], [0, 1]):
        found = np.ones((1, len(LEVELS)), bool)
        found[0, missing] = False
        values = np.where(found, line, np.nan)[..., None]
        mended = _mended(values, np.delete(found, level, 1), level)
        np.testing.assert_allclose(mended[0, :, 0], line)


def quadratic_table() -> PadTable:
    """`linear_table` whose u falls with the squares of both places instead."""
    table = linear_table()
    place = 4 * table.angle[:, None] ** 2 + 900 * table.axial**2
    force = 10.0 * LEVELS  # the largest is 10 N everywhere
    share = (1 + place)[..., None, None] * force[:, None] * (1 + np.arange(3))
    pressure = np.broadcast_to(100.0 * force, table.pressure.shape)
    cap = np.full_like(table.cap, 10.0)
    return dataclasses.replace(table, u=1e-3 - 1e-5 * share, pressure=pressure, cap=cap)


RADIUS = 0.06


@pytest.mark.parametrize(("diameter", "slender"), [(20e-3, 0.3), (9e-3, -0.2), (5e-3, 0.1)])
def test_a_wide_contact_is_the_mean_of_discs_over_its_extent(
    diameter: float, slender: float
) -> None:
    """The mean of a quadratic dent adds half the curvature times the variance."""
    interpolant = PadInterpolant(quadratic_table(), RADIUS)
    angle, axial, force = 0.05, -0.01, 2.0
    x = np.array([[angle, axial, force, diameter, slender, 0.0, 0.0]])
    found = interpolant(x, 1)
    arc, along = diameter * np.exp(slender), diameter * np.exp(-slender)
    variance = np.array([arc**2 - 64e-6, along**2 - 64e-6]) / 16
    place = 4 * (angle**2 + variance[0] / RADIUS**2) + 900 * (axial**2 + variance[1])
    u = 1e-3 - 1e-5 * force * (1 + place) * (1 + np.arange(3))
    np.testing.assert_allclose(found.readings[0, :3], 1 / u, rtol=1e-8)
    assert found.readings[0, 3] == pytest.approx(100 * force, rel=1e-8)


@pytest.mark.parametrize("askew", [[0.2, 0.1, -0.2], [0.5, 0.1, -0.2, 0.6]])
def test_slopes_by_extent_and_tangent_are_those_of_the_readings(askew: list[float]) -> None:
    interpolant = PadInterpolant(quadratic_table(), RADIUS)
    x = np.array([[0.05, -0.01, 3.0, 14e-3, *askew]])
    found = interpolant(x, 1)
    for k, step in enumerate([1e-4, 1e-5, 1e-2, 1e-6, *[1e-3] * len(askew)]):
        by = step * np.eye(x.shape[1])[k]
        high, low = (interpolant(x + side * by, 1).readings[0] for side in (1, -1))
        slope = (high - low) / (2 * step)
        # What tangents add is of single precision: steps are long enough for its rounding.
        np.testing.assert_allclose(found.jacobian[0, k], slope, rtol=1e-4, atol=1e-4)


def test_tangential_forces_add_what_the_table_says() -> None:
    interpolant = PadInterpolant(quadratic_table(), RADIUS)
    x = np.array([[0.05, -0.01, 3.0, 14e-3, 0.2, 0.1, -0.2]])
    # The table's slopes by tangential forces are 1e-6 and -2e-6 everywhere.
    radial = x.copy()
    radial[0, 5:] = 0.0
    more = interpolant(x, 1).change - interpolant(radial, 1).change
    np.testing.assert_allclose(more, 3.0 * (0.1 + 0.4) * 1e-6, rtol=1e-6)


@pytest.mark.parametrize(("turn", "way"), [(0.0, 1.0), (np.pi / 2, -1.0)])
def test_a_contact_that_lies_straight_is_askew_by_nothing(turn: float, way: float) -> None:
    interpolant = PadInterpolant(quadratic_table(), RADIUS)
    askew = np.array([[0.05, -0.01, 3.0, 14e-3, 0.5, 0.1, -0.2, turn]])
    straight = np.array([[0.05, -0.01, 3.0, 14e-3, way * 0.5, 0.1, -0.2]])
    a, b = (interpolant(x, 1) for x in (askew, straight))
    np.testing.assert_allclose(a.readings, b.readings, rtol=1e-8)
    np.testing.assert_allclose(a.jacobian[0, :4], b.jacobian[0, :4], rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(extents(14e-3, 0.5, turn), extents(14e-3, way * 0.5, 0.0))


def test_a_told_direction_is_that_of_the_components() -> None:
    told = Told(diameter=False, direction=True)
    assert told.parameters.names == ("angle", "axial", "force", "direction", "tilt")
    x = np.array([[0.1, 0.02, 5.0, 0.3, -0.4]])
    plane = 5 * np.cos(-0.4)
    inward, along, axially = plane * np.cos(0.3), plane * np.sin(0.3), 5 * np.sin(-0.4)
    rest = np.array([0.0, 0.0, 0.0, 7e-3, 0.1, 0.0, 0.0])
    whole = told.whole(x, rest, 1)
    expected = [0.1, 0.02, inward, 7e-3, 0.1, along / inward, axially / inward]
    np.testing.assert_allclose(whole[0], expected, rtol=1e-12)
    shown, slopes = told.turned(whole, 1)
    np.testing.assert_allclose(shown[0, [0, 1, 2, 5, 6]], x[0], rtol=1e-12)
    for j, k in enumerate((0, 1, 2, 5, 6)):
        step = 1e-6 * np.eye(5)[j]
        by = (told.whole(x + step, rest, 1) - told.whole(x - step, rest, 1)) / 2e-6
        np.testing.assert_allclose(slopes[0, :, k], by[0], rtol=1e-8, atol=1e-9)


def test_what_is_not_told_is_marginalised() -> None:
    """The covariance of what is told is its block of the whole inverse."""
    told, random = Told(diameter=True, direction=False), np.random.default_rng(0)
    root = random.normal(size=(1, 14, 20))
    information = root @ root.transpose(0, 2, 1)
    whole = np.tile([0.1, 0.02, 5.0, 7e-3, 0.1, 0.0, 0.0], (1, 1)).repeat(2, 1)
    values, slopes, left, others, held = told.marginal(whole, root, information, 2)
    rows, _ = told.columns(2)
    np.testing.assert_array_equal(rows, np.arange(8))
    np.testing.assert_array_equal(values, whole[:, :8])
    np.testing.assert_array_equal(held, root[:, :8])
    inverse = np.linalg.inv(information)[0][np.ix_(rows, rows)]
    np.testing.assert_allclose(np.linalg.inv(left[0]), inverse, rtol=1e-7)
    # With what the others do nothing of the whole fit is lost: J^T I^-1 J is the sum of both.
    both = slopes[0].T @ inverse @ slopes[0] + others[0].T @ others[0]
    whole_fit = root[0].T @ np.linalg.inv(information[0]) @ root[0]
    np.testing.assert_allclose(both, whole_fit, atol=1e-7)


def test_extents_and_tangents_that_readings_do_not_show_are_not_told() -> None:
    whole = np.array([[0.1, 0.02, 5.0, 10e-3, 0.2, 0.3, -0.1]])
    known = np.diag(1 / np.array([1e-3, 1e-4, 0.1, 1e-3, 0.05, 0.02, 0.29]) ** 2)
    found = beside(whole, known[None], PRIOR, 1)[0, 0]
    arc = 10e-3 * np.exp(0.2)
    np.testing.assert_allclose(found[0], [arc, arc * np.hypot(0.1, 0.05)], rtol=1e-6)
    force = np.hypot(5.0 * 0.02, 0.3 * 0.1)
    np.testing.assert_allclose(found[2], [1.5, force], rtol=1e-6)
    assert np.isnan(found[3]).all()  # no better than the prior's 0.3
    loose = np.diag(1 / np.array([1e-3, 1e-4, 0.1, 5e-3, 0.5, 0.02, 0.29]) ** 2)
    assert np.isnan(beside(whole, loose[None], PRIOR, 1)[0, 0, :2]).all()


# --- least squares ------------------------------------------------------------------------


def quadratic(parameters: list[float], gradient: list[float], information: Any) -> PadFit:
    none = np.zeros((1, 0))
    return PadFit(
        np.array([parameters]),
        none,
        none,
        np.zeros(1),
        np.array([gradient]),
        np.array([information], float),
    )


def test_step_without_damping_is_gauss_s_and_its_decrease_that_of_the_parabola() -> None:
    information = np.array([[4.0, 1.0], [1.0, 100.0]])
    gradient = [2.0, -3.0]
    fit = quadratic([0.0, 0.0], gradient, information)
    far = np.full((1, 2), 10.0)
    step, decrease = step_of(fit, -far, far, np.zeros(1))
    expected = np.linalg.solve(information, gradient)
    np.testing.assert_allclose(step[0], expected, rtol=1e-8)
    assert decrease[0] == pytest.approx(expected @ gradient, rel=1e-8)
    # Damping of one: the diagonal counts twice.
    step, _ = step_of(fit, -far, far, np.ones(1))
    expected = np.linalg.solve(information + np.diag([4.0, 100.0]), gradient)
    np.testing.assert_allclose(step[0], expected, rtol=1e-8)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_presses_against_a_bound_takes_no_part_in_the_step(side: float) -> None:
    information = np.array([[4.0, 1.0], [1.0, 100.0]])
    low, high = np.array([[-1.0, -1.0]]), np.array([[1.0, 1.0]])
    fit = quadratic([side, 0.0], [2.0 * side, 5.0], information)
    step, decrease = step_of(fit, low, high, np.zeros(1))
    np.testing.assert_allclose(step[0], [0.0, 0.05], rtol=1e-8)
    assert decrease[0] == pytest.approx(0.25, rel=1e-8)
    # Away from the bound it is free.
    fit = quadratic([side, 0.0], [-2.0 * side, 5.0], information)
    step, _ = step_of(fit, low, high, np.zeros(1))
    np.testing.assert_allclose(
        step[0], np.linalg.solve(information, [-2.0 * side, 5.0]), rtol=1e-8
    )


def test_a_parameter_that_nothing_shows_stays() -> None:
    fit = quadratic([0.0, 0.0], [0.0, 3.0], [[0.0, 0.0], [0.0, 9.0]])
    far = np.full((1, 2), 10.0)
    step, decrease = step_of(fit, -far, far, np.zeros(1))
    np.testing.assert_allclose(step[0], [0.0, 1 / 3], rtol=1e-8)
    assert decrease[0] == pytest.approx(1.0, rel=1e-8)


EDGE = (0.35, 0.035)


def test_bounds_of_contacts_on_a_pad() -> None:
    one = PadLeastSquares(PadInterpolant(linear_table()), EDGE)
    x = np.array([[0.1, 0.2, 0.0, 0.02, 3.0, 13.0]])  # the last is large somewhere on the pad
    cap = 10 * np.exp([0.0, 0.02])
    low, high = one.bounds(x, 2, False)
    np.testing.assert_allclose(low[0], [-0.35, -0.35, -0.035, -0.035, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(high[0, :4], [0.35, 0.35, 0.035, 0.035])
    np.testing.assert_allclose(high[0, 4:], 1.2 * cap, rtol=1e-9)
    low, high = one.bounds(x, 2, True)
    np.testing.assert_allclose(low[0, 4:], -0.3 * cap, rtol=1e-9)
    np.testing.assert_array_equal(high[0, 4:], 0.0)
    # Beyond the edge the largest force is that at the edge.
    _, high = one.bounds(np.array([[0.0, 9.0, 13.0]]), 1, False)
    assert high[0, 2] == pytest.approx(12 * np.exp(0.035), rel=1e-9)


def test_bounds_of_extents_and_tangents() -> None:
    one = PadLeastSquares(PadInterpolant(linear_table(), RADIUS), EDGE)
    x = one.completed(np.array([[0.0, 0.0, 1.0]]), 1)
    np.testing.assert_allclose(x[0], [0, 0, 1, 8e-3, 0, 0, 0])
    low, high = one.bounds(x, 1, False)
    tangent = np.tan(np.pi / 3)
    np.testing.assert_allclose(low[0, 3:], [2.4e-3, -1.5, -tangent, -tangent], rtol=1e-12)
    np.testing.assert_allclose(high[0, 3:], [0.12, 1.5, tangent, tangent], rtol=1e-12)


def test_fit_of_exact_readings_finds_the_loads_and_chi2_their_misfit() -> None:
    interpolant = PadInterpolant(linear_table())
    fitter = PadLeastSquares(interpolant, EDGE)
    truth = np.array([[0.1, 0.01, 4.0]])
    y = interpolant(truth, 1).readings
    # Without the pressure, force and place could not be told apart in a table so plain.
    weight = np.array([[1.0, 1.0, 0.0, 1e-2]])
    found = finished(fitter.steps(y, weight, np.array([[0.0, 0.01, 2.0]]), 1, None, False))
    assert found.chi2[0] < 1e-4
    assert found.parameters[0, 2] == pytest.approx(4.0, rel=1e-4)
    assert found.parameters[0, 0] + 20 * found.parameters[0, 1] == pytest.approx(0.3, rel=1e-3)
    off = y + np.array([[3.0, -2.0, 1e6, 10.0]])
    chi2 = fitter.judged(off, weight, truth, 1).chi2
    assert chi2[0] == pytest.approx(9.0 + 4.0 + 1.0, rel=1e-6)


def test_priors_count_as_readings_do() -> None:
    interpolant = PadInterpolant(linear_table(), RADIUS)
    fitter = PadLeastSquares(interpolant, EDGE)
    diameter = 8e-3 * np.exp(0.6)
    x = np.array([[0.1, 0.01, 4.0, diameter, 0.5, -0.3, 0.0]])  # one deviation off, thrice
    weight = np.array([[1.0, 1.0, 1.0, 1e-2]])
    y = interpolant(x, 1).readings
    found = fitter.judged(y, weight, x, 1)
    assert found.chi2[0] == pytest.approx(3.0, rel=1e-9)
    by_diameter = 1 / (0.6 * diameter)
    expected = [0, 0, 0, -by_diameter, -2.0, 1 / 0.3, 0]
    np.testing.assert_allclose(found.gradient[0], expected, rtol=1e-9, atol=1e-9)
    slopes = found.jacobian[0]
    prior = np.diag([0, 0, 0, by_diameter, 2.0, 1 / 0.3, 1 / 0.3]) ** 2
    np.testing.assert_allclose(
        found.information[0], (slopes * weight) @ slopes.T + prior, rtol=1e-10
    )
    free = np.arange(3, 7)
    profiled = fitter.profiled(y, weight, x, 1, None, free)[0]
    assert 0 <= profiled < 3.0


# --- contacts of any shape ----------------------------------------------------------------

_DENT = 6e-3  # standard deviation of a disc's dent
_TAXELS = np.stack(
    [x.reshape(-1) for x in np.meshgrid(*[np.linspace(-18e-3, 18e-3, 7)] * 2, indexing="ij")]
)


def dent(arc: Any, axial: Any) -> Any:
    """Fall of u under a disc of 1 N at places, over all taxels [..., taxel]."""
    away = (arc - _TAXELS[0]) ** 2 + (axial - _TAXELS[1]) ** 2
    return 1e-5 * np.exp(-away / (2 * _DENT**2))


def dent_table() -> PadTable:
    axis = np.linspace(-24e-3, 24e-3, 13)
    shape, taxels = (13, 13), _TAXELS.shape[1]
    force = 20.0 * LEVELS
    fall = dent(axis[:, None, None], axis[:, None])[:, :, None] * force[:, None]
    return PadTable(
        axis / RADIUS,
        axis,
        np.full(shape, 20.0),
        np.full(shape, np.inf),
        1e-3 - fall,
        np.broadcast_to(100.0 * force, (*shape, len(LEVELS))),
        np.zeros((*shape, len(LEVELS))),
        np.full(taxels, 1e3),
        np.zeros(taxels),
        np.zeros((13, 13, len(LEVELS), 2, taxels + 1)),
        axis / RADIUS,
        axis,
        6e-3,
    )


def strip(turn: float, length: float) -> np.ndarray:
    """Readings, and no pressure, of 10 N over a strip around the middle [1, channel]."""
    along = np.linspace(-0.5, 0.5, 201)[:, None] * length
    fall = 10 * dent(along * np.cos(turn), along * np.sin(turn)).mean(0)
    return np.append(1 / (1e-3 - fall), 0.0)[None]


@pytest.mark.parametrize("turn", [0.0, 90.0, 45.0, -30.0])
def test_a_strip_is_one_contact_of_its_length_and_force(
    spec: SkinSpec, turn: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The table is made up: no pad has these dents.
    monkeypatch.setattr(SolvedContacts, "correction_of_wide", lambda *_: None)
    skin = skin_of(spec, elements=(8, 8), contact=False)
    interpolant, told = PadInterpolant(dent_table(), RADIUS), Told(False, False)
    kinds = [
        kind(lambda: skin, PadShape.of(skin), interpolant, told, live=False, most_contacts=1)
        for kind in (PadFitter, AskewFitter)
    ]
    y, length = strip(np.deg2rad(turn), 24e-3), 24e-3
    weight = np.append(np.full(y.shape[1] - 1, 1.0), 0.0)[None]
    start = np.array([[0.05, 2e-3, 4.0]])
    straight, askew = (
        fitter.fit(y, weight, start, State(*[np.zeros(0)] * 3), 1) for fitter in kinds
    )
    found = straight if turn in (0.0, 90.0) else askew
    assert found.chi2[0] < (askew if found is straight else straight).chi2[0] + 0.5
    np.testing.assert_allclose(found.parameters[0, :2] * [RADIUS, 1], 0.0, atol=1e-4)
    assert found.parameters[0, 2] == pytest.approx(10.0, rel=0.01)
    more = length**2 / 12 * np.array([np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))]) ** 2
    extents_ = found.beside[0, 0, :2, 0]
    np.testing.assert_allclose(extents_, 4 * np.sqrt(more + 6e-3**2 / 16), rtol=0.1)
    if turn == 45.0:  # straight boxes leave what noise would not
        assert straight.chi2[0] > 20 * askew.chi2[0]
    assert np.isnan(found.beside[0, 0, 2:]).all()  # of tangents this pad says nothing


@pytest.mark.parametrize("direction", [False, True])
def test_a_stiffness_is_a_share_of_the_force_and_shows_in_nothing(
    spec: SkinSpec, *, direction: bool
) -> None:
    # Extents and tangents are fitted along, under priors: they must not tell the stiffness.
    skin, table = skin_of(spec, elements=(8, 8), contact=False), dent_table()
    own = PadShape.of(skin), PadInterpolant(table, RADIUS), Told(False, direction)
    fitter = PadFitter(lambda: skin, *own, live=False, most_contacts=1)
    y = strip(0.0, 10e-3)
    weight = np.append(np.full(y.shape[1] - 1, 1.0), 0.0)[None]
    start = np.array([[0.05, 2e-3, 4.0]])
    best = fitter.fit(y, weight, start, State(*[np.zeros(0)] * 3), 1)
    none = np.zeros((1, y.shape[1] - 1))
    nodes = np.zeros(1), np.zeros(1), np.full((1, 1, 2), [1.0, 20.0]), np.zeros((1, 1, 2, 0))
    tenth = Stiffening(np.full(1, 0.1), np.zeros((0, 1)).T, *nodes)
    errors = PadErrors(
        ("stiffness",), InputEffects(none, none, none, tenth), table, RADIUS, from_rest=True
    )
    told = errors.of(best, y - best.so, fitter.per_contact)
    # A stiffer pad takes what a tenth of the force does off the readings.
    gain = told.gain[0, :, 0]
    np.testing.assert_allclose(gain[2], -0.1 * best.parameters[0, 2], rtol=1e-8)
    np.testing.assert_allclose(np.delete(gain, 2), 0.0, atol=1e-8)
    np.testing.assert_allclose(told.spread, 1.0, atol=1e-6)


@pytest.mark.parametrize("live", [False, True])
def test_a_live_frame_does_not_wait_for_a_wide_contact_to_be_solved(
    spec: SkinSpec, monkeypatch: pytest.MonkeyPatch, *, live: bool
) -> None:
    solved = []
    monkeypatch.setattr(SolvedContacts, "correction_of_wide", lambda *_: solved.append(1))
    skin = skin_of(spec, elements=(8, 8), contact=False)
    fitter = PadFitter(
        lambda: skin,
        PadShape.of(skin),
        PadInterpolant(dent_table(), RADIUS),
        Told(False, False),
        live=live,
        most_contacts=1,
    )
    y = strip(0.0, 40e-3)
    weight = np.append(np.full(y.shape[1] - 1, 1.0), 0.0)[None]
    fitter.fit(y, weight, np.array([[0.05, 2e-3, 4.0]]), State(*[np.zeros(0)] * 3), 1)
    assert bool(solved) is not live


def test_two_fingers_stand_beside_one_wide_contact(
    spec: SkinSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SolvedContacts, "correction_of_wide", lambda *_: None)  # likewise
    skin = skin_of(spec, elements=(8, 8), contact=False)
    interpolant, told = PadInterpolant(dent_table(), RADIUS), Told(False, False)
    own = lambda: skin, PadShape.of(skin), interpolant, told
    fitter = PadFitter(*own, live=False, most_contacts=2)
    fall = 2 * (dent(0.0, -12e-3) + dent(0.0, 12e-3))
    two = np.append(1 / (1e-3 - fall), 0.0)[None]
    one = interpolant(np.array([[0.0, 0.0, 4.0, 8e-3, 0.0, 0.0, 0.0]]), 1).readings
    y = np.concatenate([two, one])
    weight = np.tile(np.append(np.full(y.shape[1] - 1, 0.25), 0.0), (2, 1))
    state = State(*[np.zeros(0)] * 3)
    wide = fitter.fit(y, weight, np.tile([0.0, 1e-3, 4.0], (2, 1)), state, 1)
    rows, pairs = fitter.pairs_for_wide(y, wide)
    assert rows.tolist() == [0]
    assert pairs.chi2[0] < 0.1 < wide.chi2[0]
    found = pairs.parameters[0, :6]
    np.testing.assert_allclose(np.sort(found[2:4]), [-12e-3, 12e-3], atol=1e-4)
    np.testing.assert_allclose(found[4:], 2.0, rtol=1e-2)
    # A fit nearby begins with what this one found, extents and tangents among it.
    again = fitter.fit(y, weight, wide.parameters[:, :3] + [0.01, 0.0, 0.1], wide.state, 1)
    assert again.chi2[1] == pytest.approx(wide.chi2[1], abs=2e-2)


def test_what_a_wide_contact_leaves_may_be_its_shape_s(spec: SkinSpec) -> None:
    skin = skin_of(spec, elements=(8, 8), contact=False)
    interpolant = PadInterpolant(dent_table(), RADIUS)
    own = lambda: skin, PadShape.of(skin), interpolant, Told(False, False)
    fitter = PadFitter(*own, live=False, most_contacts=1)
    y = strip(0.0, 24e-3)
    relief = interpolant.relief(np.array([[24e-3**2 / 12, 0.0]]))[0][0]
    share = 0.06 * np.log(relief)
    change = np.where(np.arange(y.shape[1]) < y.shape[1] - 1, y - interpolant.rest, 0.0)
    wide = np.array([[[[4 * np.sqrt(24e-3**2 / 12 + 6e-3**2 / 16), 1e-3], [6e-3, 1e-3]]]])
    for off, within in ((0.9, True), (1.1, False)):
        readings = y + off * share * change
        best = explanations([[0.0, 0.0, 10.0]], so=readings, weight=1e9, beside=wide)
        assert fitter.left_to_shape(y, best, np.zeros(1))[0] == within
        # What a further contact would explain is of no shape, however small beside noise.
        more = 1e9 * (off * share) ** 2 * (change**2).sum(1)
        hidden = explanations([[0.0, 0.0, 10.0]], so=y, weight=1e9, beside=wide)
        assert fitter.left_to_shape(y, hidden, more)[0] == within
        none = np.full_like(wide, np.nan)
        unknown = explanations([[0.0, 0.0, 10.0]], so=readings, weight=1e9, beside=none)
        assert not fitter.left_to_shape(y, unknown, np.zeros(1))[0]


# --- solved states ------------------------------------------------------------------------


def test_force_at_which_little_of_the_gap_is_left_is_interpolated() -> None:
    levels = np.array([-0.2, 0.25, 0.5, 0.75, 1.0])

    def reach(gap: list[float], lost: int | None = None) -> tuple[float, float]:
        found = np.ones((1, 5), bool)
        if lost is not None:
            found[0, lost] = False
        none = np.zeros((1, 5))
        return _reach(Column(none, none, np.array([gap]), found), 0, levels, 0.2)

    np.testing.assert_allclose(reach([9.0, 0.7, 0.4, 0.1, -0.2]), [2 / 3, 0.75 + 0.25 / 3])
    # Beyond the last level it is where the last slope leads.
    np.testing.assert_allclose(reach([9.0, 0.7, 0.5, 0.3, 0.1]), [0.875, 1.125])
    assert reach([9.0, 0.9, 0.8, 0.7, 0.6]) == (1.0, np.inf)
    # A path that ends says nothing of what is behind.
    assert reach([9.0, 0.7, 0.4, 0.1, -0.2], 3) == (0.5, np.inf)
    assert reach([9.0, 0.7, 0.4, 0.1, -0.2], 1) == (0.25, np.inf)


class Membrane:
    """Columns of a pad whose gap of 5 mm closes at 10 N (1 + angle), a little stiffening.

    Prestressed, the gap is smaller elsewhere until a third of that force acts.
    """

    def __init__(self, *, prestressed: bool) -> None:
        self.skin = SimpleNamespace(
            geometry=SimpleNamespace(oil_gap=[5e-3], thickness=[1e-3]),
            law=SimpleNamespace(shear_modulus=[1e6]),
            prestressed=prestressed,
        )

    def solve(self, places: Any, force: Any, levels: Any) -> Column:
        """Gaps at all levels of the forces."""
        share = force[:, None] * levels / (10.0 * (1 + places[:, :1]))
        gap = 5e-3 * (1 - np.sign(share) * np.abs(share) ** 0.8)
        if self.skin.prestressed:
            gap = np.minimum(gap, 3e-3 + 1e-4 * share)
        return Column(gap, gap, gap, np.ones(gap.shape, bool))


@pytest.mark.parametrize("prestressed", [False, True])
def test_largest_forces_leave_a_twentieth_of_the_gap(prestressed: bool) -> None:
    columns: Any = Membrane(prestressed=prestressed)
    cap, touch = largest_forces(columns, (np.array([0.0, 0.5]), np.array([0.0])))
    closes = 10.0 * np.array([[1.0], [1.5]])
    np.testing.assert_allclose(touch, closes, rtol=0.03)
    np.testing.assert_allclose(cap, 0.95**1.25 * closes, rtol=0.03)


def test_surplus_of_a_coarse_mesh_is_the_force_that_reads_as_the_finer_one() -> None:
    levels = np.array([-0.15, 0.28, 0.64, 1.0])
    so = 1000 + 300 * levels[None, :, None] * np.array([1.0, 2.0])
    fine = 1000 + 300 * (1.02 * levels)[None, :, None] * np.array([1.0, 2.0])
    none, found = np.zeros((1, 4)), np.ones((1, 4), bool)
    coarse, finer = Column(so, none, none, found), Column(fine, none, none, found)
    np.testing.assert_allclose(force_surplus(coarse, finer, levels), 0.02, rtol=1e-9)
    much = Column(fine + 30 * (fine - 1000), none, none, found)
    np.testing.assert_allclose(force_surplus(coarse, much, levels), 0.05)
    lost = finer._replace(found=np.array([[True, False, True, True]]))
    rising = lost._replace(so=1000 + (so - 1000) * (1 + 0.02 * levels[None, :, None]))
    share = force_surplus(coarse, rising, levels)[0]
    np.testing.assert_allclose(share, 0.02 * levels[[0, 0, 2, 3]], rtol=1e-9)


@pytest.mark.parametrize(("live", "share"), [(True, 1.0), (False, 0.2)])
def test_a_correction_holds_within_millimetres_and_a_share_of_the_force(
    live: bool, share: float
) -> None:
    radius, old = 0.06, np.array([0.1, 0.4, 0.0, 0.01, 5.0, 2.0])
    kept = Correction(old, np.zeros(4), 1.0)

    def holds(k: int, by: float) -> bool:
        return near(kept, old + by * np.eye(6)[k], 2, radius, live=live)

    limits = {0: 2.5e-3 / radius, 3: 2.5e-3}
    limits[4] = share * 0.15 * 5.0 / (1 - share * 0.15)
    limits[5] = -share * 0.15 * 2.0 / (1 + share * 0.15)
    for k, limit in limits.items():
        most = share * limit if k < 4 else limit
        assert holds(k, 0.99 * most)
        assert not holds(k, 1.01 * most)


@pytest.mark.parametrize("slender", [0.2, -0.8])
def test_points_of_a_wide_contact_have_the_second_moments_of_its_ellipse(
    slender: float,
) -> None:
    radius, diameter, turn = 0.06, 40e-3, 0.5
    contact = np.array([0.2, -0.01, 7.0, diameter, slender, 0.1, 0.2, turn])
    places, share = patch_points(contact, radius)
    assert share.sum() == pytest.approx(1)
    metres = (places - contact[:2]) * [radius, 1.0]
    np.testing.assert_allclose(share @ metres, 0, atol=1e-12)
    both = extents(np.array(diameter), np.array(slender), turn)
    np.testing.assert_allclose(share @ metres**2, both**2 / 16, rtol=1e-9)


def test_values_of_a_quarter_are_even_between_its_probes() -> None:
    axes = np.linspace(0, 0.4, 3), np.linspace(0, 0.03, 4)
    a, z = np.meshgrid(*axes, indexing="ij")
    values = (1 + a**2 - 200 * z**2)[..., None]
    places = np.array([[0.1, 0.02], [-0.1, -0.02], [0.3, -0.011]])
    expected = 1 + places[:, 0] ** 2 - 200 * places[:, 1] ** 2
    np.testing.assert_allclose(_between(axes, values, places)[:, 0], expected, rtol=1e-9)


def test_contacts_stay_on_the_pad(spec: SkinSpec) -> None:
    angle, axial = PadShape.of(skin_of(spec, contact=False)).edge(12e-3)
    margin = 6e-3 + 5e-3 / 4
    assert angle == pytest.approx(np.deg2rad(60) - margin / 60e-3, rel=1e-12)
    assert axial == pytest.approx(50e-3 - margin, rel=1e-12)


# --- search and mirror --------------------------------------------------------------------


def test_distance_on_a_pad_is_along_the_outer_face() -> None:
    search = PadNodeSearch(linear_table(), radius=60e-3)
    a, b = np.array([[0.1, 0.02, 5.0]]), np.array([[0.3, 0.05, 1.0]])
    expected = np.hypot(60e-3 * 0.2, 0.03)
    np.testing.assert_allclose(search.distance(a, b), expected, rtol=1e-12)


def test_nearest_node_has_the_nearest_place_and_force() -> None:
    search = PadNodeSearch(linear_table(), radius=60e-3)
    for node in (0, 5, 17, 40, len(search.loads) - 1):
        angle, axial, force = search.loads[node]
        two = np.array([[angle + 0.02, 9.0, axial - 0.001, 9.0, 1.02 * force, 9.0]])
        assert search.nearest_to(two, 2).tolist() == [node]


def test_quarters_are_mirrored_about_their_first_row_and_column() -> None:
    quarter = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    expected = [
        [6.0, 5.0, 4.0, 5.0, 6.0],
        [3.0, 2.0, 1.0, 2.0, 3.0],
        [6.0, 5.0, 4.0, 5.0, 6.0],
    ]
    np.testing.assert_array_equal(mirrored(quarter), expected)


def test_mirror_images_of_taxels_are_told_apart_by_place_and_size(spec: SkinSpec) -> None:
    """Two taxels are each other's image; the third, on the middle plane, is its own."""
    skin, image = mirror_images(skin_of(spec, contact=False))
    taxels = skin.electrodes.taxels
    place = np.stack([np.asarray(taxels.angle)[:, 0], np.asarray(taxels.axial)[:, 0]], 1)
    assert len(place) == 2 + 2 + 1 + 1
    own = np.array([[np.deg2rad(-10), 5e-3], [np.deg2rad(10), 5e-3], [0.0, -5e-3]])
    for k, sign in enumerate(([1, 1], [-1, 1], [1, -1], [-1, -1])):
        np.testing.assert_allclose(place[image[k]], own * sign, atol=1e-9)
    assert image[0, 0] == image[1, 1]
    assert image[0, 2] == image[1, 2] != image[2, 2]
    np.testing.assert_allclose(np.asarray(taxels.diameter)[image[3], 0], [4e-3, 4e-3, 6e-3])
