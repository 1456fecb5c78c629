"""Columns of a table of measurements, as the tests of every mode read them."""

import contextlib
import dataclasses
import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from fitting.material.data.columns import Column, plain_words, quantity_of, understand
from fitting.material.data.errors import DataError
from fitting.material.data.numbers import is_missing
from fitting.material.data.specimen_sizes import given_sizes, stated_sizes
from fitting.material.data.tables import Table
from fitting.material.experiments import timing
from fitting.material.experiments.measurements import Kind, Origin
from suas_jax.config.errors import listed
from suas_jax.config.quantities import parse_quantity


class Reader:
    """One file on its way to a data set.

    Attributes:
        mode: kind of test.
        table: the file.
        noise: standard deviation of the readings, where the file doesn't state it.
        columns: position and meaning by quantity and direction.
        sizes: of the specimen, SI units.
        machine_stiffness: of the machine with its grips [N/m], if its travel is corrected.
        warnings: what a person should know.
    """

    def __init__(
        self,
        mode: str,
        table: Table,
        specimen: dict[str, str],
        noise: str | None,
        machine_stiffness: float | None = None,
    ) -> None:
        self.machine_stiffness = machine_stiffness
        self.mode, self.table, self.noise = mode, table, noise
        self.warnings: list[str] = list(table.remarks)
        self.columns: dict[tuple[str, int], tuple[int, Column]] = {}
        # Known quantities in units that are missing or unknown: an error once asked for.
        self._faulty: dict[str, DataError] = {}
        self._read_names()
        # Of a whole test, as the command line states it.
        self.given = {key: text for key, text in specimen.items() if key in timing.KEYS}
        sizes = {key: text for key, text in specimen.items() if key not in timing.KEYS}
        self.sizes = {**stated_sizes(table), **given_sizes(table, sizes)}

    def _read_names(self) -> None:
        """Find out what the columns measure."""
        ignored = []
        for index, name in enumerate(self.table.names):
            if not name:
                continue
            try:
                column = understand(name, self.table.file)
            except ValueError as error:
                meant = quantity_of(name)
                self._faulty.setdefault(meant or name, DataError(str(error)))
                continue
            if column is None:
                ignored.append(name)
                continue
            key = (column.quantity, column.direction)
            if key not in self.columns:
                self.columns[key] = (index, column)
                continue
            other = self.columns[key][0]
            kept = self._better_of(other, index)
            self.columns[key] = (kept, column) if kept == index else self.columns[key]
        if ignored:
            names = ", ".join(f'"{name}"' for name in ignored)
            self.warnings.append(f"column {names} is not used: not a quantity known here")

    def _better_of(self, first: int, second: int) -> int:
        """Which of two columns of the same meaning to use.

        Raises:
            DataError: neither is the better one.
        """
        names = [self.table.names[i] for i in (first, second)]
        ranks = [_closeness(name) for name in names]
        same = np.array_equal(
            self.table.cells[:, first], self.table.cells[:, second], equal_nan=True
        )
        if ranks[0] == ranks[1] and not same:
            raise DataError(
                f'{self.table.file}: columns "{names[0]}" and "{names[1]}" mean the same; keep '
                f"one, or choose one: --columns QUANTITY={first + 1}"
            )
        kept, left = (second, first) if ranks[1] > ranks[0] else (first, second)
        if not same:
            self.warnings.append(
                f'column "{self.table.names[left]}" is not used: "{self.table.names[kept]}" is '
                f"measured closer to the specimen; --columns QUANTITY={left + 1} chooses it"
            )
        return kept

    def column(self, quantity: str, direction: int = 0) -> np.ndarray | None:
        """Values of a column in SI units, NaN where missing; None if there is none.

        Raises:
            DataError: a cell holds neither a number nor a usual sign of a missing one.
        """
        wanted = (0, 1) if direction in (0, 1) else (direction,)
        if quantity in self._faulty and not any((quantity, d) in self.columns for d in wanted):
            raise self._faulty[quantity]
        for d in wanted:
            if (quantity, d) in self.columns:
                index, column = self.columns[quantity, d]
                values = self.table.cells[:, index]
                for row in np.flatnonzero(np.isnan(values)):
                    text = self.table.texts[row][index]
                    if not is_missing(text):
                        raise DataError(
                            f'{self.at(int(row), index)}: "{text[:40]}" is no number; leave '
                            f"the cell empty if the value is missing"
                        )
                return values * column.factor
        return None

    def at(self, row: int, index: int) -> str:
        """Where a cell is, for messages."""
        return (
            f"{self.table.file}: line {self.table.lines[row]}, "
            f'column "{self.table.names[index]}"'
        )

    def position(self, quantity: str, direction: int = 0) -> int:
        """Which column of the table holds a quantity."""
        for d in (direction, 0, 1):
            if (quantity, d) in self.columns:
                return self.columns[quantity, d][0]
        return 0

    def size(self, name: str) -> np.ndarray | None:
        """A size of the specimen, per row [m]; a column goes before a single value."""
        values = self.column(name)
        if values is not None:
            self.require_positive(values, name)
            return values
        if name in self.sizes:
            return np.full(len(self.table.lines), self.sizes[name])
        return None

    def require_positive(self, values: np.ndarray, quantity: str, why: str = "") -> None:
        """Refuse values that are impossible.

        Raises:
            DataError: names the first of them, and why.
        """
        bad = np.flatnonzero(values <= 0.0)
        if bad.size:
            index = self.position(quantity)
            text = self.table.texts[bad[0]][index]
            raise DataError(
                f"{self.at(bad[0], index)}: {text} is impossible: "
                f"{why or 'it must be greater than zero'}"
            )

    def need(self, what: str, *names: str) -> DataError:
        """What is missing, and what the file has."""
        have = ", ".join(f'"{name}"' for name in self.table.names if name)
        choices = listed(f'"{name}"' for name in names)
        return DataError(
            f"{self.table.file}: {what} is missing for the mode {self.mode}; expected a "
            f"column such as {choices} (the file has {have})"
        )

    def stretch(self, direction: int = 0) -> np.ndarray:
        """Stretch in a direction, whatever measure states it."""
        tag = f"_{direction}" if direction == 2 else "_1"
        ways: tuple[tuple[str, Callable[[np.ndarray], np.ndarray], str], ...] = (
            ("stretch", lambda x: x, "a stretch is greater than zero (undeformed: 1)"),
            ("strain", lambda x: 1.0 + x, "a strain is greater than -1 (-100 %)"),
            ("log_strain", np.exp, ""),
            (
                "green_strain",
                lambda x: np.sqrt(np.maximum(1.0 + 2.0 * x, 0.0)),
                "a Green strain is greater than -1/2",
            ),
        )
        # A machine's stiffness corrects its travel, not an extensometer's strain.
        moved = None
        if self.machine_stiffness is not None:
            moved = self.column("displacement", direction)
        for quantity, convert, why in ways:
            values = self.column(quantity, direction)
            if values is not None and moved is None:
                if self.machine_stiffness is not None:
                    values = values - self._given_way(direction) / self._needed_length()
                stretches = convert(values)
                self.require_positive(stretches, quantity, why=why)
                return stretches
        moved = self.column("displacement", direction)
        if moved is not None:
            length = self._needed_length(direction)
            if self.machine_stiffness is not None:
                moved = moved - self._given_way(direction)
            stretches = 1.0 + moved / length
            self.require_positive(
                stretches, "displacement", why="the specimen would have no length left"
            )
            return stretches
        held = timing.held_stretch(self.table.metadata, self.given, self.table.file)
        if held is not None and direction != 2:
            return np.full(len(self.table.lines), held)
        raise self.need("the stretch", f"stretch{tag}", f"strain{tag}", "displacement_mm")

    def times(self, strain: np.ndarray) -> np.ndarray:
        """Time of each row [s], NaN where neither a column nor a rate of strain states it.

        Args:
            strain: nominal strain, or amount of shear, of each row.
        """
        times = self.column("time")
        if times is not None:
            return times
        return timing.times_by_rate(self.table.metadata, self.given, self.table.file, strain)

    def _needed_length(self, direction: int = 0) -> np.ndarray:
        length = self._length_of("displacement", direction)
        if length is None:
            raise DataError(
                f"{self.table.file}: displacement needs the specimen's length: add "
                f'"# length: 25 mm" to the file or --specimen "length=25 mm"'
            )
        return length

    def _given_way(self, direction: int) -> np.ndarray:
        """Travel that the machine itself takes at each reading's force [m]."""
        assert self.machine_stiffness is not None
        if not {"displacement", "strain", "stretch"} & {key[0] for key in self.columns}:
            raise DataError(
                f"{self.table.file}: --machine-stiffness corrects a displacement, strain or "
                f"stretch; the file has none"
            )
        force = self.column("force", direction)
        if force is None:
            warned = len(self.warnings)
            found = self.stress(direction)
            del self.warnings[warned:]
            if found is None or found[1] != "nominal":
                raise DataError(
                    f"{self.table.file}: --machine-stiffness needs the force, or nominal "
                    f"stress and the specimen's cross-section"
                )
            force = found[0] * self.area()
        return force / self.machine_stiffness

    def _length_of(self, quantity: str, direction: int = 0) -> np.ndarray | None:
        """The length that a displacement stretches: between grips, or the gauge's."""
        gauge, grips = self.size("length"), self.size("grip_separation")
        if gauge is None or grips is None:
            return grips if gauge is None else gauge
        name = self.table.names[self.position(quantity, direction)]
        return grips if _closeness(name) < 0 else gauge

    def area(self) -> np.ndarray:
        """Undeformed cross-section of the specimen [m²]."""
        area = self.size("area")
        if area is not None:
            return area
        width, thickness = self.size("width"), self.size("thickness")
        if width is not None and thickness is not None:
            return width * thickness
        diameter = self.size("diameter")
        if diameter is not None:
            return 0.25 * math.pi * diameter**2
        raise DataError(
            f"{self.table.file}: force needs the specimen's cross-section: add "
            f'"# width: 6 mm" and "# thickness: 2 mm" (or "# area: 12 mm2", '
            f'"# diameter: 29 mm") to the file or give --specimen "width=6 mm,thickness=2 mm"'
        )

    def stress(self, direction: int = 0) -> tuple[np.ndarray, str] | None:
        """Readings of stress in a direction [Pa] and their measure; None if there are none."""
        for quantity in ("nominal", "cauchy", "second_pk"):
            values = self.column(quantity, direction)
            if values is not None:
                return values, quantity
        values = self.column("stress", direction)
        if values is not None:
            name = self.table.names[self.position("stress", direction)]
            self.warnings.append(
                f'column "{name}" does not say whether it is nominal or Cauchy stress; taken '
                f"as nominal (force over undeformed area)"
            )
            return values, "nominal"
        force = self.column("force", direction)
        if force is not None:
            return force / self.area(), "nominal"
        return None

    def fields(self, values: np.ndarray, sigma: np.ndarray | None = None) -> dict[str, Any]:
        """What the readings of every kind of test share, one entry a row of the table.

        Args:
            values: readings [row].
            sigma: standard deviation of their noise [row], if they are no stresses.

        Raises:
            DataError: a weight is negative, or a noise is not positive.
        """
        return {
            "mode": self.mode,
            "file": self.table.file,
            "value": values,
            "sigma": self._sigma(values) if sigma is None else sigma,
            "weight": self._weight(),
            "specimen": self._specimens(),
            "line": self.table.lines,
            "dropped": {},
            "warnings": tuple(self.warnings),
            "origin": self._origin(),
        }

    def kept(self, test: Kind, states: np.ndarray) -> Kind:
        """A test without the rows that are masked or miss something.

        Args:
            test: one reading a row.
            states: what else a row must state [..., row].

        Raises:
            DataError: no row is left.
        """
        missing = ~np.isfinite(test.value) | np.isnan(test.weight)
        missing |= ~np.isfinite(states.reshape(-1, test.size)).all(0)
        masked = ~self._mask() | (test.weight == 0.0)
        keep = ~missing & ~masked
        if not keep.any():
            raise DataError(f"{self.table.file}: no row holds both a state and a reading")
        counts = {"missing value": int(missing.sum()), "masked": int((masked & ~missing).sum())}
        dropped = {reason: count for reason, count in counts.items() if count}
        return dataclasses.replace(test.select(keep), dropped=dropped)

    def _origin(self) -> Origin:
        """Which column states the deformation, and the specimen's length and area."""
        length, area = self._length_of("displacement"), None
        with contextlib.suppress(DataError):
            area = self.area()
        sizes = [math.nan if x is None else float(np.nanmean(x)) for x in (length, area)]
        sizes.append(timing.ramp_of(self.table.metadata, self.given, self.table.file))
        for quantity in ("stretch", "strain", "log_strain", "green_strain", "displacement"):
            for d in (0, 1):
                if (quantity, d) in self.columns:
                    index, column = self.columns[quantity, d]
                    return Origin(quantity, self.table.names[index], column.unit, *sizes)
        return Origin("", "", "", *sizes)

    def _weight(self) -> np.ndarray:
        weight = self.column("weight")
        if weight is None:
            return np.ones(len(self.table.lines))
        bad = np.flatnonzero(weight < 0.0)
        if bad.size:
            raise DataError(
                f"{self.at(bad[0], self.position('weight'))}: a weight must not be negative"
            )
        return weight

    def _mask(self) -> np.ndarray:
        if ("use", 0) not in self.columns:
            return np.ones(len(self.table.lines), dtype=bool)
        index = self.columns["use", 0][0]
        words = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False}
        mask = []
        for row, texts in enumerate(self.table.texts):
            word = texts[index].casefold().removesuffix(".0")
            if word not in words:
                raise DataError(
                    f'{self.at(row, index)}: "{texts[index]}" is not allowed; use 1 or 0'
                )
            mask.append(words[word])
        return np.array(mask)

    def _specimens(self) -> np.ndarray:
        if ("specimen", 0) not in self.columns:
            name = self.table.metadata.get("specimen", "")
            return np.full(len(self.table.lines), name, dtype=object)
        index = self.columns["specimen", 0][0]
        return np.array([texts[index] for texts in self.table.texts], dtype=object)

    def _sigma(self, values: np.ndarray) -> np.ndarray:
        sigma = self.column("sigma")
        relative = self.column("relative_sigma")
        if sigma is None and relative is not None:
            sigma = relative * np.abs(values)
        if sigma is not None:
            quantity = "sigma" if ("sigma", 0) in self.columns else "relative_sigma"
            self.require_positive(sigma, quantity)
            return sigma
        text = self.noise or next(
            (
                self.table.metadata[key]
                for key in ("sigma", "noise")
                if key in self.table.metadata
            ),
            None,
        )
        if text is None:
            return np.full(len(values), np.nan)
        try:
            if text.strip().endswith("%"):
                size = parse_quantity(text, "number") * np.abs(values)
            else:
                size = np.full(len(values), parse_quantity(text, "stress"))
        except ValueError as error:
            raise DataError(f'{self.table.file}: noise "{text}": {error}') from None
        if np.any(size < 0.0) or not np.any(size > 0.0):
            raise DataError(f'{self.table.file}: noise "{text}" must be greater than zero')
        return np.where(size > 0.0, size, np.max(size))


def _closeness(name: str) -> int:
    """1 for an extensometer on the specimen, -1 for the machine's own travel, else 0."""
    plain = plain_words(name)
    if re.search(r"extensom|video|dic|gauge|gage|corrected|strain_1(?!\d)", plain):
        return 1
    if re.search(r"crosshead|cross_head|traverse|stroke|grip|machine|position|actuator", plain):
        return -1
    return 0
