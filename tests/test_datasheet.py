"""Data sheets: definitions against formulas, figures against references, derivatives."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fitting.datasheet import pad, readings, sheet
from fitting.datasheet.figures import (
    CURRIE,
    Accuracy,
    Cases,
    Figures,
    Measured,
    figures_at,
    told,
    two_point,
    unlike,
)
from fitting.datasheet.in_time import creep
from fitting.datasheet.pad import _readings
from fitting.datasheet.page import described
from fitting.datasheet.readings import Readings
from fitting.datasheet.sheet import DataSheet, Figure, _beyond_contact, _in_time, _worst
from fitting.datasheet.variants import DEEPER, STEP, WARMER, named, variants_of, why_constant
from fitting.datasheet.words import PLACED
from fitting.force_range.bound import rated_force
from fitting.inverse_load.pad.input_errors import InputEffects
from fitting.report.description import Remark
from suas_jax import Loads
from suas_jax.config import continuous_inputs, load_scene, load_skin
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.oils.vented import VentedOilSpec
from suas_jax.sensing.converter import Converter
from suas_jax.skin.plain import plain_geometry

ROOT = Path(__file__).parent.parent
SKIN = ROOT / "configs" / "skins" / "suas.toml"
ACCURACY = Accuracy(2.0, 0.0)


def test_resolution_is_the_bound_of_cramer_and_rao() -> None:
    columns = np.random.default_rng(0).normal(size=(3, 20, 4))
    own = np.asarray(unlike(jnp.asarray(columns)))
    found = 1 / np.sqrt((own**2).sum(1))
    for place in range(4):
        j = columns[:, :, place]
        np.testing.assert_allclose(found[:, place] ** 2, np.diag(np.linalg.inv(j @ j.T)))


def test_sizes_of_tolerances_have_the_units_of_their_inputs() -> None:
    variants = variants_of(load_skin(SKIN))
    names = variants.errors.names
    sizes = dict(zip(names, map(variants.size, range(len(names))), strict=True))
    known = {
        "stiffness of the material": (10.0, "%"),
        "geometry.thickness": (3.0, "%"),
        "geometry.mounting": (0.05, "%"),
        "oil.fill": (0.3, "%"),
        "electrodes.lsb": (1.0, "%"),
    }
    for name, (value, unit) in known.items():
        found = sizes[name]
        assert found is not None
        assert found == (pytest.approx(value, rel=1e-9), unit)


def test_a_figure_says_which_places_have_none() -> None:
    """Where a membrane loses its equilibrium before the wall, its range is not the skin's.

    Where two contacts are never told apart, their discrimination is not the skin's, either.
    """
    measured: Any = SimpleNamespace(
        region=np.array([True, True, True, False]),
        coordinates={"angle_deg": np.array([-30.0, 0.0, 30.0, 80.0])},
        missing={},
    )
    worst = _worst("range_N", np.array([2.0, np.nan, 1.5, np.nan]), measured)
    assert (worst.value, worst.place) == (1.5, 2)
    assert worst.reason.startswith("1 of 3 places are left out, such as 0 deg: there the memb")
    assert not _worst("range_N", np.array([2.0, 3.0, 1.5, np.nan]), measured).reason
    worst = _worst("two_point_m", np.array([2.0, np.nan, 1.5, np.nan]), measured)
    assert (worst.value, worst.place) == (2.0, 0)
    assert "such as 0 deg: there two contacts cannot be told apart" in worst.reason


def test_no_figure_is_of_a_membrane_that_is_in_the_wall() -> None:
    """Under a rated force beyond first contact; that of no contact is not beyond."""
    none: Any = None
    measured = Measured(none, {}, none, np.array([True, True, False]), none, 10.0, none, (3, 1))
    same, beyond = _beyond_contact(measured, np.array([12.0, np.nan, 8.0]))
    assert not same.missing  # the place beyond does not count
    assert beyond.tolist() == [False, False, True]
    moved, beyond = _beyond_contact(measured, np.array([9.0, 12.0, 12.0]))
    assert beyond.tolist() == [True, False, False]
    for key in ("force_resolution_N", "crosstalk", "force_accuracy"):
        assert "reaches the wall before the rated force" in moved.missing[key]
    assert "range_N" not in moved.missing


def stand_in(scale: Any, closed: float = 50.0) -> Cases:
    """Readings of three taxels at two places that follow formulas, changed by a number."""
    at, taxels = np.array([-0.2, 0.5]), np.array([-1.0, 0.1, 0.9])[:, None]
    bell = jnp.exp(-((at - taxels) ** 2))

    def readings(force: Any) -> Readings:
        so = 4000 + 300 * scale * bell * force + 20 * scale**2 * bell**2 * force**2
        by_force = 300 * scale * bell + 40 * scale**2 * bell**2 * force
        by_place = -2 * (at - taxels) * by_force * force
        gap = 5e-3 - 1e-4 * scale * force * jnp.ones(2)
        return Readings(
            so, jnp.stack([by_place, by_force]), gap, -1e-4 * scale * jnp.ones(2), 0, 0
        )

    touch = jnp.full(2, closed)
    return Cases(readings(0.0), readings(5.0), readings(10.0), readings(touch), touch)


def test_figures_are_what_they_say() -> None:
    far = np.array([[False, True], [False, False], [True, False]])
    found = figures_at(stand_in(1.0), ACCURACY, far)
    cases = stand_in(1.0)
    np.testing.assert_allclose(found.first_contact, 50.0)
    np.testing.assert_allclose(figures_at(stand_in(1.25), ACCURACY, far).first_contact, 40.0)
    light = np.linalg.norm(cases.rest.slope[1], axis=0)
    np.testing.assert_allclose(found.sensitivity, light)
    np.testing.assert_allclose(found.detection_limit, CURRIE * np.sqrt(4 + 1 / 12) / light)
    change = np.asarray(cases.rated.so - cases.rest.so)
    np.testing.assert_allclose(
        found.crosstalk, [change[2, 0] / change[:, 0].max(), change[0, 1] / change[:, 1].max()]
    )
    # Of a taxel under the contact it is (20 F^2 / 4) / (300 F + 20 F^2) = 0.1, of others less.
    assert 0.08 < found.nonlinearity.max() < 0.1


def test_resolutions_weigh_readings_by_noise_rounding_and_the_model_s_error() -> None:
    """On a pad, whose places have two coordinates; saturated taxels say nothing."""
    rng = np.random.default_rng(2)
    rest, change = np.full((8, 2), 3000.0), 400 * rng.uniform(0.1, 1, (8, 2))
    slope, none = rng.normal(size=(3, 8, 2)), np.ones(2)
    so = rest + change
    so[0, 1], full = Converter().full_scale, so.copy()
    quiet, rated = (Readings(x, slope, none, -none, 0, 0) for x in (rest, so))
    accuracy = Accuracy(2.0, 0.01)
    cases = Cases(quiet, quiet, rated, rated, none)
    found = figures_at(cases, accuracy, np.ones((8, 2), bool))
    assert accuracy.variance == pytest.approx(4 + 1 / 12)
    variance = 4 + 1 / 12 + (0.01 * (full - rest)) ** 2
    moved = jnp.einsum("c,ctp->tp", jnp.array([1e-3, -2e-3, 0.2]), slope)
    seen = told(cases, accuracy, moved)
    for k, taxels in enumerate((slice(0, 8), slice(1, 8))):
        J, W = slope[:, taxels, k], 1 / variance[taxels, k]
        covariance = np.linalg.inv((J * W) @ J.T)
        deviations = np.sqrt(np.diag(covariance))
        assert found.force_resolution[k] == pytest.approx(deviations[2])
        assert found.place_resolution[k] == pytest.approx(np.hypot(*deviations[:2]))
        np.testing.assert_allclose(seen[:, k], [1e-3, -2e-3, 0.2])


@pytest.mark.parametrize(
    ("taxels", "saturated"), [((0,), False), ((1, 1), False), ((0, 1), False), ((0, 1), True)]
)
def test_what_taxels_do_not_tell_has_no_resolution(
    taxels: tuple[int, ...], saturated: bool
) -> None:
    """One taxel, two at one place, or two at the converter's limit tell no place and force."""
    own = list(taxels)

    def of(readings: Readings) -> Readings:
        so, slope = np.asarray(readings.so)[own], np.asarray(readings.slope)[:, own]
        if saturated:
            so, slope = np.full_like(so, Converter().full_scale), 0 * slope
        return readings._replace(so=so, slope=slope)

    whole = stand_in(1.0)
    cases = whole._replace(
        **{name: of(getattr(whole, name)) for name in ("rest", "half", "rated", "touch")}
    )
    found = figures_at(cases, ACCURACY, np.zeros((len(own), 2), bool))
    seen = told(cases, ACCURACY, jnp.ones((len(own), 2)))
    known = len(set(own)) == 2 and not saturated
    for value in (found.force_resolution, found.place_resolution, *seen):
        assert np.isfinite(value).all() if known else np.isnan(value).all()
    for value in (found.detection_limit, found.nonlinearity):
        assert np.isnan(value).all() if saturated else np.isfinite(value).all()
    assert (np.asarray(found.sensitivity) == 0).all() == saturated
    none = _worst(
        "force_resolution_N",
        np.full(2, np.nan),
        SimpleNamespace(region=np.full(2, True), missing={}),
    )
    assert "do not tell place and force" in none.reason


def test_a_rated_force_is_round_and_of_the_smallest_first_contact() -> None:
    assert rated_force(np.array([np.nan, 52.0, 40.0])) == 10.0
    assert rated_force(np.full(2, np.nan)) == 1.0


def test_nonlinearity_is_how_far_half_a_force_is_from_half_of_the_readings() -> None:
    none = np.ones(1)

    def at(change: float) -> Readings:
        so = 3000 + change * np.array([[1.0], [2.0]])
        return Readings(so, np.ones((2, 2, 1)), none, -none, 0, 0)

    cases = Cases(at(0.0), at(46.0), at(100.0), at(100.0), none)
    found = figures_at(cases, ACCURACY, np.ones((2, 1), bool))
    np.testing.assert_allclose(found.nonlinearity, 0.04)


def test_derivatives_of_the_definitions() -> None:
    far = np.array([[False, True], [False, False], [True, False]])

    def figures(scale: Any) -> Figures:
        return figures_at(stand_in(scale, 50 / 1.1), Accuracy(2.0, 0.01), far)

    _, slope = jax.jvp(figures, (1.1,), (1.0,))
    low, high = (figures(1.1 + side) for side in (-1e-5, 1e-5))
    for name, a, b, own in zip(Figures._fields, low, high, slope, strict=True):
        np.testing.assert_allclose(own, (b - a) / 2e-5, rtol=1e-5, atol=1e-9, err_msg=name)


def test_a_reason_that_is_a_sentence_ends_with_one_stop() -> None:
    sheet: Any = SimpleNamespace(
        figures=(Figure("bandwidth_Hz", 1.0, reason="Not counted."),),
        variants=SimpleNamespace(changes=()),
        order=[],
        remarks=[],
    )
    (remark,) = (part for part in described(sheet, meanings=False) if isinstance(part, Remark))
    assert remark.text == "Bandwidth: Not counted."


def test_crosstalk_of_a_far_taxel_that_changes_most_has_a_slope() -> None:
    """It is over the near ones; where every taxel is far, over all."""
    far = np.array([[False, True], [True, True], [False, True]])

    def crosstalk(scale: Any) -> Any:
        return figures_at(stand_in(scale), ACCURACY, far).crosstalk

    change = np.asarray(stand_in(1.0).rated.so - stand_in(1.0).rest.so)
    found, slope = jax.jvp(crosstalk, (1.0,), (1.0,))
    np.testing.assert_allclose(found, [change[1, 0] / change[2::-2, 0].max(), 1.0])
    assert found[0] > 1
    assert abs(slope[0]) > 1e-3


def test_a_change_that_looks_like_a_load_is_told_as_one() -> None:
    cases = stand_in(1.0)
    change = jnp.einsum("c,ctp->tp", jnp.array([1e-3, 0.2]), cases.rated.slope)
    np.testing.assert_allclose(told(cases, ACCURACY, change), [[1e-3] * 2, [0.2] * 2])


def test_two_points_are_told_apart_at_their_bound() -> None:
    arc = np.linspace(-0.08, 0.08, 41)
    taxels = np.linspace(-0.09, 0.09, 12)

    def light(x: Any) -> Any:
        return 40 * np.exp(-(((x - taxels) / 0.02) ** 2))

    def by_place(x: Any) -> Any:
        return -2 * (x - taxels) / 0.02**2 * light(x)

    force, variance = 2.0, 4.0
    found = two_point(arc, np.array([light(x) for x in arc]).T, force, variance)[20]
    sides = [-found / 2, found / 2]
    j = np.array([y for x in sides for y in (force * by_place(x), light(x))]) / np.sqrt(
        variance
    )
    c = np.linalg.inv(j @ j.T)
    distance = np.sqrt(c[0, 0] + c[2, 2] - 2 * c[0, 2])
    assert found / distance == pytest.approx(CURRIE, rel=0.05)  # its table's steps
    readings = np.array([light(x) for x in arc]).T
    between = two_point(arc, readings, force, variance, arc[::20] + 1e-9)
    assert between[1] == pytest.approx(found, rel=1e-4)  # whatever lies beside it
    # Two places and two forces need four taxels, whatever symmetry tells of the distance.
    three = np.exp(-(((arc - np.array([[-0.03], [0.0], [0.03]])) / 0.02) ** 2))
    assert np.isnan(two_point(arc, 40 * three, force, variance)).all()


def test_a_coefficient_of_nothing_has_its_reason() -> None:
    spec = load_skin(SKIN)
    vented = spec.model_copy(update={"oil": VentedOilSpec(relative_permittivity=2.2)})
    assert why_constant(spec, WARMER).startswith("the skin file states no expansion")
    assert why_constant(spec, DEEPER).startswith("oil, rubber and wall")
    assert why_constant(vented, DEEPER).startswith("vented oil comes and goes, rubber and wall")
    yielding = spec.wall.model_copy(update={"bulk_modulus": 3e9})
    assert not why_constant(spec.model_copy(update={"wall": yielding}), DEEPER)


def test_creep_undoes_relaxation() -> None:
    series = RelaxationSpec(g=(0.15, 0.1), tau=(0.5, 10.0))
    t = np.linspace(0, 40, 4001)
    compliance = (1 + np.array([creep(series, x) for x in t])) / (1 + creep(series, 0.0))
    fading = [g * (1 - np.exp(-t / tau)) for g, tau in zip(series.g, series.tau, strict=True)]
    modulus = 1 - np.sum(fading, 0)
    # integral of G(t - s) dJ(s), with the step of J at zero
    middle = (modulus[1:] + modulus[:-1]) / 2
    held = modulus[-1] + np.sum(middle[::-1] * np.diff(compliance))
    assert held == pytest.approx(1, abs=1e-5)
    late = (1 + creep(series, 1e5)) / (1 + creep(series, 0.0))
    assert late == pytest.approx(1 / 0.75)


def test_figures_in_time_say_what_they_leave_out(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = load_scene(SKIN.parent.parent / "scenes" / "hold.toml")
    monkeypatch.setattr(sheet, "motion_figures", lambda spec: ({}, "why"))
    monkeypatch.setattr(sheet, "buckling_mismatch", lambda spec: (0.0, ""))
    for stressed in (False, True):
        creeps = _in_time(spec, stressed=stressed)[:2]
        assert all(("stress at rest" in figure.reason) == stressed for figure in creeps)


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_sheet_without_noise_says_so(noise: float) -> None:
    spec = load_skin(SKIN)
    own = SimpleNamespace(
        spec=spec,
        variants=variants_of(spec),
        figures=[Figure("buckling_mismatch", 1.0)],
        measured=SimpleNamespace(accuracy=Accuracy(noise, 0.0)),
    )
    said = DataSheet.remarks.fget(own)  # type: ignore[attr-defined]
    assert any("electrodes.noise" in text for text in said) == (noise == 0)


def test_neighbours_move_one_tolerance_each_and_nothing_at_rest() -> None:
    spec = load_skin(SKIN)
    variants = variants_of(spec)
    own = continuous_inputs(named(spec))
    for path, values in variants.inputs.items():
        assert values[0] == own[path]
    thickness = variants.inputs["geometry.thickness"]
    row = variants.changes.index("geometry.thickness")
    np.testing.assert_allclose(variants.slopes(thickness)[row], 0.03 * 1.5e-3)
    assert np.count_nonzero(thickness != thickness[0]) == 2
    assert (thickness.max() / 1.5e-3 - 1) == pytest.approx(0.03 * STEP)


def test_pads_readings_move_with_their_tolerances() -> None:
    rng = np.random.default_rng(1)
    so, jacobian = 4000 + rng.normal(size=(5, 7)), rng.normal(size=(5, 3, 7))
    moved, rest = rng.normal(size=(5, 2, 7)), rng.normal(size=(2, 7))

    def interpolant(*_: Any) -> Any:
        return SimpleNamespace(readings=so, jacobian=jacobian)

    errors: Any = SimpleNamespace(under=lambda *_: moved, rest=rest)
    at, force = rng.normal(size=(5, 2)), np.full(5, 3.0)
    rate = np.linspace(0.04, 0.06, 5)  # of the outer face, where a section is no circle
    found = _readings(interpolant, errors, at, force, rate)  # type: ignore[arg-type]
    light = found._replace(so=0.9 * found.so)
    half = found._replace(so=0.95 * found.so)
    cases = Cases(light, half, found, found._replace(gap_slope=-1 + found.gap), force[None])
    figures = figures_at(cases, ACCURACY, np.ones((6, 5), bool))
    assert {np.shape(x) for x in figures} == {(5, 5)}  # itself and two tolerances, places
    by_tolerance = (found.so[:, 2::2] - found.so[:, 1::2]) / (2 * STEP)
    wanted = np.transpose(moved[..., :-1], (2, 1, 0))
    np.testing.assert_allclose(by_tolerance, wanted, rtol=1e-6)
    np.testing.assert_allclose(found.slope[0, :, 0], jacobian[:, 0, :-1].T / rate)
    np.testing.assert_allclose(found.slope[1, :, 0], jacobian[:, 1, :-1].T)


def test_slopes_by_place_are_those_by_the_outer_face(monkeypatch: pytest.MonkeyPatch) -> None:
    geometry = plain_geometry(load_skin(SKIN.with_stem("suas-flat-topped")).geometry)

    def stand_in(_: Any, loads: Any, __: Any) -> Any:
        so = jnp.sin(40 * geometry.outer_arc(loads.angle)) * loads.force
        rest = {"min_gap": loads.force, "oil_pressure": loads.force, "result": 0, "state": 0}
        return SimpleNamespace(so=so, **rest)

    monkeypatch.setattr(readings, "forward", stand_in)
    angle = np.array([-1.4, -0.9, -0.2, 0.5, 1.1])  # of flat and of round parts
    skin, loads = SimpleNamespace(geometry=geometry), Loads.line(angle, np.full(5, 2.0))
    found = readings.read(skin, loads)[0]  # type: ignore[arg-type]
    arc = np.asarray(geometry.outer_arc(angle))
    np.testing.assert_allclose(found.slope[0, 0], 80 * np.cos(40 * arc), rtol=1e-6)


def test_a_pads_sheet_tells_places_as_its_scenes_do(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = load_skin(SKIN.with_stem("suas-flat-topped"))
    geometry = spec.geometry.model_copy(update={"ends": "clamped"})
    variants = variants_of(spec.model_copy(update={"geometry": geometry}))
    section, taxels = plain_geometry(geometry), len(spec.electrodes.taxels)  # type: ignore[union-attr]
    table = SimpleNamespace(
        angle=np.array([0.0, 1.3]),
        axial=np.array([0.0, 0.05]),
        first_contact_at=lambda angle, axial: 5.0 + 0 * angle,
        rest=np.full(taxels, 4e3),
        reading_error=0.0,
    )

    class Interpolant:
        """Readings that grow with the arc length of the outer face, and with the force."""

        def __init__(self, _: Any) -> None:
            pass

        def largest(self, angle: Any, axial: Any) -> Any:
            """Largest force that is known."""
            return 10.0 + 0 * angle + 0 * axial

        def __call__(self, loads: Any, _: int) -> Any:
            """Readings and their derivatives by angle, axial place and force."""
            ones = np.ones((len(loads), taxels + 1))
            rate = np.gradient(section.outer_arc(angles)[:, 0], angles[:, 0])
            by_angle = np.interp(loads[:, 0], angles[:, 0], rate)[:, None] * ones
            return SimpleNamespace(
                readings=4e3 + ones,
                jacobian=np.stack([by_angle, ones, ones * (3 + loads[:, 2:])], 1),
            )

    angles = np.linspace(-1.4, 1.4, 20001)[:, None]
    none = SimpleNamespace(
        under=lambda angle, *_: np.zeros((len(angle), 0, taxels + 1)),
        rest=np.zeros((0, taxels + 1)),
    )
    monkeypatch.setattr(pad, "pad_table_of", lambda *_, **__: table)
    monkeypatch.setattr(pad, "PadInterpolant", Interpolant)
    monkeypatch.setattr(pad, "_errors", lambda *_: none)
    found = pad.measure_pad(variants, (9, 4), 2.0, 1.0, lambda text: None)
    at = np.repeat(np.linspace(-1.3, 1.3, 9), 4)[:, None]
    np.testing.assert_allclose(found.arc, np.asarray(section.outer_arc(at))[:, 0], rtol=1e-6)
    arc = np.asarray(section.section.arc(at))[:, 0]
    np.testing.assert_allclose(found.coordinates["arc_m"], arc, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.cases.half.slope[0], 1.0, rtol=1e-3)
    np.testing.assert_array_equal(found.cases.rest.slope[-1], 3.0)  # without any force
    assert found.light is not None  # of places between those and beyond, in all rows of them
    assert found.light[0][[0, -1]] == pytest.approx(found.arc[[0, -1]])
    np.testing.assert_array_equal(found.light[1], np.full((taxels, 4, 128), 3.0))


def test_a_pads_zero_drifts_with_warmth_and_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oil that swells lifts the membrane off every taxel, whatever presses."""
    plain, rates = load_skin(SKIN.with_stem("suas-pad")), {WARMER: -1.2, DEEPER: 0.03}
    grows = plain.oil.model_copy(update={"expansion": 1e-3})
    yields = plain.wall.model_copy(update={"bulk_modulus": 3e9})
    variants = variants_of(plain.model_copy(update={"oil": grows, "wall": yields}))
    count = len(variants.changes)
    stiffening: Any = SimpleNamespace(at=lambda angle, *_: np.zeros((*angle.shape, count)))
    effects = InputEffects(*np.zeros((3, count, 2)), stiffening)
    table: Any = SimpleNamespace(rest=np.full(2, 500.0), stray=np.zeros(2))

    def solved(moved: dict[str, float], load: Any, *_: Any) -> tuple[np.ndarray, None]:
        assert not load.any()
        ((path, value),) = moved.items()
        return np.array([500.0, 480.0, 0.0]) + rates[path] * value, None

    monkeypatch.setattr(pad, "effects_of", lambda *_, **__: effects)
    monkeypatch.setattr(pad, "skin_of", lambda spec, moved, **_: moved)
    monkeypatch.setattr(pad, "solved_contact", solved)
    monkeypatch.setattr(pad.PadShape, "of", lambda _: SimpleNamespace(radius=0.06))
    errors = pad._errors(variants, SimpleNamespace(elements=None), table)  # type: ignore[arg-type]
    none = np.zeros((1, 1)), np.zeros((1, 1)), np.ones((1, 1)), np.zeros((1, 1, 3))
    pressed = errors.under(*none, np.full((1, 2), 700.0), np.zeros(1))[0]
    for moved in (errors.rest, pressed):
        np.testing.assert_allclose(moved[:-2], 0.0)
        np.testing.assert_allclose(moved[-2:, :2], np.repeat([[-1.2], [0.03]], 2, 1))


@pytest.mark.long  # programs of lanes with prestress, of a solve and of small motions
def test_sheet_of_the_papers_skin() -> None:
    from fitting.datasheet.sheet import data_sheet

    spec = load_skin(SKIN)
    sheet, finer = data_sheet(spec, (17, 4)), data_sheet(spec, (33, 4))
    # Two contacts that are closer to one another than two places are told apart at as much.
    np.testing.assert_allclose(sheet.two_point, finer.two_point[::2], rtol=0.05)
    contact = sheet.at["range_N"][0]
    assert contact[8] == pytest.approx(82.8, rel=5e-3)  # the crown, an independent continuum
    row = {name: sheet.effects[i] for i, name in enumerate(sheet.variants.changes)}
    # Forces scale with the stiffness, and places don't feel it.
    np.testing.assert_allclose(row["stiffness of the material"], [-0.1, 0, 0.1], atol=1e-5)
    own = {figure.key: figure for figure in sheet.figures}
    # Hoop buckling of a clamped half-circle that keeps its area, in the third mode.
    closed = 2 / 3 * (1.5 / 58.25) ** 2
    assert own["buckling_mismatch"].value == pytest.approx(closed, rel=0.02)
    assert "density" in own["bandwidth_Hz"].reason
    assert own["range_N"].deviation > 0.1 * own["range_N"].value


@pytest.mark.long  # second derivatives of the forward model
def test_derivatives_of_every_figure() -> None:
    from fitting.design.section import SectionProblem
    from fitting.design.want import Limit, Variable, Want

    variables = (
        Variable("geometry.thickness", ("geometry.thickness",), 1e-3, 2e-3, False),
        Variable("geometry.oil_gap", ("geometry.oil_gap",), 4e-3, 6e-3, False),
        Variable("stiffness", ("material.C1", "material.C2"), 0.5, 1.5, True),
    )
    limits = tuple(Limit(key, 1.0, True) for key in PLACED)
    region = (np.deg2rad(-42.0), np.deg2rad(55.0))
    want = Want(
        SKIN, load_skin(SKIN), variables, "range_N", True, limits, region, 4, 10.0, 1, 0
    )
    problem = SectionProblem(want, elements=8)
    x, step = np.array([0.45, 0.55, 0.5]), 1e-4
    touch = problem.first_contacts(x)
    # One step of Newton's method from the same forces, whatever the design.
    problem.first_contacts = lambda x: touch  # type: ignore[method-assign]
    found = problem(x)
    assert found.found
    assert set(found.values) == set(PLACED)
    for i in range(3):
        low, high = (problem(x + side * np.eye(3)[i]).values for side in (-step, step))
        for key, slopes in found.slopes.items():
            by_steps = (high[key] - low[key]) / (2 * step)
            atol = 1e-5 * np.abs(found.values[key]).max()
            np.testing.assert_allclose(slopes[:, i], by_steps, 1e-5, atol, err_msg=key)


@pytest.mark.long  # second derivatives of the forward model of many skins
def test_bounds_that_units_keep_and_their_derivatives() -> None:
    from fitting.datasheet.sheet import data_sheet
    from fitting.design.section import SectionProblem
    from fitting.design.want import Variable, Want

    variables = (Variable("geometry.oil_gap", ("geometry.oil_gap",), 4e-3, 6e-3, False),)
    region = (np.deg2rad(-30.0), np.deg2rad(45.0))
    spec = load_skin(SKIN)
    want = Want(SKIN, spec, variables, "range_N", True, (), region, 3, 10.0, 1, 0, units=0.95)
    problem, x, step = SectionProblem(want), np.array([0.5]), 1e-3
    found, low, high = (problem(x + side) for side in (0.0, -step, step))
    by_steps = (high.values["range_N"] - low.values["range_N"]) / (2 * step)
    # First contact is found to 1e-6 of it, which a step of 1e-3 makes 1e-3 of the slope's.
    np.testing.assert_allclose(found.slopes["range_N"][:, 0], by_steps, rtol=1e-3)
    # As the data sheet's interval of the same skin has it, to 1.96 deviations instead of 1.645.
    sheet = data_sheet(problem.spec(x), (3 + 1, 4), force=10.0, between=problem.ends)
    values, deviation = sheet.at["range_N"]
    for place in (0, -1):
        bound = values[place] * np.exp(-1.6449 * deviation[place] / values[place])
        assert found.values["range_N"][place] == pytest.approx(bound, rel=2e-3)
