"""What a calibrated skin file says about where its numbers come from."""

from typing import Annotated

from pydantic import BeforeValidator

from suas_jax.config.fields import NOT_A_LIST, AsList, Spec, file_key

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

    path: str = file_key('"press.csv"')
    sha256: str = file_key('"e3b0c442..."')


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

    created: str = file_key('"2025-11-21T05:40:12+00:00"', "")
    versions: str = file_key('"suas_jax 0.1"', "")
    parameters: Names = file_key('["oil_gap"]', ())
    units: Names = file_key('["m"]', ())
    values: Numbers = file_key("[5e-3]", ())
    standard_errors: Numbers = file_key("[1e-6]", ())
    covariance: Annotated[tuple[tuple[float, ...], ...], BeforeValidator(rows_of_numbers)] = (
        file_key("[[1e-12]]", ())
    )
    priors: Names = file_key('["oil_gap: 5 mm +- 0.25 mm"]', ())
    unidentifiable: Names = file_key('["lsb is not determined"]', ())
    offsets: Numbers = file_key("[1.5, -0.3]", ())
    offset_errors: Numbers = file_key("[0.1, 0.1]", ())
    masked: Names = file_key('["module 0, taxel 3: stuck"]', ())
    skin: LogRecord | None = file_key('{ path = "suas.toml", sha256 = "e3b0c442..." }', None)
    logs: Annotated[tuple[LogRecord, ...], AsList] = file_key(
        '[ { path = "press.csv", sha256 = "e3b0c442..." } ]', ()
    )
