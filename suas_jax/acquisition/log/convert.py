"""SO logs as Parquet (rows, a column each) and NetCDF files (xarray), and back to the same log.

A log is recorded as CSV, which a crash can't make unreadable, and converted afterwards.
"""

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from suas_jax.acquisition.log.columns import columns, from_columns
from suas_jax.acquisition.log.log_file import LogFileError, LogWriter, SoLog, read_log
from suas_jax.acquisition.log.reader import MOST_BYTES
from suas_jax.files.reading import check_readable, read_bytes
from suas_jax.files.writing import check_output, write_bytes, written
from suas_jax.runtime.optional import optional

if TYPE_CHECKING:
    import xarray

_KEY = b"suas-so-log"
_PREFIX = "log."
_MOST_VALUES = 100_000_000
_UNITS = {"t_host": "s", "t_device": "s", "so": "counts"}
_ROWS = {"t_host": "t_host_s", "t_device": "t_device_s", "seq": "seq", "module": "module"}


def convert(source: Path, target: Path, *, overwrite: bool = False) -> SoLog:
    """Convert a log between CSV, Parquet and NetCDF, as the files' endings say; returns it.

    Raises ValueError: an ending is unknown, the source is not a log, or a library is missing;
    OSError: a file can't be read or written.
    """
    read = _chosen({".csv": read_log, ".parquet": read_parquet, ".nc": read_netcdf}, source)
    write = _chosen({".csv": write_csv, ".parquet": write_parquet, ".nc": write_netcdf}, target)
    check_output(target, overwrite=overwrite)
    log: SoLog = read(source)
    write(log, target)
    return log


def _chosen(by_ending: dict[str, Any], file: Path) -> Any:
    try:
        return by_ending[file.suffix.lower()]
    except KeyError:
        raise ValueError(
            f'{file}: "{file.suffix}" is not a log format; use {", ".join(by_ending)}'
        ) from None


def _library(name: str, what: str) -> ModuleType:
    return optional(name, f"{what} files need", "tables")


def write_csv(log: SoLog, path: Path) -> None:
    """Write a log as CSV, as if it had just been recorded."""
    flags = {name: values.tolist() for name, values in log.flags.items()}
    rows = zip(log.t_host, log.t_device, log.seq, log.module, log.so, strict=True)
    header = log.header
    with (
        written(path) as draft,
        LogWriter(draft, header, taxels=log.so.shape[1], flags=tuple(flags)) as writer,
    ):
        for i, (t_host, t_device, seq, module, so) in enumerate(rows):
            counts = [None if np.isnan(c) else _shortest(c) for c in so]
            values = [column[i] for column in flags.values()]
            writer.write(float(t_host), float(t_device), int(seq), int(module), counts, values)


def _shortest(count: float) -> Any:
    """Counts are whole, unless another hand averaged them."""
    return int(count) if float(count).is_integer() else repr(float(count))


def write_parquet(log: SoLog, path: Path) -> None:
    """Write a log as Parquet: a column each, missing values as nulls."""
    arrow, parquet = _library("pyarrow", "Parquet"), _library("pyarrow.parquet", "Parquet")
    import json

    table = arrow.table(
        {name: arrow.array(x, from_pandas=True) for name, x in columns(log).items()}
    )
    table = table.replace_schema_metadata({_KEY: json.dumps(log.header).encode()})
    content = arrow.BufferOutputStream()
    parquet.write_table(table, content)
    write_bytes(path, content.getvalue().to_pybytes())


def read_parquet(path: Path) -> SoLog:
    """Read a log from Parquet; errors as of `convert`."""
    arrow, parquet = _library("pyarrow", "Parquet"), _library("pyarrow.parquet", "Parquet")
    import json

    content = arrow.BufferReader(read_bytes(path, MOST_BYTES))
    try:
        file = parquet.ParquetFile(content)
        _check_size(path, file.metadata.num_rows, file.metadata.num_columns)
        table = file.read()
        header = json.loads((table.schema.metadata or {}).get(_KEY, b"{}"))
        by_name = {n: table[n].to_numpy(zero_copy_only=False) for n in table.column_names}
    except (arrow.ArrowException, OSError, ValueError, RecursionError) as error:
        raise _unreadable(path, error) from None
    return from_columns(path, header, by_name)


def to_xarray(log: SoLog) -> "xarray.Dataset":
    """A log as a data set with the dimensions row and taxel, units as attributes."""
    xarray = _library("xarray", "NetCDF")
    variables: dict[str, Any] = {name: ("row", getattr(log, name)) for name in _ROWS}
    variables["so"] = ("row", "taxel"), log.so
    variables |= {f"flag_{name}": ("row", values) for name, values in log.flags.items()}
    data = xarray.Dataset(
        variables,
        coords={"taxel": np.arange(1, log.so.shape[1] + 1)},
        attrs={_PREFIX + key: value for key, value in log.header.items()},
    )
    for name, unit in _UNITS.items():
        data[name].attrs["units"] = unit
    return data


def write_netcdf(log: SoLog, path: Path) -> None:
    """Write a log as NetCDF 4. In memory first: HDF5 doesn't survive a disk that is full."""
    _library("h5netcdf", "NetCDF"), _library("h5py", "NetCDF")
    write_bytes(path, bytes(to_xarray(log).to_netcdf(engine="h5netcdf")))


def read_netcdf(path: Path) -> SoLog:
    """Read a log from NetCDF; errors as of `convert`."""
    xarray = _library("xarray", "NetCDF")
    _library("h5netcdf", "NetCDF"), _library("h5py", "NetCDF")
    check_readable(path, MOST_BYTES)
    try:
        options = {"engine": "h5netcdf", "decode_times": False, "phony_dims": "sort"}
        with xarray.open_dataset(path, **options) as file:
            for variable in file.variables.values():
                _check_size(path, variable.size, 1)
            data = file.load()
    except (OSError, ValueError, RuntimeError, KeyError, TypeError) as error:
        raise _unreadable(path, error) from None
    missing = {*_ROWS, "so"} - set(data.variables)
    if missing:
        raise LogFileError(f"{path}: no variable {', '.join(sorted(missing))}: no SO log")
    header = {
        str(key).removeprefix(_PREFIX): str(value)
        for key, value in data.attrs.items()
        if str(key).startswith(_PREFIX)
    }
    counts = data["so"].values
    if counts.ndim != 2:
        raise LogFileError(f"{path}: so has {counts.ndim} dimensions, not row and taxel")
    table = {long: data[name].values for name, long in _ROWS.items()}
    table |= {f"so_{k + 1}": counts[:, k] for k in range(counts.shape[1])}
    table |= {
        str(name).removeprefix("flag_"): data[name].values
        for name in data.variables
        if str(name).startswith("flag_")
    }
    return from_columns(path, header, table)


def _unreadable(path: Path, error: Exception) -> LogFileError:
    reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
    return LogFileError(f"{path}: {reason}")


def _check_size(path: Path, rows: int, columns: int) -> None:
    """Refuse what would fill the memory once it is unpacked."""
    if rows * columns > _MOST_VALUES:
        raise LogFileError(
            f"{path}: {rows} rows of {columns} columns; at most {_MOST_VALUES} values are read"
        )
