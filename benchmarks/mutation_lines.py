"""Pytest plugin of `mutation.py record`: which lines each test executes, and how long it takes.

A fixture that several tests share runs within the first of them: its lines and its processor
time are kept apart, and belong to each test that uses it. What JAX traces for one test it knows
for the next ones of the same file: lines of traced code are found with the first test alone.
"""

import json
import os
import pathlib
from collections import defaultdict
from collections.abc import Iterator

import coverage
import pytest

from benchmarks.mutants import PACKAGES, ROOT

LINES = ROOT / ".venv/.mutants/lines"
"""One JSON file for each test file."""


def _processor_seconds() -> float:
    return sum(os.times()[:4])  # those of child processes, too


class _Recorder:
    """Contexts of coverage: a test's own, and one for each fixture that is shared."""

    def __init__(self) -> None:
        # Only what is imported from here on is measured: nothing of both packages yet.
        source = [str(ROOT / package) for package in PACKAGES]
        self._coverage = coverage.Coverage(data_file=None, source=source, config_file=False)
        self._seconds: dict[str, float] = defaultdict(float)
        self._shared: dict[str, list[str]] = {}
        self._open: list[str] = []
        self._since = 0.0
        self._coverage.start()

    def _switch(self) -> None:
        now = _processor_seconds()
        if self._open:
            self._seconds[self._open[-1]] += now - self._since
        self._since = now

    def _within(self, context: str) -> Iterator[None]:
        self._switch()
        self._open.append(context)
        self._coverage.switch_context(context)
        try:
            return (yield)
        finally:
            self._switch()
            self._open.pop()
            self._coverage.switch_context(self._open[-1] if self._open else "")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        return (yield from self._within(item.nodeid))

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef, request: pytest.FixtureRequest
    ) -> Iterator[None]:
        if fixturedef.scope == "function":
            return (yield)
        return (yield from self._within(_name(fixturedef, getattr(request, "param", None))))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Function) -> Iterator[None]:
        parameters = item.callspec.params if hasattr(item, "callspec") else {}
        self._shared[item.nodeid] = [
            _name(found[-1], parameters.get(name))
            for name, found in item._fixtureinfo.name2fixturedefs.items()
            if found[-1].scope != "function"
        ]
        return (yield)

    def pytest_sessionfinish(self) -> None:
        self._coverage.stop()
        measured = self._coverage.get_data()
        lines: dict[str, dict[str, set[int]]] = defaultdict(lambda: defaultdict(set))
        for place in measured.measured_files():
            file = str(pathlib.Path(place).relative_to(ROOT))
            for line, contexts in measured.contexts_by_lineno(place).items():
                for context in contexts:
                    lines[context][file].add(line)
        tests: dict[str, dict[str, object]] = defaultdict(dict)
        for test, shared in self._shared.items():
            whole: dict[str, set[int]] = defaultdict(set)
            for context in (test, *shared):
                for file, numbers in lines[context].items():
                    whole[file] |= numbers
            tests[test.partition("::")[0]][test] = {
                "seconds": sum(self._seconds[context] for context in (test, *shared)),
                "lines": {file: sorted(numbers) for file, numbers in whole.items()},
            }
        LINES.mkdir(parents=True, exist_ok=True)
        for file, of_file in tests.items():
            (LINES / f"{pathlib.Path(file).stem}.json").write_text(json.dumps(of_file))


def _name(fixture: pytest.FixtureDef, parameter: object) -> str:
    return f"{fixture.baseid}::{fixture.argname}[{parameter!r}]"


def pytest_configure(config: pytest.Config) -> None:
    """Begin before anything of both packages is imported."""
    config.pluginmanager.register(_Recorder())
