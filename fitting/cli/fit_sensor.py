"""`suas fit sensor`. JAX is imported inside the command."""

from pathlib import Path
from typing import Annotated

import typer

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.options import Plot, check_figures, quantity_option
from fitting.cli.progress import fitting_spinner
from fitting.json_text import json_text
from suas_jax.acquisition.terminal import say
from suas_jax.files.command import own_output
from suas_jax.files.reading import read_bytes
from suas_jax.files.writing import check_outputs, write_text

_MARK = "written by suas fit sensor"


def sensor(
    skin: Annotated[Path, typer.Argument(metavar="SKIN", help="Skin file (TOML).")],
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="SO logs; known inputs in columns such as load_0_force_N, "
            "load_0_displacement_mm, load_0_angle_deg and fluid.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="SKIN.toml",
            help="Calibrated skin file; default: SKIN.calibrated.toml in this folder.",
        ),
    ] = None,
    fit: Annotated[
        str,
        typer.Option(
            help="Constants to find: permittivity, gap, scale, stray, layers, material.C1, "
            "..., separated by commas; or as-built: all that a unit has of its own."
        ),
    ] = "permittivity,gap",
    gap: Annotated[
        str, typer.Option(help="One gap for all taxels (global), each module, or each taxel.")
    ] = "global",
    model: Annotated[
        str,
        typer.Option(
            help="Shapes of the membrane: shell, solid, auto (solid; shell for simulated logs)."
        ),
    ] = "auto",
    field: Annotated[
        bool,
        typer.Option(
            "--field", help="Capacitances from the electrostatic field, not from the formula."
        ),
    ] = False,
    joint: Annotated[
        bool, typer.Option("--joint", help="Find the material's constants as well.")
    ] = False,
    inputs: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Known inputs in a CSV of their own, joined on time (t_s): once for all "
            "logs, or once for each.",
        ),
    ] = None,
    place_error: Annotated[
        str,
        typer.Option(
            metavar="LENGTH", help="Standard deviation of the presses' places, with as-built."
        ),
    ] = "1 mm",
    fluid: Annotated[
        list[str] | None,
        typer.Option(
            help="What fills the gap: oil, air, or a known permittivity: once, or once a log."
        ),
    ] = None,
    air: Annotated[
        str,
        typer.Option(
            help="How air in the gap responds: skin (as the oil does), trapped, vented."
        ),
    ] = "skin",
    prior: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE+-SD", help='What is known: "gap=5 mm +- 0.1 mm". Repeatable.'
        ),
    ] = None,
    baseline: Annotated[
        Path | None,
        typer.Option(
            help="Counts at rest, from `suas baseline`; they fix the taxels' offsets."
        ),
    ] = None,
    offsets: Annotated[
        bool, typer.Option("--offsets", help="Give every taxel an offset of its own.")
    ] = False,
    sample: Annotated[
        bool, typer.Option("--sample", help="Sample the posterior of the constants (emcee).")
    ] = False,
    steps: Annotated[
        int, typer.Option(min=1, help="Largest number of steps of the sampler.")
    ] = 20_000,
    walkers: Annotated[int, typer.Option(min=4, help="Number of walkers of the sampler.")] = 32,
    seed: Annotated[int, typer.Option(help="Seed of the sampler.")] = 0,
    chain: Annotated[
        Path | None,
        typer.Option(help="HDF5 file that keeps the chain; one that exists is resumed."),
    ] = None,
    plot: Plot = None,
    overwrite: Overwrite = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, SI units.")] = False,
) -> None:
    """Calibrate permittivity, gap and scale from logs with known inputs.

    Exit status: 0 a calibration was found, 2 bad input (no file is written).
    """
    with bad_input():
        if chain and not sample:
            raise ValueError("--chain needs --sample")
        target = output or Path(f"{skin.stem.removesuffix('.calibrated')}.calibrated.toml")
        if target.exists() and target.samefile(skin):
            raise ValueError(f"{target}: is the skin file itself; choose another name with -o")
        check_outputs([target, plot], overwrite=overwrite or _is_own(target, output is None))
        own_output(chain)  # not only when the fit has ended
        check_figures(plot)
        from fitting.sensor.logs.data import load_sensor_data
        from suas_jax.config import continuous_inputs, load_skin

        with fitting_spinner() as show:
            spec = load_skin(skin)
            names = [name.strip() for name in fit.split(",") if name.strip()]
            if joint:
                names += [k for k in continuous_inputs(spec) if k.startswith("material.")]
            of_material = any(name.startswith(("material.", "as-built")) for name in names)
            place_deviation = quantity_option("--place-error", place_error, "length")
            data = load_sensor_data(spec, logs, inputs or (), fluid or (), joint=of_material)
            from suas_jax.runtime.settings import configure

            configure()
            from fitting.sensor.fit.calibrate import fit_sensor
            from fitting.sensor.report.skin_file import calibrated_skin
            from fitting.sensor.report.summary import sensor_report
            from suas_jax.acquisition.baseline import read_baseline

            known = dict(_prior(text) for text in prior or ())
            found = fit_sensor(
                data,
                names,
                priors=known,
                baseline=read_baseline(baseline) if baseline else None,
                offsets=offsets,
                air=air,
                gaps=gap,
                model=model,
                field=field,
                place_error=place_deviation,
                progress=show,
            )
            report = sensor_report(found)
            posterior = None
            if sample:
                from fitting.sensor.fit.sensor_posterior import sample_sensor
                from fitting.statistics.posterior import PosteriorError, Settings

                settings = Settings(walkers=walkers, steps=steps, seed=seed, chain=chain)
                try:
                    posterior, report["posterior"] = sample_sensor(
                        found, settings, lambda step, *_: show(f"posterior: step {step}")
                    )
                except PosteriorError as error:
                    report["posterior"] = {"status": "no_posterior", "message": str(error)}
            if plot is not None:
                from fitting.sensor.report.plots import plot_sensor

                plot_sensor(found, plot, posterior)
            write_text(target, calibrated_skin(skin, found))
            report["skin_file"] = str(target)
    if as_json:
        say(json_text(report))
    else:
        from fitting.sensor.report.summary import print_report

        print_report(report, found)
        say(f"written: {target}", err=True)


def _is_own(target: Path, own_name: bool) -> bool:
    """Whether an earlier run wrote a file under its own name: the next may replace it."""
    from suas_jax.config.toml_file import MOST_BYTES

    return (
        own_name
        and target.is_file()
        and _MARK in read_bytes(target, MOST_BYTES, remember=False).decode(errors="replace")
    )


def _prior(text: str) -> tuple[str, tuple[float, float]]:
    """NAME=VALUE+-SD in units."""
    from suas_jax.config import parse_quantity

    name, equals, value = text.partition("=")
    mean, plus, sd = value.replace("±", "+-").partition("+-")
    if not equals or not plus:
        raise ValueError(
            f'--prior "{text}": expected NAME=VALUE+-SD, such as gap=5 mm +- 0.1 mm'
        )
    own = name.strip()
    dimension = {"gap": "length", "oil_gap": "length", "layers": "length"}.get(own)
    dimension = dimension or {"scale": "capacitance", "lsb": "capacitance"}.get(own)
    dimension = dimension or {"stray": "capacitance"}.get(own, "number")
    if own.startswith("material."):
        dimension = "number" if "alpha" in own else "stress"
    try:
        pair = tuple(parse_quantity(part.strip(), dimension) for part in (mean, sd))  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(f'--prior "{text}": {error}') from None
    if not pair[1] > 0:
        raise ValueError(f'--prior "{text}": the standard deviation must be positive')
    return own, (pair[0], pair[1])
