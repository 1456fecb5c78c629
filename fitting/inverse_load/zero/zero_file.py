"""The file that `suas zero` writes: plain TOML, beside the skin file.

::

    [zero]                   the keys of [calibration]: paths, values, covariance, hashes
    [[press]]                what was known, and how sure a force is there

The values take the place of the skin file's, their covariance that of its tolerances.
"""

from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from fitting.inverse_load.zero.zero import Zero, zeroed_inputs
from suas_jax.acquisition.log.reader import MOST_BYTES as LOG_BYTES
from suas_jax.config import ConfigError, SkinSpec, format_quantity, load_skin
from suas_jax.config.errors import Mistake
from suas_jax.config.input_errors import WARMTH, as_assembled
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.config.toml_file import MOST_BYTES, read_toml
from suas_jax.config.validation import validate_table
from suas_jax.files.reading import read_bytes, sha256_of

ENDING = ".zero.toml"
MARK = "written by suas zero"
_TABLES = ("zero", "press")
_OF_TAXELS = ("offsets", "offset_errors", "masked")  # which a zero leaves as they are
_WARMTH_PATH = "environment.temperature"
_NEGLIGIBLE = 0.1  # change of temperature that nothing is said of [K]
_UNITS = {
    **dict.fromkeys(("fill", "mounting", "mounting_axial", "relative_permittivity"), "1"),
    **dict.fromkeys(("lsb", "stray"), "F"),
    **dict.fromkeys(("temperature",), "K"),
    **dict.fromkeys(("expansion",), "1/K"),
    **dict.fromkeys(("bulk_modulus", "pressure"), "Pa"),
}


def zero_file_of(skin: Path) -> Path:
    """Where the zero of a skin file stands: beside it."""
    return skin.with_name(skin.stem + ENDING)


def zero_text(zero: Zero, skin: Path, log: Path) -> str:
    """The file of a zero. `zero`: what known presses said. `log`: that held the presses."""
    spec, paths = zero.errors.spec, zero.errors.paths
    document: Any = tomlkit.document()
    document.add(tomlkit.comment(f"{MARK}; used by suas invert; SI units"))
    table = tomlkit.table()
    table["created"] = datetime.now(UTC).isoformat(timespec="seconds")
    table["taken"] = zero.taken
    table["versions"] = f"suas-jax {version('suas-jax')}"
    table["parameters"] = list(paths)
    table["units"] = [_unit(spec, path) for path in paths]
    table["values"] = zero.values.tolist()
    covariance = zero.covariance
    table["standard_errors"] = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    table["covariance"] = [row.tolist() for row in covariance]
    table["priors"] = [f"{name}: one standard deviation" for name in zero.errors.names]
    table["skin"] = _file(skin, MOST_BYTES)
    table["logs"] = [_file(log, LOG_BYTES)]
    document["zero"] = table
    presses = tomlkit.aot()
    for press, before, after in zip(zero.presses, zero.before, zero.after, strict=True):
        row = tomlkit.table()
        row["known"] = press.text
        row["force"] = format_quantity(press.force, "force")
        if spec.geometry.has_angle:
            row["angle"] = format_quantity(press.place, "angle")
        else:
            row["arc"] = format_quantity(press.place, "length")
        if press.axial is not None:
            row["axial"] = format_quantity(press.axial, "length")
        row["force_deviation_before"] = f"{100 * before:.3g} %"
        row["force_deviation_after"] = f"{100 * after:.3g} %"
        presses.append(row)
    document["press"] = presses
    return str(tomlkit.dumps(document))


def _unit(spec: SkinSpec, path: str) -> str:
    if path.startswith("material.") and not path.endswith(("expansion", "bulk_modulus")):
        head = path.removeprefix("material.").split(".")[0]
        return spec.material.unit(head) if head in spec.material.declared() else "SI"
    keys = [key for key in path.split(".") if not key.isdigit()]
    return _UNITS.get(keys[-1], "m" if keys[0] == "geometry" else "SI")


def _file(path: Path, most: int) -> Any:
    row = tomlkit.inline_table()
    row.update({"path": str(path), "sha256": sha256_of(path, most)})
    return row


def read_zero(path: Path, skin: Path) -> CalibrationSpec:
    """Read a zero and check that it is the skin's.

    The file is what `suas zero` wrote.
    Raises ConfigError: the file can't be understood, or it is another skin file's.
    """
    data, file = read_toml(path), str(path)
    foreign = [key for key in data if key not in _TABLES]
    if foreign or "zero" not in data:
        key = foreign[0] if foreign else "zero"
        advice = "is not a table of a zero" if foreign else "is missing"
        raise ConfigError([Mistake(file, key, f"{advice}; give a file that `suas zero` wrote")])
    record, findings = validate_table(CalibrationSpec, data["zero"], "zero")
    if record is None:
        raise ConfigError([Mistake(file, k, advice, value) for k, advice, value in findings])
    sizes = {len(record.parameters), len(record.values), len(record.covariance)}
    finite = np.isfinite([*record.values, *(x for row in record.covariance for x in row)]).all()
    if len(sizes) != 1 or not record.parameters or not finite:
        advice = "parameters, values and covariance need as many finite entries each"
        raise ConfigError([Mistake(file, "zero", advice)])
    if record.skin is None or record.skin.sha256 != sha256_of(skin, MOST_BYTES):
        raise ConfigError(
            [
                Mistake(
                    file,
                    "zero.skin",
                    f"the zero was made for another skin file, or {skin} has changed since; "
                    "run suas zero again, or leave it out with --zero none",
                )
            ]
        )
    return record


def zeroed(spec: SkinSpec, record: CalibrationSpec) -> SkinSpec:
    """A skin as a zero says it is: its values, and their covariance as its tolerances.

    Raises ValueError: the record's inputs are not the skin's, or a value is not allowed.
    """
    values = dict(zip(record.parameters, record.values, strict=True))
    changed = zeroed_inputs(as_assembled(spec), values)
    own = spec.calibration
    if own is not None:  # offsets of single taxels are nothing that a press tells
        record = record.model_copy(update={key: getattr(own, key) for key in _OF_TAXELS})
    return changed.model_copy(update={"calibration": record})


def aged(spec: SkinSpec, begin: str, lasts: float = 0.0) -> tuple[SkinSpec, list[str]]:
    """A skin with its zero over some time, where nothing tells its temperature.

    The temperature walks at random from when the zero was taken, by as much as a file's
    tolerance within an hour; its deviation is that of the end that is farther away. The time
    begins at a date and time and `lasts` [s]. Also in words what that assumes.
    """
    record = spec.calibration
    if record is None or _WARMTH_PATH not in record.parameters:
        return spec, []
    try:
        away = datetime.fromisoformat(begin) - datetime.fromisoformat(record.taken)
        since = away.total_seconds()
        hours = max(-since, since + lasts) / 3600
        when = f"{hours:.2g} h from its zero"
    except (TypeError, ValueError):  # one of them does not say, or not where on earth
        hours, when = 1.0, "at an unknown time from its zero (no start_time with a time zone)"
    walked = WARMTH * min(hours, 1.0) ** 0.5
    if walked < _NEGLIGIBLE:
        return spec, []
    k = record.parameters.index(_WARMTH_PATH)
    rows = np.array(record.covariance)
    rows[k, k] += walked**2
    record = record.model_copy(update={"covariance": tuple(map(tuple, rows.tolist()))})
    return spec.model_copy(update={"calibration": record}), [
        f"{when} the skin may be {walked:.2g} K warmer or colder, which "
        "counts in every force: record temperature_degC with zero and log"
    ]


def skin_with_zero(skin: Path, zero: Path | str | None = None) -> tuple[SkinSpec, str]:
    """A skin with its zero, and a sentence that says which one it is; empty without one.

    Args:
        skin: the skin file.
        zero: what `suas zero` wrote; None for the one beside the skin file, if there is one;
            "none" for none.

    Raises:
        ConfigError: a file can't be used, or the zero is not this skin's.
        ValueError: the zero has inputs that the skin does not allow.
    """
    if read_bytes(skin, MOST_BYTES).startswith(f"# {MARK}".encode()):
        raise ConfigError(
            [Mistake(str(skin), "zero", f"{MARK}; give the skin file, and this with --zero")]
        )
    spec, beside = load_skin(skin), zero_file_of(skin)
    if str(zero) == "none" or (zero is None and not beside.is_file()):
        return spec, ""
    path = beside if zero is None else Path(zero)
    record = read_zero(path, skin)
    said = f"with the zero of {path}, {record.created} (--zero none leaves it out)"
    return zeroed(spec, record), said
