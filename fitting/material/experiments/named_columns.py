"""The columns of a table, found by what they measure."""

import functools
import re

import numpy as np

from fitting.material.data.cells import is_missing
from fitting.material.data.column_names import plain_words
from fitting.material.data.columns import Column, quantity_of, understand
from fitting.material.data.errors import DataError
from fitting.material.data.tables import Table
from fitting.material.experiments.measurements import PATHS
from suas_jax.config.errors import listed

# Readings whose sign tells tension from compression.
_SIGNED = ("force", "stress", "nominal", "cauchy", "strain", "log_strain", "displacement")
_STRAINS = ("strain", "log_strain", "green_strain", "stretch")
_TOGETHER = 0.3  # share of the strain along, across, beyond which both are loaded
# Sizes at rest. A column has one a specimen: more different numbers than this, and than a
# quarter of the readings, are readings themselves.
_AT_REST = ("length", "grip_separation", "width", "thickness", "diameter", "area")
_OWN_SIZES = 6
_UNLOADED = 0.1  # share of the largest force, up to which a test begins without load
# What a file says of its test: the kind, method or standard of it.
_OF_TEST = re.compile(
    r"test|pruef|(?:specimen_)?(?:method|procedure|standard|norm|type|mode)(?![a-z])"
)
_COMPRESSION = r"compress(?!ion_mou?ld)|druckversuch|stauch|iso_7743|astm_d_?575"
# Words for a kind of test, of the modes that a curve's columns can't tell apart.
_KINDS = {
    "uniaxial": re.compile(r"uni_?axial|einachsig|单轴|単軸|一軸"),
    "equibiaxial": re.compile(r"(?:equi|aequi)_?bi_?axial|bulge|等双轴|等二軸"),
    "pure_shear": re.compile(r"pure_?shear|planar|平面|純せん断"),
}
# By their columns: modes that read them, for a file whose stress or state is missed.
_READ_BY = {
    frozenset({"pressure", "height"}): "bulge",
    frozenset({"pressure", "radius"}): "balloon",
    frozenset({"shear"}): "simple_shear",
    frozenset({"shear_angle"}): "simple_shear",
    frozenset({"pressure", "volume_ratio"}): "volumetric",
    frozenset({"pressure", "volumetric_strain"}): "volumetric",
    frozenset({"pressure", "volumetric_compression"}): "volumetric",
}
_CLOCK = re.compile(r"(?:(\d+):)?(\d+):(\d+(?:\.\d*)?)\s*([AaPp][Mm])?")


class NamedColumns:
    """Columns of one file, for a test of a mode."""

    def __init__(self, mode: str, table: Table) -> None:
        self.mode, self.table = mode, table
        self.warnings: list[str] = list(table.remarks)  # what a person should know
        # Position and meaning by quantity and direction.
        self.columns: dict[tuple[str, int], tuple[int, Column]] = {}
        # Known quantities in units that are missing or unknown: an error once asked for.
        self._faulty: dict[str, DataError] = {}
        self._emptiness = ""  # what is said of columns without a value
        self._read_names()

    def _read_names(self) -> None:
        """Find out what the columns measure."""
        ignored, empty = [], []
        for index, name in enumerate(self.table.names):
            try:
                column = understand(name, self.table.file) if name else None
            except ValueError as error:
                self._faulty.setdefault(quantity_of(name) or name, DataError(str(error)))
                continue
            if column is None:
                ignored += [name] if name else []
                continue
            if self._is_empty(index):
                empty.append(name)
                continue
            key = (column.quantity, column.direction)
            if (
                key not in self.columns
                or self._better_of(column.quantity, self.columns[key][0], index) == index
            ):
                self.columns[key] = (index, column)
        self._set_aside_states()
        if self.mode in PATHS:
            self._along_the_load()
            self._doubt_the_mode()
        if ignored:
            names = ", ".join(f'"{name}"' for name in ignored)
            self.warnings.append(f"column {names} is not used: not a quantity known here")
        if empty:
            names = ", ".join(f'"{name}"' for name in empty)
            self._emptiness = f"column {names} is not used: it is empty in every row"
            if self.table.file.casefold().endswith((".xlsx", ".xlsm")):
                self._emptiness += "; formulas count once a spreadsheet has saved their values"
            self.warnings.append(self._emptiness)

    def _is_empty(self, index: int) -> bool:
        """Whether a column, of a table that has rows, holds nothing in any of them."""
        if not np.isnan(self.table.cells[:, index]).all():
            return False
        return bool(self.table.texts) and not any(row[index] for row in self.table.texts)

    def _set_aside_states(self) -> None:
        """Sizes that change from reading to reading are those of the deformed specimen."""
        for key in [key for key in self.columns if key[0] in _AT_REST]:
            values = self.table.cells[:, self.columns[key][0]]
            distinct = len(np.unique(values[np.isfinite(values)]))
            inflated = self.mode == "balloon" and key[0] == "diameter"
            if inflated or distinct <= max(_OWN_SIZES, len(values) / 4):
                continue
            index, column = self.columns.pop(key)
            current = "current_length", key[1]
            taken = key[0] in ("length", "grip_separation") and current not in self.columns
            if taken:
                self.columns[current] = index, column
            self.warnings.append(
                f'column "{self.table.names[index]}" changes from reading to reading: it is '
                + ("a length under load" if taken else "not used")
                + ", not the specimen's size at rest"
            )

    @property
    def _of_test(self) -> list[str]:
        """What the file's head says of its test."""
        return [text for key, text in self.table.metadata.items() if _OF_TEST.match(key)]

    def _doubt_the_mode(self) -> None:
        """Where the file, or a specimen's name, speaks of another kind of test, say so."""
        said = self._of_test
        if found := self.columns.get(("specimen", 0)):
            said += [texts[found[0]] for texts in self.table.texts]
        for text in dict.fromkeys(said):
            kinds = [kind for kind, known in _KINDS.items() if known.search(plain_words(text))]
            if kinds and self.mode not in kinds:
                self.warnings.append(
                    f'"{text[:60]}" speaks of another kind of test than {self.mode}, as which '
                    f"all its readings are taken; kinds need files of their own, such as "
                    f"--data {kinds[0]}=FILE (`suas data`: --mode {kinds[0]})"
                )

    def _along_the_load(self) -> None:
        """Of readings along x and y those along the load count, which change by more."""
        for quantity in {name for name, direction in self.columns if direction == 2}:
            across = self.columns.pop((quantity, 2))
            along = self.columns.pop((quantity, 1), across)
            cells = [self.table.cells[:, index] for index, _ in (along, across)]
            cells = [x if np.isfinite(x).any() else np.zeros(1) for x in cells]
            changes = [float(np.nanmax(x) - np.nanmin(x)) for x in cells]
            if changes[1] > changes[0]:
                along, across = across, along
            self.columns.setdefault((quantity, 1), along)
            if along is not across:
                kept, left = (self.table.names[column[0]] for column in (along, across))
                if quantity in _STRAINS and self.mode != "equibiaxial":
                    self._doubt_one_direction(along[0], across[0])
                more = "by more" if changes[0] != changes[1] else "alike"
                self.warnings.append(
                    f'column "{left}" is not used: "{kept}" changes {more}, so it is taken as '
                    f"the one along the load; --columns {quantity}={across[0] + 1} chooses it"
                )

    def _doubt_one_direction(self, along: int, across: int) -> None:
        """Strains that grow together belong to no test of one direction."""
        first, second = (self.table.cells[:, index] for index in (along, across))
        if not np.isfinite(first + second).any():
            return
        rest = np.nanargmin(np.abs(first)), np.nanargmax(np.abs(first))
        moved = [float(x[rest[1]] - x[rest[0]]) for x in (first, second)]
        if moved[1] * np.sign(moved[0]) > _TOGETHER * abs(moved[0]):
            names = '" and "'.join(self.table.names[index] for index in (along, across))
            self.warnings.append(
                f'"{names}" grow together, as strains of the mode {self.mode} don\'t; read '
                f"it as equibiaxial, or as biaxial where they differ (--data "
                f"equibiaxial=FILE; `suas data`: --mode equibiaxial)"
            )

    def _better_of(self, quantity: str, first: int, second: int) -> int:
        """Which of two columns of the same quantity to use.

        Raises DataError: neither is the better one.
        """
        names = [self.table.names[i] for i in (first, second)]
        ranks = [closeness_to_specimen(name) for name in names]
        same = np.array_equal(
            self.table.cells[:, first], self.table.cells[:, second], equal_nan=True
        )
        if ranks[0] == ranks[1] and not same:
            raise DataError(
                f'{self.table.file}: columns "{names[0]}" and "{names[1]}" mean the same; keep '
                f"one, or choose one: --columns {quantity}={first + 1}"
            )
        kept, left = (second, first) if ranks[1] > ranks[0] else (first, second)
        if not same:
            self.warnings.append(
                f'column "{self.table.names[left]}" is not used: "{self.table.names[kept]}" is '
                f"measured closer to the specimen; --columns {quantity}={left + 1} chooses it"
            )
        return kept

    def column(self, quantity: str, direction: int = 0) -> np.ndarray | None:
        """Values of a column in SI units, NaN where missing; None if there is none.

        Raises DataError: a cell holds neither a number nor a usual sign of a missing one.
        """
        found = self._found(quantity, direction)
        if found is None:
            if quantity in self._faulty:
                raise self._faulty[quantity]
            return None
        index, column = found
        values = self.table.cells[:, index]
        if quantity == "time" and np.isnan(values).any():
            values = _of_clock(values, [texts[index] for texts in self.table.texts])
        for row in np.flatnonzero(np.isnan(values)):
            text = self.table.texts[row][index]
            if not is_missing(text):
                where = self.at(int(row), index)
                raise DataError(
                    f'{where}: "{text[:40]}" is not a number; leave the cell empty if the '
                    "value is missing"
                )
        return values * column.factor

    def needed(self, quantity: str, what: str, *names: str) -> np.ndarray:
        """As `column`; what is missing, and columns that would state it, are told."""
        values = self.column(quantity)
        if values is None:
            raise self.need(what, *names)
        return values

    def _found(self, quantity: str, direction: int = 0) -> tuple[int, Column] | None:
        """Position and meaning of a column; None if there is none."""
        wanted = (0, 1) if direction in (0, 1) else (direction,)
        keys = ((quantity, d) for d in wanted if (quantity, d) in self.columns)
        return next((self.columns[key] for key in keys), None)

    def seconds(self) -> np.ndarray | None:
        """The column of times [s]; None without one. A unit that is not stated is told."""
        times, found = self.column("time"), self._found("time")
        if times is None or found is None:
            return None
        index, column = found
        if not column.unit and np.isfinite(self.table.cells[:, index]).any():
            self.warn(
                f'column "{self.table.names[index]}" states no unit; taken as seconds '
                f'(--columns "time={index + 1} min" says another)'
            )
        return times

    def signed(self, quantity: str, direction: int) -> np.ndarray | None:
        """A column that is negative in compression, where the file counts that as positive."""
        values = self.column(quantity, direction)
        if values is None or not self._is_compression or quantity == "stretch":
            return values
        size = np.nan_to_num(values)
        if size.max() <= -size.min():
            return values
        name = self.table.names[self.position(quantity, direction)]
        self.warn(f'compression is positive in column "{name}"; it is taken as negative')
        return -values

    def travel(self, direction: int) -> np.ndarray | None:
        """The displacement; of a position, farther off than it ever moves, from its first on.

        A column is taken for one where the test begins without load.
        """
        moved, force = self.signed("displacement", direction), self.column("force", direction)
        if moved is None or force is None or not np.isfinite(moved * force).any():
            return moved
        first = np.flatnonzero(np.isfinite(moved * force))[0]
        loaded = abs(force[first]) > _UNLOADED * np.nanmax(np.abs(force))
        if loaded or np.nanmin(np.abs(moved)) <= np.nanmax(moved) - np.nanmin(moved):
            return moved
        name = self.table.names[self.position("displacement", direction)]
        self.warn(f'column "{name}" is a position: the displacement is counted from its first')
        return moved - moved[first]

    def warn(self, text: str) -> None:
        """Tell a person once what comes up whenever a column is read."""
        if text not in self.warnings:
            self.warnings.append(text)

    @functools.cached_property
    def _is_compression(self) -> bool:
        """Whether names of columns, or what is said of the test, speak of compression alone."""
        read = {
            index for (quantity, _), (index, _) in self.columns.items() if quantity in _SIGNED
        }
        said = [self.table.names[index] for index in read]
        said += self._of_test
        words = [plain_words(text) for text in said]
        return (
            self.mode in PATHS
            and any(re.search(_COMPRESSION, text) for text in words)
            and not any(re.search(r"(?<!ex)tens(?:ion|ile)|zug", text) for text in words)
        )

    @property
    def _is_pulled(self) -> bool:
        """Whether most of the force is tension."""
        force = np.nan_to_num(x) if (x := self.column("force")) is not None else np.zeros(1)
        return not self._is_compression and bool(force.max() > -force.min())

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

    def require_positive(self, values: np.ndarray, quantity: str, why: str = "") -> None:
        """Refuse values that are impossible; DataError: names the first of them, and why."""
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
        quantity = names[-1].partition("_")[0]
        moved = quantity == "displacement"
        measured = {key[0] for key in self.columns}
        others = {m for known, m in _READ_BY.items() if known <= measured} - {self.mode}
        unit = {"force": "50 N/V", "displacement": "mm"}.get(quantity, "UNIT")
        return DataError(
            f"{self.table.file}: {what} is missing for the mode {self.mode}; expected a "
            f"column such as {choices} (the file has {have}); if one of them is it, say which, "
            f'with its unit or with what a volt stands for: --columns "{quantity}=NAME {unit}"'
            + (' or, of a stress, "stress=NAME MPa"' if quantity == "force" else "")
            + (' or, of a strain, "strain=NAME %", "green_strain=NAME"' if moved else "")
            + "".join(
                f"; columns such as this file's are read by --data {mode}=FILE (`suas data`: "
                f"--mode {mode})"
                for mode in sorted(others)
            )
            + (f"; {self._emptiness}" if self._emptiness else "")
        )


def _of_clock(values: np.ndarray, texts: list[str]) -> np.ndarray:
    """Times of rows, those such as "00:01:30.5", with a date or without, in seconds."""
    found = [_CLOCK.search(text) for text in texts]
    parts = [[float(x or 0) for x in m.groups()[:3]] if m else [np.nan] * 3 for m in found]
    clock = np.array(parts) @ [3600.0, 60.0, 1.0]
    half = [m[4].casefold() if m and m[4] else "" for m in found]
    clock = np.where([x != "" for x in half], clock % 43200.0, clock)
    clock += np.where([x == "pm" for x in half], 43200.0, 0.0)
    # After midnight a clock begins again.
    again = np.diff(clock, prepend=clock[:1]) < -43200.0
    return np.where(np.isnan(values), clock + 86400.0 * np.cumsum(again), values)


def closeness_to_specimen(name: str) -> int:
    """1 for an extensometer on the specimen, -1 for the machine's own travel, else 0."""
    plain = plain_words(name)
    if re.search(r"extensom|video|dic|gauge|gage|corrected|strain_1(?!\d)", plain):
        return 1
    if re.search(r"crosshead|cross_head|traverse|stroke|grip|machine|position|actuator", plain):
        return -1
    return 0
