"""`suas calibrate`. JAX is imported inside the command."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.options import (
    Baud,
    CalibratedSkin,
    Format,
    JsonInSI,
    PlaceError,
    Plot,
    SkinFile,
    argument,
    check_files,
    option,
    quantity_option,
)
from fitting.cli.progress import fitting_spinner
from fitting.json_text import json_text
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_outputs

if TYPE_CHECKING:
    from fitting.calibration.next_press import Plan
    from suas_jax.config import SkinSpec


def calibrate(
    port: Annotated[
        str, argument("As for `suas log`; - prints the --plan alone.", metavar="PORT")
    ],
    skin: SkinFile,
    output: CalibratedSkin = None,
    page: Annotated[
        Path | None, option("Report; default: SKIN.calibrated.html.", metavar="FILE.html")
    ] = None,
    folder: Annotated[
        Path | None, option("Logs of the steps, to resume from; default: SKIN.calibration.")
    ] = None,
    format_name: Format = "text",
    baud: Baud = 115200,
    force: Annotated[str, option("Force of each press that no --press states.")] = "5 N",
    press: Annotated[
        list[str] | None,
        option(
            'A known load to calibrate with, such as "45 deg, 5 N", on a pad "45 deg, '
            '10 mm, 5 N"; on paths and splines by the arc, "22 mm, 5 N". Repeatable; default: '
            "three places along the arc.",
            metavar='"ANGLE, FORCE"',
        ),
    ] = None,
    verify: Annotated[
        list[str] | None,
        option("A known load to verify the result with, as --press.", metavar='"ANGLE, FORCE"'),
    ] = None,
    plan: Annotated[
        int | None,
        option(
            "Choose up to N presses that tell most about this unit, each with --force or "
            "half of it; sets --fit as-built.",
            min=1,
            metavar="N",
        ),
    ] = None,
    accuracy: Annotated[
        str, option("End the plan once the median force should be known to this.")
    ] = "0 %",
    place_error: PlaceError = "1 mm",
    plot: Plot = None,
    skip_verification: Annotated[
        bool, option("Leave the verification out.", "--skip-verification")
    ] = False,
    hold: Annotated[
        float, option("How long to hold still.", min=0.2, max=600.0, metavar="S")
    ] = 3.0,
    timeout: Annotated[
        float, option("Give up a step after this long.", min=1.0, max=86400.0, metavar="S")
    ] = 600.0,
    fit: Annotated[
        str | None,
        option(
            "Constants to find, as for `suas fit sensor`; default: permittivity,gap, and "
            "as-built with --plan."
        ),
    ] = None,
    model: Annotated[str, option("Model of the membrane, as for `suas fit sensor`.")] = "auto",
    overwrite: Overwrite = False,
    as_json: JsonInSI = False,
) -> None:
    """Calibrate a skin step by step: rest, known presses, verification.

    The command says where and how hard to press, and goes on by itself once the load is held
    still. It keeps what it records: to resume a calibration, repeat the command.
    --plan chooses the presses that shrink the uncertainty of forces over the skin most, and
    --plot draws them.
    Exit status: 0 calibrated, verified or not; 2 bad input, or a step was not done.
    """
    with bad_input():
        from fitting.calibration.plan import press_of, steps_of, usual_presses
        from suas_jax.config import load_skin, parse_quantity
        from suas_jax.runtime.settings import configure

        stem = skin.stem.removesuffix(".calibrated")
        target = output or Path(f"{stem}.calibrated.toml")
        report_file = page or target.with_suffix(".html")
        spec = load_skin(skin)
        check_files(plot, overwrite=overwrite)
        if port != "-":
            check_outputs([target, report_file], overwrite=overwrite)
        elif plan is None:
            raise ValueError("PORT -: only with --plan, which then is all that is printed")
        if plan is not None and press:
            raise ValueError("--plan and --press: give one of them, both say where to press")
        try:
            usual, usually_verified = usual_presses(spec, parse_quantity(force, "force"))
        except ValueError as error:
            raise ValueError(f"--force: {error}") from None
        pressed = tuple(press_of(text, spec, "--press") for text in press or ()) or usual
        verified = tuple(press_of(text, spec, "--verify") for text in verify or ())
        verified = () if skip_verification else verified or usually_verified
        configure()
        usual_fit = "permittivity,gap" if plan is None else "as-built"
        place_deviation = quantity_option("--place-error", place_error, "length")
        if plan is not None:
            wanted = quantity_option("--accuracy", accuracy, "number")
            largest = quantity_option("--force", force, "force")
            chosen = _planned(spec, largest, plan, wanted, place_deviation, plot)
            pressed = chosen.presses
            if port == "-":
                say(json_text(chosen.report()) if as_json else chosen.text, lines=True)
                return
        from fitting.calibration.run import CalibrationOptions, run_calibration

        options = CalibrationOptions(
            port,
            skin,
            target,
            report_file,
            folder or Path(f"{stem}.calibration"),
            steps_of(pressed, verified),
            format_name,
            baud,
            hold,
            timeout,
            [name.strip() for name in (fit or usual_fit).split(",") if name.strip()],
            model,
            place_deviation,
        )
        report = run_calibration(options, lambda text: say(text, err=True, lines=True))
    if as_json:
        say(json_text(report))
        return
    for name, value in report["parameters"].items():
        deviation, unit = report["standard_errors"][name], report["units"][name]
        say(f"{name}: {value:.6g} +- {deviation:.2g} {unit}".rstrip())
    for warning in report["warnings"]:
        say(f"warning: {warning}")
    verdicts = {None: "not verified", True: "verified", False: "the verification failed"}
    say(f"{verdicts[report['verified']]}; written: {target}, {report_file}", err=True)


def _planned(
    spec: "SkinSpec",
    force: float,
    most: int,
    accuracy: float,
    place_error: float,
    plot: Path | None,
) -> "Plan":
    """The presses that tell most of a unit, drawn where a file is given."""
    from fitting.calibration.next_press import candidates_of, planned

    with fitting_spinner() as show:
        found = planned(candidates_of(spec, force, place_error, show), most, accuracy)
    if plot is not None:
        from fitting.calibration.plan_figure import plot_plan

        plot_plan(found, plot)
    return found
