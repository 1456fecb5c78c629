"""Measurements of one file: what was read, in which state, with which noise, in SI units.

Nominal stress is force over undeformed area, Cauchy stress force over current area. Each
reading becomes the combination c₁ τ₁ + c₂ τ₂ of Kirchhoff stresses that its test measures
(see `fitting.experiments`), whatever measure the file states.
"""

import dataclasses
import math
import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from fitting.columns import Column, understand
from fitting.experiments import mode_factors, shear_factors
from fitting.tables import DataError, Table, is_missing, read_table
from suas_jax.config import LineLoadSpec, SceneSpec, load_scene
from suas_jax.config.errors import listed, nearest
from suas_jax.config.quantities import DimensionName, parse_quantity

MODES = (
    "uniaxial",
    "equibiaxial",
    "pure_shear",
    "biaxial",
    "biaxial_difference",
    "simple_shear",
    "balloon",
    "bulge",
    "skin",
)
_ALIASES = {
    "planar": "pure_shear",
    "pure-shear": "pure_shear",
    "simple-shear": "simple_shear",
    "biaxial-difference": "biaxial_difference",
}
# The mode of suas_jax that a one-parameter test is.
PATHS = {"uniaxial": "uniaxial", "equibiaxial": "equibiaxial", "pure_shear": "planar"}

_SPECIMEN_KEYS: dict[str, DimensionName | str] = {
    "length": "length",
    "width": "length",
    "thickness": "length",
    "diameter": "length",
    "radius": "length",
    "rest_radius": "length",
    "area": "area",
    "thickness_ratio": "number",
}


@dataclasses.dataclass(frozen=True)
class Dataset:
    """Readings of one file, one entry per reading (two per row of a biaxial test).

    Attributes:
        mode: kind of test.
        file: where the readings come from.
        measure: what was read: "nominal", "cauchy", "second_pk", "shear", "difference"
            or "pressure".
        coordinate: what a plot is drawn against: stretch, shear or relative height.
        stretch_1: λ₁, shape [n]; of a bulge, an estimate at its apex.
        stretch_2: λ₂, shape [n].
        factors: e₁, e₂, c₁, c₂, shape [4, n]; of a bulge, an estimate.
        value: readings [Pa], shape [n].
        companion: largest stress read at the same state [Pa], shape [n].
        sigma: standard deviation of the noise [Pa], NaN where not stated, shape [n].
        weight: weight in the sum of squares, shape [n].
        direction: 1 or 2, shape [n].
        specimen: name of the specimen of each reading, shape [n].
        line: line in the file, shape [n].
        bulge: thickness over radius of the diaphragm, shape [n]; empty otherwise.
        dropped: how many rows were left out, by reason.
        warnings: what a person should know about this file.
        scene: the skin that was tested, with the pattern of its loads; in this mode the
            coordinate is the force [N] and readings are displacements [m] (direction 1)
            or oil pressures [Pa] (direction 2).
    """

    mode: str
    file: str
    measure: str
    coordinate: np.ndarray
    stretch_1: np.ndarray
    stretch_2: np.ndarray
    factors: np.ndarray
    value: np.ndarray
    companion: np.ndarray
    sigma: np.ndarray
    weight: np.ndarray
    direction: np.ndarray
    specimen: np.ndarray
    line: np.ndarray
    bulge: np.ndarray
    dropped: dict[str, int]
    warnings: tuple[str, ...]
    scene: SceneSpec | None = None

    @property
    def size(self) -> int:
        """Number of readings."""
        return len(self.value)

    def select(self, keep: np.ndarray) -> "Dataset":
        """The readings where `keep` is true."""
        arrays: dict[str, Any] = {
            field.name: getattr(self, field.name)[..., keep]
            for field in dataclasses.fields(self)
            if isinstance(getattr(self, field.name), np.ndarray)
            and getattr(self, field.name).shape[-1:] == (self.size,)
        }
        return dataclasses.replace(self, **arrays)


def mode_named(name: str) -> str:
    """The kind of test that a name means.

    Raises:
        DataError: there is no such kind.
    """
    known = _ALIASES.get(name, name)
    if known in MODES:
        return known
    near = nearest(name, MODES)
    hint = f'did you mean "{near}"? ' if near else ""
    raise DataError(f"--data {name}: unknown mode; {hint}allowed: {listed(MODES)}")


def load_dataset(
    mode: str,
    path: str | os.PathLike[str],
    specimen: Mapping[str, str] | None = None,
    noise: str | None = None,
    scene: str | os.PathLike[str] | None = None,
) -> Dataset:
    """Read one file of measurements.

    Args:
        mode: kind of test, one of `MODES`.
        path: CSV file whose column names state measure and unit.
        specimen: sizes with units, such as {"width": "6 mm"}, where the file doesn't
            state them (as columns or as `# width: 6 mm`).
        noise: standard deviation of the readings, "5 kPa" or "2 %", where the file
            doesn't state it.
        scene: scene file of the skin, for the mode "skin".

    Raises:
        DataError: the file can't be used; the message names file, line, column, the
            value and what is allowed.
    """
    chosen = mode_named(mode)
    reader = _Reader(chosen, read_table(path), dict(specimen or {}), noise)
    if chosen != "skin":
        return reader.dataset()
    if scene is None:
        raise DataError(
            f"--data skin={path}: a skin needs --scene SCENE: its dimensions and loads"
        )
    return reader.skin(load_scene(scene))


class _Reader:
    """One file on its way to a data set."""

    def __init__(
        self, mode: str, table: Table, specimen: dict[str, str], noise: str | None
    ) -> None:
        self.mode, self.table, self.noise = mode, table, noise
        self.warnings: list[str] = []
        self.columns: dict[tuple[str, int], tuple[int, Column]] = {}
        ignored = []
        for index, name in enumerate(table.names):
            try:
                column = understand(name, f"{table.file}: line {table.lines[0]}")
            except ValueError as error:
                raise DataError(str(error).replace(f": line {table.lines[0]}", "", 1)) from None
            if column is None:
                ignored.append(name)
            elif (column.quantity, column.direction) in self.columns:
                other = table.names[self.columns[column.quantity, column.direction][0]]
                raise DataError(
                    f'{table.file}: columns "{other}" and "{name}" mean the same; keep one'
                )
            else:
                self.columns[column.quantity, column.direction] = (index, column)
        if any(ignored):
            names = ", ".join(f'"{name}"' for name in ignored if name)
            self.warnings.append(f"column {names} is not used: not a quantity known here")
        self.sizes = {**self._stated_sizes(), **self._given_sizes(specimen)}

    # ---- columns

    def _stated_sizes(self) -> dict[str, float]:
        """Specimen sizes in the file's comments."""
        sizes = {}
        for key, text in self.table.metadata.items():
            name, factor = _size_named(key)
            if not name:
                continue
            number = _plain_number(text)
            if number is not None and factor is not None:
                unit = {"area": " m2", "thickness_ratio": ""}.get(name, " m")
                text = f"{number * factor!r}{unit}"
            sizes[name] = self._size(name, _SPECIMEN_KEYS[name], text, f"# {key}")
        return sizes

    def _given_sizes(self, specimen: dict[str, str]) -> dict[str, float]:
        for name in specimen:
            if name not in _SPECIMEN_KEYS:
                near = nearest(name, _SPECIMEN_KEYS)
                hint = f'did you mean "{near}"? ' if near else ""
                raise DataError(
                    f"--specimen {name}: unknown size; {hint}allowed: {listed(_SPECIMEN_KEYS)}"
                )
        return {
            name: self._size(name, _SPECIMEN_KEYS[name], text, f"--specimen {name}")
            for name, text in specimen.items()
        }

    def _size(self, name: str, dimension: str, text: str, where: str) -> float:
        try:
            if dimension == "area":
                number, _, unit = text.strip().partition(" ")
                plain = unit.replace("²", "2").replace("^2", "2")
                if not plain.endswith("2"):
                    raise ValueError('an area with its unit is expected, for example "12 mm2"')
                side = parse_quantity(f"1 {plain[:-1]}", "length")
                value = float(number.replace(",", ".")) * side**2
            else:
                value = parse_quantity(text, dimension)  # type: ignore[arg-type]
        except ValueError as error:
            raise DataError(f'{self.table.file}: {where} = "{text}": {error}') from None
        if not value > 0.0:
            raise DataError(
                f'{self.table.file}: {where} = "{text}": {name} must be greater than zero'
            )
        return value

    def column(self, quantity: str, direction: int = 0) -> np.ndarray | None:
        """Values of a column in SI units, NaN where missing; None if there is none.

        Raises:
            DataError: a cell holds neither a number nor a usual sign of a missing one.
        """
        wanted = (0, 1) if direction in (0, 1) else (direction,)
        for d in wanted:
            if (quantity, d) in self.columns:
                index, column = self.columns[quantity, d]
                values = self.table.cells[:, index]
                for row in np.flatnonzero(np.isnan(values)):
                    text = self.table.texts[row][index]
                    if not is_missing(text):
                        raise DataError(
                            f'{self._at(int(row), index)}: "{text[:40]}" is no number; leave '
                            f"the cell empty if the value is missing"
                        )
                return values * column.factor
        return None

    def _at(self, row: int, index: int) -> str:
        return (
            f"{self.table.file}: line {self.table.lines[row]}, "
            f'column "{self.table.names[index]}"'
        )

    def _name(self, quantity: str, direction: int = 0) -> int:
        for d in (direction, 0, 1):
            if (quantity, d) in self.columns:
                return self.columns[quantity, d][0]
        return 0

    def size(self, name: str) -> np.ndarray | None:
        """A size of the specimen, per row [m]; a column goes before a single value."""
        values = self.column(name)
        if values is not None:
            self._require_positive(values, name)
            return values
        if name in self.sizes:
            return np.full(len(self.table.lines), self.sizes[name])
        return None

    def _require_positive(
        self, values: np.ndarray, quantity: str, shown: np.ndarray | None = None, why: str = ""
    ) -> None:
        bad = np.flatnonzero(values <= 0.0)
        if bad.size:
            index = self._name(quantity)
            text = self.table.texts[bad[0]][index]
            raise DataError(
                f"{self._at(bad[0], index)}: {text} is impossible: "
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

    # ---- states and readings

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
        for quantity, convert, why in ways:
            values = self.column(quantity, direction)
            if values is not None:
                stretches = convert(values)
                self._require_positive(stretches, quantity, why=why)
                return stretches
        moved = self.column("displacement", direction)
        if moved is not None:
            length = self.size("length")
            if length is None:
                raise DataError(
                    f"{self.table.file}: displacement needs the specimen's length: add "
                    f'"# length: 25 mm" to the file or --specimen "length=25 mm"'
                )
            stretches = 1.0 + moved / length
            self._require_positive(
                stretches, "displacement", why="the specimen would have no length left"
            )
            return stretches
        raise self.need("the stretch", f"stretch{tag}", f"strain{tag}", "displacement_mm")

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
            name = self.table.names[self._name("stress", direction)]
            self.warnings.append(
                f'column "{name}" does not say whether it is nominal or Cauchy stress; taken '
                f"as nominal (force over undeformed area)"
            )
            return values, "nominal"
        force = self.column("force", direction)
        if force is not None:
            return force / self.area(), "nominal"
        return None

    def dataset(self) -> Dataset:
        """Everything that this file's mode reads."""
        build = {
            "biaxial": self._biaxial,
            "biaxial_difference": self._difference,
            "simple_shear": self._simple_shear,
            "balloon": self._balloon,
            "bulge": self._bulge,
        }.get(self.mode, self._one_parameter)
        return build()

    def _one_parameter(self) -> Dataset:
        found = self.stress()
        if found is None:
            raise self.need("the stress", "nominal_stress_MPa", "cauchy_stress_kPa", "force_N")
        values, measure = found
        stretch = self.stretch()
        factors = _measured(mode_factors(PATHS[self.mode], stretch), stretch, measure)
        return self._finish(measure, stretch, factors, values)

    def _biaxial(self) -> Dataset:
        first, second = self.stretch(1), self._second_stretch()
        parts = []
        for direction, own in ((1, first), (2, second)):
            found = self.stress(direction)
            if found is not None:
                values, measure = found
                zero, one = np.zeros_like(own), np.ones_like(own)
                pair = (one, zero) if direction == 1 else (zero, one)
                factors = _measured((np.log(first), np.log(second), *pair), own, measure)
                parts.append((values, measure, factors, direction))
        if not parts:
            if any(key[0].startswith("cauchy_difference") for key in self.columns):
                raise DataError(
                    f"{self.table.file}: this file states a stress difference; use "
                    f"--data biaxial_difference={self.table.file}"
                )
            raise self.need("the stress", "nominal_stress_1_MPa", "nominal_stress_2_MPa")
        if len({measure for _, measure, _, _ in parts}) > 1:
            raise DataError(f"{self.table.file}: both stresses must be of the same measure")
        with np.errstate(invalid="ignore"):
            largest = np.fmax.reduce([np.abs(values) for values, *_ in parts])
        sets = [
            self._finish(measure, first, factors, values, second, largest, direction)
            for values, measure, factors, direction in parts
        ]
        return _joined(sets)

    def _second_stretch(self) -> np.ndarray:
        have = {key for key in self.columns if key[1] == 2}
        if not any(q in ("stretch", "strain", "log_strain", "green_strain") for q, _ in have):
            raise self.need("the second stretch", "stretch_2", "strain_2")
        return self.stretch(2)

    def _difference(self) -> Dataset:
        first, second = self.stretch(1), self._second_stretch()
        values = self.column("cauchy_difference")
        if values is None:
            reversed_sign = self.column("cauchy_difference_reversed")
            values = None if reversed_sign is None else -reversed_sign
        if values is None:
            pair = [self.column("cauchy", direction) for direction in (1, 2)]
            if pair[0] is None or pair[1] is None:
                raise self.need(
                    "the stress difference", "cauchy_stress_difference_22_minus_11_MPa"
                )
            values = pair[1] - pair[0]
        one = np.ones_like(first)
        factors = np.stack([np.log(first), np.log(second), -one, one])
        return self._finish("difference", first, factors, values, second)

    def _simple_shear(self) -> Dataset:
        shear, angle = self.column("shear"), self.column("shear_angle")
        if shear is None and angle is not None:
            shear = np.tan(angle)
        if shear is None:
            moved, height = self.column("displacement"), self.size("thickness")
            if moved is not None and height is not None:
                shear = moved / height
        if shear is None:
            raise self.need("the amount of shear", "shear_strain", "gamma", "shear_angle_deg")
        values = self.column("nominal_shear")
        if values is None:
            found = self.stress()
            if found is None:
                raise self.need("the shear stress", "shear_stress_kPa", "force_N")
            values = found[0]
        factors = np.stack(shear_factors(shear))
        stretch = np.exp(factors[0])
        return self._finish("shear", stretch, factors, values, 1.0 / stretch, coordinate=shear)

    def _balloon(self) -> Dataset:
        values = self.column("pressure")
        if values is None:
            raise self.need("the pressure", "pressure_kPa")
        radius = self.column("radius")
        rest = self.size("rest_radius")
        if any(key[0] in ("stretch", "strain") for key in self.columns):
            stretch = self.stretch()
        elif radius is not None and rest is not None:
            self._require_positive(radius, "radius")
            stretch = radius / rest
        elif radius is not None:
            raise DataError(
                f"{self.table.file}: the radius needs its undeformed value: add "
                f'"# rest_radius: 20 mm" to the file or --specimen "rest_radius=20 mm"'
            )
        else:
            raise self.need("the radius", "radius_mm", "stretch")
        ratio = self.size("thickness_ratio")
        if ratio is None:
            thickness = self.size("thickness")
            if thickness is None or rest is None:
                raise DataError(
                    f"{self.table.file}: a balloon needs its undeformed wall thickness and "
                    f'radius: add "# thickness: 0.3 mm" and "# rest_radius: 20 mm" to the file '
                    f'or give --specimen "thickness=0.3 mm,rest_radius=20 mm"'
                )
            ratio = thickness / rest
        e1, e2, c1, c2 = mode_factors("equibiaxial", stretch)
        share = 2.0 * ratio / stretch**3
        factors = np.stack([e1, e2, share * c1, share * c2])
        return self._finish("pressure", stretch, factors, values, stretch)

    def _bulge(self) -> Dataset:
        values, height = self.column("pressure"), self.column("height")
        if values is None:
            raise self.need("the pressure", "pressure_kPa")
        if height is None:
            height = self.column("displacement")
        if height is None:
            raise self.need("the apex height", "apex_height_mm")
        radius, thickness = self.size("radius"), self.size("thickness")
        if radius is None and (diameter := self.size("diameter")) is not None:
            radius = 0.5 * diameter
        if radius is None or thickness is None:
            raise DataError(
                f"{self.table.file}: a bulge test needs the diaphragm's radius and thickness: "
                f'add "# radius: 40 mm" and "# thickness: 1.5 mm" to the file or give '
                f'--specimen "radius=40 mm,thickness=1.5 mm"'
            )
        bad = np.flatnonzero(height < 0.0)
        if bad.size:
            index = self._name("height")
            raise DataError(
                f"{self._at(bad[0], index)}: {self.table.texts[bad[0]][index]} is impossible: "
                f"the apex of an inflated diaphragm rises"
            )
        relative = height / radius
        flat = relative == 0.0
        if flat.any():
            self.warnings.append(f"{flat.sum()} rows of a flat diaphragm say nothing; left out")
            values = np.where(flat, np.nan, values)
            relative = np.where(flat, 1.0, relative)
        # The spherical cap of this height (Hill's special solution): stretch 1 + η² at the
        # apex, p = 4 σ η (T/a) / ((1 + η²) λ²). It starts the fit; a membrane finishes it.
        stretch = 1.0 + relative**2
        e1, e2, c1, c2 = mode_factors("equibiaxial", stretch)
        share = 4.0 * relative * thickness / radius / stretch**3
        factors = np.stack([e1, e2, share * c1, share * c2])
        return self._finish(
            "pressure",
            stretch,
            factors,
            values,
            stretch,
            coordinate=relative,
            bulge=thickness / radius,
        )

    def skin(self, scene: SceneSpec) -> Dataset:
        """Displacements and oil pressures of a skin under given forces."""
        lines = [load for load in scene.loads if isinstance(load, LineLoadSpec)]
        if not lines or not any(load.force for load in lines):
            raise DataError(
                f"{self.table.file}: --scene has no line load; the force of the curve needs a "
                f"[[load]] with angle and force"
            )
        force = self.column("force")
        if force is None:
            raise self.need("the force", "force_N")
        readings = [
            (1, "displacement", self.column("displacement"), self.column("sigma_displacement")),
            (2, "pressure", self.column("pressure"), self.column("sigma")),
        ]
        parts = []
        idle = int(np.sum(force == 0.0))
        if idle:
            self.warnings.append(f"{idle} rows without force say nothing; left out")
        for direction, name, values, sigma in readings:
            if values is None:
                continue
            if name == "pressure" and scene.oil.model == "vented":
                raise DataError(f"{self.table.file}: a vented skin has no oil pressure to read")
            values = np.where(force == 0.0, np.nan, values)
            size = 0.01 * float(np.nanmedian(np.abs(values)))
            factors = np.zeros((4, len(values)))
            part = self._finish(
                name,
                np.ones(len(values)),
                np.where(np.isfinite(force), factors, np.nan),
                values,
                companion=np.full(len(values), size),
                direction=direction,
                coordinate=force,
                sigma=self._skin_sigma(values, sigma, name),
            )
            parts.append(dataclasses.replace(part, scene=scene))
        if not parts:
            raise self.need("a reading", "displacement_mm", "oil_pressure_kPa")
        if np.any(parts[0].coordinate < 0.0):
            raise DataError(
                f"{self.table.file}: a force must be positive: it is the sum of the loads' "
                f"magnitudes, their directions are the scene's"
            )
        return _joined(parts)

    def _skin_sigma(
        self, values: np.ndarray, stated: np.ndarray | None, name: str
    ) -> np.ndarray:
        """Standard deviation of readings that are no stresses."""
        if stated is not None:
            self._require_positive(stated, "sigma")
            return stated
        data = self.table.metadata
        text = self.noise or data.get("sigma") or data.get("noise")
        if text is None:
            return np.full(len(values), np.nan)
        try:
            if text.strip().endswith("%"):
                return parse_quantity(text, "number") * np.abs(values)
            kind: DimensionName = "length" if name == "displacement" else "stress"
            return np.full(len(values), parse_quantity(text, kind))
        except ValueError as error:
            raise DataError(
                f'{self.table.file}: noise "{text}" of the {name}: {error}; give "1 %", or '
                f"columns sigma_displacement_mm and sigma_pressure_kPa"
            ) from None

    # ---- what every mode has

    def _finish(
        self,
        measure: str,
        stretch: np.ndarray,
        factors: np.ndarray,
        values: np.ndarray,
        second: np.ndarray | None = None,
        companion: np.ndarray | None = None,
        direction: int = 1,
        coordinate: np.ndarray | None = None,
        bulge: np.ndarray | None = None,
        sigma: np.ndarray | None = None,
    ) -> Dataset:
        count = len(values)
        weight = self.column("weight")
        weight = np.ones(count) if weight is None else weight
        bad = np.flatnonzero(weight < 0.0)
        if bad.size:
            raise DataError(
                f"{self._at(bad[0], self._name('weight'))}: a weight must not be negative"
            )
        masked = ~self._mask() | (weight == 0.0)
        missing = ~np.isfinite(values) | ~np.isfinite(stretch) | ~np.isfinite(factors).all(0)
        missing |= np.isnan(weight)
        keep = ~missing & ~masked
        if not keep.any():
            raise DataError(f"{self.table.file}: no row holds both a state and a reading")
        dropped = {
            "missing value": int(missing.sum()),
            "masked": int((masked & ~missing).sum()),
        }
        data = Dataset(
            mode=self.mode,
            file=self.table.file,
            measure=measure,
            coordinate=stretch if coordinate is None else coordinate,
            stretch_1=stretch,
            stretch_2=factors[1] * 0.0 + np.exp(factors[1]) if second is None else second,
            factors=factors,
            value=values,
            companion=np.zeros(count) if companion is None else companion,
            sigma=self._sigma(values) if sigma is None else sigma,
            weight=weight,
            direction=np.full(count, direction),
            specimen=self._specimens(),
            line=self.table.lines,
            bulge=np.zeros(0) if bulge is None else bulge,
            dropped={reason: n for reason, n in dropped.items() if n},
            warnings=tuple(self.warnings),
        )
        return data.select(keep)

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
                    f'{self._at(row, index)}: "{texts[index]}" is not allowed; use 1 or 0'
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
            self._require_positive(sigma, quantity)
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


def _measured(factors: tuple[np.ndarray, ...], stretch: np.ndarray, measure: str) -> np.ndarray:
    """Turn factors that read Cauchy stress into those of another measure."""
    power = {"cauchy": 0, "nominal": 1, "second_pk": 2}[measure]
    e1, e2, c1, c2 = factors
    return np.stack([e1, e2, c1 / stretch**power, c2 / stretch**power])


def _joined(sets: list[Dataset]) -> Dataset:
    """Readings of several directions of one file as one data set."""
    arrays = {
        field.name: np.concatenate([getattr(part, field.name) for part in sets], axis=-1)
        for field in dataclasses.fields(Dataset)
        if isinstance(getattr(sets[0], field.name), np.ndarray)
    }
    dropped: dict[str, int] = {}
    for part in sets:
        for reason, count in part.dropped.items():
            dropped[reason] = dropped.get(reason, 0) + count
    warnings = tuple(dict.fromkeys(text for part in sets for text in part.warnings))
    changes: dict[str, Any] = {**arrays, "dropped": dropped, "warnings": warnings}
    return dataclasses.replace(sets[0], **changes)


def _plain_number(text: str) -> float | None:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return None


def _size_named(key: str) -> tuple[str, float | None]:
    """Which size of a specimen a comment's key names, and its unit if the key has one."""
    for spelled, bare in ((key, False), (f"{key}_mm", True), (f"{key}_mm2", True)):
        try:
            column = understand(spelled, "")
        except ValueError:  # a known quantity whose unit is missing or another
            continue
        if column is not None and column.quantity in _SPECIMEN_KEYS:
            return column.quantity, None if bare else column.factor
    return "", None
