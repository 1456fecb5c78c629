"""Options that several commands share, and what is read of their values."""

import contextlib
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fitting.cli.progress import spinner
from suas_jax.acquisition.terminal import say
from suas_jax.files.reading import read_bytes
from suas_jax.files.writing import check_outputs
from suas_jax.runtime.registry import model_names

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from suas_jax.config import SceneSpec, SkinSpec
    from suas_jax.config.quantities import DimensionName


def option(text: str, *names: str, **rules: Any) -> Any:
    """An option of a command, described by a text."""
    return typer.Option(*names, help=_as_written(text), **rules)


def _as_written(text: str) -> str:
    """A text whose [tables] and [units] the help doesn't take for markup."""
    return re.sub(r"\[(?=[a-z])", r"\[", text)


def output_option(text: str, metavar: str = "FILE") -> Any:
    """The option of the file that a command writes."""
    return option(text, "-o", "--output", metavar=metavar)


def argument(text: str, **rules: Any) -> Any:
    """An argument of a command, described by a text."""
    return typer.Argument(help=_as_written(text), **rules)


Plot = Annotated[Path | None, option("Write a figure (PNG, PDF, SVG).")]

SceneFile = Annotated[Path, argument("Scene file (TOML).", metavar="SCENE")]
SkinFile = Annotated[Path, argument("Skin file (TOML).", metavar="SKIN")]
Noise = Annotated[
    float | None,
    option("Standard deviation of a reading, in counts; default: the skin file's."),
]
AsJson = Annotated[bool, option("Print JSON, SI units in the keys.", "--json")]
JsonOnly = Annotated[bool, option("Print JSON.", "--json")]
JsonInSI = Annotated[bool, option("Print JSON, SI units.", "--json")]
Chain = Annotated[
    Path | None, option("HDF5 file that keeps the chain; one that exists is resumed.")
]
CalibratedSkin = Annotated[
    Path | None,
    output_option(
        "Calibrated skin file; default: SKIN.calibrated.toml in this folder.", "SKIN.toml"
    ),
]
Baseline = Annotated[Path | None, option("Readings at rest, from `suas baseline`.")]
FORMAT_NAMES = model_names("suas_jax.acquisition.frames.formats")
Format = Annotated[
    str, option(f"Frames of a port: {', '.join(FORMAT_NAMES)}.", "--format", metavar="NAME")
]
Baud = Annotated[int, option("Bits per second of a port.", min=1)]
LivePort = Annotated[str | None, option("Port to read, as for `suas log`.", metavar="PORT")]
Duration = Annotated[float | None, option("Live: stop after this long.", min=0.0, metavar="S")]
SkinOfLog = Annotated[
    Path | None, option("Of a log: its skin file; default: the one that its header names.")
]
LoadsOfLog = Annotated[
    Path | None,
    option("Of a log: what `suas invert LOG --json` found; default: estimate.", metavar="FILE"),
]
TaxelsOnly = Annotated[bool, option("Of a log: leave the loads out.", "--taxels-only")]
PlaceError = Annotated[
    str,
    option("Of --fit as-built: standard deviation of the places of presses.", metavar="LENGTH"),
]
Sample = Annotated[bool, option("Sample the posterior of the constants (emcee).", "--sample")]
Walkers = Annotated[int, option("Number of walkers of the sampler, even.", min=4)]
Steps = Annotated[int, option("Largest number of steps; sampling stops when converged.", min=1)]
Model = Annotated[str | None, option('"auto", "shell" or "solid"; overrides the scene.')]
Rtol = Annotated[float | None, option("Wanted relative error; overrides the scene.")]

_MOST = 1024
_WHAT = "N processes, or on workers of a Dask scheduler (tls://host:port)"
Workers = Annotated[
    str | None,
    option(f"Compute a pad's table, or a design's starts, on {_WHAT}.", metavar="N|ADDRESS"),
]
ManyWorkers = Annotated[str, option(f"Calibrate on {_WHAT}.", "--workers", metavar="N|ADDRESS")]
TrustNetwork = Annotated[
    bool,
    option(
        "Also allow a scheduler at tcp://: anyone who can reach its port can run code as "
        "this user.",
        "--trust-network",
    ),
]


def quantity_option(option: str, text: str, dimension: "DimensionName") -> float:
    """SI value of an option such as ``--diameter "6 mm"``.

    Raises ValueError: not such a quantity; names the option.
    """
    from suas_jax.config.quantities import parse_quantity

    try:
        return parse_quantity(text, dimension)
    except ValueError as error:
        raise ValueError(f'{option} "{text}": {error}') from None


def check_files(
    *figures: Path | None, others: Iterable[Path | None] = (), overwrite: bool
) -> None:
    """Refuse figures of no known kind, and files that exist unless they may be replaced.

    Raises ValueError: names the file; OSError: it exists, or can't be written.
    """
    check_figures(*figures)
    check_outputs([*figures, *others], overwrite=overwrite)


@contextlib.contextmanager
def computing(
    what: str, workers: str | None = None, trust_network: bool = False, *, later: bool = False
) -> "Iterator[tuple[Callable[[str], None], Executor | None]]":
    """Set JAX up, and show on a terminal what is being done.

    `later`: not before something computes, see `suas_jax.runtime.start`. Yields a function that
    shows something else, and what `--workers` names.
    """
    with executor(workers, trust_network) as processes, spinner(what) as show:
        if later:
            from suas_jax.runtime.start import configure_when_computing

            configure_when_computing()
        else:
            from suas_jax.runtime.settings import configure

            configure()
        yield show, processes


def remark(*sentences: str) -> None:
    """Say on stderr what there is to be said; nothing where a sentence is empty."""
    for sentence in sentences:
        if sentence:
            say(f"suas: {sentence}", err=True)


def check_figures(*files: Path | None) -> None:
    """Refuse endings that no figure can have, with a ValueError; None asks for none."""
    for file in files:
        if file is not None:
            from suas_jax.figures.style import check_figure_file

            check_figure_file(file)


def was_written_by(command: str, path: Path) -> bool:
    """Whether a file has a command's mark: the next run may replace it under its own name."""
    from suas_jax.config.toml_file import MOST_BYTES

    if not path.is_file():
        return False
    return command in read_bytes(path, MOST_BYTES, remember=False).decode(errors="replace")


def named_values(text: str | None, option: str, example: str) -> dict[str, str]:
    """Values by name of an option such as --specimen "width=6 mm,thickness=2 mm".

    Raises ValueError: a part is not NAME=VALUE.
    """
    values = {}
    for part in (text or "").split(","):
        if not part.strip():
            continue
        name, equals, value = part.partition("=")
        if not equals or not value.strip():
            raise ValueError(f'{option} {text}: expected "{example}"')
        values[name.strip()] = value.strip()
    return values


def named_file(
    text: str, option: str = "--data", example: str = "uniaxial=A.csv"
) -> tuple[str, str]:
    """Name and file of an option such as --data uniaxial=A.csv.

    Raises ValueError: the name or the file is missing.
    """
    mode, equals, path = text.partition("=")
    if not equals or not path:
        raise ValueError(f"{option} {text}: expected NAME=FILE, for example {example}")
    return mode.strip(), path.strip()


def named_bounds(text: str) -> tuple[str, tuple[float, float]]:
    """Name and bounds of an option such as --bound alpha.0=1:3; either may be left open.

    Raises ValueError: it is not NAME=LOW:HIGH, or the bounds leave nothing between them.
    """
    name, _, limits = text.partition("=")
    low, colon, high = limits.partition(":")
    try:
        if not colon:
            raise ValueError
        ends = (float(low or "-inf"), float(high or "inf"))
    except ValueError:
        raise ValueError(
            f"--bound {text}: expected NAME=LOW:HIGH in SI units, for example alpha.0=1:3"
        ) from None
    if not ends[0] < ends[1]:
        raise ValueError(f"--bound {text}: the lower bound must be below the upper one")
    return name.strip(), ends


def pad_settings(
    diameter: str | None, pressure_noise: str | None, budget: str | None = None
) -> dict[str, float | None]:
    """What options say of contacts, pressure and time, in SI units; those given alone.

    A diameter is a length, or "free", which is None in the result. Raises ValueError: an option
    can't be understood.
    """
    settings: dict[str, float | None] = {}
    if diameter == "free":
        settings["diameter"] = None
    elif diameter is not None:
        settings["diameter"] = quantity_option("--diameter", diameter, "length")
    if pressure_noise is not None:
        noise = quantity_option("--pressure-noise", pressure_noise, "pressure")
        settings["pressure_noise"] = noise
    if budget is not None:
        settings["budget"] = quantity_option("--budget", budget, "time")
    return settings


def material_note(spec: "SkinSpec") -> dict[str, str]:
    """Say on stderr what is to be known of a skin's material; the same for a command's JSON."""
    note = spec.material.note
    if note is None:
        return {}
    say(f"suas: [material] {note}", err=True)
    return {"material_note": note}


def scene_of(path: Path, model: str | None, rtol: float | None) -> "SceneSpec":
    """The scene of a file; a model or a relative error that is given overrides the file's.

    Raises ConfigError: the file or an option can't be understood.
    """
    from suas_jax.config import load_scene, with_solve

    scene = load_scene(path)
    if model is not None:
        scene = with_solve(scene, source="--model", model=model)
    if rtol is not None:
        scene = with_solve(scene, source="--rtol", rtol=rtol)
    return scene


@contextlib.contextmanager
def executor(workers: str | None, trust_network: bool) -> "Iterator[Executor | None]":
    """What `--workers` names, until the block is left; None where it isn't given.

    Raises ValueError: it is neither a number of processes nor an address that is allowed;
    OSError: no scheduler answers at the address.
    """
    if workers is None:
        yield None
        return
    from fitting.workers import LocalWorkers, scheduler_workers

    found: contextlib.AbstractContextManager[Executor]
    if "://" in workers:
        found = scheduler_workers(workers, trust_network=trust_network)
    elif workers.isascii() and workers.isdigit() and 0 < int(workers) <= _MOST:
        found = LocalWorkers(int(workers), lambda lost: say(f"suas: {lost}", err=True))
    else:
        raise ValueError(
            f"--workers {workers}: a number of processes, 1 to {_MOST}, is needed, or the "
            "address of a Dask scheduler, tls://host:port"
        )
    with found as executor:
        yield executor
