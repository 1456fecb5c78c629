"""What `make` installs: every dependency pinned for every Python, and each file by its hash."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCK = (ROOT / "requirements.lock").read_text()
PINS = [block.split(" \\\n") for block in re.split(r"\n(?=\S)", LOCK.strip())]
PYTHONS = [
    found[1]
    for line in PROJECT["classifiers"]
    if (found := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", line))
]


@pytest.mark.parametrize("python", PYTHONS)
def test_every_dependency_is_pinned_within_its_bounds(python: str) -> None:
    environment = {"python_version": python, "python_full_version": f"{python}.9"}
    pins = {}
    for pin in (Requirement(lines[0]) for lines in PINS):
        if pin.marker is None or pin.marker.evaluate(environment):
            name = canonicalize_name(pin.name)
            assert name not in pins, f"{name} is pinned twice on Python {python}"
            pins[name] = str(pin.specifier).removeprefix("==")
    wanted = [*PROJECT["dependencies"]]
    for extra, needed in PROJECT["optional-dependencies"].items():
        wanted += needed if extra != "peers" else []  # those are for benchmarks alone
    for requirement in map(Requirement, wanted):
        pinned = pins.get(canonicalize_name(requirement.name))
        assert pinned, f"{requirement.name} is not in the lock; run `make lock`"
        assert requirement.specifier.contains(pinned), f"{requirement}: the lock has {pinned}"


def test_every_pin_has_hashes_and_nothing_names_a_place() -> None:
    assert "://" not in LOCK
    for pin, *hashes in PINS:
        assert re.fullmatch(r"[\w.-]+==[\w.]+( ; .+)?", pin), pin
        assert hashes, f"{pin} has no hash; run `make lock`"
        assert all(re.fullmatch(r" +--hash=sha256:[0-9a-f]{64}", line) for line in hashes), pin
