"""Read a file of measurements of one kind of test."""

import os
import re
from collections.abc import Callable, Mapping

from fitting.column_units import unit_size
from fitting.material.data.errors import DataError
from fitting.material.data.tables import read_table
from fitting.material.experiments.bulge import bulge
from fitting.material.experiments.measurements import Dataset, mode_named
from fitting.material.experiments.skin_readings import skin
from fitting.material.experiments.stress_readings import (
    balloon,
    biaxial,
    difference,
    one_parameter,
    simple_shear,
)
from fitting.material.experiments.table_reader import Reader
from fitting.material.experiments.volumetric import volumetric
from suas_jax.config import load_scene
from suas_jax.config.quantities import parse_quantity

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
        scene: scene file of the skin, for the mode "skin".
        columns: what columns measure where their names don't say, such as
            {"force": "3", "extension": "5 mm"}; see `read_table`.
        machine_stiffness: of the machine with its grips, such as "2 kN/mm": the travel that
            it takes itself is taken off.

    Raises:
        DataError: the file can't be used; the message names file, line, column, the
            value and what is allowed.
    """
    chosen = mode_named(mode)
    table = read_table(path, columns, plane=chosen in ("biaxial", "biaxial_difference"))
    stiffness = None if machine_stiffness is None else stiffness_of(machine_stiffness)
    reader = Reader(chosen, table, dict(specimen or {}), noise, stiffness)
    if chosen != "skin":
        return TESTS.get(chosen, one_parameter)(reader)
    if scene is None:
        raise DataError(
            f"--data skin={path}: a skin needs --scene SCENE: its dimensions and loads"
        )
    return skin(reader, load_scene(scene))


def stiffness_of(text: str) -> float:
    """A machine's stiffness in N/m, from text such as "2 kN/mm".

    Raises:
        DataError: it is none, or not positive.
    """
    where = f'--machine-stiffness "{text}"'
    found = re.fullmatch(r"\s*([^\s]+)\s+([A-Za-z]+)\s*/\s*([A-Za-zµ]+)\s*", text)
    try:
        if found is None:
            raise ValueError('a force over a length is expected, such as "2 kN/mm"')
        force = parse_quantity(f"{found.group(1)} {found.group(2)}", "force")
        length = unit_size(found.group(3), "length")
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None
    if not force > 0.0:
        raise DataError(f"{where}: must be greater than zero")
    return force / length
