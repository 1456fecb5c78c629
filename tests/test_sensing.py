"""Gap, capacitance, taxels and converter: closed forms, measured layouts, published numbers."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from skins import (
    CASE_B,
    EPDM,
    GEOMETRY,
    converged,
    half_cylinder,
    line,
    problem_of,
    quick,
    scene,
)

from suas_jax.config import (
    ConfigError,
    SceneSpec,
    continuous_inputs,
    load_scene,
    load_skin,
    scene_from_dict,
)
from suas_jax.config.sections.circle import CircleSpec
from suas_jax.mechanics.base import Profile
from suas_jax.mechanics.section import INTERVALS, NormalFace, height_at, normal_face
from suas_jax.mechanics.shell.shell import Shell
from suas_jax.scene.forward import forward
from suas_jax.scene.gradient import gradient
from suas_jax.scene.loads import Loads
from suas_jax.scene.parts import skin_parts
from suas_jax.scene.skin import skin_of
from suas_jax.scene.solve import solve
from suas_jax.sensing.capacitance import VACUUM_PERMITTIVITY, Dielectric
from suas_jax.sensing.capacitances.bare_disc import BareDisc, disc_capacitance
from suas_jax.sensing.capacitances.concentric import Concentric
from suas_jax.sensing.capacitances.parallel_plate import ParallelPlate
from suas_jax.sensing.converter import EIGHT_BIT_LSB, PAPER_LSB, Converter
from suas_jax.sensing.electrodes import Electrodes, Readings
from suas_jax.sensing.field import field_capacitance_under
from suas_jax.sensing.taxels import CHORDS, DISC, EVEN, PLACE_CHANNELS, Taxels, module_places
from suas_jax.sensing.tiling import tiled_modules
from suas_jax.skin.plain import angles_at, plain_geometry
from suas_jax.skin.section import outward

DATA = Path(__file__).parent / "data"
SKINS = Path(__file__).parent.parent / "configs" / "skins"
SKIN = half_cylinder()
WALL = 0.0525  # its radius
EVEN_FACE = np.array([[1e3], [-1e3]])  # that folds nowhere


def electrodes(**more: object) -> dict[str, object]:
    angles = (-60, -20, 5, 44, 70)
    taxels = [{"angle": f"{a} deg", "diameter": "4 mm"} for a in angles]
    return {"stray": "3 fF", "lsb": "0.305 fF", "taxels": taxels, **more}


def sensing(*loads: dict, table: dict | None = None, **oil: object) -> SceneSpec:
    return scene_from_dict(
        {
            "geometry": GEOMETRY,
            "material": EPDM,
            "oil": {"model": "incompressible", "relative_permittivity": 2.2} | oil,
            "electrodes": table or electrodes(),
            "wall": {"contact": False},
            "load": list(loads),
            "solve": {"model": "shell", "elements": 32},
        }
    )


def test_formulas() -> None:
    gap, oil = jnp.array([5e-3]), jnp.array([2.2])
    plane = ParallelPlate().per_area(gap, Dielectric(oil, 0.0, 1 / WALL))
    assert plane[0] == pytest.approx(VACUUM_PERMITTIVITY * 2.2 / 5e-3, rel=1e-15)
    coaxial = Concentric().per_area(gap, Dielectric(oil, 0.0, 1 / WALL))
    per_length = 2 * np.pi * VACUUM_PERMITTIVITY * 2.2 / np.log(57.5 / 52.5)
    assert coaxial[0] * 2 * np.pi * 0.0525 == pytest.approx(per_length, rel=1e-13)
    assert coaxial[0] / plane[0] == pytest.approx(1.047, abs=1e-3)
    # In series: reciprocals of capacitance add up.
    layers = 50e-6 / 3.3 + 0.2e-3 / 1.6
    both = ParallelPlate().per_area(gap, Dielectric(oil, layers, 1 / WALL))
    parts = 5e-3 / 2.2 + 50e-6 / 3.3 + 0.2e-3 / 1.6
    assert both[0] == pytest.approx(VACUUM_PERMITTIVITY / parts, rel=1e-14)


def test_a_bare_disc_gathers_the_field_beyond_its_edge() -> None:
    """Love's equation between Kirchhoff's small gaps and the lone disc."""
    assert disc_capacitance(200.0) == pytest.approx(8 / (1 - 1 / (200 * np.pi)), rel=1e-6)
    for ratio in (0.02, 0.04):
        log = np.log(8 * np.pi / ratio)
        kirchhoff = np.pi / ratio + 2 * (log - 1)
        following = ratio / np.pi * (log**2 - 2)  # Hutson 1963
        assert disc_capacitance(ratio) == pytest.approx(kirchhoff + following, rel=2e-4)
        assert disc_capacitance(ratio) > kirchhoff + following / 2

    taxels = Taxels(
        *(jnp.array(x)[:, None] for x in ([0.0, 0.1], [0.0, 0.0], [4e-3, 12e-3])),
        (0, 0),
        (1, 2),
    )
    between = Dielectric(jnp.array([2.2]), 0.0, 1 / WALL)
    gap = jnp.array([[0.3e-3, 0.5e-3, 5e-3, 12e-3]] * 2)

    def of(gap: jax.Array) -> jax.Array:
        return BareDisc().capacitance([gap], EVEN, taxels, between)

    found = of(gap)
    for k, radius in enumerate((2e-3, 6e-3)):
        want = [disc_capacitance(g / radius) for g in np.asarray(gap[k])]
        unit = VACUUM_PERMITTIVITY * 2.2 * radius
        np.testing.assert_allclose(found[k] / unit, want, rtol=3e-7)
    np.testing.assert_allclose(BareDisc().even_gap(found, taxels, between), gap, rtol=1e-10)
    # Nearer than the polynomial's range the capacitance goes on as the plate's.
    near = of(jnp.array([[1e-5], [1e-5]]))
    plate = VACUUM_PERMITTIVITY * 2.2 * taxels.area / 1e-5
    assert np.all((near > plate) & (near < 1.06 * plate))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"layers": [{"thickness": "50 um", "relative_permittivity": 3.3}]}, "layers"),
        ({"taxels": [{"angle": "0 deg", "diameter": "0.5 mm"}]}, "oil_gap is 5 mm.*25 um"),
    ],
)
def test_a_bare_disc_is_refused_beyond_its_range(more: dict, words: str) -> None:
    spec = sensing(table=electrodes(capacitance="bare-disc", **more))
    with pytest.raises(ValueError, match=f"bare-disc.*{words}"):
        skin_parts(spec, continuous_inputs(spec))


class Bent:
    """Stands for a membrane: the undeformed face with a dent of given depth at the crown."""

    wall = None

    def face(self, q: jax.Array) -> NormalFace:
        """As `AbstractMechanics.face`."""
        angle = jnp.linspace(-np.pi / 2, np.pi / 2, 9)
        angle = angle[:-1] + jnp.linspace(0, 1, INTERVALS + 1)[:, None] * jnp.diff(angle)
        angle = angle[..., None]
        moved = -q * jnp.exp(-((angle / 0.2) ** 2)) * outward(angle)
        rest = SKIN.section.inner_face(angle)
        return normal_face(Profile(angle, rest, None, moved, *(None,) * 3), SKIN.section)


@quick
def read(held: Electrodes, depth: float) -> Readings:
    return held.read(Bent(), jnp.asarray(depth))


@pytest.mark.parametrize("capacitance", ["parallel-plate", "concentric"])
def test_the_gap_of_an_even_film_is_found_from_its_counts(capacitance: str) -> None:
    layers = [{"thickness": "50 um", "relative_permittivity": 3.3}]
    taxels = [{"angle": f"{a} deg", "height": f"{h} mm"} for a, h in ((-40, 0), (30, 0.4))]
    table = electrodes(layers=layers, taxels=taxels, capacitance=capacitance)
    spec = sensing(table=table)
    skin = skin_parts(spec, continuous_inputs(spec)).electrodes
    gap = np.array([[0.5e-3, 3e-3, 5e-3, 9e-3]])
    so = np.asarray(skin.read_even_film(gap))
    np.testing.assert_allclose(skin.even_film(so), np.repeat(gap, 2, 0), rtol=1e-12)
    film = 3e-3 if capacitance == "parallel-plate" else 52.5e-3 * np.log1p(3e-3 / 52.5e-3)
    density = 8.8541878188e-12 / (film / 2.2 + 50e-6 / 3.3)
    want = (3e-15 + density * np.pi / 4 * 4e-3**2) / 0.305e-15
    assert so[0, 1] == pytest.approx(want, rel=1e-12)
    # More than a closed film has: zero gap above the electrode; less than the stray: unknown.
    odd = np.asarray(skin.even_film(np.array([[1e9, 1.0, np.nan]] * 2)))
    np.testing.assert_allclose(odd, [[0.0, np.nan, np.nan], [0.4e-3, np.nan, np.nan]])


def test_at_rest_every_taxel_has_the_paper_s_capacitance() -> None:
    layers = [{"thickness": "50 um", "relative_permittivity": 3.3}]
    named = sensing(table=electrodes(layers=layers), relative_permittivity="silicone-oil")
    assert named.oil.relative_permittivity == 2.7
    for spec, film in ((sensing(), 5e-3 / 2.2), (named, 5e-3 / 2.7 + 50e-6 / 3.3)):
        found = read(skin_parts(spec, continuous_inputs(spec)).electrodes, 0.0)
        np.testing.assert_allclose(found.gap, 5e-3, rtol=1e-12)
        want = 3e-15 + 8.8541878188e-12 * np.pi / 4 * 4e-3**2 / film
        np.testing.assert_allclose(found.capacitance, want, rtol=1e-12)
        np.testing.assert_allclose(found.so, want / 0.305e-15, rtol=1e-12)
        assert not found.touching.any()
    with pytest.raises(ConfigError, match=r'relative_permittivity.*"silicone-oil"'):
        sensing(relative_permittivity="olive-oil")


def face_of(height: object, count: int = 12) -> NormalFace:
    """A face with a given height over the angle, one cubic an element."""
    edges = np.linspace(-np.pi / 2, np.pi / 2, count + 1)
    t = np.array([-1.0, -1 / 3, 1 / 3, 1.0])
    angle = (edges[:-1] + edges[1:]) / 2 + t[:, None] * np.diff(edges) / 2
    powers = np.linalg.solve(np.vander(t, increasing=True), height(angle))
    return NormalFace(jnp.asarray(edges)[:, None], jnp.asarray(powers)[..., None], EVEN_FACE)


def test_average_over_a_footprint() -> None:
    # 1 / d linear along the arc: the mean over a disc is the value at its centre. With d
    # itself linear, d = a + b x, the mean of 1/d over a disc has a closed form.
    taxels = Taxels(*jnp.array([[0.3], [0.0], [8e-3]])[..., None], (0,), (1,))
    rays = jnp.stack([angle for angle, _ in taxels.rays(CHORDS, SKIN)])
    slope = 0.2
    x = (rays - 0.3) * WALL
    mean = CHORDS.average(1 / (3e-3 + slope * x))[0, 0]
    ratio = slope * 4e-3 / 3e-3
    exact = 2 / (3e-3 * ratio**2) * (1 - np.sqrt(1 - ratio**2))
    assert mean == pytest.approx(exact, rel=1e-6)
    assert CHORDS.average(x)[0, 0] == pytest.approx(0, abs=1e-17)
    assert CHORDS.average(x**2)[0, 0] == pytest.approx(4e-3**2 / 4, rel=1e-12)


def test_average_over_a_footprint_in_both_directions() -> None:
    # Moments of the unit disc: <x^2> = 1/4, <x^4> = 1/8, <x^2 y^2> = 1/24.
    x, y = DISC.places.T
    assert DISC.places[DISC.centre].tolist() == [0, 0]
    for values, mean in ((x, 0), (x**2, 1 / 4), (y**2, 1 / 4), (y**4, 1 / 8)):
        assert DISC.average(values) == pytest.approx(mean, abs=1e-15)
    assert DISC.average(x**2 * y**2) == pytest.approx(1 / 24)
    assert DISC.average(x**2 * y) == pytest.approx(0, abs=1e-15)


def test_rays_meet_the_face() -> None:
    face = face_of(lambda angle: 1e-3 * angle**3)
    angle = jnp.linspace(-1.7, 1.7, 57)[:, None]
    want = 1e-3 * np.clip(angle, -np.pi / 2, np.pi / 2) ** 3
    np.testing.assert_allclose(height_at(face, angle), want, rtol=1e-13, atol=1e-17)


@pytest.fixture(scope="module")
def pressed() -> tuple:
    problem = problem_of(scene(line(25, 18)), 33)
    return problem.mechanics, converged(problem).state.q


def test_gap_is_where_the_inner_face_is(pressed: tuple) -> None:
    mechanics, q = pressed

    @quick
    def both(mechanics: Shell, q: jax.Array) -> tuple[jax.Array, jax.Array]:
        shape = mechanics.profile(q, 7)  # other points than those that rays are drawn through
        x, y = 0.0575 * outward(shape.angle) + shape.inner_displacement
        angle = jnp.arctan2(x, y).reshape(-1, 1)
        along_rays = height_at(mechanics.face(q), angle)
        return along_rays.ravel(), jnp.hypot(x, y).ravel() - 0.0575

    along_rays, of_points = both(mechanics, q)
    # 2e-8 m at the load's element, 1e-9 m elsewhere; the mesh's own error is 1e-6 m.
    np.testing.assert_allclose(along_rays, of_points, rtol=0, atol=3e-8)


def test_a_face_that_turns_back_has_no_gap(pressed: tuple) -> None:
    mechanics, q = pressed
    folded = quick(lambda m, q: m.face(q).folded)
    assert not folded(mechanics, q).any()
    assert folded(mechanics, 40 * q).all()


def test_a_fold_hides_the_rays_that_meet_it_and_no_others(pressed: tuple) -> None:
    """As a body's edge next to a clamp folds the face within one short element."""
    mechanics, q = pressed

    @quick
    def heights(mechanics: Shell, q: jax.Array, size: float) -> tuple[jax.Array, jax.Array]:
        shape = mechanics.profile(q, INTERVALS)
        within = jnp.zeros_like(shape.angle).at[1:-1, 4].set(jnp.array([[1.0], [0.0], [-1.0]]))
        along = jnp.stack([jnp.cos(shape.angle), -jnp.sin(shape.angle)])
        moved = shape.inner_displacement + size * within * along
        face = normal_face(shape._replace(inner_displacement=moved), mechanics.section)
        rays = jnp.linspace(-1.5, 1.5, 301)[:, None]
        zero = jnp.zeros_like(rays)
        return face.height(rays, zero)[:, 0], jnp.stack([shape.angle[0, 4], shape.angle[-1, 4]])

    (even, _), (folded, ends) = (heights(mechanics, q, size) for size in (0.0, 5e-3))
    lost = np.isnan(folded)
    rays = np.linspace(-1.5, 1.5, 301)
    near = (rays > float(ends[0, 0]) - 0.1) & (rays < float(ends[1, 0]) + 0.1)
    assert lost.any()
    assert not (lost & ~near).any()
    np.testing.assert_array_equal(folded[~lost & ~near], even[~lost & ~near])


@pytest.mark.long  # a scene of its own; taxels that touch below and in test_contact
def test_taxels_that_touch_are_named_and_leave_the_others_alone() -> None:
    report = solve(sensing(line(44, 45))).report
    so = [taxel["so"] for taxel in report["taxels"]]
    assert report["wall_contact"]
    assert np.isnan(so[3])
    assert np.isfinite([so[0], so[1], so[2], so[4]]).all()
    assert report["taxels"][3]["gap_m"] < 0
    assert "1 of 5 taxels touch the membrane" in report["message"]


@pytest.mark.long  # a solve and a lane, programs each; lanes in test_skin, a scene in test_cli
@pytest.mark.parametrize(
    ("spec", "within"), [(load_scene(CASE_B), 1e-3), (sensing(line(31, 14)), 2e-4)]
)
def test_solve_and_skin_agree(spec: SceneSpec, within: float) -> None:
    report = solve(spec).report
    (load,) = report["loads"]
    loads = Loads.line(np.deg2rad(load["angle_deg"]), load["force_N"])
    found = quick(forward)(skin_of(spec), loads)
    so = [taxel["so"] for taxel in report["taxels"]]
    np.testing.assert_allclose(found.so[:, 0], so, rtol=within)
    gap = [taxel["gap_m"] for taxel in report["taxels"]]
    np.testing.assert_allclose(found.readings.gap[:, 0], gap, rtol=within)


@pytest.mark.long  # the program of derivatives; those of a reading below
def test_gradient_of_a_reported_so() -> None:
    solution = solve(sensing(line(31, 14)))
    slopes = gradient(solution, "taxels.2.so")
    so = solution.report["taxels"][2]["so"]
    # Of the same degree in area and in 1 / lsb; C less stray is that of the electrode.
    assert slopes["electrodes.lsb"] * 0.305e-15 == pytest.approx(-so, rel=1e-12)
    by_oil = slopes["oil.relative_permittivity"] * 2.2
    assert by_oil + slopes["electrodes.stray"] * 3e-15 == pytest.approx(so, rel=1e-12)
    assert slopes["electrodes.taxels.2.angle"] != 0
    assert slopes["electrodes.taxels.1.angle"] == 0


def test_derivatives_survive_a_taxel_that_touches() -> None:
    # Only the untouched taxel's reading may feed the gradient of its own capacitance.
    taxels = Taxels(
        jnp.array([[0.0], [0.6]]), jnp.zeros((2, 1)), jnp.full((2, 1), 4e-3), (), ()
    )

    one = jnp.ones(1)

    def reading(depth: jax.Array, permittivity: jax.Array) -> jax.Array:
        oil = permittivity * one
        held = Electrodes(taxels, SKIN, oil, 0 * one, 0 * one, one, ParallelPlate())
        found = held.read(Bent(), depth)
        return found.capacitance[1, 0]

    gradient = quick(jax.value_and_grad(reading, (0, 1)))
    value, slopes = jax.tree.map(float, gradient(6e-3, 2.2))
    assert np.isfinite(value)
    assert np.isfinite(slopes[0])
    assert slopes[0] != 0
    assert slopes[1] == pytest.approx(value / 2.2, rel=1e-12)


def test_module_is_the_measured_triangle() -> None:
    table = np.loadtxt(DATA / "roboskin_triangle_10taxel_layout.csv", delimiter=",", skiprows=3)
    ours = 6.533 * module_places()
    order = np.lexsort((table[:, 1], -table[:, 2].round(1)))
    np.testing.assert_allclose(ours, table[order, 1:], rtol=0, atol=4e-3)
    np.testing.assert_allclose(ours.mean(0), 0, atol=1e-12)
    assert tuple(table[order, 0].astype(int)) == PLACE_CHANNELS
    assert sorted({*range(12)} - {*PLACE_CHANNELS}) == [6, 10]  # the thermal pads


def roboskin(**module: object) -> object:
    table = {"layout": "roboskin", "modules": [{"angle": "10 deg", "axial": "2 mm", **module}]}
    return sensing(table=table)


def places(spec: object) -> tuple[np.ndarray, Taxels]:
    taxels = skin_parts(spec, continuous_inputs(spec)).electrodes.taxels
    x = (taxels.angle[:, 0] - np.deg2rad(10)) * 0.0525
    return np.stack([x, taxels.axial[:, 0] - 2e-3], 1), taxels


def test_numbering_and_pose_of_a_module() -> None:
    paper, taxels = places(roboskin())
    assert taxels.number == tuple(range(1, 11))
    assert taxels.module == (0,) * 10
    np.testing.assert_allclose(paper[9], 0, atol=1e-15)  # number 10 is the centroid's
    np.testing.assert_allclose(paper[0], [0, 6.533e-3 * np.sqrt(3)], atol=1e-15)
    rows, _ = places(roboskin(numbering=list(range(1, 11))))
    np.testing.assert_allclose(rows, 6.533e-3 * module_places(), atol=1e-15)
    reverse, _ = places(roboskin(numbering=list(range(10, 0, -1))))
    np.testing.assert_allclose(reverse, rows[::-1], atol=1e-15)
    turned, _ = places(roboskin(rotation="90 deg"))  # from +angle towards +axial
    np.testing.assert_allclose(turned, paper @ np.array([[0, 1], [-1, 0]]), atol=1e-15)


def test_thirty_two_triangles_tile_the_wall() -> None:
    geometry = CircleSpec(
        inner_radius=0.0575, thickness=0.0015, half_angle=np.pi / 2, width=0.123, oil_gap=0.005
    )
    modules = tiled_modules(geometry)
    assert len(modules) == 32
    table = {"layout": "roboskin", "modules": [m.model_dump() for m in modules]}
    spec = roboskin()
    spec = spec.model_copy(update={"electrodes": type(spec.electrodes)(**table)})
    found, taxels = places(spec)
    assert len(set(zip(taxels.module, taxels.number, strict=True))) == 320
    assert spec.electrodes.taxel_names == (taxels.module, taxels.number)
    distance = np.linalg.norm(found[:, None] - found[None], axis=2)
    # No two taxels of neighbouring triangles come closer than electrodes are wide.
    assert np.sort(distance, 1)[:, 1].min() > 4e-3
    centres = np.array([[m.angle * 0.0525, m.axial] for m in modules])
    gaps = np.sort(np.linalg.norm(centres[:, None] - centres[None], axis=2), 1)[:, 1]
    np.testing.assert_allclose(gaps, 24e-3 / np.sqrt(3), rtol=1e-12)  # no holes, no overlap
    with pytest.raises(ValueError, match=r"138.564 mm of the wall's width"):
        tiled_modules(geometry, rows=8, edge=20e-3)


@pytest.mark.parametrize("name", ["suas-ellipse", "suas-flat-topped"])
def test_triangles_tile_any_wall(name: str) -> None:
    geometry = load_skin(SKINS / f"{name}.toml").geometry
    modules = tiled_modules(geometry, rows=2, columns=6)
    told = "angle" if geometry.has_angle else "arc"
    skin = plain_geometry(geometry)
    row = angles_at(geometry, told, np.array([getattr(m, told) for m in modules[:6]]))
    wall = np.asarray(skin.wall_arc(jnp.asarray(row)[:, None]))[:, 0]
    np.testing.assert_allclose(np.diff(wall), 12e-3, rtol=1e-6)
    np.testing.assert_allclose(wall, -wall[::-1], atol=1e-9)
    with pytest.raises(ValueError, match="of the wall's arc"):
        tiled_modules(geometry, rows=2, columns=20)


def test_the_field_under_a_flat_top_is_a_plate_s_and_round_its_corner_a_cylinder_s() -> None:
    spec = load_skin(SKINS / "suas-flat-topped.toml")
    electrodes = skin_parts(spec, continuous_inputs(spec)).sensing()
    half = electrodes.geometry.half_angle
    edges, even = jnp.linspace(-1, 1, 3)[:, None] * half, jnp.zeros((5, 2, 1))
    face = NormalFace(edges, even, EVEN_FACE)
    find = quick(field_capacitance_under)
    own = np.asarray(find(electrodes, face, 360))[:, 0] / (VACUUM_PERMITTIVITY * 2.2)
    area = np.pi * 2e-3**2
    np.testing.assert_allclose(own[3:5], area / 5e-3, rtol=1e-3)  # at 11 mm of 27.5
    # At 55 mm, in the middle of a quarter of a circle, the wall's radius is 25 mm.
    np.testing.assert_allclose(own[[1, 6]], area / (25e-3 * np.log(30 / 25)), rtol=1e-3)


def test_scales_of_the_paper() -> None:
    assert abs(PAPER_LSB / 3.05e-16 - 1) < 1e-3
    # 13,675 counts in air, 18,270 in oil: 4.17 and 5.57 pF.
    farads = Converter().capacitance([13675, 18270])
    np.testing.assert_allclose(farads * 1e12, [4.173, 5.576], atol=1e-3)
    assert abs(EIGHT_BIT_LSB / PAPER_LSB - 9.44) < 0.01  # no power of two


def test_converter_samples() -> None:
    random = np.random.default_rng(1)
    converter = Converter(noise=2.0, offset=1e-13, drift=4.0)
    time = np.arange(4000) / 100
    farads = np.tile(converter.capacitance([500.3, 60000.0, 65536.5, -4.0]), (4000, 1))
    farads[:, 3] = np.nan
    found = converter.sample(farads, time, random)
    assert found.counts.dtype == np.int64
    still = Converter(noise=2.0, offset=1e-13).sample(farads, time, random).counts
    assert still[:, 0].mean() == pytest.approx(500.3, abs=4 * 2 / np.sqrt(4000))
    assert still[:, 0].std() == pytest.approx(np.hypot(2, np.sqrt(1 / 12)), rel=0.05)
    assert (found.counts[:, 3] == 65535).all()  # a short circuit reads full scale
    assert found.saturated[:, 3].all()
    assert not found.saturated[:, 0].any()
    slope = np.polyfit(time, found.counts[:, :2], 1)[0]
    assert (np.abs(slope) > 0.05).any()
    rest = np.full((2, 2000), PAPER_LSB * 3e4)
    drifted = Converter(drift=100.0).sample(rest, np.array([5.0, 7.0]), random).counts
    assert np.std(drifted[1] - drifted[0]) / 2 == pytest.approx(100.0, rel=0.06)
    assert Converter(bits=1).full_scale == 1
    eight = Converter(lsb=EIGHT_BIT_LSB, bits=8)
    assert eight.sample(np.array([[1e-12]]), np.zeros(1), random).counts == 255


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        *(("lsb", 0.0), ("lsb", -1e-15), ("bits", 0), ("bits", 17)),
        *(("noise", -1.0), ("drift", -1.0), ("refresh", 0.0), ("refresh", -0.1)),
    ],
)
def test_an_impossible_converter_is_refused(setting: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{setting} = "):
        Converter(**{setting: value})  # type: ignore[arg-type]


def test_polled_faster_than_it_refreshes_a_converter_repeats() -> None:
    converter = Converter(refresh=0.03)
    time = np.arange(10) * 0.01
    ramp = converter.capacitance(np.arange(10.0)[:, None] * 10)
    found = converter.sample(ramp, time, np.random.default_rng(0))
    np.testing.assert_array_equal(found.counts[:, 0], [0, 0, 0, 30, 30, 30, 60, 60, 60, 90])
    np.testing.assert_array_equal(found.repeated, [k % 3 > 0 for k in range(10)])


def test_a_converter_reads_nothing_below_zero() -> None:
    converter = Converter()
    farads = converter.capacitance([-4.0, -0.3, 0.3])[None]
    found = converter.sample(farads, np.zeros(1), np.random.default_rng(0))
    assert found.counts.tolist() == [[0, 0, 0]]
    assert found.saturated.tolist() == [[True, False, False]]


def test_a_repeated_result_is_as_saturated_as_when_it_was_converted() -> None:
    # Results are made at frames 0 and 3; what the input does between, nobody sees.
    converter = Converter(refresh=0.03)
    counts = np.array([100.0, 1e6, 1e6, 1e6, 100.0, 100.0])
    farads = converter.capacitance(counts)[:, None]
    found = converter.sample(farads, np.arange(6) * 0.01, np.random.default_rng(0))
    assert found.counts[:, 0].tolist() == [100, 100, 100, 65535, 65535, 65535]
    assert found.saturated[:, 0].tolist() == [False, False, False, True, True, True]
