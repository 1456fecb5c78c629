"""`suas log` and `suas baseline`."""

import json
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from fitting.cli.contract import BAD_INPUT, Overwrite, answered, bad_input
from fitting.cli.log_frames import skin_of_log
from fitting.cli.options import Baud, Duration, Format, argument, option, output_option
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_output


def log(
    port: Annotated[
        str,
        argument(
            "Device file, VID:PID[:SERIAL], socket://host:port, rfc2217://host:port.",
            metavar="PORT",
        ),
    ],
    output: Annotated[Path, output_option("Log to write.", "LOG.csv")],
    format_name: Format,
    baud: Baud = 115200,
    duration: Duration = None,
    skin: Annotated[
        Path | None, option("Skin file: its name and scale go into the header.")
    ] = None,
    flush: Annotated[
        float, option("Seconds between writes to the file.", min=0.0, metavar="S")
    ] = 0.2,
    rotate: Annotated[
        float | None, option("Begin a new file at this size.", min=0.01, metavar="MB")
    ] = None,
    overwrite: Overwrite = False,
    append: Annotated[bool, option("Continue LOG.csv if it exists.", "--append")] = False,
    as_json: Annotated[bool, option("Print the totals as JSON.", "--json")] = False,
) -> None:
    """Record a port to a log until Ctrl-C, SIGTERM or the end of --duration.

    Lost links are opened again; nothing that was recorded is ever lost. Where LOG.csv is
    deleted, moved or replaced meanwhile, LOG.beside1.csv has all of it.
    Exit status: 0 recorded, 2 bad input (the port can't be opened, nothing came), a full
    disk, or a log that went on beside its file.
    """
    with bad_input():
        from suas_jax.acquisition.frames.registry import decoder, open_source
        from suas_jax.acquisition.log.log_file import LogWriter, log_header
        from suas_jax.acquisition.log.record import FLAG_COLUMNS, View, record
        from suas_jax.acquisition.stream import Stream, ended_by_signal

        if append and overwrite:
            raise ValueError("--append and --overwrite: choose one")
        check_output(output, overwrite=overwrite or append)
        decode = decoder(format_name)
        header, taxels = _skin_header(skin)
        source = open_source(port, format_name, baud)
        started = time.monotonic()
        try:
            writer = LogWriter(
                output,
                log_header(
                    **header,
                    start_time=datetime.now(UTC),
                    port=port,
                    frame_format=format_name,
                    baud=str(baud),
                ),
                flags=FLAG_COLUMNS + decode.extra_columns,
                flush_interval=flush,
                rotate_bytes=None if rotate is None else round(1e6 * rotate),
                overwrite=overwrite,
                append=append,
                report=lambda sentence: view.say(sentence),
            )
        except BaseException:
            source.close()
            raise
        with View(f"{port} -> {writer.path}") as view:
            for note in writer.notes:
                view.say(f"{writer.path}: {note}")
            stream = Stream(
                source,
                decode,
                format_name,
                report=view.say,
                clock=lambda: time.monotonic() - started + writer.elapsed,
                taxels=taxels,
                resumed=writer.resumed,
            )
            with ended_by_signal(stream):
                result = record(
                    stream,
                    writer,
                    duration=duration,
                    started=started,
                    on_progress=lambda: view.update(stream),
                )
    over = duration is not None and result["elapsed_s"] >= duration
    _tell(result, (port, output, writer.path), as_json=as_json, over=over)


def _tell(
    result: dict[str, Any], names: tuple[str, Path, Path], *, as_json: bool, over: bool
) -> None:
    """What came of a recording from a port to a file, or to another one beside it."""
    from suas_jax.acquisition.log.record import totals_text

    (port, output, path), stopped = names, result.pop("stopped")
    totals = f"{path}: {totals_text(result)}"
    status, message = "recorded", totals
    if stopped:
        status, message = "disk_full", stopped
    elif beside := result["beside"]:
        status = "file_lost"
        message = f"{output}: was lost while it was recorded; the log is in {beside[-1]}"
    elif not result["rows"]:
        status = "no_frames"
        message = f"{port}: no frame came in {result['elapsed_s']:.1f} s; {path} is empty"
    if as_json:
        summary = {"path": str(output), "status": status, "message": message}
        say(json.dumps(summary | result, allow_nan=False))
    if stopped or (result["rows"] and not as_json):
        say(totals, err=True)
    if status != "recorded":
        say(f"suas: {message}", err=True)
    if status in ("disk_full", "file_lost") or (status == "no_frames" and over):
        answered(status)
        raise typer.Exit(BAD_INPUT)


def _skin_header(skin: Path | None) -> tuple[dict[str, str], dict[int, int]]:
    """What a skin file adds to the header, and how many taxels its modules have."""
    if skin is None:
        return {}, {}
    from suas_jax.config import load_skin

    electrodes = load_skin(skin).sensing
    header = {"skin": str(skin), "scale": f"{1e15 * electrodes.lsb:.6g} fF"}
    return header, electrodes.taxels_by_module


def baseline(
    path: Annotated[Path, argument("Log of the unloaded skin, a few seconds.", metavar="LOG")],
    output: Annotated[Path, output_option("Baseline (JSON).", "BASELINE")],
    tolerance: Annotated[
        float | None,
        option(
            "Allowed change within the log; default: what its noise explains.",
            min=0.0,
            metavar="COUNTS",
        ),
    ] = None,
    reference: Annotated[
        Path | None, option("Earlier baseline to agree with.", metavar="BASELINE")
    ] = None,
    reference_tolerance: Annotated[
        float, option("Allowed relative deviation from --reference.", min=0.0)
    ] = 0.02,
    skin: Annotated[
        Path | None, option("Skin or scene to agree with at rest; default: the log's.")
    ] = None,
    model_tolerance: Annotated[
        float, option("Allowed relative deviation from the rest pattern.", min=0.0)
    ] = 0.05,
    overwrite: Overwrite = False,
    as_json: Annotated[bool, option("Print the baseline as JSON.", "--json")] = False,
) -> None:
    """Average a log of the skin at rest; refuse a skin that is loaded or drifts.

    Exit status: 0 taken, 2 bad input or not at rest.
    """
    with bad_input():
        from suas_jax.acquisition.baseline import (
            FLUID,
            baseline_json,
            common_factor,
            doubt_of_factor,
            read_baseline,
            refuse_loaded,
            rest_of,
            take_baseline,
            write_baseline,
        )
        from suas_jax.acquisition.log.log_file import read_log, sequence_notes

        check_output(output, overwrite=overwrite)
        log = read_log(path)
        for note in (*log.notes, *sequence_notes(log)):
            say(f"suas: {path}: {note}", err=True)
        taken = take_baseline(log, tolerance=tolerance)
        if reference is not None:
            rest = rest_of(read_baseline(reference), taken)
            refuse_loaded(taken, rest, tolerance=reference_tolerance, source=str(reference))
        skin = skin_of_log(log) if skin is None else skin
        if skin is not None:
            from suas_jax.config.oil import refuse_other_fluid
            from suas_jax.simulation.capacitances import rest_pattern
            from suas_jax.simulation.load_path import skin_behind

            oil = skin_behind(skin).oil.relative_permittivity
            refuse_other_fluid(taken.header.get(FLUID, ""), oil, str(path))
            rest, source = rest_pattern(skin, taken), f"the model of {skin} (--model-tolerance)"
            factor = common_factor(taken, rest, source)
            refuse_loaded(taken, rest, tolerance=model_tolerance, source=source, factor=factor)
            doubt = doubt_of_factor(factor, source)
            named = skin_of_log(log)
            if named is not None and not named.samefile(skin):
                doubt = doubt or f"the log names {named}, its counts were compared with {skin}"
            if doubt:
                say(f"suas: {path}: {doubt}", err=True)
        write_baseline(taken, output)
    if as_json:
        say(baseline_json(taken).rstrip(), lines=True)
    else:
        taxels = int((taken.so == taken.so).sum())
        say(f"{output}: {taken.frames} frames of {taxels} taxels at rest", err=True)
