"""The pages: keys and commands that are described, code that runs, commands that parse."""

import ast
import importlib
import inspect
import io
import json
import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
from PIL import Image
from rich.text import Text

from fitting.cli.app import app
from fitting.cli.commands import EXAMPLES, commands_of
from fitting.inverse_load.estimate.estimate import Contact, LoadEstimate, Tap
from fitting.inverse_load.estimate.load_field import Interval, LoadField
from fitting.inverse_load.report.frame_keys import CONTACT_KEYS, FIELD_KEYS, FRAME_KEYS
from fitting.inverse_load.report.text import frame_json
from suas_jax import load_scene
from suas_jax.config.validation import TABLES

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
sys.path.append(str(DOCS / "extensions"))

import drawings  # noqa: E402
import gallery_page  # noqa: E402
import names_page  # noqa: E402
import pictures  # noqa: E402
import report_page  # noqa: E402
import specification_page  # noqa: E402

PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
SPECIFICATIONS = [spec for specifications in TABLES.values() for spec in specifications]
FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def with_nested(specification: type[Any]) -> Iterator[type[Any]]:
    yield specification
    for field in specification.model_fields.values():
        for nested in specification_page.specifications_in(field.annotation):
            yield from with_nested(nested)


@pytest.mark.parametrize("specification", SPECIFICATIONS, ids=lambda s: s.__name__)
def test_every_key_of_a_file_is_described(specification: type[Any]) -> None:
    page = specification_page.page()
    for spec in with_nested(specification):
        meanings = specification_page.described_keys(spec)
        for key, field in spec.model_fields.items():
            if key in ("law", "model", "kind", "section"):
                continue  # they choose the specification
            assert meanings.get(key), f"{spec.__name__}.{key}: the docstring says nothing"
            assert field.examples, f"{spec.__name__}.{key}: no example"
            assert f"| `{key}` |" in page
            if "..." not in field.examples[0]:
                tomllib.loads(f"key = {field.examples[0]}")


def test_pages_of_the_code_state_what_the_code_has() -> None:
    geometry = specification_page.page().split("## `[material]`")[0]
    row = "| `width` | a length; greater than zero | required | extent along the axis |"
    assert row in geometry
    assert '`section = "ellipse"`' in geometry
    assert "| `oil_pressure_Pa` | pressure of the oil above ambient |" in report_page.page()
    assert ".. autofunction:: suas_jax.solve\n" in names_page.page("suas_jax")
    assert ".. autoclass:: fitting.LoadEstimator\n" in names_page.page("fitting")


def parse(line: str) -> None:
    """Let the program's parser read a command line, and run nothing."""
    words = shlex.split(line)[1:]
    command: Any = typer.main.get_command(app)
    while hasattr(command, "commands") and words:
        command = command.commands[words.pop(0)]
    if words:
        command.make_context("suas", words)


def test_every_command_has_examples_that_parse() -> None:
    assert {command.words for command in commands_of(app)} == set(EXAMPLES)
    for words, lines in EXAMPLES.items():
        for line in lines:
            assert line.startswith(f"suas {words}")
            parse(line)


def test_the_help_shows_tables_and_units_as_they_are_written() -> None:
    """Rich takes [lower case] for a style and leaves it out."""
    texts = []
    for command in commands_of(app):
        assert command.registered.callback is not None
        texts.append(inspect.getdoc(command.registered.callback) or "")
        parsed: Any = typer.main.get_command_from_info(
            command.registered, pretty_exceptions_short=True, rich_markup_mode="rich"
        )
        texts += [parameter.help or "" for parameter in parsed.params]
    assert any("[mm]" in Text.from_markup(text).plain for text in texts)
    for text in texts:
        assert Text.from_markup(text).plain == text.replace("\\[", "[")


def command_lines(page: Path) -> Iterator[str]:
    """The command lines of a page, without prompts, comments, pipes and redirections."""
    for language, block in FENCE.findall(page.read_text(encoding="utf-8")):
        if language not in ("", "console"):
            continue
        for line in block.replace("\\\n", " ").splitlines():
            line = re.sub(r"^(\$ )?(\.venv/bin/)?(?=suas )", "", line)
            # Square brackets mark what may be left out: a synopsis, not a command.
            if line.startswith("suas ") and "[" not in line:
                yield re.split(r"\s[|>]|\s#", line)[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_command_lines_of_the_pages_parse(page: Path) -> None:
    for line in command_lines(page):
        parse(line)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_code_of_the_pages_fits_the_column_at_1280_px(page: Path) -> None:
    blocks = FENCE.findall(page.read_text(encoding="utf-8"))
    lines = [line for _, block in blocks for line in block.split("\n")]
    assert [line for line in lines if len(line) > 96] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_line_of_a_page_is_lost_as_a_comment(page: Path) -> None:
    """The site takes a line that begins with a per cent sign for a comment."""
    prose = FENCE.sub("", page.read_text(encoding="utf-8"))
    assert re.findall(r"^\s*%.*", prose, re.MULTILINE) == []


GUIDES = re.findall(r"^(\w+)$", (DOCS / "guides.md").read_text(encoding="utf-8"), re.MULTILINE)
FORMATS = ("log_format", "firmware_frames")  # what is looked up, not followed


@pytest.mark.parametrize("name", [name for name in GUIDES if name not in FORMATS])
def test_a_guide_is_short_and_begins_with_its_command(name: str) -> None:
    page = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    prose = FENCE.sub("", page)
    assert len(re.findall(r"\S*\w\S*", prose)) <= 600
    if name not in ("tolerances", "material_files"):
        assert FENCE.findall(page)[0][0] == "console"


def test_the_pages_have_command_lines() -> None:
    assert len([line for page in PAGES for line in command_lines(page)]) > 30


def test_a_wrong_option_is_noticed() -> None:
    with pytest.raises(Exception, match="--plott"):
        parse("suas solve scene.toml --plott figure.png")


def is_there(name: str) -> bool:
    """Whether a dotted name of the code, or a file, exists."""
    if "/" in name:
        return (ROOT / name).exists()
    module, _, attribute = name.rpartition(".")
    try:
        importlib.import_module(name)
    except ImportError:
        return bool(module) and hasattr(importlib.import_module(module), attribute)
    return True


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_names_of_the_code_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    names = set(re.findall(r"`((?:suas_jax|fitting)[./][\w./]+\w)`", text))
    names |= set(re.findall(r"`((?:tests|benchmarks|configs|notebooks)/[\w./]+\w)`", text))
    if page.stem == "architecture":
        names = {name for name in names if "." in name}  # its table has a test of its own
    assert [n for n in sorted(names) if "NAME" not in n and not is_there(n)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_imports_of_the_page_are_there(page: Path) -> None:
    for language, block in FENCE.findall(page.read_text(encoding="utf-8")):
        if language == "python":
            lines = re.findall(r"^(?:from .* import .*|import .*)$", block, re.MULTILINE)
            exec("\n".join(lines), {})


def files_shown(page: str) -> Iterator[tuple[str, str]]:
    """Name and text of the files of `configs` that a page prints, named in their first line."""
    for language, block in FENCE.findall(page):
        if language == "toml" and (named := re.match(r"# (configs/\S+)\n", block)):
            yield named[1], block[named.end() :]


def files_that_differ(page: str) -> list[str]:
    """Names of the files that a page prints otherwise than they stand, but for their head."""
    wholes = (
        (n, text, (ROOT / n).read_text(encoding="utf-8")) for n, text in files_shown(page)
    )
    return [n for n, text, whole in wholes if text != re.sub(r"\A(#.*\n)*", "", whole)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_that_a_page_prints_are_as_they_stand(page: Path) -> None:
    assert files_that_differ(page.read_text(encoding="utf-8")) == []


def test_a_digit_of_a_file_that_drifts_is_noticed() -> None:
    page = (DOCS / "start.md").read_text(encoding="utf-8")
    assert files_that_differ(page.replace('"45 deg"', '"46 deg"', 1)) != []


@pytest.mark.parametrize("page", [DOCS / "start.md"], ids=lambda p: p.stem)
def test_a_first_page_runs_the_scene_that_it_prints(page: Path) -> None:
    ((name, _),) = files_shown(page.read_text(encoding="utf-8"))
    first = next(line for line in command_lines(page) if line.startswith("suas solve"))
    assert shlex.split(first)[2] == name
    # Whoever changes its force changes the answer.
    assert load_scene(ROOT / name).solve.oil_pressure is None


def gradients_shown() -> list[str]:
    """Command lines of the pages and of the help that differentiate."""
    lines = [line for page in PAGES for line in command_lines(page)]
    lines += [line for examples in EXAMPLES.values() for line in examples]
    return sorted({line for line in lines if "--gradient" in line})


def vanishes(line: str) -> bool:
    """Whether a command differentiates what its scene prescribes: all derivatives are zero."""
    words = shlex.split(line)
    scene, quantity = load_scene(ROOT / words[2]), words[words.index("--gradient") + 1]
    scaled = scene.solve.oil_pressure is not None
    pattern = "oil_pressure_Pa" if scaled else r"loads\.\d+\.force_N"
    return re.fullmatch(pattern, quantity) is not None


@pytest.mark.parametrize("line", gradients_shown())
def test_no_example_differentiates_what_its_scene_prescribes(line: str) -> None:
    assert not vanishes(line)


def test_a_derivative_that_vanishes_is_noticed() -> None:
    assert vanishes("suas solve configs/scenes/case_b.toml --gradient oil_pressure_Pa")
    assert vanishes("suas solve configs/scenes/press.toml --gradient loads.0.force_N")


def draws(source: str) -> bool:
    """Whether a cell of a notebook draws: defining a function that does is not drawing."""
    tree = ast.parse(re.sub(r"^%.*$", "", source, flags=re.MULTILINE))
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef):
            continue
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if name.startswith("plot_") or name in ("figure", "subplots"):
                return True
        waiting += ast.iter_child_nodes(node)
    return False


@pytest.mark.parametrize(
    "notebook", sorted((ROOT / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem
)
def test_cells_of_notebooks_that_draw_keep_their_pictures(notebook: Path) -> None:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    drawing = [cell for cell in code if draws("".join(cell["source"]))]
    assert [cell["source"] for cell in drawing if not has_picture(cell)] == []
    assert drawing


def has_picture(cell: dict[str, Any]) -> bool:
    kinds = {kind for output in cell["outputs"] for kind in output.get("data", {})}
    return bool(kinds & {"image/png", "image/gif"})


def test_a_cell_without_its_picture_is_noticed() -> None:
    assert draws("figure = plot_solution(solution)")
    assert not draws("def show(solution):\n    plot_solution(solution)")
    assert not has_picture({"outputs": [{"data": {"text/plain": "<Figure size 640x480>"}}]})


def has_all_colours(content: bytes) -> bool:
    true_colour, with_transparency = 2, 6  # 3 is a palette
    return content[25] in (true_colour, with_transparency)


@pytest.mark.parametrize("picture", sorted(DOCS.glob("*.png")), ids=lambda path: path.stem)
def test_pictures_have_all_their_colours(picture: Path) -> None:
    content = picture.read_bytes()
    assert has_all_colours(content)
    assert len(content) < 400_000


def test_every_picture_says_what_makes_it() -> None:
    for lines in pictures.PICTURES.values():
        for line in lines:
            parse(line)
        assert lines[-1].endswith("--plot picture.png")
    drawn = {path.stem for path in DOCS.glob("*.png")}
    assert pictures.PICTURES.keys() <= drawn
    others = drawn - pictures.PICTURES.keys()
    assert [name for name in others if not name.startswith(tuple(pictures.ELSEWHERE))] == []
    shown = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert [name for name in sorted(drawn) if f"{name}.png)" not in shown] == []


def test_a_palette_is_noticed() -> None:
    written = io.BytesIO()
    Image.new("RGB", (8, 8)).quantize(4).save(written, "png")
    assert not has_all_colours(written.getvalue())


@pytest.mark.parametrize("program", gallery_page.PROGRAMS, ids=lambda path: path.stem)
def test_programs_of_the_gallery_are_short_and_use_public_names(program: Path) -> None:
    code = program.read_text(encoding="utf-8")
    assert len(code.splitlines()) <= gallery_page.LONGEST
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            assert {name.name for name in node.names} == {"numpy"}
        elif isinstance(node, ast.ImportFrom) and node.module != "matplotlib.figure":
            names = {name.name for name in node.names}
            assert names <= set(importlib.import_module(str(node.module)).__all__)


def test_every_notebook_of_the_gallery_has_a_thumbnail() -> None:
    for notebook in gallery_page.NOTEBOOKS:
        assert next(gallery_page.pictures(notebook)).startswith(b"\x89PNG")


NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


@pytest.mark.parametrize("name", drawings.DRAWINGS)
def test_drawings_are_those_of_the_code(name: str) -> None:
    drawn = drawings.DRAWINGS[name]().text()
    kept = (drawings.FOLDER / f"{name}.svg").read_text(encoding="utf-8")
    assert NUMBER.sub("#", drawn) == NUMBER.sub("#", kept)
    # A tenth of a pixel, which is the last digit, goes either way where the rounding ties.
    own, other = (np.array(NUMBER.findall(text), float) for text in (drawn, kept))
    np.testing.assert_allclose(own, other, rtol=0, atol=0.11)


def test_keys_of_a_frame_are_described_and_occur() -> None:
    everything = Contact(
        0.1,
        1.0,
        0.0,
        np.eye(2),
        arc_position=0.0,
        systematic=np.eye(2),
        axial=0.0,
        diameter=0.0,
        spread=(0.0, 0.0),
        tilt=0.0,
        arc=0.0,
        by_arc=True,
        arc_extent=(0.0, 0.0),
        axial_extent=(0.0, 0.0),
        arc_force=(0.0, 0.0),
        axial_force=(0.0, 0.0),
    )
    one = Interval(0.0, 0.0, 0.0)
    field = LoadField(one, one, one, one, one, 0.0, arc=one, axial=one, axial_extent=one)
    estimate = LoadEstimate(
        True,
        (everything,),
        alternatives=(everything,),
        field=field,
        at_least=1.0,
        drift=(0.0, 0.0),
        tap=Tap(0.0, 0.1, everything, 0.0, 0.0),
    )
    line = frame_json(0.0, 1, estimate, filtered=[], dropped=0, posterior={})
    assert line.keys() == FRAME_KEYS.keys()
    assert line["loads"][0].keys() == {*CONTACT_KEYS, "spread_deviation_m"}
    told = {key.replace("_interval_", "_") for key in line["field"]}
    assert told == {key.replace("_interval_", "_") for key in FIELD_KEYS}
    assert FIELD_KEYS.keys() <= line["field"].keys()
