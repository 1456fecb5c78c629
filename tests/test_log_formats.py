"""CSV, Parquet and NetCDF logs obey the same rules, and are written whole or not at all."""

import json
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import xarray

from suas_jax.acquisition.log.convert import convert, read_netcdf, read_parquet
from suas_jax.acquisition.log.log_file import LogFileError, SoLog, read_log

Columns = dict[str, list[Any]]
GOOD: Columns = {
    "t_host_s": [0.0, 0.1, 0.2],
    "t_device_s": [0.0, None, 0.2],
    "seq": [1, 2, 3],
    "module": [0, 0, 0],
    "so_1": [100, None, 65535],
    "so_2": [0, 1, 2],
    "lost": [0, 0, 1],
    "fluid": ["oil", "air", ""],
}
HEADER = {"format": "suas-so-log", "skin": "suas.toml"}


def as_csv(folder: Path, columns: Columns, header: Any) -> SoLog:
    rows = zip(*columns.values(), strict=True)
    lines = [f"# {k}: {v}" for k, v in header.items()] + [",".join(columns)]
    lines += [",".join("" if x is None else str(x) for x in row) for row in rows]
    (folder / "a.csv").write_text("\n".join([*lines, ""]))
    return read_log(folder / "a.csv")


def as_parquet(folder: Path, columns: Columns, header: Any) -> SoLog:
    table = pyarrow.table(columns)
    table = table.replace_schema_metadata({b"suas-so-log": json.dumps(header).encode()})
    pyarrow.parquet.write_table(table, folder / "a.parquet")
    return read_parquet(folder / "a.parquet")


def as_netcdf(folder: Path, columns: Columns, header: Any) -> SoLog:
    def values(name: str) -> np.ndarray:
        found = columns[name]
        return np.array([np.nan if x is None else x for x in found])

    so = np.stack([values(name) for name in columns if name.startswith("so_")], 1)
    variables: dict[str, Any] = {"so": (("row", "taxel"), so)}
    for name in columns:
        if not name.startswith("so_"):
            short = name.removesuffix("_s")
            key = short if name in ("t_host_s", "t_device_s", "seq", "module") else None
            variables[key or f"flag_{name}"] = ("row", values(name))
    attributes = {f"log.{key}": value for key, value in header.items()}
    xarray.Dataset(variables, attrs=attributes).to_netcdf(folder / "a.nc", engine="h5netcdf")
    return read_netcdf(folder / "a.nc")


FORMATS = [as_csv, as_parquet, as_netcdf]
Format = Callable[[Path, Columns, Any], SoLog]


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_reads_the_same_log(tmp_path: Path, kind: Format) -> None:
    log = kind(tmp_path, GOOD, HEADER)
    np.testing.assert_array_equal(log.so, [[100, 0], [np.nan, 1], [65535, 2]])
    np.testing.assert_array_equal(log.t_device, [0.0, np.nan, 0.2])
    assert log.seq.tolist() == [1, 2, 3]
    assert log.flags["lost"].tolist() == [0, 0, 1]
    assert log.flags["fluid"].tolist() == ["oil", "air", ""]
    assert log.header == HEADER
    assert (log.seq.dtype, log.module.dtype) == (np.int64, np.int64)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("seq", 1.5),
        ("seq", -1),
        ("seq", 1e300),
        ("seq", float("inf")),
        ("module", -3),
        ("module", 0.5),
        ("so_1", -1e9),
        ("so_1", -1),
        ("so_1", 65536),
        ("so_1", float("inf")),
        ("t_host_s", float("inf")),
        ("t_device_s", -float("inf")),
    ],
)
def test_every_format_refuses_the_same_values(
    tmp_path: Path, kind: Format, column: str, value: float
) -> None:
    columns = GOOD | {column: [float(GOOD[column][0]), float(value), 1.0]}
    with pytest.raises(LogFileError, match=f"column {column}.*expected"):
        kind(tmp_path, columns, HEADER)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("missing", ["seq", "module", "t_host_s", "so_1"])
def test_every_format_needs_the_same_columns(
    tmp_path: Path, kind: Format, missing: str
) -> None:
    columns = {name: x for name, x in GOOD.items() if name != missing}
    if kind is as_netcdf and missing == "so_1":
        pytest.skip("its counts are one variable")
    with pytest.raises(LogFileError, match=missing.removesuffix("_s")):
        kind(tmp_path, columns, HEADER)


@pytest.mark.parametrize("header", [[1, 2], "words", None, 5, {"skin": {"a": 1}}, {"a": [1]}])
def test_a_parquet_header_is_an_object_of_words(tmp_path: Path, header: Any) -> None:
    with pytest.raises(LogFileError, match="header is not a table of words"):
        as_parquet(tmp_path, GOOD, header)


def test_a_parquet_header_that_is_no_json(tmp_path: Path) -> None:
    for text in (b"{", b"\xff", b"[" * 100_000):
        table = pyarrow.table(GOOD).replace_schema_metadata({b"suas-so-log": text})
        pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
        with pytest.raises(LogFileError):
            read_parquet(tmp_path / "a.parquet")


def test_columns_that_are_no_numbers(tmp_path: Path) -> None:
    for name, values in (("so_1", ["a", "b", "c"]), ("seq", [[1], [2], [3]]), ("x", [[1]] * 3)):
        with pytest.raises(LogFileError, match=f"column {name}"):
            as_parquet(tmp_path, GOOD | {name: values}, HEADER)


def test_what_would_fill_the_memory_unpacked_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.nc", "w") as file:
        for name in ("t_host", "t_device", "seq", "module", "so"):
            file.create_dataset(name, shape=(10**10,), dtype="f8", chunks=(10**6,))
    assert (tmp_path / "a.nc").stat().st_size < 10**6
    with pytest.raises(LogFileError, match="values are read"):
        read_netcdf(tmp_path / "a.nc")


@pytest.mark.parametrize("ending", ["csv", "parquet", "nc"])
@pytest.mark.parametrize("old", ["what was there", None])
def test_a_full_disk_leaves_what_was_there(
    tmp_path: Path, ending: str, old: str | None
) -> None:
    columns = GOOD | {"so_1": np.random.default_rng(0).integers(0, 2**16, 20_000).tolist()}
    columns |= {name: [x[0]] * 20_000 for name, x in GOOD.items() if name != "so_1"}
    as_csv(tmp_path, columns, HEADER)
    target = tmp_path / f"b.{ending}"
    if old is not None:
        target.write_text(old)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, limits[1]))
    try:
        with pytest.raises(OSError, match="too large"):
            convert(tmp_path / "a.csv", target, overwrite=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (target.read_text() if target.exists() else None) == old
    assert {file.name for file in tmp_path.iterdir()} <= {"a.csv", target.name}
