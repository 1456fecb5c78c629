"""Imports between the files and folders of the two packages, read off the code.

`python tests/import_graph.py` writes the table of docs/architecture.md again; the site draws
the imports above it.
"""

import ast
import functools
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "architecture.md"
_BEGIN, _END = "<!-- folders: begin -->", "<!-- folders: end -->"
# How many parts of a file's path are shown as its folder, by package.
_DEPTH = {"suas_jax": 2, "fitting": 3}

Graph = dict[str, set[str]]


@functools.cache
def modules() -> dict[str, Path]:
    """Every file of both packages by the name it is imported by."""
    found = {}
    for package in _DEPTH:
        for file in sorted((ROOT / package).rglob("*.py")):
            parts = file.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


@functools.cache
def imports() -> Graph:
    """Files of the project that each file imports: on top, in functions, for types alone.

    Python also runs the `__init__` of every folder above an imported file; that is no import
    here, so a folder's `__init__` may gather names from its own files.
    """
    files = modules()
    graph: Graph = {}
    for module, file in files.items():
        named = set()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                own = (f"{node.module}.{alias.name}" for alias in node.names)
                named |= {name if name in files else node.module for name in own}
            elif isinstance(node, ast.Import):
                named |= {alias.name for alias in node.names}
        graph[module] = named & files.keys()
    return graph


def folder_of(module: str) -> str:
    """The folder that a file is shown in, such as `fitting.sensor.logs`."""
    parts = module.split(".")
    folder = parts if modules()[module].name == "__init__.py" else parts[:-1]
    return ".".join(folder[: _DEPTH[parts[0]]])


@functools.cache
def folder_imports() -> Graph:
    """Folders that each folder imports."""
    graph: Graph = {}
    for module, found in imports().items():
        own = folder_of(module)
        graph.setdefault(own, set())
        graph[own] |= {folder_of(other) for other in found} - {own}
    imported = set().union(*graph.values())
    return {name: found for name, found in graph.items() if found or name in imported}


def cycle(graph: Mapping[str, set[str]]) -> list[str]:
    """A circle of imports, first and last alike; empty if there is none."""
    done: set[str] = set()

    def search(path: list[str]) -> list[str]:
        for other in sorted(graph.get(path[-1], ())):
            if other in path:
                return [*path[path.index(other) :], other]
            if other not in done and (found := search([*path, other])):
                return found
        done.add(path[-1])
        return []

    return next((found for start in sorted(graph) if (found := search([start]))), [])


def table() -> str:
    """The folders and what each holds."""
    rows = [
        f"| `{name.replace('.', '/')}` | {_holds(name)} |" for name in sorted(folder_imports())
    ]
    return "\n".join(["| folder | holds |", "|---|---|", *rows, ""])


def _holds(name: str) -> str:
    source = (ROOT / name.replace(".", "/") / "__init__.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").splitlines()[0].rstrip(".")


def written(page: str) -> str:
    """The page with the table as the code has it now."""
    before, _, rest = page.partition(_BEGIN)
    _, _, after = rest.partition(_END)
    return f"{before}{_BEGIN}\n\n{table()}\n{_END}{after}"


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
