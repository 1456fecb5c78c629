"""`suas zero`. JAX is imported inside the command."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fitting.cli.contract import Overwrite, answer, bad_input
from fitting.cli.options import (
    AsJson,
    SkinFile,
    argument,
    computing,
    option,
    output_option,
    quantity_option,
    was_written_by,
)
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_output, write_text

if TYPE_CHECKING:
    from fitting.inverse_load.zero.zero import Zero


def zero(
    skin: SkinFile,
    log: Annotated[Path, argument("Log: some seconds at rest, then presses.", metavar="LOG")],
    known: Annotated[
        list[str] | None,
        option(
            'A press, such as "500 g at 0 deg" or "5 N +- 0.05 N at arc 12 mm", on a pad '
            '"500 g at 0 deg, 20 mm"; once for each press, in order. Without --known the '
            "log's columns state them (load_0_force_N, load_0_angle_deg, load_0_axial_mm).",
            metavar="PRESS",
        ),
    ] = None,
    inputs: Annotated[
        Path | None, option("Known inputs in a CSV of their own (t_s).", metavar="FILE")
    ] = None,
    diameter: Annotated[
        str | None,
        option("Diameter of what presses on a pad; default: 6 mm.", metavar="LENGTH"),
    ] = None,
    output: Annotated[
        Path | None,
        output_option("File to write; default: SKIN.zero.toml beside the skin file."),
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Learn from a known weight what the baseline can't show: filling, mounting, stiffness.

    `suas invert` uses the file it writes. Exit status: 0 written, 2 bad input (no file).
    """
    with bad_input():
        from fitting.inverse_load.zero.zero_file import MARK, zero_file_of, zero_text

        target = output or zero_file_of(skin)
        own = output is None and was_written_by(MARK, target)
        check_output(target, overwrite=overwrite or own)
        if known and inputs is not None:
            raise ValueError("--known, --inputs: both say what the presses were; leave one out")
        from suas_jax.config import load_skin

        size = None if diameter is None else quantity_option("--diameter", diameter, "length")
        spec = load_skin(skin)
        with computing("updating the inputs by the known presses"):
            from fitting.inverse_load.zero.from_log import zero_from_log

            found = zero_from_log(spec, log, known or (), inputs, diameter=size)
        write_text(target, zero_text(found, skin, log))
    answer(as_json, _report(found, target), lambda: _print(found, target))


def _report(found: "Zero", target: Path) -> dict[str, Any]:
    place = "angle_rad" if found.errors.spec.geometry.has_angle else "arc_m"
    return {
        "status": found.status,
        "zero_file": str(target),
        "chi2_per_dof": found.chi2_per_dof,
        "readings_at_rest_used": found.at_rest,
        "readings_at_rest_factor": found.rest_factor,
        "presses": [
            {
                "known": press.text,
                place: press.place,
                "axial_m": press.axial,
                "force_N": press.force,
                "force_deviation_before": float(found.before[k]),
                "force_deviation_after": float(found.after[k]),
                **{f"force_deviation_at_{n}": float(x[k]) for n, x in found.after_at.items()},
            }
            for k, press in enumerate(found.presses)
        ],
        "causes": {
            cause.name: {
                "change": cause.change,
                "deviation": cause.deviation,
                "deviation_before": cause.before,
            }
            for cause in found.causes
        },
        "errors": {
            name: {"mean": float(mean), "deviation": float(variance) ** 0.5}
            for name, mean, variance in zip(
                found.errors.names,
                found.posterior.mean,
                found.posterior.covariance.diagonal(),
                strict=True,
            )
        },
        "parameters": list(found.errors.paths),
        "values": found.values.tolist(),
        "covariance": found.covariance.tolist(),
    }


def _print(found: "Zero", target: Path) -> None:
    from fitting.report.description import percent_text

    for k, press in enumerate(found.presses):
        after, before = percent_text(found.after[k]), percent_text(found.before[k])
        say(f"{press.text}: forces there are known to {after} ({before} without the zero)")
        told = [
            f"{name} as large ones to {percent_text(x[k])}"
            for name, x in found.after_at.items()
            if isfinite(x[k])
        ]
        if told:
            say(f"    {', '.join(told)}")
    causes = ", ".join(cause.text for cause in found.causes)
    say(f"what moved, the likeliest first (± one standard deviation): {causes}")
    say(f"chi2 per degree of freedom {found.chi2_per_dof:.2f}, {found.status}")
    if not found.at_rest:
        factor = found.rest_factor
        cause = (
            "readings at rest are not what the skin file leaves open, as with offsets of the "
            "taxels"
            if factor is None
            else f"at rest all taxels read {factor:.3g} times what the skin file says, beyond "
            "its deviations: its permittivity, gap or scale is another, which suas fit sensor "
            "finds from known presses"
        )
        say(f"{cause}. Only changes counted: give suas invert a --baseline", err=True)
    say(f"written: {target}", err=True)
