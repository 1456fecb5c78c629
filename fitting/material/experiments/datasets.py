"""Read a file of measurements of one kind of test.

Each reader finds what its kind of test needs among the columns, with the specimen's sizes where
a force or a radius asks for them, and raises a DataError that says what is missing, or
impossible; the measure of the stress goes into the factors c₁, c₂ of each reading.
"""

import os
import re
from collections.abc import Callable, Mapping

import numpy as np

from fitting.column_units import unit_size
from fitting.material.data.errors import DataError, said_of
from fitting.material.data.tables import read_table
from fitting.material.experiments.bulge import bulge
from fitting.material.experiments.measurements import (
    PATHS,
    Dataset,
    StressTest,
    joined,
    mode_named,
)
from fitting.material.experiments.prediction import POWERS, mode_factors, shear_factors
from fitting.material.experiments.skin_readings import indentation, skin
from fitting.material.experiments.table_reader import Reader
from fitting.material.experiments.volumetric import volumetric
from suas_jax.config import load_scene
from suas_jax.config.quantities import parse_quantity


def one_parameter(reader: Reader) -> StressTest:
    """Readings of uniaxial, equibiaxial tension or pure shear: stress over one stretch."""
    names = "nominal_stress_MPa", "cauchy_stress_kPa", "force_N"
    values, measure = reader.needed_stress("the stress", *names)
    stretch = reader.stretch()
    if reader.mode == "uniaxial" and np.nanmax(stretch, initial=1.0) > 1.0:
        reader.doubt_a_wide_strip()
    factors = mode_factors(PATHS[reader.mode], stretch, measure)
    return reader.stress_test(StressTest, measure, factors, values)


def biaxial(reader: Reader) -> StressTest:
    """Readings of general biaxial tension: one stress or both over two stretches."""
    first, second = reader.stretch(1), _second_stretch(reader)
    parts = []
    for direction, own in ((1, first), (2, second)):
        found = reader.stress(direction)
        if found is not None:
            values, measure = found
            pair = [np.zeros_like(own), np.zeros_like(own)]
            pair[direction - 1] = 1.0 / own ** POWERS[measure]
            factors = np.stack([np.log(first), np.log(second), *pair])
            parts.append((values, measure, factors, direction))
    if not parts:
        if any(key[0].startswith("cauchy_difference") for key in reader.columns):
            raise DataError(
                f"{reader.table.file}: this file states a stress difference; use "
                f"--data biaxial_difference={reader.table.file}"
            )
        raise reader.need("the stress", "nominal_stress_1_MPa", "nominal_stress_2_MPa")
    if len({measure for _, measure, _, _ in parts}) > 1:
        raise DataError(f"{reader.table.file}: both stresses must be of the same measure")
    with np.errstate(invalid="ignore"):
        largest = np.fmax.reduce([np.abs(values) for values, *_ in parts])
    sets = [
        reader.stress_test(
            StressTest,
            measure,
            factors,
            values,
            companion=largest,
            direction=np.full(len(values), direction),
        )
        for values, measure, factors, direction in parts
    ]
    return joined(sets)


def _second_stretch(reader: Reader) -> np.ndarray:
    have = {key for key in reader.columns if key[1] == 2}
    measures = "stretch", "strain", "log_strain", "green_strain", "displacement"
    if not any(quantity in measures for quantity, _ in have):
        raise reader.need("the second stretch", "stretch_2", "strain_2")
    return reader.stretch(2)


def difference(reader: Reader) -> StressTest:
    """Readings of the difference of the Cauchy stresses over two stretches."""
    first, second = reader.stretch(1), _second_stretch(reader)
    values = reader.column("cauchy_difference")
    if values is None:
        reversed_sign = reader.column("cauchy_difference_reversed")
        values = None if reversed_sign is None else -reversed_sign
    if values is None:
        pair = [reader.column("cauchy", direction) for direction in (1, 2)]
        if pair[0] is None or pair[1] is None:
            raise reader.need(
                "the stress difference", "cauchy_stress_difference_22_minus_11_MPa"
            )
        values = pair[1] - pair[0]
    one = np.ones_like(first)
    factors = np.stack([np.log(first), np.log(second), -one, one])
    return reader.stress_test(StressTest, "difference", factors, values)


def simple_shear(reader: Reader) -> StressTest:
    """Readings of simple shear: shear stress over the amount of shear."""
    shear, angle = reader.column("shear"), reader.column("shear_angle")
    if shear is None and angle is not None:
        shear = np.tan(angle)
    if shear is None:
        moved, height = reader.column("displacement"), reader.size("thickness")
        if moved is not None and height is not None:
            shear = moved / height
    if shear is None:
        raise reader.need("the amount of shear", "shear_strain", "gamma", "shear_angle_deg")
    values = reader.column("nominal_shear")
    if values is None:
        values, _ = reader.needed_stress("the shear stress", "shear_stress_kPa", "force_N")
    factors = np.stack(shear_factors(shear))
    return reader.stress_test(StressTest, "shear", factors, values, coordinate=shear)


def balloon(reader: Reader) -> StressTest:
    """Readings of a spherical balloon: p = 2 (H/R) σ / λ³ of Cauchy stress σ."""
    values = reader.needed("pressure", "the pressure", "pressure_kPa")
    radius, wide = reader.column("radius"), reader.column("diameter")
    if radius is None and wide is not None:
        radius = 0.5 * wide
    rest = reader.size("rest_radius")
    if any(key[0] in ("stretch", "strain") for key in reader.columns):
        stretch = reader.stretch()
    elif radius is not None and rest is not None:
        reader.require_positive(radius, "radius")
        stretch = radius / rest
    elif radius is not None:
        raise DataError(
            f"{reader.table.file}: the radius needs its undeformed value: add "
            f'"# rest_radius: 20 mm" to the file or --specimen "rest_radius=20 mm"'
        )
    else:
        raise reader.need("the radius", "radius_mm", "diameter_mm", "stretch")
    ratio = reader.size("thickness_ratio")
    if ratio is None:
        thickness = reader.size("thickness")
        if thickness is None or rest is None:
            raise DataError(
                f"{reader.table.file}: a balloon needs its undeformed wall thickness and "
                f'radius: add "# thickness: 0.3 mm" and "# rest_radius: 20 mm" to the file '
                f'or give --specimen "thickness=0.3 mm,rest_radius=20 mm"'
            )
        ratio = thickness / rest
    factors = mode_factors("equibiaxial", stretch)
    factors[2:] *= 2.0 * ratio / stretch**3
    return reader.stress_test(StressTest, "pressure", factors, values)


TESTS: dict[str, Callable[[Reader], Dataset]] = {
    "biaxial": biaxial,
    "biaxial_difference": difference,
    "simple_shear": simple_shear,
    "balloon": balloon,
    "bulge": bulge,
    "volumetric": volumetric,
}
"""Tests that are read in a way of their own; the others are tests of one stretch."""


def load_dataset(
    mode: str,
    path: str | os.PathLike[str],
    specimen: Mapping[str, str] | None = None,
    noise: str | None = None,
    scene: str | os.PathLike[str] | None = None,
    columns: Mapping[str, str] | None = None,
    machine_stiffness: str | None = None,
) -> Dataset:
    """Read one file of measurements.

    Args:
        mode: kind of test, one of `MODES`.
        path: file of a test machine whose column names state measure and unit.
        specimen: sizes with units, such as {"width": "6 mm"}, where the file doesn't
            state them (as columns or as `# width: 6 mm`).
        noise: standard deviation of the readings, "5 kPa" or "2 %", where the file
            doesn't state it.
        scene: scene file of the skin, for the modes "skin" and "indentation".
        columns: what columns measure where their names don't say, such as
            {"force": "3", "extension": "5 mm"}; see `read_table`.
        machine_stiffness: of the machine with its grips, such as "2 kN/mm": its own travel is
            subtracted.

    Raises:
        DataError: the file can't be used; the message names file, line, column, the
            value and what is allowed.
    """
    chosen = mode_named(mode)
    table = read_table(path, columns, plane=chosen in ("biaxial", "biaxial_difference"))
    stiffness = None if machine_stiffness is None else stiffness_of(machine_stiffness)
    reader = Reader(chosen, table, dict(specimen or {}), noise, stiffness)
    if chosen not in ("skin", "indentation"):
        return TESTS.get(chosen, one_parameter)(reader)
    if scene is None:
        raise DataError(
            f"--data {chosen}={path}: a skin needs --scene SCENE: its dimensions and loads"
        )
    return (skin if chosen == "skin" else indentation)(reader, load_scene(scene))


def stiffness_of(text: str) -> float:
    """A machine's stiffness in N/m, from text such as "2 kN/mm".

    Raises DataError: it is none, or not positive.
    """
    found = re.fullmatch(r"\s*([^\s]+)\s+([A-Za-z]+)\s*/\s*([A-Za-zµ]+)\s*", text)
    with said_of(f'--machine-stiffness "{text}"'):
        if found is None:
            raise ValueError('a force over a length is expected, such as "2 kN/mm"')
        force = parse_quantity(f"{found.group(1)} {found.group(2)}", "force")
        if not force > 0.0:
            raise ValueError("must be greater than zero")
        return force / unit_size(found.group(3), "length")
