"""`suas simulate` and `suas convert`; imports inside the commands, as in `solve`."""

import re
from pathlib import Path
from typing import Annotated

import typer

from fitting.cli.contract import NO_SOLUTION, Overwrite, bad_input
from fitting.cli.log import FORMAT_NAMES
from fitting.cli.progress import spinner
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_output


def simulate(
    scene: Annotated[
        Path,
        typer.Argument(
            metavar="SCENE|PATH",
            help="Scene (TOML), load path (CSV) that names one, or, with --live, an SO log.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="LOG.csv", help="SO log to write."),
    ] = None,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Frames per second.")] = 10.0,
    duration: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="How long to simulate; default: the path's length, 10 s for a scene.",
        ),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(metavar="COUNTS", help="Noise of a reading; default: electrodes.noise."),
    ] = None,
    drift: Annotated[
        float,
        typer.Option(metavar="COUNTS/S", help="Standard deviation of the taxels' drift."),
    ] = 0.0,
    bits: Annotated[int, typer.Option(help="Bits of the converter: 16 or 8.")] = 16,
    offset: Annotated[
        float,
        typer.Option(
            metavar="FARAD", help="Capacitance that the converter's offset DAC subtracts."
        ),
    ] = 0.0,
    refresh: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Time between two results of the converter; faster frames repeat the last.",
        ),
    ] = None,
    drop: Annotated[float, typer.Option(help="Probability that a frame is lost.")] = 0.0,
    missing: Annotated[
        float, typer.Option(help="Probability that a single count is missing.")
    ] = 0.0,
    stuck: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MODULE.TAXEL@S", help="A taxel that keeps its count from a time on."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of noise, drift and faults.")] = 0,
    overwrite: Overwrite = False,
    live: Annotated[
        bool,
        typer.Option("--live", help="Play as a device on a pseudo-terminal, at its own pace."),
    ] = False,
    frame_format: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME",
            help=f"Live: {', '.join(FORMAT_NAMES)}, or text-checked.",
        ),
    ] = "text",
    port: Annotated[
        Path | None,
        typer.Option(metavar="LINK", help="Live: symbolic link to the pseudo-terminal."),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="Live: corrupt=P, drop=P, duplicate=P, unplug=AT:FOR, clock-wrap=AT, "
            "clock-jump=AT:BY:FOR, restart=AT, taxels=AT:N, stuck=MODULE/TAXEL, seed=N.",
        ),
    ] = None,
    speed: Annotated[
        float,
        typer.Option(
            metavar="FACTOR", help="Live: speed of play; 2 is twice as fast as real time."
        ),
    ] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Live: play over and over.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Live: print the port and what was played as JSON.")
    ] = False,
) -> None:
    """Simulate the sensor output of a skin under a scene or a path of loads.

    The output goes to a log (-o), live to a pseudo-terminal, or both.
    Exit status: 0 written, 2 bad input, 3 a load has no equilibrium.
    """
    with bad_input():
        if not rate > 0 or (duration is not None and not duration > 0):
            raise ValueError("--rate and --duration must be positive")
        if output is None and not live:
            raise ValueError("-o, --live: give -o LOG.csv, or --live, or both")
        if output is not None:
            check_output(output, overwrite=overwrite)
        from suas_jax.acquisition.log.log_file import is_log

        on_air = None
        if live:
            from suas_jax.acquisition.device.device import LiveOptions, play_live, play_log
            from suas_jax.acquisition.device.faults import parse_faults

            on_air = LiveOptions(
                frame_format, port, parse_faults(fault or ()), speed, duration, loop, as_json
            )
        if scene.suffix.lower() != ".toml" and is_log(scene):
            if output is not None or on_air is None:
                raise ValueError(f"{scene}: is an SO log; it can be played with --live only")
            play_log(scene, on_air)
            return
        from suas_jax.runtime.settings import configure

        configure()
        from suas_jax.simulation.pad_frames import NoSolutionError
        from suas_jax.simulation.simulated_log import (
            LogFaults,
            simulate_log,
            write_simulated_log,
        )

        faults = LogFaults(drop, missing, dict(_stuck(text) for text in stuck or ()))
        settings = {
            "noise": noise,
            "drift": drift,
            "bits": bits,
            "offset": offset,
            "refresh": refresh,
        }
        try:
            with spinner("simulating"):
                log = simulate_log(
                    scene,
                    rate=rate,
                    duration=duration,
                    faults=faults,
                    seed=seed,
                    settings=settings,
                )
        except NoSolutionError as error:
            say(f"suas: {scene}: {error}", err=True)
            raise typer.Exit(NO_SOLUTION) from None
        if output is not None:
            write_simulated_log(log, output, scene)
    frames, rows = len(log.capacitance), len(log.readings)
    note = f"{output or scene}: {frames} frames at {rate:g} Hz, {rows} rows"
    if log.sample.saturated.any():
        note += f"; {int(log.sample.saturated.sum())} counts saturated"
    touching = int((log.capacitance != log.capacitance).any(1).sum())
    if touching:
        note += f"; {touching} frames touch the wall"
    if log.untold and output is not None:
        note += f"; without its true loads ({log.untold}): suas fit sensor needs --inputs"
    say(note, err=True)
    if on_air is not None:
        with bad_input():
            play_live(log.readings, on_air)


def convert(
    source: Annotated[Path, typer.Argument(metavar="LOG", help="Log: .csv, .parquet or .nc.")],
    target: Annotated[
        Path, typer.Argument(metavar="FILE", help="File to write: .csv, .parquet or .nc.")
    ],
    overwrite: Overwrite = False,
) -> None:
    """Convert an SO log between CSV, Parquet and NetCDF (xarray).

    Exit status: 0 converted, 2 bad input.
    """
    with bad_input():
        from suas_jax.acquisition.log.convert import convert as run

        log = run(source, target, overwrite=overwrite)
    for note in log.notes:
        say(f"suas: {source}: {note}", err=True)
    say(f"{target}: {len(log)} rows", err=True)


def _stuck(text: str) -> tuple[tuple[int, int], float]:
    found = re.fullmatch(r"(\d+)\.(\d+)@([\d.]+)", text)
    if found is None:
        raise ValueError(f'--stuck "{text}": expected MODULE.TAXEL@SECONDS, such as 0.3@2.5')
    return (int(found[1]), int(found[2])), float(found[3])
