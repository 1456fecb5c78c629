"""Mutants of both packages, drawn by cosmic-ray: single mistakes, evenly over the code.

Another operator or comparison, a number one larger or smaller, a condition the wrong way
round, a loop that doesn't run. Places are drawn, and one mistake at each.
"""

import ast
import pathlib
import random
from typing import NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

ROOT = pathlib.Path(__file__).resolve().parent.parent
PACKAGES = ("suas_jax", "fitting")

# Operators by the groups in which one is mistaken for another. Cosmic-ray also writes `a | b`
# for `a + b`, which no number with a fraction survives: it would raise the share for nothing.
_GROUPS = (
    {"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"},
    {"RShift", "LShift", "BitOr", "BitAnd", "BitXor"},
    {"Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"},
    {"Is", "IsNot"},
)


class Mutant(NamedTuple):
    """A mistake."""

    file: str  # from the root of the tree
    line: int  # where it is, from 1
    change: str  # that line before and after
    source: str  # of the whole file with it
    right: str  # the same without it


def _plausible(operator: str) -> bool:
    """Whether mutants of an operator of cosmic-ray tell something about the tests."""
    kind, *pair = operator.removeprefix("core/").split("_")
    if kind in ("ReplaceBinaryOperator", "ReplaceComparisonOperator"):
        return any(set(pair) <= group for group in _GROUPS)
    # Without its decorator a class can't be imported, and a cached function is only slower.
    return kind != "RemoveDecorator" and not get_operator(operator).arguments()


class _WithoutTypes(ast.NodeTransformer):
    """Takes annotations out, and how arguments may be passed."""

    def visit_arguments(self, node: ast.arguments) -> ast.arguments:
        self.generic_visit(node)
        first = [*node.posonlyargs, *node.args]
        missing = [None] * (len(first) - len(node.defaults))
        defaults = [*missing, *node.defaults, *node.kw_defaults]
        node.args, node.posonlyargs, node.kwonlyargs = [*first, *node.kwonlyargs], [], []
        node.defaults = [default or ast.Constant(...) for default in defaults]
        node.kw_defaults = []
        return node

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AnnAssign:
        self.generic_visit(node)
        node.annotation = ast.Constant(None)
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        self.generic_visit(node)
        node.returns = None
        return node

    def visit_Call(self, node: ast.Call) -> ast.Call:
        """`zip` as it is without `strict`: no program is meant to reach what that refuses."""
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id == "zip":
            node.keywords = []
        if isinstance(node.func, ast.Name) and node.func.id == "dataclass":
            node.keywords = []
        return node


def _computed(source: str) -> str | None:
    """What a source computes; None if it is not Python.

    The types are only read, and their operators (`int | None`) are operators to cosmic-ray,
    too, like the star in front of keywords, for which it writes a slash. What is frozen, or
    zipped strictly, computes what it would without.
    """
    try:
        return ast.dump(_WithoutTypes().visit(ast.parse(source)))
    except (SyntaxError, ValueError):
        return None


def draw(
    count: int,  # how many
    seed: int,  # of the draw
    words: list[str],  # one of which a file's path contains; all files if there are none
) -> list[Mutant]:
    """Mutants at random places of both packages, no place twice."""
    files = sorted(f for package in PACKAGES for f in (ROOT / package).rglob("*.py"))
    files = [f for f in files if not words or any(w in str(f.relative_to(ROOT)) for w in words)]
    random_ = random.Random(seed)
    # A file has about as many places as it has nodes.
    sizes = [sum(1 for _ in ast.walk(ast.parse(file.read_text()))) for file in files]
    drawn = random_.choices(range(len(files)), sizes, k=count)
    return [
        mutant
        for k in sorted(set(drawn))
        for mutant in _of_file(files[k], drawn.count(k), random_)
    ]


def _of_file(file: pathlib.Path, count: int, random_: random.Random) -> list[Mutant]:
    source, name = file.read_text(), str(file.relative_to(ROOT))
    tree, known = get_ast(source), _computed(source)
    by_place: dict[object, list[tuple[str, int]]] = {}
    nodes = list(ast_nodes(tree))
    for operator in filter(_plausible, operator_names()):
        own = get_operator(operator)()
        places = (at for node in nodes for at in own.mutation_positions(node))
        for nth, at in enumerate(places):
            by_place.setdefault(at, []).append((operator, nth))
    found: list[Mutant] = []
    for place in random_.sample(sorted(by_place), len(by_place)):
        operator, nth = random_.choice(by_place[place])
        try:
            mutant = mutate_code(source, get_operator(operator)(), nth)
        except AttributeError:  # it can't replace an exception with a dot in its name
            continue
        if mutant and _computed(mutant) not in (known, None):
            pairs = enumerate(zip(source.splitlines(), mutant.splitlines(), strict=False), 1)
            line, (old, new) = next((n, pair) for n, pair in pairs if pair[0] != pair[1])
            change = f"{old.strip()} -> {new.strip()}"
            found.append(Mutant(name, line, change, mutant, source))
        if len(found) == count:
            break
    return found
