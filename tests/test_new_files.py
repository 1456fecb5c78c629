"""`suas new`: files that load, solve, and cover the whole pad."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fitting.cli.app import app
from suas_jax.config import load_scene, load_skin
from suas_jax.scene.build import plan_for
from suas_jax.sensing.taxels import taxel_places
from suas_jax.sensing.tiling import pad_layout


def suas(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["new", *map(str, arguments)])
    return done.exit_code, done.output


PADS = ("4x8", "1x1", "5x12", "3 x 10")


@pytest.mark.parametrize(
    ("pad", "section"),
    [*((pad, "circle") for pad in (None, *PADS)), (None, "ellipse"), (None, "flat-topped")],
)
def test_new_files_load(pad: str | None, section: str, tmp_path: Path) -> None:
    skin, scene = tmp_path / "skins" / "mine.toml", tmp_path / "scene.toml"
    skin.parent.mkdir()
    options = ("--section", section) if pad is None else ("--pad", pad)
    assert suas("skin", skin, *options)[0] == 0
    assert suas("scene", scene, "--skin", skin) == (0, f"{scene}: suas solve {scene}\n")
    spec = load_scene(scene)
    assert spec.geometry.dimension == (2 if pad is None else 3)
    plan_for(spec, "shell", (16,) if pad is None else (16, 12))  # places lie on the section
    assert 'skin = "skins/mine.toml"' in scene.read_text()
    for file in (skin, scene):
        lines = [line for line in file.read_text().splitlines() if " = " in line[:40]]
        assert sum("#" in line for line in lines) >= 4  # commented


def test_triangles_cover_the_whole_pad(tmp_path: Path) -> None:
    skin = tmp_path / "pad.toml"
    suas("skin", skin, "--pad", "4x8")
    spec = load_skin(skin)
    assert spec.electrodes is not None
    places = np.array([*taxel_places(spec.electrodes, spec.geometry).values()])
    assert len(places) == 320
    degrees = np.rad2deg(places[:, 0] / 52.5e-3)
    # The last discs end within one spacing of the taxels from all four edges.
    assert 80 < degrees.max() < 90
    assert -90 < degrees.min() < -80
    assert 52e-3 < places[:, 1].max() < 61.5e-3 - 2e-3
    np.testing.assert_allclose(places.mean(0), 0.0, atol=1e-6)
    # No two electrodes of 4 mm overlap.
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    assert apart[~np.eye(320, dtype=bool)].min() > 4e-3


def test_the_shipped_pad_is_such_a_layout() -> None:
    """24 mm triangles: those of the paper, at the places of configs/skins/suas-pad.toml."""
    spec = load_skin(Path("configs/skins/suas-pad.toml"))
    assert spec.electrodes is not None
    edge = 24e-3
    found = pad_layout(
        4, 8, wall_radius=52.5e-3, half_angle=9 * edge / 4 / 52.5e-3, width=2 * 3**0.5 * edge
    )
    assert found.edge == pytest.approx(edge)
    for module, triangle in zip(spec.electrodes.modules, found.triangles, strict=True):
        assert (module.angle, module.axial, module.rotation, module.pitch) == pytest.approx(
            (*triangle, found.pitch), abs=1e-6
        )


@pytest.mark.parametrize("pad", ["8", "0x4", "20x40", "4x-8", "12x16", "axb"])
def test_a_layout_that_is_none_is_refused(pad: str, tmp_path: Path) -> None:
    status, output = suas("skin", tmp_path / "skin.toml", "--pad", pad)
    assert status == 2
    assert "--pad" in output
    assert not list(tmp_path.iterdir())


def test_a_file_is_not_replaced_unasked(tmp_path: Path) -> None:
    skin = tmp_path / "skin.toml"
    skin.write_text("mine")
    assert suas("skin", skin)[0] == 2
    assert skin.read_text() == "mine"
    assert suas("skin", skin, "--overwrite")[0] == 0


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--section", "square"), "allowed: circle"),
        (("--section", "ellipse", "--pad", "4x8"), "leave"),
    ],
)
def test_sections_that_no_skin_file_begins_with(
    options: tuple[str, ...], text: str, tmp_path: Path
) -> None:
    status, said = suas("skin", tmp_path / "a.toml", *options)
    assert status == 2
    assert text in said
    assert not (tmp_path / "a.toml").exists()
