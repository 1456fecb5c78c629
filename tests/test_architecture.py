"""The direction of imports: along the data flow, and from fitting to the model only."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
# The data flow; a module may import from its own layer and from those before it.
LAYERS = [
    ["files"],
    ["numerics", "runtime", "config"],
    ["acquisition"],  # the serial logger: without the model, and without JAX
    ["constitutive", "skin"],
    ["mesh"],
    ["mechanics"],
    ["equilibrium", "sensing"],
    ["scene"],
    ["simulation", "figures"],
]


def layer_of(module: str) -> int:
    """Position of a module of suas_jax in the data flow."""
    name = module.split(".")[1]
    found = [i for i, layer in enumerate(LAYERS) if name in layer]
    assert found, f"{module} belongs to no layer: add it to LAYERS"
    return found[0]


def imports_of(path: Path) -> set[str]:
    """Modules of this project that a file imports, inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {name for name in found if name.split(".")[0] in ("suas_jax", "fitting")}


def modules(package: str) -> list[tuple[str, Path]]:
    files = sorted((ROOT / package).rglob("*.py"))
    return [(".".join(f.relative_to(ROOT).with_suffix("").parts), f) for f in files]


@pytest.mark.parametrize(("module", "path"), modules("suas_jax"))
def test_imports_follow_the_data_flow(module: str, path: Path) -> None:
    imported = imports_of(path)
    assert not [name for name in imported if name.startswith("fitting")]
    if module == "suas_jax.__init__":
        return
    own = layer_of(module)
    later = [n for n in imported if n.count(".") and layer_of(n) > own]
    assert not later


def test_commands_that_compute_nothing_start_without_jax() -> None:
    program = (
        "import sys, suas_jax, suas_jax.config, fitting.cli.app;"
        "sys.exit(sorted({'jax', 'matplotlib', 'scipy'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
