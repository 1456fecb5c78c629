"""`suas simulate` and `suas convert`; imports inside the commands, as in `solve`."""

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from fitting.cli.log import FORMAT_NAMES
from fitting.cli.progress import bar
from fitting.cli.solve import NO_SOLUTION, bad_input

Overwrite = Annotated[bool, typer.Option(help="Replace an existing file.")]


def register(app: typer.Typer) -> None:
    """Add this module's commands to the program."""
    app.command("simulate")(simulate)
    app.command("convert")(convert)


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
        typer.Option(metavar="S", help="Default: the path's, or 10 s of a scene."),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(metavar="COUNTS", help="Standard deviation; default: electrodes.noise."),
    ] = None,
    drift: Annotated[
        float,
        typer.Option(metavar="COUNTS/S", help="Standard deviation of the taxels' drift."),
    ] = 0.0,
    bits: Annotated[int, typer.Option(help="Of the converter: 16 or 8.")] = 16,
    offset: Annotated[
        float, typer.Option(metavar="FARAD", help="Capacitance that the offset DAC takes off.")
    ] = 0.0,
    refresh: Annotated[
        float | None,
        typer.Option(metavar="S", help="Time between new results; polled faster, they repeat."),
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
    seed: Annotated[int, typer.Option(min=0, help="Of noise, drift and faults.")] = 0,
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
            "stuck=MODULE/TAXEL, seed=N.",
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option(metavar="FACTOR", help="Live: times faster than the clock.")
    ] = 1.0,
    loop: Annotated[bool, typer.Option(help="Live: play over and over.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Live: print the port and what was played as JSON.")
    ] = False,
) -> None:
    """Play a scene, or a path of loads, as the sensor output a skin would send.

    It goes to a log (-o), or live to a pseudo-terminal, or both.
    Exit status: 0 written, 2 bad input, 3 a load has no equilibrium.
    """
    with bad_input():
        if not rate > 0 or (duration is not None and not duration > 0):
            raise ValueError("--rate and --duration must be positive")
        if output is None and not live:
            raise ValueError("suas simulate: give -o LOG.csv, or --live, or both")
        if output is not None:
            _must_be_free(output, overwrite)
        from suas_jax.acquisition.log.log_file import is_log

        on_air = None
        if live:
            from suas_jax.acquisition.device.faults import parse_faults
            from suas_jax.acquisition.device.live import LiveOptions, play_live, play_log

            on_air = LiveOptions(
                frame_format, port, parse_faults(fault or ()), speed, duration, loop, as_json
            )
        if scene.suffix.lower() != ".toml" and is_log(scene):
            if output is not None or on_air is None:
                raise ValueError(f"{scene}: is an SO log; it can be played with --live only")
            play_log(scene, on_air)
            return
        import numpy as np

        from suas_jax.acquisition.integrity import Flags, Integrity
        from suas_jax.acquisition.log.log_file import LogWriter, log_header
        from suas_jax.config import load_scene
        from suas_jax.runtime.settings import configure

        configure()
        from suas_jax.sensing.taxels import taxel_names
        from suas_jax.simulation import load_path as play

        path = None if scene.suffix.lower() == ".toml" else play.load_path(scene)
        spec = load_scene(scene) if path is None else path.scene
        settings = {"noise": noise, "drift": drift, "bits": bits, "refresh": refresh}
        converter = play.converter_of(spec, offset=offset, **settings)
        faults = play.Faults(drop, missing, dict(_stuck(text) for text in stuck or ()))
        length = duration
        if length is None:
            length = 10.0 if path is None else float(path.time[-1] - path.time[0])
        count = max(1, int(np.floor(length * rate * (1 + 1e-12))) + (path is not None))
        time = np.arange(count) / rate
        random = np.random.default_rng(seed)
        try:
            if path is None:
                capacitance = np.tile(play.static_capacitance(spec), (count, 1))
            else:
                with bar("simulating", count) as advance:
                    capacitance = play.capacitances(path, path.time[0] + time, advance)
        except play.NoSolutionError as error:
            typer.echo(f"suas: {scene}: {error}", err=True)
            raise typer.Exit(NO_SOLUTION) from None
        sample = converter.sample(capacitance, time, random)
        frames = list(play.readings(spec, time, sample, faults, random))
        judge = Integrity(None, checked=True)
        header = log_header(
            skin=str(scene),
            scale=f"{1e15 * converter.lsb:.9g} fF",
            start_time=datetime.now(UTC),
            simulated=f"seed {seed}, {rate:g} Hz, {converter}",
        )
        assert spec.electrodes is not None  # or there would be no converter
        taxels = max(taxel_names(spec.electrodes)[1])
        if output is not None:
            with LogWriter(
                output, header, taxels=taxels, flags=Flags._fields, overwrite=overwrite
            ) as writer:
                for r in frames:
                    t_device, flags = judge.judge(r)
                    writer.write(r.t_host, t_device, r.seq, r.module, r.counts, flags)
    note = f"{output or scene}: {count} frames at {rate:g} Hz, {len(frames)} rows"
    if sample.saturated.any():
        note += f"; {int(sample.saturated.sum())} counts saturated"
    if np.isnan(capacitance).any():
        note += f"; {int(np.isnan(capacitance).any(1).sum())} frames touch the wall"
    typer.echo(note, err=True)
    if on_air is not None:
        with bad_input():
            play_live(frames, on_air)


def convert(
    source: Annotated[Path, typer.Argument(metavar="LOG", help="Log: .csv, .parquet or .nc.")],
    target: Annotated[Path, typer.Argument(metavar="FILE", help="Likewise.")],
    overwrite: Overwrite = False,
) -> None:
    """Convert an SO log between CSV, Parquet and NetCDF (xarray).

    Exit status: 0 converted, 2 bad input.
    """
    with bad_input():
        from suas_jax.acquisition.log.convert import convert as run

        log = run(source, target, overwrite=overwrite)
    for note in log.notes:
        typer.echo(f"suas: {source}: {note}", err=True)
    typer.echo(f"{target}: {len(log)} rows", err=True)


def _must_be_free(output: Path, overwrite: bool) -> None:
    """Refuse before the work is done, not after."""
    if not overwrite and output.exists() and output.stat().st_size > 0:
        raise FileExistsError(
            f"{output}: exists and is not empty; choose another name or give --overwrite"
        )
    if not output.parent.is_dir():
        raise FileNotFoundError(f"{output}: there is no folder {output.parent}")


def _stuck(text: str) -> tuple[tuple[int, int], float]:
    found = re.fullmatch(r"(\d+)\.(\d+)@([\d.]+)", text)
    if found is None:
        raise ValueError(f'--stuck "{text}": expected MODULE.TAXEL@SECONDS, such as 0.3@2.5')
    return (int(found[1]), int(found[2])), float(found[3])
