"""The table of a pad, kept between runs: reading it takes no JAX, solving it does."""

from collections.abc import Callable
from concurrent.futures import Executor

from fitting.inverse_load.model.kept_key import kept_key
from fitting.inverse_load.pad.table import FINE, PadResolution, PadTable
from suas_jax.config import SkinSpec
from suas_jax.files.kept_arrays import kept_arrays
from suas_jax.runtime.start import before_computing


def pad_table_of(
    spec: SkinSpec,  # the pad, with electrodes
    diameter: float,  # of the contacts [m]
    resolution: PadResolution = FINE,  # of the table
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
    workers: Executor | None = None,
) -> PadTable:
    """The table of a pad, from the cache where it is there.

    That of a pad whose thickness or gap differ from side to side is made from an even pad's,
    see `fitting.inverse_load.pad.uneven`. Raises ValueError: its section is not its own mirror
    image.

    `progress` is called with the number of columns solved and their total. Workers solve the
    table (`fitting.workers`); without them (None) this process does, on all cores.
    """
    name = kept_key(spec, diameter=diameter, resolution=resolution)
    how = diameter, resolution, progress, workers
    found = kept_arrays(name, lambda: vars(_made(spec, *how)))
    return PadTable(**{**found, "diameter": float(found["diameter"])})  # type: ignore[arg-type]


def _made(
    spec: SkinSpec,
    diameter: float,
    resolution: PadResolution,
    progress: Callable[[int, int], None],
    workers: Executor | None,
) -> PadTable:
    before_computing()
    from fitting.inverse_load.pad.table_build import build_pad_table
    from fitting.inverse_load.pad.uneven import even_spec, same_places, uneven_table
    from suas_jax.scene.skin import skin_of

    how = diameter, resolution, progress, workers
    skin = skin_of(spec, elements=resolution.elements, contact=False)
    if spec.geometry.mirrored_along_axis and skin.geometry.symmetric:
        return build_pad_table(skin, *how)
    even = even_spec(spec)
    if not skin_of(even, contact=False).geometry.symmetric:
        raise ValueError(
            "geometry.section: loads on a pad are told from a table of a quarter of it, "
            "which takes a section that is its own mirror image"
        )
    table = pad_table_of(even, diameter, resolution, progress=progress, workers=workers)
    return uneven_table(table, (even, spec), skin, same_places(even, spec), progress)
