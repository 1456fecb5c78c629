"""Whatever goes wrong ends in one line, a status, and with --json an object."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer

from fitting.cli import contract

SUAS = [sys.executable, "-c", "from fitting.cli.app import main; main()"]
SCENE = Path(__file__).parent.parent / "configs" / "scenes" / "case_b.toml"


def raising(error: BaseException) -> Callable[[], None]:
    def program() -> None:
        raise error

    return program


FAILURES = [
    (MemoryError("Unable to allocate 9.0 GiB"), 2, "out_of_memory", "not enough memory"),
    (RuntimeError("RESOURCE_EXHAUSTED: Out of memory"), 2, "out_of_memory", "not enough"),
    (RecursionError("maximum recursion depth"), 2, "bad_input", "nested too deeply"),
    (OverflowError("math range error"), 2, "bad_input", "too large to compute with"),
    (KeyboardInterrupt(), 130, "interrupted", "interrupted"),
    (FileNotFoundError(2, "No such file", "a.csv"), 2, "bad_input", "a.csv: No such file"),
    (OSError(28, "No space left on device"), 2, "bad_input", "No space left on device"),
    (ValueError("force: unknown unit"), 2, "bad_input", "force: unknown unit"),
    (ZeroDivisionError("a\nb"), 2, "internal_error", "internal error: ZeroDivisionError: a b"),
]


@pytest.mark.parametrize("as_json", [False, True])
@pytest.mark.parametrize("failure", FAILURES, ids=lambda f: type(f[0]).__name__)
def test_every_failure_is_one_line_and_a_status(
    failure: tuple[BaseException, int, str, str],
    as_json: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    error, status, name, words = failure
    monkeypatch.setattr(sys, "argv", ["suas", *(["--json"] if as_json else [])])
    assert contract.run(raising(error)) == status
    out, err = capsys.readouterr()
    assert err.startswith("suas: ")
    assert err.count("\n") == 1
    assert words in err
    if as_json:
        told = json.loads(out)
        assert told == {"status": name, "message": err.removeprefix("suas: ").strip()}
    else:
        assert out == ""


@pytest.mark.parametrize("failure", FAILURES, ids=lambda f: type(f[0]).__name__)
def test_inside_a_command_too(failure: tuple[BaseException, int, str, str]) -> None:
    error, status, name, _ = failure
    expected = BaseException if name in ("interrupted", "internal_error") else typer.Exit

    def command() -> None:
        with contract.bad_input():
            raise error

    with pytest.raises(expected) as raised:
        command()
    assert getattr(raised.value, "exit_code", status) == status


def suas(*arguments: str, shell: str = '"$@"') -> subprocess.CompletedProcess[str]:
    command = ["bash", "-c", f"set -o pipefail; {shell}", "_", *SUAS, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize(
    ("shell", "words"),
    [
        ('"$@" >/dev/full', "No space left on device"),
        ('"$@" >&-', "standard output: is closed"),
        ('{ sleep 0.5; "$@"; } | true', "standard output: is closed"),  # the reader has gone
    ],
)
@pytest.mark.parametrize("arguments", [["--version"], ["--help"]])
def test_an_output_that_takes_nothing(shell: str, words: str, arguments: list[str]) -> None:
    done = suas(*arguments, shell=shell)
    assert done.returncode == 2, done
    assert done.stderr.count("\n") == 1, done.stderr
    assert words in done.stderr


def test_all_streams_may_be_closed(tmp_path: Path) -> None:
    done = suas("solve", str(tmp_path / "none.toml"), shell='"$@" >&- 2>&- <&-')
    assert (done.returncode, done.stdout, done.stderr) == (2, "", "")


def test_wrong_usage_is_an_object_too() -> None:
    done = suas("solve", "--json", "--nonsense")
    assert done.returncode == 2
    assert json.loads(done.stdout)["status"] == "bad_input"


def test_bad_input_is_an_object_with_the_message() -> None:
    done = suas("solve", "nowhere/none.toml", "--json")
    assert done.returncode == 2
    assert json.loads(done.stdout) == {
        "status": "bad_input",
        "message": "nowhere/none.toml: no such file",
    }
    assert done.stderr == "suas: nowhere/none.toml: no such file\n"


@pytest.mark.parametrize("name", ["S.toml", "skin.toml"])
def test_a_sweep_never_replaces_its_scene_or_skin(tmp_path: Path, name: str) -> None:
    skin = SCENE.parent.parent / "skins" / "suas.toml"
    (tmp_path / "skin.toml").write_bytes(skin.read_bytes())
    text = SCENE.read_text().replace("../skins/suas.toml", "skin.toml")
    (tmp_path / "S.toml").write_text(text)
    before = (tmp_path / name).read_bytes()
    arguments = ["sweep", str(tmp_path / "S.toml"), "--force", "0:1:2"]
    done = suas(*arguments, "--csv", str(tmp_path / name), "--overwrite")
    assert done.returncode == 2
    assert "is an input of this command" in done.stderr
    assert (tmp_path / name).read_bytes() == before
