"""What presses show beyond a model: the process against closed forms, and its evidence."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomlkit
from scipy.optimize import least_squares
from scipy.stats import multivariate_normal, norm

from fitting.inverse_load.discrepancy import ReadingDiscrepancy, _by_load
from fitting.inverse_load.fit.explanation import Explanations
from fitting.inverse_load.search.table import LoadTable
from fitting.sensor.report.skin_file import _discrepancy
from fitting.statistics.discrepancy import (
    _BOUNDS,
    _USUAL,
    _WIDTHS,
    Discrepancy,
    Numbers,
    Presses,
    learned,
)
from suas_jax.config import load_skin
from suas_jax.config.schema_calibration import DiscrepancySpec

SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"
TAXELS = np.deg2rad(np.arange(-70.0, 71.0, 20.0))
SCATTER = 2e-3


def change_at(angle: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Changes of readings of a made-up skin [press, taxel]."""
    d = TAXELS - angle[:, None]
    return force[:, None] * (300 * np.exp(-(d**2) / 0.08) - 40 * np.exp(-(d**2) / 0.72))


def made(seed: int, count: int, share: float) -> tuple[Presses, np.ndarray]:
    """Presses whose readings err by a smooth share of their change, and what they err by."""
    random = np.random.default_rng(seed)
    angle, force = random.uniform(-1.25, 1.25, count), random.uniform(2.5, 10.0, count)
    change, d = change_at(angle, force), TAXELS - angle[:, None]
    place = 3 * force[:, None] * np.sin(6 * d) * np.exp(-(d**2) / 0.08)
    noise = np.hypot(0.3, 2.5e-3 * change)
    true = share * (np.sin(3 * angle + 1)[:, None] + 0.5 * np.cos(4 * d)) * change
    left = true + random.normal(size=(count, 1)) * place
    left = left + SCATTER * random.normal(size=(count, 1)) * change
    left = left + noise * random.normal(size=change.shape)
    return Presses(angle, force, change, left, noise, place, SCATTER * change), true


def test_mean_covariance_and_likelihood_are_those_of_a_gaussian() -> None:
    """One taxel, which the pattern's length does not matter to, and presses at one place."""
    n = Numbers(0.02, 0.0, 1.0, 1.0, 0.8)
    force = np.array([2.0, 5.0, 9.0])
    change, left = 10 * force[:, None], np.array([[0.3], [0.9], [-0.2]])
    noise, place = np.full((3, 1), 0.2), np.full((3, 1), 0.1)
    angle = np.zeros(3)
    presses = Presses(angle, force, change, left, noise, place, 0.01 * change)
    own = Discrepancy(presses, n, np.zeros(1))
    far = np.log(force[:, None] / force) ** 2 / (2 * 0.8**2)
    process = 0.02**2 * (change @ change.T) * np.exp(-far)
    whole = process + np.diag(0.2**2 + 0.1**2 + 0.01**2 * change[:, 0] ** 2)
    told = multivariate_normal(np.zeros(3), whole).logpdf(left[:, 0])
    assert own.log_likelihood - 1.5 * np.log(2 * np.pi) == pytest.approx(told)
    mean, covariance = own.at(angle, force, change)
    np.testing.assert_allclose(mean[:, 0], process @ np.linalg.solve(whole, left[:, 0]))
    after = process - process @ np.linalg.solve(whole, process)
    np.testing.assert_allclose(covariance[:, 0, 0], np.diag(after), atol=1e-12)


@pytest.mark.parametrize(("count", "largest"), [(10, 1.0), (40, 0.6)])
def test_presses_with_their_errors_alone_change_little(count: int, largest: float) -> None:
    """What they show is within noise, and the more there are the less is left open."""
    for seed in range(5):
        presses, _ = made(seed, count, 0.0)
        found = learned(presses, TAXELS)
        other, _ = made(100 + seed, 30, 0.0)
        mean, covariance = found.at(other.angle, other.force, other.change)
        deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        size = np.abs(other.change).max(1, keepdims=True)
        assert np.median(np.abs(mean) / size) < 2e-3
        assert np.median(deviation.max(1, keepdims=True) / size) < largest * 1e-2


def test_learned_numbers_are_the_most_probable_ones() -> None:
    """The posterior of their logarithms is level there, or falls towards a bound."""
    presses, _ = made(3, 8, 0.02)
    found = learned(presses, TAXELS).numbers

    def cost(p: np.ndarray) -> float:
        told = Discrepancy(presses, Numbers(*np.exp(p)), TAXELS).log_likelihood
        return float(-told - norm(np.log(_USUAL), _WIDTHS).logpdf(p).sum())

    p, step = np.log(found), 1e-4
    slopes = [(cost(p + h) - cost(p - h)) / (2 * step) for h in step * np.eye(5)]
    bend = [cost(p + 0.05 * h) + cost(p - 0.05 * h) - 2 * cost(p) for h in np.eye(5)]
    inside = (p > np.log(_BOUNDS)[:, 0] + step) & (p < np.log(_BOUNDS)[:, 1] - step)
    assert inside.sum() >= 4
    newton = np.array(slopes) / (np.array(bend) / 0.05**2)  # to where it is level
    assert np.abs(newton[inside]).max() < 0.02


def test_slopes_of_a_table_are_those_of_what_it_tabulates() -> None:
    angles, share = np.linspace(-1.2, 1.2, 241), np.geomspace(1.0, 3.0, 60)
    force = (2.0 + np.cos(angles))[:, None] * share  # levels are of other forces elsewhere
    so = np.stack([change_at(angles, f) + 0.5 * f[:, None] ** 2 for f in force.T], 1)
    none = np.zeros(force.shape)
    found = _by_load(LoadTable(angles, force, so, np.zeros(8), none, none, none[:, 0]))
    k, j, step = 100, 30, 1e-5
    a, f = angles[k : k + 1], force[k, j : j + 1]
    by_angle = (change_at(a + step, f) - change_at(a - step, f))[0] / (2 * step)
    by_force = change_at(a, np.ones(1))[0] + f
    scale = np.abs(by_angle).max()
    np.testing.assert_allclose(found[k, j, 0], by_angle, atol=5e-3 * scale)
    np.testing.assert_allclose(found[k, j, 1], by_force, rtol=2e-3, atol=0.05)


@pytest.fixture(scope="module")
def shown() -> Discrepancy:
    return learned(made(0, 40, 0.02)[0], TAXELS)


def test_what_presses_show_is_found_with_its_own_uncertainty(shown: Discrepancy) -> None:
    found = shown
    other, true = made(1, 60, 0.02)
    mean, covariance = found.at(other.angle, other.force, other.change)
    assert np.sqrt(np.mean((true - mean) ** 2)) < 0.25 * np.sqrt(np.mean(true**2))
    z = (true - mean) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert np.mean(np.abs(z) < 1.96) > 0.85
    # Far from all presses there is nothing to take off, and as much uncertainty as before.
    angle, force = np.array([9.0]), np.array([5.0])
    mean, covariance = found.at(angle, force, np.full((1, 8), 100.0))
    assert np.abs(mean).max() < 1e-6
    n = found.numbers
    expected = 1e4 * (n.common**2 + n.pattern**2 * (1 + 0.05**2))
    assert covariance[0, 0, 0] == pytest.approx(expected)


def by_place(mean: np.ndarray, covariance: np.ndarray, presses: Presses) -> np.ndarray:
    """The part of changes of readings that places do, beside forces [press, taxel]."""
    a, f = presses.angle, presses.force
    slopes = np.stack([change_at(a + 1e-5, f) - change_at(a - 1e-5, f),
                       change_at(a, f + 1e-5) - change_at(a, f - 1e-5)], 1) / 2e-5  # fmt: skip
    variance = np.median(presses.noise) ** 2 + np.diagonal(covariance, axis1=1, axis2=2)
    parts = []
    for J, m, v in zip(slopes, mean, variance, strict=True):
        whole = np.linalg.lstsq((J / np.sqrt(v)).T, m / np.sqrt(v))[0]
        parts.append(whole[0] * J[0])
    return np.array(parts)


def test_estimates_read_it_between_the_states_of_their_table(shown: Discrepancy) -> None:
    found, presses = shown, shown.presses
    angles, forces = np.linspace(-1.5, 1.5, 91), np.geomspace(0.1, 20.0, 24)
    grid = np.repeat(forces[None], 91, 0)
    so = np.stack([change_at(angles, np.full(91, f)) for f in forces], 1)
    none = np.zeros((91, 24))
    table = LoadTable(angles, grid, so, np.zeros(8), none, none, none[:, 0])
    own = ReadingDiscrepancy(found, table)
    mean, covariance = own.under(presses.angle, presses.force)
    exact, spread = found.at(presses.angle, presses.force, presses.change)
    # Less what another place would do, whose square is left.
    moved = by_place(exact, spread, presses)
    exact, spread = exact - moved, spread + moved[:, :, None] * moved[:, None]
    assert np.abs(mean - exact).max() < 0.03 * np.abs(exact).max()
    # Between the states it is above that at a press, and never far below.
    share = np.trace(covariance, axis1=1, axis2=2) / np.trace(spread, axis1=1, axis2=2)
    assert 0.95 < np.median(share) < 1.2
    assert share.min() > 0.8


class _OneContact:
    """Least squares for one contact on the made-up skin, in place of `Selection`."""

    nodes: "_OneContact"
    of_one: "_OneContact"

    def __init__(self) -> None:
        self.nodes = self.of_one = self
        self.fitter = SimpleNamespace(per_contact=2, live=False)
        self.doubts = SimpleNamespace(of=lambda y, best: best.contacts > 1)
        self.asked = 0  # frames that were explained

    def nearest(self, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.abs(y).argmax(1), np.zeros(len(y), int)

    def near(self, y: np.ndarray, weight: np.ndarray, node: np.ndarray) -> np.ndarray:
        found = []
        for row, w, k in zip(y, weight, node, strict=True):

            def misfit(p: np.ndarray, row: np.ndarray = row, w: np.ndarray = w) -> np.ndarray:
                return np.sqrt(w) * (change_at(p[:1], p[1:])[0] - row)

            found.append(least_squares(misfit, [TAXELS[k], 5.0]).x)
        return np.array(found)

    def explain(self, y: np.ndarray, weight: np.ndarray) -> tuple[Any, list[None]]:
        parameters = self.near(y, weight, self.nearest(y, weight)[0])
        jacobian = np.stack(
            [
                (change_at(*(parameters + h).T) - change_at(*(parameters - h).T)) / 2e-5
                for h in 1e-5 * np.eye(2)
            ],
            1,
        )
        information = (jacobian * weight[:, None]) @ np.swapaxes(jacobian, 1, 2)
        contacts = np.ones(len(y), int)
        contacts[-1] = 2  # whatever it is, one contact does not explain it
        so = change_at(*parameters.T)
        chi2 = np.where(contacts == 1, (weight * (y - so) ** 2).sum(1), 1e9)
        none, wide = np.zeros(len(y)), np.full((len(y), 1, 1, 2), np.nan)
        best = Explanations(
            chi2, chi2.copy(), contacts, parameters, jacobian, information, none, none, none,
            so, none[:, None, None], weight.copy(), 0 * y, wide, none[:, None, None],
            jacobian,
        )  # fmt: skip
        self.seconds, self.asked = none, self.asked + len(y)
        return best, [None] * len(y)


def test_loads_of_readings_without_it(shown: Discrepancy) -> None:
    """Forces lose the model's error, and their intervals hold what is left of it."""
    angles, forces = np.linspace(-1.5, 1.5, 91), np.geomspace(0.1, 20.0, 24)
    so = np.stack([change_at(angles, np.full(91, f)) for f in forces], 1)
    none = np.zeros((91, 24))
    grid = np.repeat(forces[None], 91, 0)
    table = LoadTable(angles, grid, so, np.zeros(8), none, none, none[:, 0])
    own, selection = ReadingDiscrepancy(shown, table), _OneContact()
    told, true = made(2, 40, 0.02)
    y = told.change + true
    weight = 1 / (4 + (2.5e-3 * told.change) ** 2)
    before = selection.explain(y, weight)[0].parameters[:, 1] / told.force - 1
    selection.asked = 0
    readings, weights, left, found, _ = own.explain(selection, y, weight)  # type: ignore[arg-type]
    assert selection.asked < 1.5 * len(y)  # others are explained by a step
    np.testing.assert_array_equal(readings[-1], y[-1])
    assert not left[-1].any()
    best, _ = selection.explain(readings, weights)
    sizes = np.sqrt(np.diagonal(np.linalg.inv(best.information), axis1=1, axis2=2))
    assert np.abs((found.parameters - best.parameters) / sizes).max() < 1e-3
    np.testing.assert_allclose(found.chi2[:-1], best.chi2[:-1], rtol=1e-3)
    after = best.parameters[:, 1] / told.force - 1
    assert np.median(np.abs(after[:-1])) < 0.3 * np.median(np.abs(before[:-1]))
    more = own.of_loads(best, left, 2)
    deviation = np.sqrt((np.linalg.inv(best.information) + more)[:, 1, 1]) / told.force
    assert np.mean(np.abs(after / deviation)[:-1] < 1.96) > 0.9
    assert np.isnan(more[-1]).sum() == 0
    assert not more[-1].any()


def test_a_skin_file_keeps_it(tmp_path: Path) -> None:
    presses, _ = made(0, 10, 0.02)
    presses.left[3, 2] = np.nan  # a reading that was left out
    found = Discrepancy(presses, Numbers(0.02, 0.01, 0.3, 0.5, 1.0), TAXELS)
    document = tomlkit.parse(SKIN.read_text())
    document["calibration"] = tomlkit.table()
    document["calibration"]["discrepancy"] = _discrepancy(found)
    file = tmp_path / "unit.toml"
    file.write_text(tomlkit.dumps(document))
    angles, forces = np.linspace(-1.5, 1.5, 46), np.geomspace(0.1, 20.0, 13)
    so = np.stack([change_at(angles, np.full(46, f)) for f in forces], 1)
    none = np.zeros((46, 13))
    grid = np.repeat(forces[None], 46, 0)
    table = LoadTable(angles, grid, so, np.zeros(8), none, none, none[:, 0])
    own = ReadingDiscrepancy.of(load_skin(file), table, TAXELS)
    assert own is not None
    for told, kept in zip(
        ReadingDiscrepancy(found, table).under(presses.angle, presses.force),
        own.under(presses.angle, presses.force),
        strict=True,
    ):
        np.testing.assert_allclose(kept, told, atol=1e-3 * np.abs(told).max())
    assert ReadingDiscrepancy.of(load_skin(SKIN), table, TAXELS) is None
    with pytest.raises(ValueError, match="8 numbers a press for the skin's 7 taxels"):
        ReadingDiscrepancy.of(load_skin(file), table, TAXELS[:7])


def test_a_record_of_other_shape_is_refused() -> None:
    rows = ((1.0, 2.0),)
    told = {
        "common": 0.01, "pattern": 0.01, "apart": 0.3, "along": 0.5, "force": 1.0,
        "angles": (0.1,), "forces": (5.0,), "changes": rows, "left": rows, "noise": rows,
        "places": rows, "pushes": rows,
    }  # fmt: skip
    assert DiscrepancySpec(**told).angles == (0.1,)
    for key, value, said in (
        ("left", ((1.0,),), "left: 1 rows of 2 numbers"),
        ("forces", (5.0, 6.0), "one for each of angles"),
        ("noise", ((0.0, 1.0),), "above zero"),
        ("places", ((np.nan, 1.0),), "finite"),
    ):
        with pytest.raises(ValueError, match=said):
            DiscrepancySpec(**told | {key: value})
