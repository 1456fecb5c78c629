"""Reader of a specimen's table: what it was subjected to, and what was measured."""

import contextlib
import dataclasses
import math
import re
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from fitting.material.data.column_names import plain_words
from fitting.material.data.errors import DataError
from fitting.material.data.header import given_sizes, stated_sizes
from fitting.material.data.tables import Table
from fitting.material.experiments import timing
from fitting.material.experiments.measurements import Kind, Origin, StressTest
from fitting.material.experiments.named_columns import NamedColumns, closeness_to_specimen
from fitting.material.experiments.prediction import POWERS
from suas_jax.config.quantities import DimensionName, parse_quantity

# Measures of a stretch, how it follows from them, and why some are impossible.
_MEASURES: tuple[tuple[str, Callable[[np.ndarray], np.ndarray], str], ...] = (
    ("stretch", lambda x: x, "a stretch is greater than zero (undeformed: 1)"),
    ("strain", lambda x: 1.0 + x, "a strain is greater than -1 (-100 %)"),
    ("log_strain", np.exp, ""),
    (
        "green_strain",
        lambda x: np.sqrt(np.maximum(1.0 + 2.0 * x, 0.0)),
        "a Green strain is greater than -1/2",
    ),
)
# Columns of the noise, over the readings where it is zero; dimension of what is not stress.
_SIGMAS = {"sigma": 1.0, "relative_sigma": 0.0}
_DIMENSIONS: dict[str, DimensionName] = {"displacement": "length", "force": "force"}
_WIDE = 4.0  # widths over lengths, beyond which a strip is pulled in pure shear
# Share by which a stress may miss the force over the area that it is.
_AS_FORCE = 0.02
_RING = re.compile(r"(?<![a-z])(?:o_?)?ring(?:probe|_type)?(?![a-z])|(?:inner|inside)_diameter")
_PRELOAD = re.compile(r"vorkraft|vorlast|pre_?(?:load|force|tension)|precharge")

AnyStressTest = TypeVar("AnyStressTest", bound=StressTest)


class Reader(NamedColumns):
    """One file on its way to a data set."""

    def __init__(
        self,
        mode: str,
        table: Table,
        specimen: dict[str, str],
        noise: str | None,  # of the readings, where the file doesn't state it
        machine_stiffness: float | None = None,  # [N/m], if the machine's travel is corrected
    ) -> None:
        super().__init__(mode, table)
        self.noise, self.machine_stiffness = noise, machine_stiffness
        # Of a whole test, as the command line states it.
        given = {key: text for key, text in specimen.items() if key in timing.KEYS}
        self.stated = timing.Stated(table.file, table.metadata, given)
        sizes = {key: text for key, text in specimen.items() if key not in timing.KEYS}
        written, doubts = stated_sizes(table.file, table.metadata)
        own = given_sizes(table.file, sizes)
        self.sizes = written | own
        self.warnings += [text for name, text in doubts.items() if name not in own]

    def size(self, name: str) -> np.ndarray | None:
        """A size of the specimen, per row [m]; a column goes before a single value."""
        values = self.column(name)
        if values is not None:
            self.require_positive(values, name)
            return values
        if name in self.sizes:
            return np.full(len(self.table.lines), self.sizes[name])
        return None

    def stretch(self, direction: int = 0) -> np.ndarray:
        """Stretch in a direction, whatever measure states it."""
        # A machine's stiffness corrects its travel, not an extensometer's strain.
        machine = self.machine_stiffness
        moved = None if machine is None else self.column("displacement", direction)
        for quantity, convert, why in _MEASURES if moved is None else ():
            values = self.signed(quantity, direction)
            if values is not None:
                if machine is not None:
                    values = values - self._given_way(direction) / self._needed_length()
                return self._possible(convert(values), quantity, why)
        moved = self.travel(direction)
        if moved is not None:
            length = self._needed_length(direction)
            if machine is not None:
                moved = moved - self._given_way(direction)
            why = "the specimen would have no length left"
            return self._possible(1.0 + moved / length, "displacement", why)
        apart = self.column("current_length", direction)
        if apart is not None:
            ratio = apart / self._needed_length(direction)
            return self._possible(ratio, "current_length", "the specimen has no length left")
        held = self.stated.held_stretch()
        if held is not None and direction != 2:
            return np.full(len(self.table.lines), held)
        tag = max(direction, 1)
        raise self.need("the stretch", f"stretch_{tag}", f"strain_{tag}", "displacement_mm")

    def _possible(self, stretch: np.ndarray, quantity: str, why: str) -> np.ndarray:
        self.require_positive(stretch, quantity, why=why)
        return stretch

    def times(self, strain: np.ndarray) -> np.ndarray:
        """Time of each row [s]; NaN where neither a column nor a rate of strain states it."""
        times = self.seconds()
        return self.stated.times(strain) if times is None else times

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
        force = self.signed("force", direction)
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
        return grips if closeness_to_specimen(name) < 0 else gauge

    def doubt_a_wide_strip(self) -> None:
        """Say where grips keep a pulled specimen from growing narrower: it is too wide."""
        width, length = self.size("width"), self._length_of("displacement")
        if width is None or length is None:
            return
        ratio = float(np.nanmedian(width / length))
        if ratio > _WIDE:
            self.warnings.append(
                f"the specimen is {ratio:.3g} times as wide as long: its grips keep it from "
                f"growing narrower, as in pure shear (--data pure_shear={self.table.file})"
            )

    def area(self) -> np.ndarray:
        """Undeformed cross-section of the specimen, in simple shear the sheared face [m²].

        Raises DataError: no size states it, or the specimen is a ring.
        """
        area = self.size("area")
        if area is not None:
            return area
        sheared = self.mode == "simple_shear"
        side = "length" if sheared else "thickness"
        width, thickness = self.size("width"), self.size(side)
        said = (plain_words(f"{key} {text}") for key, text in self.table.metadata.items())
        flat = width is None and thickness is not None and self.size("diameter") is not None
        if any(map(_RING.search, said)) or (flat and not sheared and self._is_pulled):
            raise DataError(
                f"{self.table.file}: sizes of a ring, whose two legs carry the force: give the "
                f'cross-section of both, such as --specimen "area=32 mm2" for two legs of 4 mm '
                f"by 4 mm"
            )
        if width is not None and thickness is not None:
            return width * thickness
        diameter = self.size("diameter")
        if diameter is not None:
            return 0.25 * math.pi * diameter**2
        raise DataError(
            f"{self.table.file}: force needs the specimen's "
            f"{'sheared face' if sheared else 'cross-section'}: add "
            f'"# width: 6 mm" and "# {side}: 2 mm" (or "# area: 12 mm2", '
            f'"# diameter: 29 mm") to the file or give --specimen "width=6 mm,{side}=2 mm"'
        )

    def stress(self, direction: int = 0) -> tuple[np.ndarray, str] | None:
        """Readings of stress in a direction [Pa] and their measure; None if there are none."""
        for quantity in ("nominal", "cauchy", "second_pk", "stress"):
            values = self.signed(quantity, direction)
            if values is not None:
                return values, self._measure_of(quantity, values, direction)
        force = self.signed("force", direction)
        if force is not None:
            return force / self.area(), "nominal"
        return None

    def _measure_of(self, quantity: str, values: np.ndarray, direction: int) -> str:
        """Measure of stresses, which a force in the file tells where their name doesn't."""
        column = f'column "{self.table.names[self.position(quantity, direction)]}"'
        unnamed = quantity == "stress"
        measure = "nominal" if unnamed else quantity
        taken = "taken as nominal (force over undeformed area)" if unnamed else "kept as it is"
        beside = self._over_force(values, direction)
        if beside is None:
            if unnamed:
                self.warn(
                    f"{column} does not say whether it is nominal or Cauchy stress; {taken}"
                )
            return measure
        ratio, stretch = beside

        def times(measure: str) -> float:
            return float(np.nanmedian(ratio / stretch ** (1 - POWERS[measure])))

        if abs(times(measure) - 1) < _AS_FORCE:
            return measure
        if unnamed and abs(times("cauchy") - 1) < _AS_FORCE:
            self.warn(
                f"{column} is taken as Cauchy stress: it is the force over the undeformed area "
                f"times the stretch"
            )
            return "cauchy"
        self.warn(
            f"{column} is {times(measure):.3g} times the force over the stated cross-section: "
            f"check the sizes; it is {taken}"
        )
        return measure

    def _over_force(
        self, values: np.ndarray, direction: int
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Stresses over the force by the undeformed area, and stretches; None without both."""
        with contextlib.suppress(DataError):
            force, area = self.signed("force", direction), self.area()
            stretch = self.stretch(direction)
            if force is not None and np.any(np.nan_to_num(force)):
                # Near rest a zero that is off by little changes the ratio by much.
                known = np.abs(force) > 0.1 * np.nanmax(np.abs(force))
                return (values * area)[known] / force[known], stretch[known]
        return None

    def needed_stress(self, what: str, *names: str) -> tuple[np.ndarray, str]:
        """As `stress`; what is missing, and columns that would state it, are told."""
        found = self.stress()
        if found is None:
            raise self.need(what, *names)
        return found

    def fields(self, values: np.ndarray, read: str = "stress") -> dict[str, Any]:
        """What the readings of every kind of test share, one entry a row of the table.

        `read`: what they are readings of.
        Raises DataError: a weight is negative, or a noise is not positive.
        """
        return {
            "mode": self.mode,
            "file": self.table.file,
            "value": values,
            "sigma": self._sigma(values, read),
            "weight": self._weight(),
            "specimen": self._specimens(),
            "line": self.table.lines,
            "dropped": {},
            "warnings": tuple(self.warnings),
            "origin": self._origin(),
        }

    def stress_test(
        self,
        kind: type[AnyStressTest],
        measure: str,
        factors: np.ndarray,
        values: np.ndarray,
        *,
        coordinate: np.ndarray | None = None,  # λ₁ unless another is given
        strain: np.ndarray | None = None,  # whose rate a file may state
        **own: Any,  # what else this kind of test has, or has otherwise
    ) -> AnyStressTest:
        """A test of one stress or pressure; see `StressTest`."""
        count = len(values)
        if strain is None:
            strain = np.expm1(factors[0]) if coordinate is None else coordinate
        given: dict[str, Any] = {
            "measure": measure,
            "coordinate": np.exp(factors[0]) if coordinate is None else coordinate,
            "factors": factors,
            "companion": np.zeros(count),
            "direction": np.ones(count, int),
            "time": self.times(strain),
        }
        return self.kept(kind(**self.fields(values), **given | own), factors)

    def kept(self, test: Kind, states: np.ndarray) -> Kind:
        """A test of one reading a row without rows that are masked or miss something.

        Raises DataError: no row is left.
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
        sizes += [self.stated.ramp(), self._preload()]
        for quantity in ("stretch", "strain", "log_strain", "green_strain", "displacement"):
            for d in (0, 1):
                if (quantity, d) in self.columns:
                    index, column = self.columns[quantity, d]
                    return Origin(quantity, self.table.names[index], column.unit, *sizes)
        return Origin("", "", "", *sizes)

    def _preload(self) -> float:
        """Force where the machine set its travel to zero, if the header states one [N]."""
        for key, text in self.table.metadata.items():
            if _PRELOAD.search(key):
                with contextlib.suppress(ValueError):
                    return parse_quantity(text.replace(",", "."), "force")
        return math.nan

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
        cells = [texts[index].casefold().removesuffix(".0") for texts in self.table.texts]
        for row, word in enumerate(cells):
            if word not in words:
                text = self.table.texts[row][index]
                raise DataError(f'{self.at(row, index)}: "{text}" is not allowed; use 1 or 0')
        return np.array([words[word] for word in cells])

    def _specimens(self) -> np.ndarray:
        if ("specimen", 0) not in self.columns:
            name = self.table.metadata.get("specimen", "")
            return np.full(len(self.table.lines), name, dtype=object)
        index = self.columns["specimen", 0][0]
        return np.array([texts[index] for texts in self.table.texts], dtype=object)

    def _sigma(self, values: np.ndarray, read: str) -> np.ndarray:
        """Standard deviation of readings, SI units; NaN where none is stated."""
        own = read in _DIMENSIONS
        columns = {f"sigma_{read}": 1.0} if own else _SIGMAS
        for quantity, size in columns.items():
            sigma = self.column(quantity)
            if sigma is not None:
                sigma = sigma * (size or np.abs(values))
                self.require_positive(sigma, quantity)
                return sigma
        text = self.noise or self.table.metadata.get("sigma", self.table.metadata.get("noise"))
        if text is None:
            return np.full(len(values), np.nan)
        try:
            if text.strip().endswith("%"):
                sigma = parse_quantity(text, "number") * np.abs(values)
            else:
                one = parse_quantity(text, _DIMENSIONS.get(read, "stress"))
                sigma = np.full(len(values), one)
            if np.any(sigma < 0.0) or not np.any(sigma > 0.0):
                raise ValueError("must be greater than zero")
        except ValueError as error:
            what, hint = "", ""
            if self.mode in ("skin", "indentation"):
                what = f" of the {read}"
                hint = (
                    '; give "1 %", or columns sigma_displacement_mm (sigma_force_N) and '
                    "sigma_pressure_kPa"
                )
            raise DataError(f'{self.table.file}: noise "{text}"{what}: {error}{hint}') from None
        return np.where(sigma > 0.0, sigma, np.max(sigma))
