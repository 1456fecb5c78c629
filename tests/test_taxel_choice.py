"""Which taxels are kept: against every choice, the bound of the relaxed problem, skin files."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from fitting.arrays import Floats
from fitting.design.design import skin_with_taxels
from fitting.design.taxels import Variances, select
from fitting.design.want import load_want
from suas_jax import skin_of
from suas_jax.config import ConfigError, load_skin

ROOT = Path(__file__).parent.parent
WANT = ROOT / "configs" / "design" / "fewer_taxels.toml"


def bumps(taxels: int, places: int, seed: int) -> Floats:
    """Slopes of readings that see a contact of their surroundings, by place and force."""
    at, contact = np.linspace(0, 1, taxels), np.linspace(0.1, 0.9, places)
    away = (at[:, None] - contact) / 0.15
    size = np.random.default_rng(seed).uniform(0.5, 1.5, (taxels, 1)) * np.exp(-(away**2) / 2)
    return np.stack([10 * size * away, 3 * size])


def of_choice(columns: Floats, chosen: tuple[int, ...], which: int) -> float:
    """The worst deviation with some taxels, by inversion place by place."""
    found = []
    for rows in np.moveaxis(columns[:, list(chosen)], -1, 0):
        found.append(np.linalg.inv(rows @ rows.T)[which, which])
    return float(np.sqrt(max(found)))


@pytest.mark.parametrize(("of_force", "which"), [(True, 1), (False, 0)])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_choice_is_better_by_much_and_none_below_the_bound(
    of_force: bool, which: int, seed: int
) -> None:
    columns = bumps(12, 9, seed)
    found = select(Variances(columns, of_force=of_force), 6)
    every = [of_choice(columns, c, which) for c in itertools.combinations(range(12), 6)]
    kept = tuple(np.flatnonzero(found.kept).tolist())
    assert len(kept) == 6
    assert found.chosen.max() == pytest.approx(of_choice(columns, kept, which), rel=1e-6)
    assert found.every.max() == pytest.approx(of_choice(columns, (*range(12),), which))
    assert found.chosen.max() < 1.03 * min(every)
    assert 0.8 * min(every) < found.bound <= min(every)
    dearest = int(np.nanargmax(found.costs))
    without = np.where(np.arange(12) == dearest, 0.0, found.kept)
    variance, _ = Variances(columns, of_force=of_force)(without)
    loss = np.max(np.sqrt(variance) / found.chosen) - 1
    assert found.costs[dearest] == pytest.approx(loss, rel=1e-5)


def test_variances_fall_by_a_taxel_as_their_derivatives_say() -> None:
    variances = Variances(bumps(12, 5, 3), of_force=True)
    weights = np.random.default_rng(0).uniform(0.2, 1.0, 12)
    _, slope = variances(weights)
    for i in range(12):
        step = np.where(np.arange(12) == i, 1e-5, 0.0)
        change = (variances(weights + step)[0] - variances(weights - step)[0]) / 2e-5
        np.testing.assert_allclose(-change, slope[i], rtol=1e-6, atol=1e-9)


def test_a_contact_that_too_few_taxels_see_has_no_variance() -> None:
    columns = bumps(12, 5, 3)
    variance, _ = Variances(columns, of_force=True)(np.eye(12)[0])
    assert np.isinf(variance).all()
    with pytest.raises(ValueError, match="from 3 to 11 of the 12 taxels"):
        select(Variances(columns, of_force=True), 12)
    columns[:, :, 2] = 0.0
    with pytest.raises(ValueError, match="do not tell the figure at every place"):
        select(Variances(columns, of_force=True), 6)


@pytest.mark.parametrize("name", ["suas", "suas-pad"])
def test_the_skin_file_has_the_taxels_that_are_kept(tmp_path: Path, name: str) -> None:
    skin = (ROOT / "configs/skins" / f"{name}.toml").read_text()
    gains = ", ".join(f"{1 + 0.01 * k:g}" for k in range(10))
    skin = skin.replace('rotation = "0 deg"', f'rotation = "0 deg", gains = [{gains}]')
    (tmp_path / "skin.toml").write_text(skin.replace('"-70 deg"', '"-70 deg", gain = 1.02'))
    text = WANT.read_text().replace("../skins/suas-pad", str(tmp_path / "skin"))
    (tmp_path / "want.toml").write_text(text.replace("160", "5"))
    want = load_want(tmp_path / "want.toml")
    kept, output = [0, 2, 3, 6, 7], tmp_path / "fewer.toml"
    output.write_text(skin_with_taxels(want, kept, output))
    every, some = (skin_of(s, contact=False).electrodes for s in (want.spec, load_skin(output)))
    for column in ("angle", "axial", "diameter"):
        expected = np.asarray(getattr(every.taxels, column))[kept]
        np.testing.assert_allclose(getattr(some.taxels, column), expected, rtol=1e-8)
    lsb = np.broadcast_to(every.lsb, (len(every.taxels.angle), 1))[kept]
    assert np.ptp(lsb) > 0
    np.testing.assert_allclose(some.lsb, lsb, rtol=1e-8)
    if name == "suas-pad":
        assert "# module 0, taxel" in output.read_text()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("keep = 160", "keep = 0", "at least 1"),
        ("keep", "kept", 'did you mean "keep"'),
        ('"force_resolution_N"', '"range_N"', "allowed beside"),
        ("[at]", '[variables]\n"geometry.oil_gap" = ["2 mm", "8 mm"]\n[at]', "no meaning"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = WANT.read_text().replace("../skins", str(ROOT / "configs/skins"))
    start = text.index("[taxels]")
    (tmp_path / "want.toml").write_text(text[:start] + text[start:].replace(old, new, 1))
    with pytest.raises(ConfigError, match=words):
        load_want(tmp_path / "want.toml")
