"""`suas tour`: its states are what the scenes give today, and its command lines parse."""

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
from test_documentation import ROOT, parse
from typer.testing import CliRunner

from benchmarks.tour_states import SCENES, answer, curves, solution_of
from fitting.cli.app import app
from fitting.cli.tour import NEXT, STATES

KEPT = dict(zip(SCENES, json.loads(STATES.read_text(encoding="utf-8")), strict=True))


def leaves(tree: object) -> list[object]:
    if isinstance(tree, dict):
        tree = [x for pair in tree.items() for x in pair]
    return [x for y in tree for x in leaves(y)] if isinstance(tree, list) else [tree]


def differences(kept: dict[str, Any], now: dict[str, Any]) -> list[tuple[object, object]]:
    pairs = zip(leaves(kept), leaves(now), strict=True)
    return [
        (a, b)
        for a, b in pairs
        if not (isinstance(b, float) and a == pytest.approx(b, rel=1e-4)) and a != b
    ]


def test_the_answer_is_what_the_scene_gives() -> None:
    now = answer("press", solution_of("press").report)
    kept = {key: KEPT["press"][key] for key in now}
    assert differences(kept, now) == []
    changed = now | {"oil_pressure_Pa": 1.001 * now["oil_pressure_Pa"]}
    assert len(differences(kept, changed)) == 1


@pytest.mark.long  # a pad's program, and that of a section's curves
@pytest.mark.parametrize("name", SCENES)
def test_pad_and_curves_are_what_the_scenes_give(name: str) -> None:
    solution = solution_of(name)
    assert differences(KEPT[name], answer(name, solution.report) | curves(solution)) == []


def test_the_tour_prints_pictures_and_what_to_do_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figure = tmp_path / "tour.png"
    monkeypatch.chdir(ROOT)
    done = CliRunner().invoke(app, ["tour", "--plot", str(figure)])
    assert done.exit_code == 0, done.output
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert done.stdout.count("█") > 30
    for line in (line for lines in NEXT.values() for line in lines):
        assert line in done.stdout
        parse(line)
        files = [word for word in shlex.split(line) if "configs/" in word]
        assert all((ROOT / word.split("=")[-1]).exists() for word in files)
    assert "suas examples" not in done.stdout  # they are here already: it would refuse
    monkeypatch.chdir(tmp_path)
    assert "suas examples" in CliRunner().invoke(app, ["tour"]).stdout
    again = CliRunner().invoke(app, ["tour", "--json"])
    assert json.loads(again.stdout)["scenes"] == list(KEPT.values())
