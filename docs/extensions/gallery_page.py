"""The gallery: short programs of public names with their figures, and the notebooks."""

import base64
import contextlib
import io
import json
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image

ROOT = Path(__file__).parents[2]
PROGRAMS = sorted((ROOT / "docs" / "gallery").glob("*.py"))
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LONGEST = 25
"""Lines of a program of the gallery."""
_WIDTH = 480  # of a thumbnail [px]

HEAD = """---
html_theme.sidebar_secondary.remove: true
---

# Gallery

Programs of at most 25 lines, which the build of this site runs, and notebooks with the outputs
of their last run.

"""


class Tile(NamedTuple):
    """A picture, its title, and where it leads."""

    picture: str
    title: str
    link: str


def page(folder: Path) -> str:
    """The page, in MyST Markdown; thumbnails and figures go into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    sections, tiles = [], []
    for program in PROGRAMS:
        title, section = _program(program, folder)
        tiles.append(Tile(f"gallery/{program.stem}.png", title, f"#{program.stem}"))
        sections.append(section)
    tiles += [_notebook(notebook, folder) for notebook in NOTEBOOKS]
    contents = "```{toctree}\n:hidden:\n:glob:\n\n/notebooks/*\n```\n"
    grid = "\n".join(["::::{grid} 1 2 3 3", ":gutter: 3", "", *map(_card, tiles), "::::", ""])
    return "\n".join([HEAD, contents, grid, *sections])


def _card(tile: Tile) -> str:
    kind = "ref" if tile.link.startswith("#") else "doc"
    lines = [":::{grid-item-card}", f":img-top: {tile.picture}", f":img-alt: {tile.title}"]
    link = tile.link.removeprefix("#")
    return "\n".join([*lines, f":link: {link}", f":link-type: {kind}", tile.title, ":::", ""])


def _program(file: Path, folder: Path) -> tuple[str, str]:
    """Title and section of a program; its figure is drawn where it isn't that of the file."""
    code = file.read_text(encoding="utf-8")
    figure, printed = folder / f"{file.stem}.png", folder / f"{file.stem}.txt"
    if not printed.exists() or not printed.read_text(encoding="utf-8").startswith(code):
        result, said = run(file)
        result.savefig(figure, dpi=100)
        printed.write_text(code + said, encoding="utf-8")
    said = printed.read_text(encoding="utf-8").removeprefix(code)
    title = re.sub(r"[:,].*", "", code.split('"""')[1]).rstrip(".")
    lines = [f"({file.stem})=", f"## {title}", "", "```python", code.rstrip(), "```", ""]
    if said:
        lines += ["```text", said.rstrip(), "```", ""]
    return title, "\n".join([*lines, f"![{title}](gallery/{file.stem}.png)", ""])


def run(file: Path) -> tuple[Any, str]:
    """The figure that a program leaves, and what it prints."""
    said = io.StringIO()
    with contextlib.chdir(ROOT), contextlib.redirect_stdout(said):
        names = runpy.run_path(str(file))
    return names["figure"], said.getvalue()


def pictures(notebook: Path) -> Iterator[bytes]:
    """The pictures among a notebook's outputs."""
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                yield base64.b64decode("".join(data["image/png"]))


def _notebook(file: Path, folder: Path) -> Tile:
    """The tile of a notebook, with its first picture."""
    with Image.open(io.BytesIO(next(pictures(file)))) as picture:
        image = picture.convert("RGB")
        image.thumbnail((_WIDTH, _WIDTH), Image.Resampling.LANCZOS)
        image.save(folder / f"{file.stem}.png")
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    text = "".join(next(cell["source"] for cell in cells if cell["cell_type"] == "markdown"))
    title = text.splitlines()[0].removeprefix("# ")
    return Tile(f"gallery/{file.stem}.png", title, f"/notebooks/{file.stem}")
