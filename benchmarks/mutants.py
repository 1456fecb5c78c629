"""Mutants drawn by a library: the share of random mistakes in the heart that tests notice.

    python -m venv .venv/.mutants
    .venv/.mutants/bin/python -m pip install cosmic-ray==8.7.0
    .venv/.mutants/bin/python -m benchmarks.mutation_library            every module below
    .venv/.mutants/bin/python -m benchmarks.mutation_library cobs laws  those with such a name
    .venv/.mutants/bin/python -m benchmarks.mutation_library --per-module 100 --seed 1

Cosmic-ray makes the mistakes: another operator or comparison, a number one larger or smaller,
a condition the wrong way round, a loop that doesn't run. Of each module a random sample is
drawn that spreads over its places before it returns to one. A mutant is killed if tests fail
that pass without it, can't be collected, or take far longer. Survivors are printed;
`mutation_survivors.py` says of those that were judged why they do no harm, and they count as
survivors all the same. Mutants are made in a temporary copy of the tree, one at a time. Exit
status 1 if fewer than 90 % were killed.

`mutation.py` has mistakes that were thought out.
"""

import argparse
import ast
import pathlib
import random
import sys
import time
from collections import Counter
from typing import NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

from benchmarks.mutation_runner import LONGEST, ROOT, Verdict, copied, run_tests
from benchmarks.mutation_survivors import EQUIVALENT

WANTED = 0.9


class Module(NamedTuple):
    """A module and what must notice its mutants.

    Attributes:
        file: from the root of the tree.
        tests: test files.
        only: which of their tests, as pytest's -k; the others don't concern the module.
        most: mutants of it at most, where it is small or its tests are slow.
    """

    file: str
    tests: str
    only: str = ""
    most: int = 1000


FORMATS = "suas_jax/acquisition/frames/formats"
LAWS = "suas_jax/constitutive/laws"
MODULES = (
    Module(f"{FORMATS}/cobs.py", "tests/test_frames.py"),
    Module(f"{FORMATS}/text.py", "tests/test_frames.py"),
    Module("suas_jax/acquisition/integrity.py", "tests/test_integrity.py"),
    Module("suas_jax/acquisition/device_clock.py", "tests/test_integrity.py"),
    Module("suas_jax/acquisition/baseline.py", "tests/test_baseline.py"),
    Module("suas_jax/config/quantities.py", "tests/test_config.py tests/test_config_errors.py"),
    Module("suas_jax/config/units.py", "tests/test_config.py tests/test_config_errors.py"),
    Module("suas_jax/files/writing.py", "tests/test_files.py", "not special_files"),
    Module("suas_jax/skin/oils/compressible.py", "tests/test_oil.py", most=10),
    Module("suas_jax/skin/oils/aerated.py", "tests/test_oil.py", most=15),
    Module("suas_jax/numerics/bspline.py", "tests/test_bspline.py"),
    Module(
        "suas_jax/numerics/block_tridiagonal.py",
        "tests/test_linear_solve.py",
        "dense_algebra or inertia or pivot or products or singular",
        12,
    ),
    Module("suas_jax/numerics/hermite.py", "tests/test_element.py", most=10),
    Module("suas_jax/numerics/quadrature.py", "tests/test_element.py", most=10),
    Module("suas_jax/sensing/converter.py", "tests/test_sensing.py", "converter or scales"),
    Module(f"{LAWS}/neo_hookean.py", "tests/test_laws.py", "neo-hookean", 8),
    Module(f"{LAWS}/mooney_rivlin.py", "tests/test_laws.py", "mooney-rivlin", 8),
    Module(f"{LAWS}/yeoh.py", "tests/test_laws.py", "yeoh", 8),
    Module(f"{LAWS}/polynomial.py", "tests/test_laws.py", "polynomial", 8),
    Module(f"{LAWS}/gent.py", "tests/test_laws.py", "gent", 8),
    Module(f"{LAWS}/arruda_boyce.py", "tests/test_laws.py", "arruda-boyce", 12),
    Module(f"{LAWS}/carroll.py", "tests/test_laws.py", "carroll", 12),
    Module(f"{LAWS}/ogden.py", "tests/test_laws.py", "ogden or refused", 12),
    Module("fitting/statistics/residuals.py", "tests/test_linear_model.py"),
    Module("fitting/statistics/identifiability.py", "tests/test_linear_model.py"),
    Module(
        "fitting/statistics/laplace.py",
        "tests/test_posterior.py",
        "known_gaussian or laplace or skewed",
    ),
    Module("fitting/inverse_load/drift.py", "tests/test_drift.py"),
    Module("fitting/inverse_load/live/filter.py", "tests/test_inverse_load.py", "filter"),
    Module("fitting/material/data/numbers.py", "tests/test_material_data.py", "not command"),
)

# Operators by the groups in which one is mistaken for another. Cosmic-ray also writes `a | b`
# for `a + b`, which no number with a fraction survives: it would raise the share for nothing.
_GROUPS = (
    {"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"},
    {"RShift", "LShift", "BitOr", "BitAnd", "BitXor"},
    {"Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"},
    {"Is", "IsNot"},
)


def plausible(operator: str) -> bool:
    """Whether mutants of an operator of cosmic-ray tell something about the tests."""
    kind, *pair = operator.removeprefix("core/").split("_")
    if kind in ("ReplaceBinaryOperator", "ReplaceComparisonOperator"):
        return any(set(pair) <= group for group in _GROUPS)
    # Without its decorator a class can't be imported, and a cached function is only slower.
    return kind != "RemoveDecorator"


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


def computed(source: str) -> str | None:
    """What a source computes, without the types that are only read; None if it is no Python.

    The operators of types (`int | None`) and the star in front of keywords, for which it
    writes a slash, are operators to cosmic-ray, too.
    """
    try:
        return ast.dump(_WithoutTypes().visit(ast.parse(source)))
    except (SyntaxError, ValueError):
        return None


def sample(source: str, most: int, draw: random.Random) -> list[str]:
    """Mutants of a source, no two the same, first one of each place."""
    tree = get_ast(source)
    found = []
    for name in filter(plausible, operator_names()):
        if get_operator(name).arguments():
            continue
        operator = get_operator(name)()
        places = (at for node in ast_nodes(tree) for at in operator.mutation_positions(node))
        found += [(name, nth, at) for nth, at in enumerate(places)]
    draw.shuffle(found)
    seen: Counter = Counter()
    turns = []
    for name, nth, at in found:
        turns.append((seen[at], name, nth))
        seen[at] += 1
    turns.sort(key=lambda turn: turn[0])
    known, mutants = {computed(source), None}, []
    for _, name, nth in turns:
        if len(mutants) == most:
            break
        try:
            mutant = mutate_code(source, get_operator(name)(), nth)
        except AttributeError:  # it can't replace an exception with a dot in its name
            continue
        meaning = computed(mutant) if mutant else None
        if meaning not in known:
            known.add(meaning)
            mutants.append(mutant)
    return mutants


def difference(source: str, mutant: str) -> str:
    """The line that was changed, before and after."""
    pairs = zip(source.splitlines(), mutant.splitlines(), strict=False)
    old, new = next((a.strip(), b.strip()) for a, b in pairs if a != b)
    return f"{old} -> {new}"


def judge(module: Module, copy: pathlib.Path, options: argparse.Namespace) -> tuple[int, int]:
    """Try a module's mutants; how many there were, and how many of them were killed."""
    file = copy / module.file
    right = file.read_text()
    mutants = sample(
        right,
        min(module.most, options.per_module),
        random.Random(f"{options.seed} {file.name}"),
    )

    def tried(limit: float) -> Verdict:
        return run_tests(
            copy, module.tests, only=module.only, limit=limit, python=options.python
        )

    sound = tried(LONGEST)
    if sound.outcome != "passed":
        sys.exit(f"{module.tests}: fails without a mutant")
    survivors = []
    start = time.perf_counter()
    for mutant in mutants:
        file.write_text(mutant)
        if tried(30.0 + 5.0 * sound.seconds).outcome == "passed":
            survivors.append(difference(right, mutant))
    file.write_text(right)
    killed = len(mutants) - len(survivors)
    seconds = time.perf_counter() - start
    print(f"{len(mutants):7} {killed:7} {len(survivors):9} {seconds:6.0f} s  {module.file}")
    for survivor in survivors:
        why = EQUIVALENT.get(module.file, {}).get(survivor)
        print(f"{'':10}{survivor}\n{'':14}{'SURVIVED' if why is None else why}")
    sys.stdout.flush()
    return len(mutants), killed


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("words", nargs="*", help="of the modules' paths; all by default")
    parser.add_argument("--per-module", type=int, default=25, help="mutants at most")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument(
        "--python", default=str(ROOT / ".venv/bin/python"), help="that runs the tests"
    )
    options = parser.parse_args()
    chosen = [
        m for m in MODULES if not options.words or any(w in m.file for w in options.words)
    ]
    total = killed = 0
    print("mutants  killed  survived      time  module", flush=True)
    with copied(options.python) as copy:
        for module in chosen:
            of_module, killed_of_module = judge(module, copy, options)
            total += of_module
            killed += killed_of_module
    print(f"{killed} of {total} killed, {100 * killed / max(total, 1):.1f} %")
    return int(killed < WANTED * total)


if __name__ == "__main__":
    sys.exit(main())
