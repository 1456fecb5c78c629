"""Arrays that take long to compute: kept between runs, computed by one process at a time."""

import io
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import platformdirs
from numpy.typing import NDArray

from suas_jax.files.cache_folder import CacheFolder

Arrays = Mapping[str, NDArray[Any]]


def kept_arrays(
    name: str, compute: Callable[[], Mapping[str, Any]], folder: CacheFolder | None = None
) -> Arrays:
    """Arrays from a folder of the user's cache, computed where they are not there.

    `name` is a digest of all that they depend on. Where another process computes the same, its
    end is waited for, and a warning says so. A cache that can't be used costs time, never a
    result.
    """
    kept = folder or CacheFolder(platformdirs.user_cache_path("suas_jax") / "tables")
    found = kept.get(name)
    if found is None:
        with kept.making(name, _warn):
            found = kept.get(name)  # another process may have been first
            if found is None:
                stream = io.BytesIO()
                np.savez(stream, **compute())
                found = stream.getvalue()
                kept.put(name, found)
    with np.load(io.BytesIO(found)) as data:
        arrays = dict(data)
    kept.settled()  # arrays crash nobody: the next process need not distrust them
    return arrays


def _warn(process: str) -> None:
    warnings.warn(f"waiting for {process}, which computes the same table", stacklevel=2)
