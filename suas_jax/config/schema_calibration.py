"""What a calibrated skin file says about where its numbers come from."""

import itertools
import math
from typing import Annotated, Self

from pydantic import BeforeValidator, model_validator

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


Rows = Annotated[tuple[tuple[float, ...], ...], BeforeValidator(rows_of_numbers)]


class LogRecord(Spec):
    """A file that a calibration was made from.

    Attributes:
        path: as it was named.
        sha256: of its bytes, in hexadecimal digits.
    """

    path: str = file_key('"press.csv"')
    sha256: str = file_key('"e3b0c442..."')


class DiscrepancySpec(Spec):
    """What presses showed beyond the fitted model: numbers of a process, and the presses.

    `suas invert` takes it off readings; see `fitting.statistics.discrepancy`.

    Attributes:
        common: deviation of all readings of a press together, relative.
        pattern: deviation of single readings, relative.
        apart: over which angle between taxel and press readings err alike [rad].
        along: over which angle of the press [rad].
        force: over which logarithm of its force.
        angles: of the presses [rad].
        forces: of the presses [N].
        changes: of the model's readings from rest, in rows of one press [counts].
        left: readings less the model's, likewise; nan where one was left out [counts].
        noise: their standard deviations, likewise [counts].
        places: what one standard deviation of a place does to them, likewise [counts].
        pushes: what one standard deviation of its force does, likewise [counts].
    """

    common: float = file_key("0.01", ge=0, le=1)
    pattern: float = file_key("0.02", ge=0, le=1)
    apart: float = file_key("0.35", gt=0)
    along: float = file_key("0.5", gt=0)
    force: float = file_key("1.0", gt=0)
    angles: Numbers = file_key("[-0.3, 0.4]", min_length=1, max_length=300)
    forces: Numbers = file_key("[5.0, 10.0]")
    changes: Rows = file_key("[[420.0, -35.0], [-60.0, 800.0]]")
    left: Rows = file_key("[[3.1, -0.4], [nan, 5.2]]")
    noise: Rows = file_key("[[1.1, 0.3], [0.4, 2.0]]")
    places: Rows = file_key("[[25.0, -1.2], [3.0, 40.0]]")
    pushes: Rows = file_key("[[510.0, -40.0], [-70.0, 980.0]]")

    @model_validator(mode="after")
    def _of_one_shape(self) -> Self:
        taxels = len(self.changes[0]) if self.changes else 0
        if len(self.forces) != len(self.angles):
            raise ValueError(f"forces: {len(self.angles)} are needed, one for each of angles")
        for key in ("changes", "left", "noise", "places", "pushes"):
            rows = getattr(self, key)
            if len(rows) != len(self.angles) or {len(row) for row in rows} != {taxels}:
                raise ValueError(
                    f"{key}: {len(self.angles)} rows of {taxels} numbers are needed, a row for "
                    "each press, a number for each taxel"
                )
            if key != "left" and not all(math.isfinite(x) for row in rows for x in row):
                raise ValueError(f"{key}: finite numbers are needed")
        if min(self.forces) <= 0 or min(x for row in self.noise for x in row) <= 0:
            raise ValueError("forces and noise: numbers above zero are needed")
        return self


class PlaceShiftSpec(Spec):
    """By how much further along the arc than they are contacts are felt, as presses show.

    `suas invert` takes it off places, between the angles by straight lines.

    Attributes:
        angles: of places on the skin, in order [rad].
        shifts: there [rad].
        covariance: of the shifts, in rows [rad^2].
    """

    angles: Numbers = file_key("[-1.0, 1.0]", min_length=1, max_length=300)
    shifts: Numbers = file_key("[-0.012, -0.008]")
    covariance: Rows = file_key("[[9e-6, 4e-6], [4e-6, 9e-6]]")

    @model_validator(mode="after")
    def _of_one_shape(self) -> Self:
        count, rows = len(self.angles), [len(row) for row in self.covariance]
        if len(self.shifts) != count or rows != [count] * count:
            raise ValueError(f"shifts, covariance: {count} are needed, one for each of angles")
        numbers = (*self.angles, *self.shifts, *itertools.chain(*self.covariance))
        if not all(map(math.isfinite, numbers)):
            raise ValueError("angles, shifts, covariance: finite numbers are needed")
        felt = [a + b for a, b in zip(self.angles, self.shifts, strict=True)]
        for key, own in (("angles", self.angles), ("angles with shifts", felt)):
            if not all(a < b for a, b in itertools.pairwise(own)):
                raise ValueError(f"{key}: numbers in ascending order are needed")
        return self


class CalibrationSpec(Spec):
    """The record of `suas fit sensor`. It changes no result of the model.

    Estimates of loads read it: covariance, offsets, place_shift, force_scatter and
    discrepancy. Simulated readings have its offsets.

    Attributes:
        created: date and time, UTC.
        taken: when the log of a zero began; empty where it does not say.
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
        place_shift: by how much further along the arc than they are contacts are felt, as
            presses show; it is taken off estimated places.
        force_scatter: what forces scatter by from press to press, standard deviation,
            relative.
        discrepancy: what presses showed beyond the model, where they did.
        skin: the file that was calibrated.
        logs: files of readings and known inputs.
    """

    created: str = file_key('"2025-11-21T05:40:12+00:00"', "")
    taken: str = file_key('"2025-11-21T05:40:12+00:00"', "")
    versions: str = file_key('"suas_jax 0.1"', "")
    parameters: Names = file_key('["oil_gap"]', ())
    units: Names = file_key('["m"]', ())
    values: Numbers = file_key("[5e-3]", ())
    standard_errors: Numbers = file_key("[1e-6]", ())
    covariance: Rows = file_key("[[1e-12]]", ())
    priors: Names = file_key('["oil_gap: 5 mm +- 0.25 mm"]', ())
    unidentifiable: Names = file_key('["lsb is not determined"]', ())
    offsets: Numbers = file_key("[1.5, -0.3]", ())
    offset_errors: Numbers = file_key("[0.1, 0.1]", ())
    masked: Names = file_key('["module 0, taxel 3: stuck"]', ())
    place_shift: PlaceShiftSpec | None = file_key("{ angles = [-1.0, 1.0] }", None)
    force_scatter: float = file_key("0.008", 0.0, ge=0, le=1)
    discrepancy: DiscrepancySpec | None = file_key("{ common = 0.01 }", None)
    skin: LogRecord | None = file_key('{ path = "suas.toml", sha256 = "e3b0c442..." }', None)
    logs: Annotated[tuple[LogRecord, ...], AsList] = file_key(
        '[ { path = "press.csv", sha256 = "e3b0c442..." } ]', ()
    )

    def offsets_of(self, taxels: int) -> tuple[float, ...]:
        """Offsets of so many taxels [counts]; zeros where none were found.

        Raises ValueError: they are of another number of taxels.
        """
        if self.offsets and len(self.offsets) != taxels:
            raise ValueError(
                f"[calibration] offsets: {len(self.offsets)} numbers for the skin's "
                f"{taxels} taxels"
            )
        return self.offsets or (0.0,) * taxels
