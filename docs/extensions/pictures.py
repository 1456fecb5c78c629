"""Pictures of the pages that commands make.

    python docs/extensions/pictures.py [NAME ...]

runs the commands of all pictures, or of the named ones, and writes docs/NAME.png.
"""

import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[2]
PICTURES = {
    "press": ("suas solve configs/scenes/press.toml --plot picture.png",),
    "pad": ("suas solve configs/scenes/pad_fingers.toml --plot picture.png",),
    "wall": ("suas sweep configs/scenes/case_b.toml --force 0:60:31 --plot picture.png",),
    "hold": (
        "suas sweep configs/scenes/hold.toml --history configs/scenes/hold.csv "
        "--plot picture.png",
    ),
    "modes": ("suas modes configs/scenes/film.toml --plot picture.png",),
    "loads": (
        "suas simulate configs/scenes/press_path.csv -o press.csv",
        "suas invert configs/skins/suas.toml press.csv --plot picture.png",
    ),
    "health": (
        "suas simulate configs/scenes/press_path.csv -o press.csv",
        "suas health press.csv --skin configs/skins/suas.toml --plot picture.png",
    ),
    "test_file": ("suas data configs/data/treloar1944_uniaxial.csv --plot picture.png",),
    "rubber": (
        "suas fit material --law ogden --terms 3 "
        "--data uniaxial=configs/data/treloar1944_uniaxial.csv "
        "--data equibiaxial=configs/data/treloar1944_equibiaxial.csv "
        "--data pure_shear=configs/data/treloar1944_pure_shear.csv --plot picture.png",
    ),
    "indentation": ("suas sweep configs/scenes/body.toml --depth 0:4:41 --plot picture.png",),
    "range": ("suas range configs/skins/suas.toml --plot picture.png",),
    "calibration": (
        "suas simulate configs/scenes/press_path.csv -o press.csv",
        "suas fit sensor configs/skins/suas.toml press.csv --plot picture.png",
    ),
    "loads_pad": (
        "suas simulate configs/scenes/pad_slide.csv -o slide.csv",
        "suas invert configs/skins/suas-pad.toml slide.csv --plot picture.png",
    ),
}
"""Command lines by the name of the picture; the last one writes it."""

ELSEWHERE = {
    "as_built": "benchmarks/as_built.py",
    "prestress_forces": "benchmarks/prestress_forces.py",
    "run_time_error": "benchmarks/run_time_error.py",
    "view_": "docs/view.md",
}
"""Beginnings of the names of other pictures, and what they are made by or shots of."""

_WIDTH = 1300  # the widest picture [px]


def make(name: str) -> None:
    """Run the commands of a picture and write it into docs."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "configs").symlink_to(ROOT / "configs")
        for line in PICTURES[name]:
            words = ["-c", "from fitting.cli.app import main; main()", *shlex.split(line)[1:]]
            subprocess.run([sys.executable, *words], cwd=folder, check=True)
        picture = Image.open(folder / "picture.png").convert("RGB")
        if picture.width > _WIDTH:
            size = (_WIDTH, round(picture.height * _WIDTH / picture.width))
            picture = picture.resize(size, Image.Resampling.LANCZOS)
        picture.save(ROOT / "docs" / f"{name}.png", optimize=True)


if __name__ == "__main__":
    for wanted in sys.argv[1:] or PICTURES:
        make(wanted)
