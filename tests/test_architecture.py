"""The direction of imports: along the data flow, and from fitting to the model only."""

import ast
import re
import subprocess
import sys

import pytest
from import_graph import PAGE, ROOT, cycle, folder_imports, imports, modules, written

# The data flow; a file may import from its own layer and from those before it.
LAYERS = {
    "suas_jax": [
        ["files"],
        ["numerics", "runtime", "config"],
        ["acquisition"],  # the serial logger: without the model, and without JAX
        ["constitutive", "skin"],
        ["mesh"],
        ["mechanics"],
        ["equilibrium", "sensing"],
        ["scene"],
        ["dynamics"],
        ["simulation", "figures"],
    ],
    "fitting": [
        [
            "arrays",
            "steps",
            "credential",
            "json_text",
            "column_units",
            "report",
            "surroundings",
            "workers",
        ],
        ["statistics"],
        ["material", "sensor"],
        ["inverse_load"],
        ["force_range", "calibration", "robotics", "view"],
        ["datasheet"],
        ["design"],
        ["cli"],
    ],
}


def layer_of(module: str) -> int:
    """Position of a file in the data flow of its package."""
    package, name = module.split(".")[:2]
    found = [i for i, layer in enumerate(LAYERS[package]) if name in layer]
    assert found, f"{module} belongs to no layer: add its folder to LAYERS"
    return found[0]


@pytest.mark.parametrize("module", [name for name in modules() if "." in name])
def test_imports_follow_the_data_flow(module: str) -> None:
    package = module.split(".")[0]
    imported = [name for name in imports()[module] if "." in name]
    if package == "suas_jax":
        assert not [name for name in imported if name.startswith("fitting")]
    own = [name for name in imported if name.startswith(package)]
    assert not [name for name in own if layer_of(name) > layer_of(module)]


def test_statistics_know_no_laws() -> None:
    own = [name for name in modules() if name.startswith("fitting.statistics.")]
    used = {part.split(".")[1] for name in own for part in imports()[name] if "." in part}
    assert used <= {"arrays", "statistics", "files", "runtime"}


def test_no_file_imports_itself_through_others() -> None:
    assert cycle(imports()) == []


def test_no_folder_imports_itself_through_others() -> None:
    assert cycle(folder_imports()) == []


def test_a_circle_of_imports_is_found() -> None:
    assert cycle({"a": {"b"}, "b": {"c"}, "c": {"d", "b"}, "d": set()}) == ["b", "c", "b"]
    assert cycle({"a": {"b", "c"}, "b": {"d"}, "c": {"d"}, "d": set()}) == []


def test_the_page_shows_the_folders_of_the_code() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == written(page), "write it again: python tests/import_graph.py"


def test_the_model_has_folders_alone_at_its_top() -> None:
    files = {file.name for file in (ROOT / "suas_jax").glob("*.py")}
    assert files <= {"__init__.py", "_version.py"}


@pytest.mark.parametrize(
    ("modules", "absent"),
    [
        ("suas_jax, suas_jax.config, fitting.cli.commands", {"jax", "matplotlib", "scipy"}),
        # A robot's estimator starts in a second; `test_pad_estimation` has a whole frame.
        (
            "fitting.inverse_load.estimator, fitting.inverse_load.pad.parts",
            {"jax", "equinox", "matplotlib"},
        ),
    ],
)
def test_what_computes_nothing_with_jax_starts_without(modules: str, absent: set[str]) -> None:
    program = f"import sys, {modules}; sys.exit(sorted({absent} & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


def test_one_module_writes_to_the_terminal() -> None:
    """It escapes what a terminal would obey."""
    files = [*(ROOT / "suas_jax").rglob("*.py"), *(ROOT / "fitting").rglob("*.py")]
    writing = re.compile(r"\btyper\.echo\(|\bConsole\(|(?<![\w.])print\(")
    found = [file.name for file in files if writing.search(file.read_text(encoding="utf-8"))]
    assert found == ["terminal.py"]


def test_functions_have_fewer_than_80_lines() -> None:
    """Of their bodies: a command's options, and a docstring, are not part of what it does."""
    long = {}
    for file in (*(ROOT / "suas_jax").rglob("*.py"), *(ROOT / "fitting").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                body = node.body[ast.get_docstring(node) is not None :] or node.body
                length = (body[-1].end_lineno or 0) - body[0].lineno + 1
                if length >= 80:
                    long[node.name] = length
    assert not long


# The declaration of a section says whether it is a circle; a circle's table is checked by
# itself; a specimen is a tube.
ROUND = {
    "suas_jax/config/consistency.py",
    "suas_jax/config/geometry.py",
    "suas_jax/constitutive/specimens/inflation.py",
}
# What works with circles alone, or takes a shorter way for them: the list only gets shorter.
STILL_ROUND = {
    "fitting/cli/new.py",
    "fitting/inverse_load/estimate/place.py",
    "suas_jax/figures/outline.py",
    "suas_jax/mesh/section.py",
    "suas_jax/scene/observables.py",
}


def test_the_skin_alone_knows_that_it_may_be_a_circle() -> None:
    """By its radius, its declaration, or the sine or cosine of a place's angle."""
    known = re.compile(
        r"\b(inner_radius|CircleSpec|is_circle)\b|\.circle\(|\b(sin|cos)\([\w.]*\bangle\b"
    )
    files = {
        file.relative_to(ROOT).as_posix(): file.read_text(encoding="utf-8")
        for package in ("suas_jax", "fitting")
        for file in (ROOT / package).rglob("*.py")
    }
    found = {name for name, text in files.items() if known.search(text)}
    own = ("suas_jax/skin/", "suas_jax/config/sections/")
    assert {name for name in found if not name.startswith(own)} - ROUND == STILL_ROUND
