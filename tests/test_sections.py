"""The section of every kind: one contract, the circle as a limit, tables, derivatives."""

import dataclasses
import functools
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline
from skins import WIDTH, half_cylinder, line, quick, shaped

from suas_jax.config import ConfigError, SceneSpec, continuous_inputs, structure
from suas_jax.figures.curve import plot_sweep
from suas_jax.figures.pad import _draw_load, plot_pad
from suas_jax.mechanics.contact.face import ContactState
from suas_jax.mesh.section import measures
from suas_jax.scene.contact_zone import contact_zone
from suas_jax.scene.curve import contact_of
from suas_jax.scene.parts import scene_parts
from suas_jax.skin.charted import ChartedSection
from suas_jax.skin.geometry import SkinGeometry
from suas_jax.skin.loads import PadLoad
from suas_jax.skin.registry import CURVES, build_geometry
from suas_jax.skin.section import AbstractSection, outward

THICKNESS: dict[str, Any] = {
    "arc": [0, 0.3, 0.6, 1],
    "value": ["1.5 mm", "1.1 mm", "1.7 mm", "1.4 mm"],
}
GAP: dict[str, Any] = {"arc": [0, 0.4, 1], "value": ["5 mm", "4 mm", "4.5 mm"]}
WAVE = [(-62, 0), (-57, 25), (-36, 44), (-4, 52), (29, 45), (53, 24), (60, 1)]


def points(places: Any) -> list[list[str]]:
    """Points of a spline, given in millimetres, as in a file."""
    return [[f"{x:.12g} mm", f"{y:.12g} mm"] for x, y in places]


def arc(radius: float, angle: float) -> dict[str, str]:
    return {"radius": f"{radius} mm", "angle": f"{angle} deg"}


# One section of each kind, as general as it can be: nothing is its own mirror image.
EXAMPLES: dict[str, dict[str, Any]] = {
    "circle": {"inner_radius": "57.5 mm", "half_angle": "80 deg"},
    "ellipse": {
        "section": "ellipse",
        "inner_semi_axes": ["57.5 mm", "40 mm"],
        "half_angle": "85 deg",
    },
    "path": {
        "section": "path",
        "path": [
            *({"line": "15 mm"}, arc(35, 110), arc(60, -20)),
            *(arc(30, 60), arc(50, 20), {"line": "10 mm"}),
        ],
        "start": "85 deg",
    },
    "spline": {"section": "spline", "points": points(WAVE)},
}
TABLES = {"thickness": THICKNESS, "oil_gap": GAP}
CASES = {
    **EXAMPLES,
    **{f"{name} with tables": example | TABLES for name, example in EXAMPLES.items()},
}


def of_kind(name: str) -> SceneSpec:
    """A scene of one of the cases."""
    return shaped(CASES[name], line_at("5 mm"))


def line_at(arc: str, force: float = 1.0) -> dict[str, Any]:
    return {"kind": "line", "arc": arc, "force": f"{force} N"}


def value_of(spec: SceneSpec, inputs: Mapping[str, Any]) -> Any:
    """The number of a key of [geometry] by lane."""
    numbers = {**dict(structure(spec)), **inputs}
    lanes = len(next(iter(inputs.values())))

    def value(key: str) -> jax.Array:
        return jnp.broadcast_to(jnp.asarray(numbers[f"geometry.{key}"], float), (lanes,))

    return value


def inputs_of(spec: SceneSpec) -> dict[str, float]:
    """Numbers of the section and of what lies along it, by path."""
    numbers = continuous_inputs(spec)
    return {path: x for path, x in numbers.items() if path.startswith("geometry.")}


@quick
def geometries(
    spec: SceneSpec, inputs: dict[str, Any], along: dict[str, Any]
) -> tuple[SkinGeometry, SkinGeometry]:
    """Dimensions of several lanes, and their derivatives along changes of the inputs."""

    def build(inputs: dict[str, Any]) -> SkinGeometry:
        return build_geometry(spec.geometry, value_of(spec, inputs))

    return jax.jvp(build, (inputs,), (along,))


class NoCurve(eqx.Module):
    """Stands for the curve that a section was made from: programs don't differ by it."""


def shared(geometry: SkinGeometry) -> SkinGeometry:
    """The same dimensions in a form that all kinds of section have."""
    if isinstance(geometry.section, ChartedSection):
        none: Any = NoCurve()
        section = dataclasses.replace(geometry.section, curve=none, mirrored=False)
        geometry = dataclasses.replace(geometry, section=section)
    return geometry


SIMILAR = 3


@functools.cache
def lanes_of(name: str) -> tuple[SkinGeometry, SkinGeometry, list[str], np.ndarray]:
    """A case in many lanes.

    The first few are similar sections. Then follow, for each input, that of the file and two
    with a little more and less of the input.

    Returns:
        The dimensions, their changes with a little more of an input, the inputs, and how
        much that is.
    """
    spec = of_kind(name)
    numbers = inputs_of(spec)
    paths = list(numbers)
    base = np.array(list(numbers.values()))
    little = 1e-4 * np.abs(base) + 1e-7
    similar = base[:, None] * (1 + 0.02 * np.random.default_rng(0).uniform(-1, 1, SIMILAR))
    around = base[:, None, None] + np.einsum("i,ij,k->ijk", little, np.eye(len(base)), SIGNS)
    change = np.einsum("i,ij,k->ijk", little, np.eye(len(base)), [1.0, 0.0, 0.0])
    rows = [np.concatenate([similar, around.reshape(len(base), -1)], 1)]
    rows += [np.concatenate([0 * similar, change.reshape(len(base), -1)], 1)]
    values, along = (np.pad(x, ((0, 0), (0, LANES - x.shape[1])), "edge") for x in rows)
    found = geometries(spec, *(dict(zip(paths, x, strict=True)) for x in (values, along)))
    return (*found, paths, little)


SIGNS = [0.0, 1.0, -1.0]
LANES = SIMILAR + 3 * 25  # of the spline, which has most inputs


def slope(function: Any, angle: jax.Array) -> jax.Array:
    """Derivative by the angle."""
    return jax.jvp(function, (angle,), (jnp.ones_like(angle),))[1]


def size(vector: jax.Array) -> jax.Array:
    return jnp.sqrt(jnp.sum(vector**2, 0))


def inner_normal(section: AbstractSection, angle: jax.Array) -> jax.Array:
    """Unit normal of the inner face, from its positions."""
    along = slope(section.inner_face, angle)
    return jnp.stack([-along[1], along[0]]) / size(along)


def walked(line: Any, start: jax.Array, end: jax.Array) -> jax.Array:
    """Length of a line between angles, by chords, extrapolated."""

    def chords(count: int) -> jax.Array:
        share = jnp.linspace(0.0, 1.0, count + 1)[:, None, None]
        places = line(start + share * (end - start))
        return jnp.sum(size(jnp.diff(places, axis=1)), 0)

    return (4 * chords(128) - chords(64)) / 3


@quick
def enclosed_at(geometry: SkinGeometry, axial: jax.Array) -> jax.Array:
    """See `enclosed`, at a place along the axis."""
    return enclosed(geometry, axial)


def enclosed(geometry: SkinGeometry, axial: jax.Array | None = None) -> jax.Array:
    """Area between the inner face and its normals' ends on the wall, by polygons."""

    def polygon(count: int) -> jax.Array:
        angle = jnp.linspace(-1.0, 1.0, count + 1)[:, None] * geometry.half_angle
        face = geometry.section.inner_face(angle)
        wall = face - geometry.gap(angle, axial) * inner_normal(geometry.section, angle)
        x, y = jnp.concatenate([face, wall[:, ::-1]], 1)
        return jnp.sum(jnp.roll(x, -1, 0) * y - x * jnp.roll(y, -1, 0), 0) / 2

    return (4 * polygon(2000) - polygon(1000)) / 3


@quick
def errors(geometry: SkinGeometry) -> dict[str, jax.Array]:
    """What the contract says is zero: lengths in metres, else without a unit."""
    section, half = geometry.section, geometry.section.half_angle
    a = jnp.linspace(-0.96, 0.96, 29)[:, None] * half
    frame, inner = section.frame(a), inner_normal(section, a)
    parallel = jnp.stack([inner[1], -inner[0]])
    found = {
        "tangent": slope(section.mid_line, a) / section.size - frame.tangent,
        "normal": frame.normal - jnp.stack([-frame.tangent[1], frame.tangent[0]]),
        "direction": frame.normal - outward(section.direction(a)),
        "curvature": frame.curvature * section.size - slope(section.direction, a),
        "curvature alone": (section.curvature(a) - frame.curvature) * section.size,
        "thickness": section.thickness(a) - frame.thickness,
        "inner normal": section.inner_normal(a) - inner,
        "inner face": section.mid_line(a) - section.inner_face(a) - frame.thickness / 2 * inner,
        "arc": slope(section.arc, a) - size(slope(section.inner_face, a)),
        "middle": section.arc(half) + section.arc(-half),
        "fraction": section.fraction(jnp.stack([-half, half])) - jnp.array([[0.0], [1.0]]),
        "from arc": section.from_arc(section.arc(a)) - a,
        "film": geometry.film_area / enclosed(geometry) - 1,
    }
    for height in (-4e-3, 3e-3):
        place = section.inner_face(a) + height * inner

        def foot(place: jax.Array) -> tuple[jax.Array, jax.Array]:
            return section.foot(place, a + 0.02)

        def rise(place: jax.Array) -> jax.Array:
            return jax.jvp(foot, (place,), (parallel,))[1][1]

        angle, over = foot(place)
        height_there, normal, curvature = section.height_frame(place, a + 0.02)
        bend = jnp.sum(parallel * slope(lambda x: inner_normal(section, x), a), 0)
        bend = bend / slope(section.arc, a)
        second = jax.jvp(rise, (place,), (parallel,))[1]
        found |= {
            f"foot {height}": angle - a,
            f"height {height}": over - height,
            f"along the normal {height}": jax.jvp(foot, (place,), (inner,))[1][1] - 1,
            f"along the face {height}": rise(place),
            f"height at once {height}": height_there - height,
            f"normal {height}": normal - inner,
            f"its bend at once {height}": (curvature - bend / (1 + bend * height))
            * section.size,
            f"below {height}": 1.0 - section.may_lie_below(place, a + 0.02, -1e-9 - height),
            f"above {height}": 1.0 * section.may_lie_below(place, a, 1e-9 - height),
            f"its bend {height}": (second - bend / (1 + bend * height)) * section.size,
        }
    for height, length in ((-5.75e-3, 9e-3), (0.75e-3, -9e-3)):

        def beside(angle: jax.Array, height: float = height) -> jax.Array:
            return section.mid_line(angle) + height * outward(section.direction(angle))

        inside = a[4:-4]
        end = section.moved(inside, jnp.full_like(inside, length), jnp.asarray(height))
        found[f"moved {height}"] = walked(beside, inside, end) - abs(length)
    return found


def lane(tree: Any, lanes: slice) -> Any:
    """Some lanes of everything."""
    return jax.tree.map(lambda x: x[..., lanes], tree)


@pytest.mark.parametrize("name", CASES)
def test_contract(name: str) -> None:
    geometry = shared(lanes_of(name)[0])
    for what, found in errors(lane(geometry, slice(SIMILAR))).items():
        # A curvature is the second derivative of what is tabulated.
        allowed = 1e-6 if what.startswith("its bend") else 1e-9
        if what == "film" and geometry.gap_along is not None:
            allowed = 1e-6  # a quadrature; a spline's curvature has corners at its points
        np.testing.assert_allclose(found, 0, atol=allowed, err_msg=what)


@pytest.mark.parametrize("name", [x for x in CASES if of_kind(x).geometry.has_angle])
def test_the_angle_of_a_place_leads_back_to_it(name: str) -> None:
    @quick
    def errors(section: AbstractSection) -> jax.Array:
        a = jnp.linspace(-1.0, 1.0, 9)[:, None] * section.half_angle
        return section.from_given_angle(section.given_angle(a)) - a

    np.testing.assert_allclose(errors(lanes_of(name)[0].section), 0, atol=1e-12)


@pytest.mark.parametrize("name", ["circle", "path"])
@pytest.mark.parametrize("timed", [False, True])
def test_a_curve_names_its_loads_by_what_places_are_told_by(name: str, timed: bool) -> None:
    load = {"kind": "line", "angle_deg": 11.4671, "arc_m": 0.015, "force_N": 5.0}
    report = {"status": "converged", "oil_pressure_Pa": 1e3, "min_gap_angle_deg": 3.0}
    report |= {"loads": [load | {"displacement_m": 1e-3}], "wall": None, "min_gap_arc_m": 4e-3}
    scene = of_kind(name).model_copy(update={"loads": (SimpleNamespace(kind="line"),)})
    found = SimpleNamespace(
        points=[report | ({"t_s": 0.0} if timed else {})], scene=scene, first_contact=None
    )
    legend = plot_sweep(found).axes[0].get_legend()
    assert legend is not None
    told = "load at 11.47°" if name == "circle" else "load at 15 mm"
    assert [text.get_text() for text in legend.get_texts()] == [told]
    assert contact_of(report)["arc_m"] == 4e-3


def test_every_kind_has_an_example() -> None:
    assert EXAMPLES.keys() == CURVES.keys()


def described(geometry: SkinGeometry) -> jax.Array:
    """What the model asks a section, at a few places [number, lane]; lengths in metres."""
    section, half = geometry.section, geometry.section.half_angle
    a = jnp.array([-0.813, -0.107, 0.331, 0.677])[:, None] * half
    place = jnp.array([[3e-3], [45e-3]]) + 0 * half
    angle, height = section.foot(place, 0 * half)
    lanes = half.shape
    rows = [
        *(section.size, half, geometry.film_area, angle, height),
        *(section.mid_line(a), section.inner_face(a), section.inner_normal(a)),
        *(x + 0 * a for x in (section.thickness(a), geometry.gap(a))),
        *(section.arc(a), section.fraction(a), geometry.outer_arc(a)),
        *(section.from_arc(jnp.array([[11e-3]])), geometry.along_wall(a, jnp.asarray(4e-3))),
        *(geometry.outer_size, geometry.wall_size, geometry.thickness, geometry.oil_gap),
        section.curvature(a) * section.size + 0 * a,
    ]
    flat = [jnp.broadcast_to(x, (*x.shape[:-1], *lanes)).reshape(-1, *lanes) for x in rows]
    return jnp.concatenate(flat)


@quick
def answers(geometry: SkinGeometry, along: SkinGeometry) -> tuple[jax.Array, jax.Array]:
    """Those of all lanes, and their derivatives along a change of the dimensions."""
    found: tuple[jax.Array, jax.Array] = eqx.filter_jvp(described, (geometry,), (along,))
    return found


@pytest.mark.parametrize("name", [f"{kind} with tables" for kind in EXAMPLES])
def test_derivatives_are_those_of_differences_in_other_lanes(name: str) -> None:
    geometry, along, paths, _ = lanes_of(name)
    value, change = (np.asarray(x) for x in answers(shared(geometry), shared(along)))
    value, change = (x[:, SIMILAR : SIMILAR + 3 * len(paths)] for x in (value, change))
    exact, central = change[:, ::3], (value[:, 1::3] - value[:, 2::3]) / 2
    scale = np.maximum(np.max(np.abs(exact), 1, keepdims=True), 1e-15)
    used = [path for path, any_ in zip(paths, np.any(exact, 0), strict=True) if any_]
    assert set(paths) - set(used) == {"geometry.width"}
    assert np.all(np.ptp(value[:, ::3], 1) == 0), "lanes that read others"
    np.testing.assert_allclose(central / scale, exact / scale, rtol=0, atol=1e-6)


SHEET: dict[str, Any] = {
    "arc": [0, 0.3, 0.6, 1],
    "axial": [0, 0.4, 1],
    "value": [[f"{1.2 + 0.1 * ((3 * i + k * k) % 5)} mm" for k in range(3)] for i in range(4)],
}


def test_no_place_has_no_frame() -> None:
    """A pad of uneven thickness at rest has no load whose place could be looked up."""
    spec = of_kind("ellipse")
    inputs = {path: np.array([x]) for path, x in inputs_of(spec).items()}

    def thickness(inputs: dict[str, Any]) -> jax.Array:
        section = build_geometry(spec.geometry, value_of(spec, inputs)).section
        return section.frame(jnp.zeros((0, 1))).thickness

    assert jax.eval_shape(thickness, inputs).shape == (0, 1)


def test_tables_along_the_axis_are_products_of_splines() -> None:
    gap = SHEET | {"value": [[x.replace("1.", "4.") for x in row] for row in SHEET["value"]]}
    tables = {"thickness": SHEET, "oil_gap": gap, "ends": "clamped"}
    spec = shaped(EXAMPLES["ellipse"] | tables)
    inputs = {path: np.array([x]) for path, x in inputs_of(spec).items()}
    geometry = quick(lambda inputs: build_geometry(spec.geometry, value_of(spec, inputs)))(
        inputs
    )
    section, x = geometry.section, np.linspace(-0.5, 0.5, 41)
    angle = jnp.linspace(-0.9, 0.9, 7)[:, None] * section.half_angle
    share = np.asarray(section.fraction(angle))[:, 0]
    for key, found in (
        (
            "thickness",
            lambda z: section.thickness(angle) + geometry.thickness_beyond_mean(angle, z),
        ),
        ("oil_gap", lambda z: geometry.gap(angle, z)),
    ):
        values = np.array(getattr(spec.geometry, key).value)
        by_arc = CubicSpline(SHEET["arc"], values)(share)
        wanted = CubicSpline(SHEET["axial"], by_arc, axis=1)(x + 0.5)
        got = np.stack([found(jnp.asarray([z * WIDTH]))[:, 0] for z in x], 1)
        np.testing.assert_allclose(got, wanted, rtol=1e-12)
    mean = CubicSpline(SHEET["axial"], by_arc, axis=1).integrate(0, 1)
    np.testing.assert_allclose(geometry.gap(angle)[:, 0], mean, rtol=1e-12)
    # The film's cross-sections at the middles of many slices.
    count = 64
    cuts = (np.arange(count) + 0.5) / count - 0.5
    areas = [enclosed_at(geometry, jnp.asarray([z * WIDTH])) for z in cuts]
    np.testing.assert_allclose(geometry.film_area, np.mean(areas, 0), rtol=1e-4)
    assert not geometry.symmetric
    assert not spec.geometry.mirrored_along_axis


@pytest.mark.parametrize(
    ("change", "key", "text"),
    [
        ({"arc": [0, 0.5, 1]}, "geometry.thickness", "3 places (arc) and 4 rows of values"),
        ({"axial": [0, 1]}, "geometry.thickness", "2 places (axial) and 3 values in row 0"),
        ({"axial": [0, 0.4, 0.9]}, "geometry.thickness", "axial must rise from 0 to 1"),
        ({"axial": ["-9 mm", 0.5, 1]}, "geometry.thickness.axial.0", "fractions of the way"),
        ({"axial": [-9, 0.5, 1]}, "geometry.thickness.axial.0", "from 0 to 1"),
        ({"ends": "sliding"}, "geometry.thickness.axial", "three dimensions"),
        ({"kind": "body"}, "load.0.kind", "the same along the axis"),
    ],
)
def test_what_tables_along_the_axis_can_t_be(
    change: dict[str, Any], key: str, text: str
) -> None:
    table = {name: change.get(name, value) for name, value in SHEET.items()}
    geometry = {"thickness": table, "ends": change.get("ends", "clamped")}
    load = {"kind": "patch", "arc": "5 mm", "force": "1 N", "diameter": "8 mm"}
    if "kind" in change:
        load = {
            "kind": "body",
            "shape": "sphere",
            "radius": "9 mm",
            "arc": "0 mm",
            "depth": "1 mm",
        }
    with pytest.raises(ConfigError) as caught:
        shaped(EXAMPLES["ellipse"] | geometry, load)
    assert key in str(caught.value)
    assert text in str(caught.value)


def test_a_film_that_is_closed_somewhere_along_the_axis_is_refused_with_the_place() -> None:
    thin = {"arc": [0, 1], "axial": [0, 0.1, 0.9, 1], "value": [["5 mm", "0.1 mm"] * 2] * 2}
    geometry = EXAMPLES["ellipse"] | {"oil_gap": thin, "ends": "clamped"}
    place = r"geometry.oil_gap.* would be -.* at arc = 0.* of the table.*axial = "
    with pytest.raises(ConfigError, match=place):
        measures(shaped(geometry))


# The circle as a limit of the other kinds.


def arcs_of(count: int) -> Any:
    turn = np.linspace(-np.pi / 2, np.pi / 2, count)
    return 57.5 * np.stack([np.sin(turn), np.cos(turn)], 1)


EVEN: dict[str, Any] = {"arc": [0, 0.2, 1], "value": ["1.5 mm"] * 3}
LIMITS: dict[str, dict[str, Any]] = {
    "ellipse": {
        "section": "ellipse",
        "inner_semi_axes": ["57.5 mm", "57.5 mm"],
        "half_angle": "90 deg",
    },
    "path": {"section": "path", "path": [arc(57.5, 180)]},
    "spline": {"section": "spline", "points": points(arcs_of(200))},
    "circle with a table": {
        "inner_radius": "57.5 mm",
        "half_angle": "90 deg",
        "thickness": EVEN,
        "oil_gap": EVEN | {"value": ["4 mm"] * 3},
    },
}


all_of = quick(described)


@pytest.mark.parametrize("name", LIMITS)
def test_it_is_the_circle(name: str) -> None:
    spec = shaped({"oil_gap": "4 mm"} | LIMITS[name])
    inputs = {path: jnp.full(1, x) for path, x in inputs_of(spec).items()}
    geometry, _ = geometries(spec, inputs, {path: 0 * x for path, x in inputs.items()})
    found, want = (all_of(x) for x in (shared(geometry), half_cylinder(oil_gap=4e-3)))
    allowed = np.full((len(want), 1), 1e-6 if name == "spline" else 1e-12)
    allowed[-4:] *= 20  # curvatures, second derivatives
    assert np.all(np.abs(found - want) <= allowed * np.maximum(np.abs(want), 57.5e-3))


# Tables.


def test_a_table_is_the_smooth_curve_through_its_values() -> None:
    @quick
    def along(section: AbstractSection) -> tuple[jax.Array, ...]:
        angle = section.half_angle * jnp.linspace(-0.98, 0.98, 40)[:, None]
        fraction, rate = jax.jvp(section.fraction, (angle,), (jnp.ones_like(angle),))
        return fraction, section.thickness(angle), slope(section.thickness, angle) / rate

    geometry = lane(lanes_of("ellipse with tables")[0], slice(SIMILAR, SIMILAR + 1))
    fraction, thickness, by_fraction = along(geometry.section)
    values = [1.5e-3, 1.1e-3, 1.7e-3, 1.4e-3]
    want = CubicSpline(THICKNESS["arc"], values)
    np.testing.assert_allclose(thickness, want(fraction), rtol=1e-9)
    np.testing.assert_allclose(by_fraction, want(fraction, 1), rtol=0, atol=1e-8)


HUMP: dict[str, Any] = {
    "arc": [0, 0.25, 0.5, 0.75, 1],
    "value": [f"{x} mm" for x in (1.5, 1.2, 1, 1.2, 1.5)],
}
LEANING = HUMP | {"value": [*HUMP["value"][:-1], "1.4 mm"]}
MIRRORED_PATH = {
    "section": "path",
    "path": [{"line": "20 mm"}, arc(30, 90), {"line": "27.5 mm"}],
    "mirror": True,
}


@pytest.mark.parametrize(
    ("geometry", "symmetric"),
    [
        (EXAMPLES["ellipse"], True),
        (EXAMPLES["ellipse"] | {"thickness": HUMP}, True),
        (EXAMPLES["ellipse"] | {"thickness": LEANING}, False),
        (EXAMPLES["circle"] | {"thickness": LEANING}, False),
        (EXAMPLES["circle"] | {"oil_gap": LEANING}, False),
        (EXAMPLES["circle"] | {"oil_gap": HUMP}, True),
        (MIRRORED_PATH, True),
        (EXAMPLES["path"], False),
        (EXAMPLES["spline"], False),
        ({"section": "spline", "points": points(arcs_of(9))}, True),
    ],
)
def test_half_an_arc_stands_for_the_whole_where_both_halves_are_alike(
    geometry: dict[str, Any], symmetric: bool
) -> None:
    spec = shaped(geometry, line_at("0 mm"))
    inputs = {path: np.full(1, x) for path, x in inputs_of(spec).items()}
    built = eqx.filter_eval_shape(build_geometry, spec.geometry, value_of(spec, inputs))
    assert built.symmetric is symmetric


@pytest.mark.parametrize(("mirror", "joints"), [(True, 4), (False, 2)])
def test_a_mirrored_path_has_no_joint_at_its_crown(mirror: bool, joints: int) -> None:
    spec = shaped(MIRRORED_PATH | {"mirror": mirror}, line_at("0 mm"))
    inputs = {path: np.full(1, x) for path, x in inputs_of(spec).items()}
    built = eqx.filter_eval_shape(build_geometry, spec.geometry, value_of(spec, inputs))
    assert len(built.section.kinks) == joints


def test_a_scene_is_solved_on_half_an_arc_where_tables_allow_it() -> None:
    for table, half in ((HUMP, True), (LEANING, False)):
        spec = shaped(EXAMPLES["circle"] | {"oil_gap": table}, line_at("0 mm"))
        assert measures(spec).symmetric is half


# Files.


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"start": "80 deg"}, ["geometry.path", "-10", "corner at the crown"]),
        ({"path": [{"line": "20 mm", "radius": "3 mm"}]}, ["geometry.path.0", "a piece is"]),
        ({"path": [{"radius": "3 mm"}]}, ["geometry.path.0", "a piece is"]),
        ({"path": []}, ["geometry.path"]),
        ({"inner_radius": "50 mm"}, ["geometry.inner_radius"]),
        ({"section": "polygon"}, ["geometry", "polygon", "ellipse"]),
        ({"thickness": {"arc": [0.1, 1], "value": ["1 mm"] * 2}}, ["thickness", "from 0 to 1"]),
        ({"thickness": {"arc": [0, 0.5], "value": ["1 mm"] * 2}}, ["thickness", "from 0 to 1"]),
        ({"oil_gap": {"arc": [0, 0.7, 0.7, 1], "value": ["5 mm"] * 4}}, ["oil_gap", "rise"]),
        (
            {"oil_gap": {"arc": [0, 0.7, 1], "value": ["5 mm"] * 4}},
            ["oil_gap", "3 places", "4"],
        ),
        ({"oil_gap": {"arc": [0, 1], "value": ["5 mm", "0 mm"]}}, ["oil_gap.value.1"]),
    ],
)
def test_a_path_that_is_none_is_refused(change: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ConfigError) as error:
        shaped(MIRRORED_PATH | change)
    for word in words:
        assert word in str(error.value)
    assert ("entries; at least" in str(error.value)) is (change.get("path") == [])


@pytest.mark.parametrize(
    ("places", "words"),
    [
        (WAVE[::-1], ["geometry.points", "from the left clamp"]),
        (WAVE[:3], ["geometry.points", "has 3 entries", "at least 4"]),
        ([*WAVE[:3], *WAVE[2:]], ["geometry.points", "points 2 and 3", "the same"]),
    ],
)
def test_points_that_make_no_section_are_refused(places: Any, words: list[str]) -> None:
    with pytest.raises(ConfigError) as error:
        shaped({"section": "spline", "points": points(places)})
    for word in words:
        assert word in str(error.value)


def test_a_missing_table_of_points_is_named_with_its_folder() -> None:
    with pytest.raises(ConfigError, match="no such file in") as raised:
        shaped({"section": "spline", "points": "absent.csv"})
    assert "Errno" not in str(raised.value)


@pytest.mark.parametrize(
    ("geometry", "load", "words"),
    [
        ("ellipse", line(20, 1) | {"arc": "4 mm"}, ["load.0.angle", "take one out"]),
        ("ellipse", {"kind": "line", "force": "1 N"}, ["load.0.angle", "missing", "arc"]),
        ("path", line(20, 1), ["load.0.angle", "no meaning", 'arc = "22 mm"']),
        ("spline", line(20, 1), ["load.0.angle", "no meaning", 'arc = "22 mm"']),
        ("circle", line_at("90 mm"), ["load.0.arc", "off the skin"]),
    ],
)
def test_a_place_is_told_once(geometry: str, load: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ConfigError) as error:
        shaped(EXAMPLES[geometry], load)
    for word in words:
        assert word in str(error.value)


FLAT_TOPPED: dict[str, Any] = {
    "section": "path",
    "path": [{"line": "20 mm"}, arc(30, 90), {"line": "27.5 mm"}],
    "start": "90 deg",
    "mirror": True,
}


def test_contact_on_a_flat_has_the_area_of_the_flat_wall() -> None:
    spec = shaped(FLAT_TOPPED)
    geometry = scene_parts(spec, continuous_inputs(spec)).skin.geometry
    places = jnp.linspace(-8e-3, 8e-3, 33)[None, :, None]
    angle = geometry.section.from_arc(places)
    ones = jnp.ones_like(places)
    touched = ContactState(angle, angle, jnp.abs(places) - 4e-3, ones, ones)
    area = float(contact_zone(touched, geometry)["area_m2"][0])
    assert area == pytest.approx(8e-3 * WIDTH, rel=1e-9)


def test_the_map_of_a_pad_tells_places_as_scenes_do() -> None:
    taxel = {"arc": "11 mm", "axial": "0 mm", "diameter": "4 mm"}
    patch = {"kind": "patch", "arc": "12 mm", "axial": "3 mm", "size": ["6 mm", "4 mm"]}
    scene = shaped(
        {**FLAT_TOPPED, "ends": "clamped"},
        {**patch, "force": "1 N"},
        oil={"model": "incompressible", "relative_permittivity": 2.2},
        electrodes={"lsb": "0.3 fF", "noise": 2.0, "layout": "list", "taxels": [taxel]},
    )
    parts = scene_parts(scene, continuous_inputs(scene))
    axes = Figure().subplots()
    (load,) = parts.forces
    assert isinstance(load, PadLoad)
    _draw_load(axes, load, parts)
    box = axes.patches[0].get_bbox()  # type: ignore[attr-defined]
    np.testing.assert_allclose([box.x0, box.x1, box.y0, box.y1], [9, 15, 1, 5], atol=1e-9)
    figure = plot_pad(scene, [100.0])
    discs = figure.axes[0].collections[0].get_paths()[0].get_extents()
    np.testing.assert_allclose([discs.x0, discs.x1], [9, 13], atol=1e-2)
    assert not figure.axes[0].child_axes  # no angle has a meaning there


def test_the_upper_axis_of_a_map_ends_at_the_clamps() -> None:
    taxel = {"angle": "10 deg", "axial": "0 mm", "diameter": "4 mm"}
    electrodes = {"lsb": "0.3 fF", "noise": 2.0, "layout": "list", "taxels": [taxel]}
    oil = {"model": "incompressible", "relative_permittivity": 2.2}
    spec = shaped(
        {"inner_radius": "57.5 mm", "half_angle": "90 deg"}, oil=oil, electrodes=electrodes
    )
    (upper,) = plot_pad(spec, [1.0]).axes[0].child_axes
    to_mm = upper._functions[1]  # type: ignore[attr-defined]
    np.testing.assert_allclose(to_mm(90.0), 52.5 * np.pi / 2, rtol=1e-9)
    assert to_mm(100.0) > to_mm(90.0) + 1  # no tick of 100 degrees at the clamp
