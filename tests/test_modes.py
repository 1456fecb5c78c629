"""Natural modes: an independent program's, closed forms of film and water, the command."""

import csv
import dataclasses
import json
import tomllib
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize, special
from test_cli import SCENES, suas

from suas_jax import ConfigError, load_scene, scene_from_dict
from suas_jax.config.oil import OilSpec
from suas_jax.dynamics.inertia import (
    Densities,
    Inertia,
    Outline,
    Water,
    densities_of,
    inertia_of,
)
from suas_jax.dynamics.modes import (
    Modes,
    Spectrum,
    bandwidth_of,
    damped_roots,
    lowest_modes,
    modes,
    relaxation_note,
    spectrum_of,
)
from suas_jax.dynamics.motion import Motion
from suas_jax.dynamics.pad import PadMotion, Sheet, pad_inertia
from suas_jax.figures.modes import plot_modes

FILM = SCENES / "film.toml"
DATA = Path(__file__).parent / "data" / "film2d.csv"
GIVEN = Densities(oil=960.0, viscosity=0.048, membrane=1150.0, water=1000.0)
LENGTH, GAP, THICKNESS = 0.18, 4e-3, 1.5e-3


def strip(segments: int, motion: str) -> Motion:
    """A straight membrane from clamp to clamp whose one unknown is a normal displacement."""
    s = np.linspace(0.0, LENGTH, segments + 1)
    up = {"cos": np.cos, "sin": np.sin}[motion](np.pi * s / LENGTH)
    moved = np.stack([0 * s, up])[..., None]
    faces = np.stack([np.stack([s, 0 * s + y]) for y in (0.0, THICKNESS / 2, THICKNESS)])
    none, gap = np.zeros((1, 1)), np.full_like(s, GAP)
    wall, section = np.stack([s, -gap]), THICKNESS * np.diff(s)
    outline = Outline(jnp.asarray(faces), jnp.asarray(gap))
    water = Water.over(jnp.diff(s))
    faces = np.stack([moved] * 3)
    return Motion(none, none, np.zeros(1), 0.0, outline, faces, wall, section, water)


def inertia(motion: Motion) -> Inertia:
    return inertia_of(motion.outline, motion.moved, motion.section, motion.water, GIVEN)


def test_film_membrane_and_water_have_the_energies_of_closed_forms() -> None:
    # w = cos(pi s / L) makes the flux (L / pi) sin(pi s / L).
    flux = (LENGTH / np.pi) ** 2 * LENGTH / 2
    wanted = np.array(
        [
            GIVEN.oil / GAP * flux,
            GIVEN.membrane * THICKNESS * LENGTH / 2,
            GIVEN.water * LENGTH / np.pi * LENGTH / 2,
            12 * GIVEN.viscosity / GAP**3 * flux,
        ]
    )

    def error(segments: int) -> np.ndarray:
        found = inertia(strip(segments, "cos"))
        return np.abs(np.array([x[0, 0] for x in found]) / wanted - 1)

    assert np.all(error(400) < 3e-5)
    assert np.all(error(400) < 0.27 * error(200))  # of second order


def test_oil_that_yields_makes_room_evenly() -> None:
    # What sin(pi s / L) displaces leaves with the flux of its difference to its mean.
    s = np.linspace(0.0, LENGTH, 4001)
    flux = LENGTH / np.pi * (1 - np.cos(np.pi * s / LENGTH) - 2 * s / LENGTH)
    wanted = GIVEN.oil / GAP * np.trapezoid(flux**2, s)
    assert inertia(strip(400, "sin")).film[0, 0] == pytest.approx(wanted, rel=1e-4)


def test_a_closed_film_is_one_that_no_longer_drains() -> None:
    drains = strip(50, "cos")
    shut = drains._replace(outline=drains.outline._replace(gap=jnp.full(51, -1e-6)))
    assert np.isfinite(inertia(shut).damping).all()
    assert inertia(shut).damping[0, 0] > 1e9 * inertia(drains).damping


def test_damped_roots_are_those_of_oscillators_in_the_order_of_their_modes() -> None:
    omega, zeta = np.array([3.0, 7.0, 11.0]), np.array([5.0, 0.2, 1.5])
    roots = damped_roots(omega**2, np.diag(2 * zeta * omega))
    slow = -omega * (zeta - np.sqrt(zeta**2 - 1 + 0j))
    wanted = np.where(zeta > 1, slow, omega * (-zeta + 1j * np.sqrt(1 - zeta**2 + 0j)))
    np.testing.assert_allclose(roots, wanted, rtol=1e-12)


def test_what_a_thick_oil_delays_is_not_rounded() -> None:
    omega = np.geomspace(1.0, 300.0, 6)
    coupled = np.diag(1 / omega) + 1e-2 * np.exp(-np.add.outer(np.arange(6), np.arange(6)))
    damping = 1e9 * coupled
    times = -1 / damped_roots(omega**2, damping).real
    wanted = -1 / np.linalg.eigvals(-np.linalg.solve(damping, np.diag(omega**2)))
    np.testing.assert_allclose(np.sort(times), np.sort(wanted), rtol=1e-7)
    assert bandwidth_of(omega[:1] ** 2, damping[:1, :1]) * 2 * np.pi == pytest.approx(
        0.01 / damping[0, 0] / np.sqrt(1 - 1e-4), rel=1e-6
    )


def test_bandwidth_of_one_mode() -> None:
    tau = 0.3  # |1 / (1 + i w tau) - 1| = 0.01
    viscous = bandwidth_of(np.array([1e10]), np.array([[tau * 1e10]]))
    assert 2 * np.pi * viscous == pytest.approx(0.01 / tau / np.sqrt(1 - 1e-4), rel=1e-6)
    free = bandwidth_of(np.array([25.0]), np.zeros((1, 1)))
    assert 2 * np.pi * free == pytest.approx(5.0 * np.sqrt(0.01 / 1.01), rel=1e-6)


def test_low_modes_are_not_rounded_by_the_stiffest() -> None:
    # k x - a (a . x) mean = w^2 x with a = (1, ..., 1): sum 1 / (k - w^2) = 0.
    k = np.concatenate([np.arange(1.0, 13.0), np.geomspace(1e8, 1e13, 60)])
    volume, none = np.ones(k.size), np.zeros((k.size, k.size))
    held = strip(4, "cos")._replace(stiffness=np.diag(k), omitted=none, volume=volume)
    squares, vectors = lowest_modes(held, np.eye(k.size), 11)
    wanted = [
        optimize.brentq(lambda x: np.sum(1 / (k - x)), i + 1e-9, i + 1 - 1e-9, xtol=1e-13)
        for i in range(1, 12)
    ]
    np.testing.assert_allclose(squares, wanted, rtol=1e-9)
    assert np.max(np.abs(volume @ vectors)) < 1e-12


@pytest.fixture(scope="module")
def at_rest() -> Modes:
    return modes(load_scene(FILM))


def test_modes_are_those_of_an_independent_program(at_rest: Modes) -> None:
    text = [line for line in DATA.read_text().splitlines() if not line.startswith("#")]
    rows = [row for row in csv.DictReader(text) if row["viscosity_cSt"] == "50"]
    assert len(rows) == len(at_rest.modes)
    for row, mode in zip(rows, at_rest.modes, strict=True):
        damping = float(row["modal_damping_ratio_uncoupled"])
        share = float(row["film_share_of_modal_mass"])
        assert mode["undamped_Hz"] == pytest.approx(float(row["undamped_Hz"]), rel=2e-3)
        assert mode["frequency_Hz"] == pytest.approx(float(row["damped_Hz"]), rel=4e-3)
        assert mode["damping_ratio"] == pytest.approx(damping, rel=3e-3)
        assert mode["time_s"] == pytest.approx(float(row["decay_time_s"]), rel=3e-3)
        assert mode["film_share"] == pytest.approx(share, rel=3e-3)


def with_tables(**tables: dict[str, Any]) -> Any:
    """The example's skin with other tables."""
    data = tomllib.loads(FILM.read_text(encoding="utf-8"))
    for name, table in tables.items():
        data[name] = {**data.get(name, {}), **table}
    return scene_from_dict(data, base=SCENES)


def in_fluids(at_rest: Modes, **others: float) -> Spectrum:
    """The same motion with other fluids."""
    assert at_rest.motion is not None
    found = spectrum_of(at_rest.motion, GIVEN._replace(**others), 6)
    assert found is not None
    return found


def frequencies(found: Spectrum | Modes) -> np.ndarray:
    return np.array([mode["undamped_Hz"] for mode in found.modes], float)


def test_air_outside_and_an_oil_without_viscosity(at_rest: Modes) -> None:
    air = in_fluids(at_rest, water=0.0)
    assert frequencies(air)[0] == pytest.approx(2.56, rel=3e-3)  # the independent program's
    assert densities_of(with_tables(environment={"medium": "air"})).water == 0.0
    thin = in_fluids(at_rest, viscosity=0.0)
    np.testing.assert_allclose(frequencies(thin), frequencies(at_rest), rtol=1e-12)
    assert thin.modes[0]["damping_ratio"] == 0.0
    assert thin.modes[0]["time_s"] is None
    assert thin.modes[0]["frequency_Hz"] == pytest.approx(frequencies(thin)[0], rel=1e-9)
    # Inertia alone: (w / w1)^2 is the error of statics.
    first = frequencies(thin)[0]
    assert thin.bandwidth == pytest.approx(first * np.sqrt(0.01 / 1.01), rel=1e-6)


def test_a_thick_oil_swings_no_more(at_rest: Modes) -> None:
    thick = in_fluids(at_rest, viscosity=20 * GIVEN.viscosity)
    for mode, thin in zip(thick.modes, at_rest.modes, strict=True):
        assert mode["damping_ratio"] == pytest.approx(20 * (thin["damping_ratio"] or 0.0))
        assert (mode["frequency_Hz"] is None) == ((mode["damping_ratio"] or 0.0) > 1)
    # Viscosity alone is the error of statics there: the slowest motion's time.
    slowest = thick.modes[0]["time_s"]
    assert slowest is not None
    assert 2 * np.pi * thick.bandwidth * slowest == pytest.approx(0.01, rel=0.02)


def test_units_tell_kinematic_from_dynamic_viscosity() -> None:
    kinematic = OilSpec(model="x", density="960 kg/m^3", viscosity="50 cSt +- 10 %")
    assert kinematic.viscosity == pytest.approx(0.048)
    assert kinematic.viscosity.deviation == pytest.approx(0.0048)
    again = OilSpec(**kinematic.model_dump())  # as specifications are changed
    assert again.viscosity == kinematic.viscosity
    assert OilSpec(model="x", viscosity="48 mPa s").viscosity == pytest.approx(0.048)
    with pytest.raises(ValueError, match="needs the oil's density"):
        OilSpec(model="x", viscosity="50 cSt")
    with pytest.raises(ValueError, match="a viscosity with its unit is expected"):
        OilSpec(model="x", density="960 kg/m^3", viscosity="50 mm")


def test_a_rubber_that_relaxes_is_named_beside_its_modes() -> None:
    hold = load_scene(SCENES / "hold.toml")
    said = relaxation_note(hold.material)
    assert "the long-term one; 25 % of a stress fades in 0.5 to 10 s" in said
    assert not relaxation_note(load_scene(SCENES / "tap.toml").material)


def test_what_is_missing_is_named() -> None:
    with pytest.raises(ConfigError, match=r"oil\.viscosity: missing"):
        modes(load_scene(SCENES / "press.toml"))
    with pytest.raises(ValueError, match="outlet"):
        modes(with_tables(oil={"model": "vented"}))


def test_the_command_prints_the_contract_and_draws(tmp_path: Path) -> None:
    picture = tmp_path / "modes.png"
    command = ("modes", str(FILM), "--count", "6", "--plot", str(picture))
    found = json.loads(suas(*command, "--json").stdout)
    assert found["status"] == "converged"
    assert set(found["modes"][0]) >= {"undamped_Hz", "damping_ratio", "frequency_Hz", "time_s"}
    assert found["bandwidth_Hz"] == pytest.approx(0.0172, rel=1e-2)
    assert picture.stat().st_size > 10_000
    assert "Statics is right to 1 % below 0.0172 Hz" in suas("modes", str(FILM)).stdout


def test_an_unstable_state_has_no_modes(at_rest: Modes) -> None:
    lost = dataclasses.replace(at_rest, modes=[], bandwidth=None, status="unstable")
    with pytest.raises(ValueError, match="no modes to draw"):
        plot_modes(lost)


ARC, AXIAL = 0.18, 0.12


def plate(rows: int, columns: int, n: int, m: int) -> PadMotion:
    """A flat pad whose one unknown is the normal displacement cos(n pi x/L) cos(m pi z/W)."""
    x, z = np.linspace(0, ARC, rows + 1), np.linspace(0, AXIAL, columns + 1)
    up = np.outer(np.cos(n * np.pi * x / ARC), np.cos(m * np.pi * z / AXIAL))
    grid = np.meshgrid(x, z, indexing="ij")
    moved = np.stack([0 * up, up, 0 * up])[None]
    sheet = Sheet(np.stack([grid[0], 0 * up, grid[1]]), moved)
    even = np.full_like(up, 1.0)
    none = np.zeros((1, 1))
    return PadMotion(
        none, none[0], 0.0, sheet, sheet, sheet, GAP * even, THICKNESS * even, x, z
    )


@pytest.mark.parametrize(("n", "m"), [(1, 0), (0, 1), (2, 1)])
def test_film_and_water_of_a_pad_have_the_energies_of_closed_forms(n: int, m: int) -> None:
    k = np.array([n * np.pi / ARC, m * np.pi / AXIAL])
    area = ARC * AXIAL / (4 if n * m else 2)
    radius = ARC / np.pi
    beyond = special.kv(n, k[1] * radius) / -special.kvp(n, k[1] * radius) if m else None
    water = radius / n if beyond is None else beyond / k[1]
    wanted = [
        GIVEN.oil / GAP / (k @ k) * area,
        GIVEN.membrane * THICKNESS * area,
        GIVEN.water * water * area,
        12 * GIVEN.viscosity / GAP**3 / (k @ k) * area,
    ]

    def error(count: int) -> np.ndarray:
        found = pad_inertia(plate(3 * count, 2 * count, n, m), GIVEN)
        return np.abs(np.array([form[0, 0] for form in found]) / wanted - 1)

    assert np.all(error(20) < 3e-3)
    assert np.all(error(20) < 0.3 * error(10) + 1e-12)


# Programs of a pad; the forms that it adds have a test above.
@pytest.mark.long
def test_modes_of_a_pad(tmp_path: Path) -> None:
    """The film of a pad that is no longer than wide lets its oil flow along the axis, too."""
    scene = with_tables(geometry={"ends": "clamped"}, solve={"elements": [8, 8]})
    found = modes(scene, 2)
    first, second = found.modes
    assert first["undamped_Hz"] == pytest.approx(30.26, rel=0.02)  # of meshes of 20 by 16
    assert second["undamped_Hz"] == pytest.approx(33.54, rel=0.04)
    # An even film damps its own mass by 12 nu / h^2.
    for mode in found.modes:
        rate = 12 * 50e-6 / 5e-3**2 * (mode["film_share"] or 0.0)
        ratio = rate / (4 * np.pi * (mode["undamped_Hz"] or 0.0))
        assert mode["damping_ratio"] == pytest.approx(ratio, rel=1e-3)
    assert np.abs(found.shapes).max() == pytest.approx(1.0)
    plot_modes(found, tmp_path / "pad.png")
