"""`suas fit sensor`. JAX is imported inside the command."""

import inspect
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fitting.cli.contract import Overwrite, answer, bad_input, print_report
from fitting.cli.options import (
    CalibratedSkin,
    Chain,
    JsonInSI,
    PlaceError,
    Plot,
    Sample,
    SkinFile,
    Steps,
    Walkers,
    argument,
    check_files,
    option,
    quantity_option,
    was_written_by,
)
from fitting.cli.progress import fitting_spinner
from suas_jax.acquisition.terminal import say
from suas_jax.files.command import own_output
from suas_jax.files.writing import check_output, write_text

if TYPE_CHECKING:
    from fitting.report.description import Part
    from fitting.sensor.fit.result import SensorFit
    from fitting.sensor.logs.data import SensorData
    from suas_jax.config import SkinSpec

_OF_MATERIAL = "material.", "as-built", "relaxation"  # constants that are told by forces


def sensor(
    skin: SkinFile,
    logs: Annotated[
        list[Path],
        argument(
            "Logs of taxels; known inputs in columns such as load_0_force_N, "
            "load_0_displacement_mm, load_0_angle_deg and fluid.",
            metavar="LOG...",
        ),
    ],
    output: CalibratedSkin = None,
    fit: Annotated[
        str,
        option(
            "Constants to find: permittivity, gap, scale, stray, layers, material.C1, "
            "..., separated by commas; as-built: all that a unit has of its own; or "
            "relaxation: shares and times of the rubber, from held presses."
        ),
    ] = "permittivity,gap",
    gap: Annotated[
        str, option("One gap for all taxels (global), each module, or each taxel.")
    ] = "global",
    model: Annotated[
        str,
        option("Model of the membrane: shell, solid, auto (solid; shell for simulated logs)."),
    ] = "auto",
    field: Annotated[
        bool,
        option("Capacitances from the electrostatic field, not from the formula.", "--field"),
    ] = False,
    joint: Annotated[bool, option("Find the material's constants as well.", "--joint")] = False,
    inputs: Annotated[
        list[Path] | None,
        option(
            "Known inputs in a CSV of their own, joined on time (t_s): once for all "
            "logs, or once for each.",
            metavar="FILE",
        ),
    ] = None,
    place_error: PlaceError = "1 mm",
    force_noise: Annotated[
        str | None,
        option(
            "Standard deviation of a known force; default: what the readings show.",
            metavar="FORCE",
        ),
    ] = None,
    displacement_noise: Annotated[
        str | None, option("The same of a known displacement or depth.", metavar="LENGTH")
    ] = None,
    fluid: Annotated[
        list[str] | None,
        option("What fills the gap: oil, air, or a known permittivity: once, or once a log."),
    ] = None,
    air: Annotated[
        str, option("How air in the gap responds: skin (as the oil does), trapped, vented.")
    ] = "skin",
    prior: Annotated[
        list[str] | None,
        option('What is known: "gap=5 mm +- 0.1 mm". Repeatable.', metavar="NAME=VALUE+-SD"),
    ] = None,
    baseline: Annotated[
        Path | None,
        option("Counts at rest, from `suas baseline`; they fix the taxels' offsets."),
    ] = None,
    offsets: Annotated[
        bool, option("Give every taxel an offset of its own.", "--offsets")
    ] = False,
    sample: Sample = False,
    steps: Steps = 20_000,
    walkers: Walkers = 32,
    seed: Annotated[int, option("Seed of the sampler.")] = 0,
    chain: Chain = None,
    plot: Plot = None,
    overwrite: Overwrite = False,
    as_json: JsonInSI = False,
) -> None:
    """Calibrate permittivity, gap and scale from logs with known inputs.

    Exit status: 0 a calibration was found, 2 bad input (no file is written).
    """
    given = dict(locals())
    with bad_input():
        if chain and not sample:
            raise ValueError("--chain needs --sample")
        target = _target(skin, output, plot, overwrite=overwrite)
        of_relaxation = fit.strip() == "relaxation"
        if of_relaxation:
            _refuse_beside_relaxation(given)
        own_output(chain)  # not only when the fit has ended
        from fitting.sensor.logs.data import load_sensor_data
        from fitting.sensor.model.constants import law_constants
        from suas_jax.config import load_skin

        with fitting_spinner() as show:
            spec = load_skin(skin)
            names = [name.strip() for name in fit.split(",") if name.strip()]
            if joint:
                names += law_constants(spec)
            of_material = any(name.startswith(_OF_MATERIAL) for name in names)
            _refuse_sample(sample, names, spec)
            place_deviation = quantity_option("--place-error", place_error, "length")
            input_noise = _input_noise(force_noise, displacement_noise)
            data = load_sensor_data(spec, logs, inputs or (), fluid or (), joint=of_material)
            from suas_jax.runtime.settings import configure

            configure()
            if of_relaxation:
                text, report, parts = _relaxation(skin, data, plot, show)
            else:
                from fitting.sensor.fit.calibrate import fit_sensor
                from suas_jax.acquisition.baseline import read_baseline

                found = fit_sensor(
                    data,
                    names,
                    priors=dict(_prior(text) for text in prior or ()),
                    baseline=read_baseline(baseline) if baseline else None,
                    offsets=offsets,
                    air=air,
                    gaps=gap,
                    model=model,
                    field=field,
                    place_error=place_deviation,
                    input_noise=input_noise,
                    progress=show,
                )
                sampler = (walkers, steps, seed, chain) if sample else None
                text, report, parts = _constants(skin, found, sampler, plot, show)
            write_text(target, text)
            report["skin_file"] = str(target)
    answer(as_json, report, lambda: print_report([*parts]))
    if not as_json:
        say(f"written: {target}", err=True)


# Text of the skin file, and the report for programs and for people.
Answer = tuple[str, dict[str, Any], "Iterable[Part]"]


def _target(skin: Path, output: Path | None, plot: Path | None, *, overwrite: bool) -> Path:
    """The skin file to write, after a check that it and the figure may be written."""
    from fitting.sensor.report.mark import MARK

    target = output or Path(f"{skin.stem.removesuffix('.calibrated')}.calibrated.toml")
    if target.exists() and target.samefile(skin):
        raise ValueError(f"{target}: is the skin file itself; choose another name with -o")
    overwrite |= output is None and was_written_by(MARK, target)
    check_output(target, overwrite=overwrite)
    check_files(plot, overwrite=overwrite)
    return target


def _constants(
    skin: Path,
    found: "SensorFit",
    sampler: tuple[int, int, int, Path | None] | None,  # walkers, steps, seed and chain file
    plot: Path | None,
    show: Callable[[str], None],
) -> Answer:
    """The constants, sampled and drawn where that is asked for."""
    from fitting.sensor.report.skin_file import calibrated_skin
    from fitting.sensor.report.summary import described, sensor_report

    report, posterior = sensor_report(found), None
    if sampler is not None:
        from fitting.sensor.fit.sensor_posterior import sample_sensor
        from fitting.statistics.posterior import PosteriorError, Settings

        walkers, steps, seed, chain = sampler
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
    return calibrated_skin(skin, found), report, described(report, found)


def _refuse_sample(sample: bool, names: list[str], spec: "SkinSpec") -> None:
    """Raise a ValueError for a pad as built, whose chain no memory holds."""
    if sample and "as-built" in names and spec.geometry.dimension == 3:
        raise ValueError(
            "--sample: a pad as built has a gain for each of its channels, too many constants "
            "to sample; leave it out, [calibration] holds their covariance"
        )


_WITH_RELAXATION = {"skin", "logs", "output", "fit", "inputs", "plot", "overwrite", "as_json"}


def _refuse_beside_relaxation(given: dict[str, Any]) -> None:
    """Raise a ValueError for options of other fits that are not as they are without."""
    usual = inspect.signature(sensor).parameters
    for name in sorted(given.keys() - _WITH_RELAXATION):
        if given[name] != usual[name].default:
            raise ValueError(
                f"--{name.replace('_', '-')}: not with --fit relaxation, which takes logs of "
                "held presses, --inputs, -o and --plot; leave it out"
            )


def _relaxation(
    skin: Path, data: "SensorData", plot: Path | None, show: Callable[[str], None]
) -> Answer:
    """Shares and times of the rubber's relaxation."""
    from fitting.sensor.relaxation.fit import fit_relaxation
    from fitting.sensor.relaxation.report import (
        described,
        plot_relaxation,
        relaxation_report,
        relaxing_skin,
    )

    found, tried = fit_relaxation(data, show)
    if plot is not None:
        plot_relaxation(found, plot)
    report = relaxation_report(found, tried)
    return relaxing_skin(skin, found), report, described(report)


def _input_noise(force: str | None, displacement: str | None) -> dict[str, float] | None:
    """Deviations of known inputs, SI; None where the readings are to show them."""
    found = {}
    if force is not None:
        found["force"] = quantity_option("--force-noise", force, "force")
    if displacement is not None:
        own = quantity_option("--displacement-noise", displacement, "length")
        found |= {"displacement": own, "depth": own}
    return found or None


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
    lengths = dict.fromkeys(("gap", "oil_gap", "layers", "touch"), "length")
    capacitances = dict.fromkeys(("scale", "lsb", "stray"), "capacitance")
    dimension = (lengths | capacitances | {"force_zero": "force"}).get(own, "number")
    if own.startswith("material."):
        dimension = "number" if "alpha" in own else "stress"
    try:
        pair = tuple(parse_quantity(part.strip(), dimension) for part in (mean, sd))  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(f'--prior "{text}": {error}') from None
    if not pair[1] > 0:
        raise ValueError(f'--prior "{text}": the standard deviation must be positive')
    return own, (pair[0], pair[1])
