"""What the pages print is what their commands print."""

import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_documentation import DOCS, FENCE, PAGES, ROOT
from typer.testing import CliRunner

from fitting.cli.app import app

pytestmark = pytest.mark.long  # the programs of a dozen commands

CHANGES = ("solve / compile", "estimated error of the gradient")
"""Lines of an answer that differ from run to run: times, and directions drawn at random."""


def shown(page: Path, words: str) -> list[str]:
    """Lines of the block of a page that holds some words, as wide as they are printed."""
    blocks = FENCE.findall(page.read_text(encoding="utf-8"))
    (found,) = (text for language, text in blocks if language == "text" and words in text)
    return [line.rstrip() for line in found.splitlines()]


def compared(lines: list[str]) -> Iterator[str]:
    for line in lines:
        if line and not line.lstrip().startswith(CHANGES):
            yield re.sub(r"\s+", " ", line).strip()


def printed(*arguments: str) -> list[str]:
    result = CliRunner(env={"COLUMNS": "80"}).invoke(app, list(arguments))
    assert result.exit_code == 0, result.output
    return list(compared(result.stdout.splitlines()))


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    monkeypatch.chdir(tmp_path)


def test_the_scene_of_the_start_page() -> None:
    found = printed("solve", "configs/scenes/press.toml", "--gradient", "min_gap_m")
    assert list(compared(shown(DOCS / "start.md", "smallest gap"))) == found


def test_the_membrane_of_the_start_page() -> None:
    data = [
        f"{mode}=configs/data/treloar1944_{mode}.csv"
        for mode in ("uniaxial", "equibiaxial", "pure_shear")
    ]
    options = [word for name in data for word in ("--data", name)]
    found = printed("fit", "material", "--law", "ogden", "--terms", "3", *options)
    expected = list(compared(shown(DOCS / "start.md", "shear modulus")))
    assert expected == found[: len(expected)]


def test_the_log_of_both_pages() -> None:
    printed("simulate", "configs/scenes/press_path.csv", "-o", "press.csv")
    fit = printed("fit", "sensor", "configs/skins/suas.toml", "press.csv")
    expected = list(compared(shown(DOCS / "start.md", "relative_permittivity")))
    assert expected == fit[: len(expected)]
    loads = printed("invert", "configs/skins/suas.toml", "press.csv")
    assert set(compared(shown(ROOT / "README.md", "no_contact"))) <= set(loads)


_ANSWERED = re.compile(
    r"```console\n\$ suas ([^\n]*)\n[^`]*```\n\n```text\n(.*?)```", re.DOTALL
)
WEIGHT = """\
# scene: configs/scenes/press.toml
t_s,loads.0.force_N,loads.0.angle_deg
0,0,0
5,0,0
5.5,4.903,0
12,4.903,0
"""
"""Half a kilogram at the crown, after five seconds of rest."""


def answered() -> list[tuple[str, str]]:
    """The first command of a block whose answer stands below it, and the answer."""
    pages = [page for page in PAGES if page.stem != "start"]
    return [x for page in pages for x in _ANSWERED.findall(page.read_text(encoding="utf-8"))]


@pytest.mark.parametrize(("line", "answer"), answered(), ids=lambda text: text[:60])
def test_lines_of_an_answer_on_a_guide(line: str, answer: str) -> None:
    words = shlex.split(line, comments=True)
    if "--plot" in words:
        at = words.index("--plot")
        del words[at : at + 2]
    if "press.csv" in words:
        printed("simulate", "configs/scenes/press_path.csv", "-o", "press.csv")
    if "weight.csv" in words:
        Path("path.csv").write_text(WEIGHT, encoding="utf-8")
        printed("simulate", "path.csv", "-o", "weight.csv")
    shown_lines = list(compared(answer.splitlines()))
    assert shown_lines
    assert set(shown_lines) <= set(printed(*words))
