"""What a calibrated skin file says about where its numbers come from."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field

from suas_jax.config.fields import NOT_A_LIST, AsList, Spec

Names = Annotated[tuple[str, ...], AsList]
Numbers = Annotated[tuple[float, ...], AsList]


def rows_of_numbers(value: object) -> tuple[tuple[float, ...], ...]:
    """A matrix from a file: a list of rows."""
    if not isinstance(value, list | tuple) or any(
        not isinstance(row, list | tuple) for row in value
    ):
        raise ValueError(f"{NOT_A_LIST}, one row for each parameter")
    return tuple(tuple(map(float, row)) for row in value)


class LogRecord(Spec):
    """A file that a calibration was made from.

    Attributes:
        path: as it was named.
        sha256: of its bytes, in hexadecimal digits.
    """

    path: str = Field(examples=['"press.csv"'])
    sha256: str = Field(examples=['"e3b0c442..."'])


class CalibrationSpec(Spec):
    """The record of `suas fit sensor`. It changes no result of the model.

    Attributes:
        created: date and time, UTC.
        versions: of the programs.
        parameters: calibrated keys, in the order of what follows.
        units: SI units.
        values: of the parameters, SI.
        standard_errors: of the values, SI.
        covariance: of the values, SI, in rows.
        priors: what was assumed, in words.
        unidentifiable: what the logs don't determine, in words.
        offsets: counts to be subtracted from a taxel's readings, in the layout's order; nan
            where it is unknown.
        offset_errors: their standard errors [counts].
        masked: taxels that took no part, in words.
        skin: the file that was calibrated.
        logs: files of readings and known inputs.
    """

    created: str = Field(default="", examples=['"2025-11-21T05:40:12+00:00"'])
    versions: str = Field(default="", examples=['"suas_jax 0.1"'])
    parameters: Names = Field(default=(), examples=['["oil_gap"]'])
    units: Names = Field(default=(), examples=['["m"]'])
    values: Numbers = Field(default=(), examples=["[5e-3]"])
    standard_errors: Numbers = Field(default=(), examples=["[1e-6]"])
    covariance: Annotated[tuple[tuple[float, ...], ...], BeforeValidator(rows_of_numbers)] = (
        Field(default=(), examples=["[[1e-12]]"])
    )
    priors: Names = Field(default=(), examples=['["oil_gap: 5 mm +- 0.25 mm"]'])
    unidentifiable: Names = Field(default=(), examples=['["lsb is not determined"]'])
    offsets: Numbers = Field(default=(), examples=["[1.5, -0.3]"])
    offset_errors: Numbers = Field(default=(), examples=["[0.1, 0.1]"])
    masked: Names = Field(default=(), examples=['["module 0, taxel 3: stuck"]'])
    skin: LogRecord | None = Field(
        default=None, examples=['{ path = "suas.toml", sha256 = "e3b0c442..." }']
    )
    logs: Annotated[tuple[LogRecord, ...], AsList] = Field(
        default=(), examples=['[ { path = "press.csv", sha256 = "e3b0c442..." } ]']
    )
