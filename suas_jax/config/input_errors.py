"""How far the numbers of a skin file may be off: independent errors of its inputs.

An error is one direction in the space of the continuous inputs, one standard deviation long.
They come from what the file states (``+-``), from the covariance of a calibration
([calibration]), or, where a file says nothing at all, from `DEFAULTS`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Literal, NamedTuple

from suas_jax.config.inputs import given_inputs
from suas_jax.config.schema_calibration import CalibrationSpec
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
"""Standard deviations, relative, of a skin file that states none.

Rubber of one recipe differs by a tenth in stiffness from batch to batch and with the speed of
a test; moulded sheets and gaps are held to a few per cent, an oil's permittivity to what
grade and moisture leave open, a converter's scale to one per cent.
"""

_CALIBRATED = {
    "relative_permittivity": "oil.relative_permittivity",
    "oil_gap": "geometry.oil_gap",
    "lsb": "electrodes.lsb",
    "stray": "electrodes.stray",
}
"""TOML paths of the constants of `suas fit sensor`. Others are sums over several keys."""
_LEAST_VARIANCE = 1e-9  # of a direction that is kept, relative to its constants' own

Source = Literal["stated", "default", "none"]


class InputErrors(NamedTuple):
    """Independent errors of a skin's inputs.

    Attributes:
        paths: TOML paths of the inputs, as `continuous_inputs` lists them.
        directions: change of the inputs by each error of one standard deviation
            [error, path], SI.
        names: of the errors: a path, `STIFFNESS`, or which direction of a calibration.
        source: whether the file states them, or they are `DEFAULTS`; "none" without any.
    """

    paths: tuple[str, ...]
    directions: NDArray[np.float64]
    names: tuple[str, ...]
    source: Source

    def __len__(self) -> int:
        return len(self.names)

    @property
    def text(self) -> str:
        """What is assumed, in a sentence; empty where the file states it."""
        if self.source != "default":
            return ""
        shares = {
            name.rpartition(".")[2].replace("_", " "): f"{100 * DEFAULTS[name]:g} %"
            for name in self.names
            if name in DEFAULTS
        }
        listed = ", ".join(f"{name} {share}" for name, share in shares.items())
        return (
            f"the skin file states no tolerances; one standard deviation is taken as: {listed} "
            '(write your own, such as thickness = "1.50 mm +- 0.03 mm", or "+- 0" where a '
            "value is exact)"
        )


def value_of(spec: SkinSpec, path: str) -> float:
    """Value of a continuous input of a skin with electrodes [SI].

    Args:
        spec: the skin.
        path: as in the file, or the scale, which files need not give.
    """
    if path == "electrodes.lsb" and spec.electrodes is not None:
        return float(spec.electrodes.lsb)
    return float(given_inputs(spec)[path])


def input_errors(spec: SkinSpec) -> InputErrors:
    """The errors of a skin's or a scene's inputs.

    A quantity that is both calibrated and written with ``+-`` counts as it is written.

    Args:
        spec: the skin or the scene.

    Raises:
        ValueError: the record of the calibration can't be understood.
    """
    values = given_inputs(spec)
    stated = {path: deviation_of(value) for path, value in values.items()}
    typical = dict(_typical(spec))
    columns: list[tuple[str, dict[str, float]]] = [
        (path, {path: size})
        for path, size in stated.items()
        if size and (path in typical or not isinstance(values[path], TypicalQuantity))
    ]
    any_stated = any(
        size is not None and not isinstance(values[path], TypicalQuantity)
        for path, size in stated.items()
    )
    record = spec.calibration
    if record is not None and record.covariance:
        known = {path for path, size in stated.items() if size is not None}
        columns += _calibrated(spec, record, known)
    elif not any_stated:
        return default_errors(spec)
    return _joined(columns, "stated" if columns or any_stated else "none")


def default_errors(spec: SkinSpec) -> InputErrors:
    """The errors of a skin that states none, whatever this one states; see `DEFAULTS`."""
    return _joined([*_defaults(spec), *_typical(spec)], "default")


def _typical(spec: SkinSpec) -> Iterator[tuple[str, dict[str, float]]]:
    """The errors of substances that are named, where surroundings make them matter."""
    if getattr(spec, "environment", None) is not None:
        for path, value in given_inputs(spec).items():
            if isinstance(value, TypicalQuantity):
                yield path, {path: value.deviation}


def _defaults(spec: SkinSpec) -> Iterator[tuple[str, dict[str, float]]]:
    values = {path: float(value) for path, value in given_inputs(spec).items()}
    declared = spec.material.declared()
    stresses = {f"material.{key}" for key, c in declared.items() if c.dimension == "stress"}
    for name, share in DEFAULTS.items():
        if name == STIFFNESS:
            constants = {
                path: share * value
                for path, value in values.items()
                if ".".join(path.split(".")[:2]) in stresses
            }
            if constants:
                yield name, constants
        elif name in values:
            yield name, {name: share * values[name]}
        elif name == "electrodes.lsb" and spec.electrodes is not None:
            yield name, {name: share * spec.electrodes.lsb}


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
    parts = [_paths_of(spec, name) for name in names]
    left = [i for i, own in enumerate(parts) if not own.keys() & known]
    covariance = covariance[np.ix_(left, left)]
    # Columns of a root of the covariance: each is one independent error.
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size = np.where(size > 0, size, 1.0)
    widths, axes = np.linalg.eigh(covariance / np.outer(size, size))
    root = size[:, None] * axes * np.sqrt(np.maximum(widths, 0.0))
    for k in np.flatnonzero(widths > _LEAST_VARIANCE)[::-1]:
        largest = left[int(np.argmax(np.abs(axes[:, k])))]
        column: dict[str, float] = {}
        for row, i in enumerate(left):
            for path, factor in parts[i].items():
                column[path] = column.get(path, 0.0) + factor * float(root[row, k])
        yield f"calibration, {names[largest]} above all", column


def _paths_of(spec: SkinSpec, name: str) -> dict[str, float]:
    """Inputs that a calibrated constant stands for, and their change per unit of it."""
    if name == "layers":
        assert spec.electrodes is not None
        layers = spec.electrodes.layers
        if not layers:
            return {}
        total = sum(layer.thickness / layer.relative_permittivity for layer in layers)
        return {
            f"electrodes.layers.{i}.thickness": layer.thickness / total
            for i, layer in enumerate(layers)
        }
    if name.startswith("oil_gap."):
        assert spec.electrodes is not None
        where = [int(text) for text in name.split(".")[1:]]
        taxels = where[1:] or None
        if spec.electrodes.layout == "list":
            numbers = taxels or range(1, len(spec.electrodes.taxels) + 1)
            return {f"electrodes.taxels.{k - 1}.height": -1.0 for k in numbers}
        numbers = taxels or range(1, MODULE_TAXELS + 1)
        return {f"electrodes.modules.{where[0]}.heights.{k - 1}": -1.0 for k in numbers}
    path = _CALIBRATED.get(name, name)
    return {path: 1.0}


def _joined(columns: list[tuple[str, dict[str, float]]], source: Source) -> InputErrors:
    import numpy as np

    paths = tuple(dict.fromkeys(path for _, column in columns for path in column))
    directions = np.array(
        [[column.get(path, 0.0) for path in paths] for _, column in columns]
    ).reshape(len(columns), len(paths))
    return InputErrors(paths, directions, tuple(name for name, _ in columns), source)
