"""`suas simulate` and `suas convert`; imports inside the commands, as in `solve`."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fitting.cli.contract import NO_SOLUTION, Overwrite, bad_input
from fitting.cli.options import FORMAT_NAMES, argument, computing, option, output_option
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_output

if TYPE_CHECKING:
    from suas_jax.simulation.simulated_log import SimulatedLog


def simulate(
    scene: Annotated[
        Path,
        argument(
            "Scene (TOML), load path (CSV) that names one, or, with --live, a log.",
            metavar="SCENE|PATH",
        ),
    ],
    output: Annotated[Path | None, output_option("Log to write.", "LOG.csv")] = None,
    rate: Annotated[float, option("Frames per second.", metavar="HZ")] = 10.0,
    duration: Annotated[
        float | None,
        option(
            "How long to simulate; default: the path's length, 10 s for a scene.", metavar="S"
        ),
    ] = None,
    noise: Annotated[
        float | None, option("Noise of a reading; default: electrodes.noise.", metavar="COUNTS")
    ] = None,
    drift: Annotated[
        float, option("Standard deviation of the taxels' drift.", metavar="COUNTS/S")
    ] = 0.0,
    bits: Annotated[int, option("Bits of the converter: 16 or 8.")] = 16,
    offset: Annotated[
        float, option("Capacitance that the converter's offset DAC subtracts.", metavar="FARAD")
    ] = 0.0,
    refresh: Annotated[
        float | None,
        option(
            "Time between two results of the converter; faster frames repeat the last.",
            metavar="S",
        ),
    ] = None,
    drop: Annotated[float, option("Probability that a frame is lost.")] = 0.0,
    missing: Annotated[float, option("Probability that a single count is missing.")] = 0.0,
    stuck: Annotated[
        list[str] | None,
        option("A taxel that keeps its count from a time on.", metavar="MODULE.TAXEL@S"),
    ] = None,
    seed: Annotated[int, option("Seed of noise, drift and faults.", min=0)] = 0,
    overwrite: Overwrite = False,
    live: Annotated[
        bool, option("Play as a device on a pseudo-terminal, at its own pace.", "--live")
    ] = False,
    frame_format: Annotated[
        str,
        option(
            f"Live: {', '.join(FORMAT_NAMES)}, or text-checked.", "--format", metavar="NAME"
        ),
    ] = "text",
    port: Annotated[
        Path | None, option("Live: symbolic link to the pseudo-terminal.", metavar="LINK")
    ] = None,
    fault: Annotated[
        list[str] | None,
        option(
            "Live: corrupt=P, drop=P, duplicate=P, unplug=AT:FOR, clock-wrap=AT, "
            "clock-jump=AT:BY:FOR, restart=AT, taxels=AT:N, stuck=MODULE/TAXEL, seed=N.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    speed: Annotated[
        float, option("Live: speed of play; 2 is twice as fast as real time.", metavar="FACTOR")
    ] = 1.0,
    loop: Annotated[bool, option("Live: play over and over.", "--loop")] = False,
    as_json: Annotated[
        bool, option("Live: print the port and what was played as JSON.", "--json")
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
                raise ValueError(f"{scene}: is a log; it can be played with --live only")
            play_log(scene, on_air)
            return
        with computing("simulating"):
            from suas_jax.simulation import simulated_log as simulated
            from suas_jax.simulation.pad_frames import NoSolutionError

            converter = {"noise": noise, "drift": drift, "bits": bits, "offset": offset}
            played: dict[str, Any] = {
                "rate": rate,
                "duration": duration,
                "faults": simulated.LogFaults(drop, missing, dict(map(_stuck, stuck or ()))),
                "seed": seed,
                "settings": converter | {"refresh": refresh},
            }
            try:
                log = simulated.simulate_log(scene, **played)
            except NoSolutionError as error:
                say(f"suas: {scene}: {error}", err=True)
                raise typer.Exit(NO_SOLUTION) from None
        if output is not None:
            simulated.write_simulated_log(log, output, scene)
    _tell(log, output or scene, rate, written=output is not None)
    if on_air is not None:
        with bad_input():
            play_live(log.readings, on_air)


def _tell(log: "SimulatedLog", file: Path, rate: float, *, written: bool) -> None:
    frames, rows = len(log.capacitance), len(log.readings)
    note = f"{file}: {frames} frames at {rate:g} Hz, {rows} rows"
    if log.sample.saturated.any():
        note += f"; {int(log.sample.saturated.sum())} counts saturated"
    touching = int((log.capacitance != log.capacitance).any(1).sum())
    if touching:
        note += f"; the membrane touches taxels in {touching} frames"
    if log.untold and written:
        note += f"; without its true loads ({log.untold}): suas fit sensor needs --inputs"
    say(note, err=True)
    skin = log.scene
    told = skin.oil.density, skin.oil.viscosity, skin.material.density
    if None not in told and len({row.tobytes() for row in log.capacitance}) > 1:
        say(
            f"suas: {file}: the film's inertia and viscosity are left out: readings are right "
            "where loads change slowly against the bandwidth that suas modes tells",
            err=True,
        )


def convert(
    source: Annotated[Path, argument("Log: .csv, .parquet or .nc.", metavar="LOG")],
    target: Annotated[Path, argument("File to write: .csv, .parquet or .nc.", metavar="FILE")],
    overwrite: Overwrite = False,
) -> None:
    """Convert a log between CSV, Parquet and NetCDF (xarray).

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
