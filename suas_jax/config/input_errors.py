"""How far the numbers of a skin file may be off: independent errors of its inputs.

An error is one direction in the space of the continuous inputs, one standard deviation long.
It comes from what the file states (``+-``, `correlation`), from the covariance of a
calibration, or, for what a file says nothing of, from `DEFAULTS`.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from suas_jax.config.inputs import given_inputs
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.config.schema_load import EnvironmentSpec
from suas_jax.config.schema_scene import SkinSpec
from suas_jax.config.schema_skin import MODULE_TAXELS
from suas_jax.config.tolerance import TypicalQuantity, deviation_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

STIFFNESS = "stiffness of the material"
DEFAULTS: Mapping[str, float] = {
    STIFFNESS: 0.10,
    "geometry.thickness": 0.03,
    "geometry.oil_gap": 0.03,
    "oil.relative_permittivity": 0.02,
    "electrodes.lsb": 0.01,
}
"""Standard deviations, relative, of inputs of which a skin file states none.

Rubber of one recipe differs by a tenth in stiffness from batch to batch and with the speed of
a test; moulded sheets and gaps are held to a few per cent, an oil's permittivity to what
grade and moisture leave open, a converter's scale to one per cent.
"""

_FILL, _MOUNTING = 3e-3, 5e-4
"""Standard deviations of what no file tells unless it names it, see `as_assembled`.

A syringe and a weighed film fill to some tenths of a per cent, a sheet is cut and glued to
some hundredths of a millimetre.
"""
WARMTH = 5.0
"""The same of the temperature: water changes by several kelvin between two looks at it [K]."""
_ASSEMBLY = ("oil.fill", "geometry.mounting", "environment.temperature")

_CALIBRATED = {
    "relative_permittivity": "oil.relative_permittivity",
    "oil_gap": "geometry.oil_gap",
    "lsb": "electrodes.lsb",
    "stray": "electrodes.stray",
    "fill": "oil.fill",
    "mounting": "geometry.mounting",
    "thickness": "geometry.thickness",
}
"""TOML paths of the constants of `suas fit sensor`. Others are sums over several keys."""
ELECTRICAL = ("geometry.oil_gap", "oil.relative_permittivity", "electrodes.")
"""Beginnings of paths of what readings depend on beside the membrane's shape."""
_MECHANICAL = ("material.", "geometry.thickness", "geometry.mounting", "oil.fill")
_LEAST_VARIANCE = 1e-9  # of a direction that is kept, relative to its constants' own


class InputErrors(NamedTuple):
    """Independent errors of a skin's inputs."""

    paths: tuple[str, ...]  # TOML paths of the inputs, as `continuous_inputs` lists them
    # change of the inputs by each error of one standard deviation [error, path], SI
    directions: "NDArray[np.float64]"
    # a path, `STIFFNESS`, or which direction of a material or of a calibration
    names: tuple[str, ...]
    assumed: tuple[str, ...]  # those of them that are `DEFAULTS`
    spec: SkinSpec  # the skin, which names every path

    def __len__(self) -> int:
        return len(self.names)

    @property
    def text(self) -> str:
        """What is assumed, in a sentence; empty where the file states everything."""
        sizes = [(name, 100 * DEFAULTS[name], "%") for name in self.assumed]
        for name, column in _typical(self.spec):
            if name in _ASSEMBLY:
                kelvin = name.endswith("temperature")
                size = column[name] if kelvin else 100 * column[name]
                sizes.append((name, size, "K" if kelvin else "%"))
        if not sizes:
            return ""
        listed = ", ".join(
            f"{name.rpartition('.')[2].replace('_', ' ')} {size:g} {unit}"
            for name, size, unit in sizes
        )
        return (
            f"where the skin file states no tolerances, ± assumes {listed} (state your own, "
            'such as thickness = "1.50 mm +- 0.03 mm")'
        )


def value_of(spec: SkinSpec, path: str) -> float:
    """Value of a continuous input of a skin with electrodes [SI], or of its scale."""
    if path == "electrodes.lsb" and spec.electrodes is not None:
        return float(spec.electrodes.lsb)
    return float(given_inputs(spec)[path])


def scaled_input(spec: SkinSpec, path: str, factor: float) -> dict[str, float]:
    """A continuous input, or all values of a table, times a factor, by path [SI]."""
    table = {
        own: factor * float(x)
        for own, x in given_inputs(spec).items()
        if own.startswith(f"{path}.value.")
    }
    return table or {path: factor * value_of(spec, path)}


def input_errors(spec: SkinSpec) -> InputErrors:
    """The errors of a skin's or a scene's inputs.

    A quantity that is both calibrated and written with ``+-`` counts as it is written. What is
    neither has its default; of a calibrated skin that is its mechanics alone, for the constants
    of its readings were found together. Raises ValueError: the record of the calibration can't
    be understood.
    """
    values = given_inputs(spec)
    typical = dict(_typical(spec))
    stated = {
        path: size
        for path, value in values.items()
        if (size := deviation_of(value)) is not None
        and (path in typical or not isinstance(value, TypicalQuantity))
    }
    told = set(stated) - set(typical)
    together = list(_correlated(spec, stated))
    joint = {path for _, column in together for path in column}
    columns = [(path, {path: size}) for path, size in stated.items() if size]
    columns = [pair for pair in columns if pair[0] not in joint] + together
    record = spec.calibration
    calibrated = record is not None and bool(record.covariance)
    by_presses: set[str] = set()
    if calibrated:
        assert record is not None
        found = list(_calibrated(spec, record, told))
        columns += found
        by_presses = {path for _, column in found for path in column}
        told |= by_presses
    # Known forces tell how stiff the membrane is, whatever makes it so.
    pressed = any(path.startswith(_MECHANICAL) for path in by_presses)
    defaults = [
        (name, column)
        for name, column in _defaults(spec)
        if not told & column.keys()
        and not pressed
        and not (calibrated and all(path.startswith(ELECTRICAL) for path in column))
    ]
    return _joined(spec, [*columns, *defaults], tuple(name for name, _ in defaults))


def default_errors(spec: SkinSpec) -> InputErrors:
    """The errors of a skin that states none, whatever this one states; see `DEFAULTS`."""
    defaults = list(_defaults(spec))
    assumed = tuple(name for name, _ in defaults)
    return _joined(spec, [*defaults, *_typical(spec)], assumed)


def as_assembled(spec: SkinSpec) -> SkinSpec:
    """A skin that names what its file leaves out and hands decide: filling, mounting, warmth.

    The numbers are those that a file without them stands for, each with a deviation: 0.3 % of
    the oil, 0.05 % of the membrane's length, and 5 K where the file knows how parts grow. A
    file whose thickness is exact (``+- 0``) is a drawing's, and stays as it is. A calibration
    of filling or mounting knows what both do to forces.
    """
    if deviation_of(spec.geometry.thickness) == 0:
        return spec
    tables: dict[str, Any] = {}
    record = spec.calibration
    found = {_CALIBRATED.get(n, n) for n in (() if record is None else record.parameters)}
    known = not found.isdisjoint(_ASSEMBLY[:2])
    if not known and spec.oil.trapped and deviation_of(spec.oil.fill) is None:
        fill = TypicalQuantity(spec.oil.fill or 1.0, _FILL)
        tables["oil"] = spec.oil.model_copy(update={"fill": fill})
    if not known and deviation_of(spec.geometry.mounting) is None:
        mounting = TypicalQuantity(spec.geometry.mounting or 0.0, _MOUNTING)
        tables["geometry"] = spec.geometry.model_copy(update={"mounting": mounting})
    parts = (spec.material, spec.oil, spec.wall)
    around = spec.environment or EnvironmentSpec()
    warmth_told = _ASSEMBLY[2] in found or deviation_of(around.temperature) is not None
    if any(part.expansion is not None for part in parts) and not warmth_told:
        now = around.temperature or spec.reference.temperature
        warmth = TypicalQuantity(now, WARMTH)
        tables["environment"] = around.model_copy(update={"temperature": warmth})
    return spec.model_copy(update=tables)


def _typical(spec: SkinSpec) -> Iterator[tuple[str, dict[str, float]]]:
    """The errors of an assembly, and of substances where surroundings make them matter."""
    for path, value in given_inputs(spec).items():
        matters = path in _ASSEMBLY or spec.environment is not None
        if matters and isinstance(value, TypicalQuantity):
            yield path, {path: value.deviation}


def _defaults(spec: SkinSpec) -> Iterator[tuple[str, dict[str, float]]]:
    values = {path: float(value) for path, value in given_inputs(spec).items()}
    for name, share in DEFAULTS.items():
        if name == STIFFNESS:
            constants = {path: share * value for path, value in stresses_of(spec).items()}
            if constants:
                yield name, constants
        elif table := [path for path in values if path.startswith(f"{name}.value.")]:
            yield name, {path: share * values[path] for path in table}
        elif name in values:
            yield name, {name: share * values[name]}
        elif name == "electrodes.lsb" and spec.electrodes is not None:
            yield name, {name: share * spec.electrodes.lsb}


def stresses_of(spec: SkinSpec) -> dict[str, float]:
    """Constants of the material that are stresses, by path [Pa]."""
    declared = spec.material.declared()
    own = {f"material.{key}" for key, c in declared.items() if c.dimension == "stress"}
    return {
        path: float(value)
        for path, value in given_inputs(spec).items()
        if ".".join(path.split(".")[:2]) in own
    }


def _calibrated(
    spec: SkinSpec, record: CalibrationSpec, known: set[str]
) -> Iterator[tuple[str, dict[str, float]]]:
    """The errors that a calibration leaves, from the covariance that it wrote."""
    import numpy as np

    names = record.parameters
    values = np.array(record.values, float)
    ragged = {len(row) for row in record.covariance} != {len(names)}
    if ragged or len(record.covariance) != len(names) or len(values) != len(names):
        raise ValueError(
            f"[calibration] covariance: {len(names)} rows of as many numbers are needed, "
            "one for each of parameters and values"
        )
    covariance = np.array(record.covariance, float)
    if not (np.isfinite(covariance).all() and np.isfinite(values).all()):
        raise ValueError("[calibration] covariance and values: finite numbers are needed")
    given = given_inputs(spec)
    for name in names:
        path = _CALIBRATED.get(name, name)
        if path in _ASSEMBLY and path not in given:
            table, key = path.split(".")
            raise ValueError(
                f'[calibration] parameters name "{name}", but [{table}] has no {key}: '
                "add the value that was found, as `suas fit sensor` writes it"
            )
    parts = [_paths_of(spec, name, value) for name, value in zip(names, values, strict=True)]
    left = [i for i, own in enumerate(parts) if not own.keys() & known]
    covariance = covariance[np.ix_(left, left)]
    kept = [names[i] for i in left]
    yield from _independent("calibration", kept, [parts[i] for i in left], covariance)


def _correlated(
    spec: SkinSpec, stated: Mapping[str, float]
) -> Iterator[tuple[str, dict[str, float]]]:
    """The errors of the material's constants that are known together."""
    import numpy as np

    record = spec.material.correlation
    if record is None:
        return
    paths = [f"material.{name}" for name in record.of]
    sizes = np.array([stated.get(path, 0.0) for path in paths])
    covariance = np.array(record.matrix) * np.outer(sizes, sizes)
    parts: list[Mapping[str, float]] = [{path: 1.0} for path in paths]
    yield from _independent("material", record.of, parts, covariance)


def _independent(
    label: str,  # what found the constants
    names: Sequence[str],  # of the constants
    # inputs that each stands for, and their change per unit of it
    parts: Sequence[Mapping[str, float]],
    covariance: "NDArray[np.float64]",  # of the constants
) -> Iterator[tuple[str, dict[str, float]]]:
    """Independent errors of constants that are known together, the largest first."""
    import numpy as np

    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size = np.where(size > 0, size, 1.0)
    # Columns of a root of the covariance: each is one independent error.
    widths, axes = np.linalg.eigh(covariance / np.outer(size, size))
    root = size[:, None] * axes * np.sqrt(np.maximum(widths, 0.0))
    told: list[str] = []
    for k in np.flatnonzero(widths > _LEAST_VARIANCE)[::-1]:
        column: dict[str, float] = {}
        for i, part in enumerate(parts):
            for path, factor in part.items():
                column[path] = column.get(path, 0.0) + factor * float(root[i, k])
        most = names[int(np.argmax(np.abs(axes[:, k])))]
        told.append(most)
        again = f" ({told.count(most)})" if told.count(most) > 1 else ""
        yield f"{label}, {most} above all{again}", column


def _paths_of(spec: SkinSpec, name: str, value: float) -> dict[str, float]:
    """Inputs that a calibrated constant stands for, and their change per unit of it."""
    if name == "stiffness":
        return {path: x / value for path, x in stresses_of(spec).items()}
    if name == "layers":
        layers = spec.sensing.layers
        if not layers:
            return {}
        total = sum(layer.thickness / layer.relative_permittivity for layer in layers)
        return {
            f"electrodes.layers.{i}.thickness": layer.thickness / total
            for i, layer in enumerate(layers)
        }
    if name.startswith("oil_gap."):
        where = [int(text) for text in name.split(".")[1:]]
        taxels = where[1:] or None
        if spec.sensing.layout == "list":
            numbers = taxels or range(1, len(spec.sensing.taxels) + 1)
            return {f"electrodes.taxels.{k - 1}.height": -1.0 for k in numbers}
        numbers = taxels or range(1, MODULE_TAXELS + 1)
        return {f"electrodes.modules.{where[0]}.heights.{k - 1}": -1.0 for k in numbers}
    path = _CALIBRATED.get(name, name)
    return {path: 1.0}


def _joined(
    spec: SkinSpec, columns: Sequence[tuple[str, Mapping[str, float]]], assumed: tuple[str, ...]
) -> InputErrors:
    import numpy as np

    paths = tuple(dict.fromkeys(path for _, column in columns for path in column))
    directions = np.array(
        [[column.get(path, 0.0) for path in paths] for _, column in columns]
    ).reshape(len(columns), len(paths))
    return InputErrors(paths, directions, tuple(name for name, _ in columns), assumed, spec)
