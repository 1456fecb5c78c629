"""Whatever goes wrong ends in one line, a status, and with --json an object."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from rich.table import Table

from fitting.cli import contract
from suas_jax.acquisition.terminal import new_console

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


@pytest.mark.parametrize("as_json", [False, True])
def test_too_little_memory_is_said(as_json: bool) -> None:
    done = suas("solve", str(SCENE), *["--json"] * as_json, shell='ulimit -v 1500000; "$@"')
    assert done.returncode == 2
    assert done.stderr.startswith("suas: not enough memory: ulimit -v allows 1.54 GB; commands")
    assert done.stderr.count("\n") == 1
    assert not as_json or json.loads(done.stdout)["status"] == "out_of_memory"


def test_commands_that_compute_nothing_run_in_little_memory(tmp_path: Path) -> None:
    shell = 'ulimit -v 700000; "$@"'
    assert suas("--version", shell=shell).returncode == 0
    log = ("socket://127.0.0.1:9", "-o", str(tmp_path / "log.csv"), "--format", "text")
    done = suas("log", *log, shell=shell)
    assert done.returncode == 2
    assert "127.0.0.1:9" in done.stderr  # where nothing listens


@pytest.mark.parametrize(
    ("end", "status", "said"),
    [
        ("os.abort()", 2, "suas: not enough memory: ulimit -v allows"),
        ("os.write(2, b'a warning'); sys.exit(3)", 3, "a warning"),
        ("os.kill(os.getpid(), signal.SIGTERM)", 128 + signal.SIGTERM, ""),
    ],
)
def test_what_becomes_of_a_limited_command(end: str, status: int, said: str) -> None:
    program = (
        "import os, signal, sys\n"
        "from fitting.cli.limited_memory import run_in_child_where_limited as run\n"
        f"run(); os.write(2, b'terminate called') if {status} == 2 else None; {end}"
    )
    shell = ["bash", "-c", 'ulimit -v 8000000; "$@"', "_", sys.executable, "-c", program]
    done = subprocess.run(shell, capture_output=True, text=True, timeout=60)
    assert done.returncode == status
    assert done.stderr.startswith(said)
    assert "terminate" not in done.stderr


def test_a_device_that_is_not_there_is_named() -> None:
    for name in ("cuda", "nonsense"):
        done = suas("solve", str(SCENE), shell=f'JAX_PLATFORMS={name} "$@"')
        assert done.returncode == 2
        assert done.stderr == (
            f'suas: JAX_PLATFORMS is "{name}", but JAX finds no such device here: unset the '
            'variable, or set it to "cpu"\n'
        )


@pytest.mark.parametrize("module", ["typer", "fitting.cli.solve", "jax"])
def test_ctrl_c_during_imports(module: str) -> None:
    program = f"""
import importlib.abc, signal, sys
class Interrupt(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
sys.argv = ["suas", "solve", {str(SCENE)!r}, "--json"]
from fitting.cli.app import main
main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "suas: interrupted\n")
    assert json.loads(done.stdout) == {"status": "interrupted", "message": "interrupted"}


def test_ctrl_c_in_a_finaliser_is_not_lost() -> None:
    program = """
import signal, sys, time
from fitting.cli import contract
class Last:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
def command(app):
    sys.argv, last = ["suas"], Last()
    del last
    time.sleep(20)
run = contract.run
contract.run = lambda app: run(lambda: command(app))
from fitting.cli.app import main
main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "suas: interrupted\n")


HOSTILE = "\x1b[31ma\n\x9b\u202e\u2066\udcff.toml"


@pytest.mark.parametrize(
    "arguments",
    [
        ["solve", HOSTILE],
        ["solve", HOSTILE, "--json"],
        ["solve", str(SCENE), f"--{HOSTILE}"],
        [HOSTILE],
        ["fit", "material", "--law", HOSTILE, "--data", f"uniaxial={HOSTILE}"],
        ["log", HOSTILE, "-o", HOSTILE, "--format", "text", "--duration", "1"],
        ["examples", HOSTILE],
    ],
)
def test_names_never_move_the_terminal(arguments: list[str], tmp_path: Path) -> None:
    done = subprocess.run(
        [*SUAS, *arguments],
        capture_output=True,
        cwd=tmp_path,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )
    said = (done.stdout + done.stderr).decode()
    assert "\\x1b[31ma" in said.replace("\\\\", "\\")
    assert all(c.isprintable() or c == "\n" for c in said)
    if "--json" in arguments:
        assert json.loads(done.stdout)["status"] == "bad_input"


def test_tables_never_move_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(title=HOSTILE)
    table.add_column(HOSTILE)
    table.add_row(HOSTILE)
    console = new_console(force_terminal=True)
    with console.capture() as shown:
        console.print(HOSTILE, table, markup=False)
    assert "\x1b[31m" not in shown.get()
    assert shown.get().count("\\x1b[31ma") >= 2
    assert not set("\x9b\u202e\u2066\udcff") & set(shown.get())
