"""The commands of `suas`, put together, with examples of each."""

from collections.abc import Callable, Iterator
from importlib.metadata import version
from typing import Annotated, NamedTuple

import typer

from fitting.cli import (
    calibrate,
    data,
    datasheet,
    design,
    export,
    fit_material,
    fit_materials,
    fit_sensor,
    force_range,
    health,
    invert,
    log,
    modes,
    new,
    simulate,
    solve,
    sweep,
    tour,
    view,
    zero,
)
from suas_jax.acquisition.terminal import say

EXAMPLES: dict[str, tuple[str, ...]] = {
    "tour": ("suas tour", "suas tour --plot tour.png"),
    "solve": (
        "suas solve configs/scenes/case_b.toml --plot section.png",
        "suas solve configs/scenes/press.toml --gradient min_gap_m",
    ),
    "sweep": (
        "suas sweep configs/scenes/case_b.toml --force 0:40:21 --plot curve.png",
        "suas sweep configs/scenes/hold.toml --history configs/scenes/hold.csv --plot hold.png",
    ),
    "modes": ("suas modes configs/scenes/film.toml --plot modes.png",),
    "range": ("suas range configs/skins/suas.toml --plot range.png",),
    "datasheet": ("suas datasheet configs/skins/suas.toml -o sheet.html",),
    "design": ("suas design configs/design/sensitive.toml -o designed.toml",),
    "simulate": (
        "suas simulate configs/scenes/press_path.csv -o press.csv",
        "suas simulate press.csv --live --port /tmp/skin --format cobs",
    ),
    "convert": ("suas convert press.csv press.parquet",),
    "log": ("suas log /dev/ttyUSB0 --format cobs --duration 60 -o press.csv",),
    "health": (
        "suas health press.csv --skin configs/skins/suas.toml --plot health.png",
        "suas health /dev/ttyUSB0 --format cobs --duration 10",
    ),
    "calibrate": (
        "suas calibrate /dev/ttyUSB0 configs/skins/suas.toml --format cobs --force '500 gf'",
        "suas calibrate /dev/ttyUSB0 configs/skins/suas.toml --press '-30 deg, 5 N' "
        "--press '40 deg, 8 N' --verify '10 deg, 5 N'",
    ),
    "new skin": ("suas new skin", "suas new skin pad.toml --pad 4x8"),
    "new scene": ("suas new scene --skin configs/skins/suas-pad.toml",),
    "baseline": ("suas baseline rest.csv -o rest.json",),
    "data": ("suas data configs/data/treloar1944_uniaxial.csv",),
    "examples": ("suas examples", "suas examples elsewhere/configs"),
    "invert": (
        "suas invert configs/skins/suas.toml press.csv --plot loads.png",
        "suas invert configs/skins/suas.toml --live /dev/ttyUSB0 --json",
    ),
    "zero": (
        'suas zero configs/skins/suas.toml weight.csv --known "500 g at 0 deg"',
        'suas zero configs/skins/suas.toml weights.csv --known "5 N at -30 deg" '
        '--known "5 N at 30 deg"',
    ),
    "export mcap": ("suas export mcap press.csv --skin configs/skins/suas.toml",),
    "view": (
        "suas view configs/scenes/pad_crown.toml --open",
        "suas view press.csv --skin configs/skins/suas.toml --open",
        "suas view configs/skins/suas.toml --live /dev/ttyUSB0 --open",
    ),
    "fit material": (
        "suas fit material --law ogden --terms 3 "
        "--data uniaxial=configs/data/treloar1944_uniaxial.csv --plot fit.png",
        "suas fit material --law auto --data uniaxial=configs/data/treloar1944_uniaxial.csv",
    ),
    "fit sensor": ("suas fit sensor configs/skins/suas.toml press.csv --plot fit.png",),
    "fit materials": ("suas fit materials jobs.toml -o results.jsonl",),
}
"""Command lines by the words that follow `suas`, shown by `--help` and on the site.

They run as they stand: `suas examples` puts the files they name into the folder `configs`.
"""


class Command(NamedTuple):
    """A command of the program."""

    words: str  # that follow `suas`
    registered: typer.models.CommandInfo  # what the parser keeps about it


def commands_of(app: typer.Typer, group: str = "") -> Iterator[Command]:
    """Every command of the program, those of its groups included."""
    for command in app.registered_commands:
        assert command.callback is not None
        name = command.name or command.callback.__name__
        yield Command(f"{group} {name}".strip(), command)
    for part in app.registered_groups:
        assert part.typer_instance is not None
        yield from commands_of(part.typer_instance, f"{group} {part.name}".strip())


def _group(text: str, **commands: Callable[..., None]) -> typer.Typer:
    found = typer.Typer(help=text, no_args_is_help=True)
    for name, command in commands.items():
        found.command(name)(command)
    return found


_PANELS: dict[str, dict[str, Callable[..., None] | typer.Typer]] = {
    "Start": {
        "tour": tour.tour,
        "examples": new.examples,
        "new": _group("Write a commented file to start from.", skin=new.skin, scene=new.scene),
    },
    "The model": {
        "solve": solve.solve,
        "sweep": sweep.sweep,
        "modes": modes.modes,
        "simulate": simulate.simulate,
        "range": force_range.find_range,
        "datasheet": datasheet.datasheet,
        "design": design.design,
        "view": view.view,
    },
    "Measurements": {
        "convert": simulate.convert,
        "log": log.log,
        "baseline": log.baseline,
        "data": data.data,
        "health": health.health,
        "export": _group("Convert logs for other programs.", mcap=export.mcap),
    },
    "Fits": {
        "calibrate": calibrate.calibrate,
        "zero": zero.zero,
        "invert": invert.invert,
        "fit": _group(
            "Fit the model to measurements.",
            material=fit_material.material,
            sensor=fit_sensor.sensor,
            materials=fit_materials.materials,
        ),
    },
}
"""Headings of the overview, with the commands below each."""

app = typer.Typer(
    help="Model of a soft underwater artificial skin: loads, oil pressure, sensor output.",
    epilog="Start with: suas tour",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for panel, parts in _PANELS.items():
    for name, part in parts.items():
        if isinstance(part, typer.Typer):
            app.add_typer(part, name=name, rich_help_panel=panel)
        else:
            app.command(name, rich_help_panel=panel)(part)
for command in commands_of(app):
    lines = EXAMPLES.get(command.words, ())
    title = "Example:" if len(lines) == 1 else "Examples:"
    # An empty line parts paragraphs; a single end of line would be taken out.
    command.registered.epilog = "\n\n".join([title, *lines]) if lines else None


def _print_version(wanted: bool) -> None:
    if wanted:
        say(f"suas_jax {version('suas-jax')}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    show_version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    from suas_jax.files.command import command_files

    context.with_resource(command_files())
