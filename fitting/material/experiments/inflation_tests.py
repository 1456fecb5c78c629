"""Tests that read a pressure: a balloon's, and a bulging diaphragm's."""

import numpy as np

from fitting.material.data.tables import DataError
from fitting.material.experiments.homogeneous import mode_factors
from fitting.material.experiments.measurements import Dataset
from fitting.material.experiments.table_reader import Reader


def balloon(reader: Reader) -> Dataset:
    """Readings of a spherical balloon: p = 2 (H/R) σ / λ³ of Cauchy stress σ.

    Raises:
        DataError: what is missing, or impossible.
    """
    values = reader.column("pressure")
    if values is None:
        raise reader.need("the pressure", "pressure_kPa")
    radius = reader.column("radius")
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
        raise reader.need("the radius", "radius_mm", "stretch")
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
    e1, e2, c1, c2 = mode_factors("equibiaxial", stretch)
    share = 2.0 * ratio / stretch**3
    factors = np.stack([e1, e2, share * c1, share * c2])
    return reader.finish("pressure", stretch, factors, values, stretch)


def bulge(reader: Reader) -> Dataset:
    """Readings of a clamped circular diaphragm: pressure over the apex's relative height.

    Raises:
        DataError: what is missing, or impossible.
    """
    values, height = reader.column("pressure"), reader.column("height")
    if values is None:
        raise reader.need("the pressure", "pressure_kPa")
    if height is None:
        height = reader.column("displacement")
    if height is None:
        raise reader.need("the apex height", "apex_height_mm")
    radius, thickness = reader.size("radius"), reader.size("thickness")
    if radius is None and (diameter := reader.size("diameter")) is not None:
        radius = 0.5 * diameter
    if radius is None or thickness is None:
        raise DataError(
            f"{reader.table.file}: a bulge test needs the diaphragm's radius and thickness: "
            f'add "# radius: 40 mm" and "# thickness: 1.5 mm" to the file or give '
            f'--specimen "radius=40 mm,thickness=1.5 mm"'
        )
    bad = np.flatnonzero(height < 0.0)
    if bad.size:
        index = reader.position("height")
        raise DataError(
            f"{reader.at(bad[0], index)}: {reader.table.texts[bad[0]][index]} is impossible: "
            f"the apex of an inflated diaphragm rises"
        )
    relative = height / radius
    flat = relative == 0.0
    if flat.any():
        reader.warnings.append(f"{flat.sum()} rows of a flat diaphragm say nothing; left out")
        values = np.where(flat, np.nan, values)
        relative = np.where(flat, 1.0, relative)
    # The spherical cap of this height (Hill's special solution): stretch 1 + η² at the
    # apex, p = 4 σ η (T/a) / ((1 + η²) λ²). It starts the fit; a membrane finishes it.
    stretch = 1.0 + relative**2
    e1, e2, c1, c2 = mode_factors("equibiaxial", stretch)
    share = 4.0 * relative * thickness / radius / stretch**3
    factors = np.stack([e1, e2, share * c1, share * c2])
    return reader.finish(
        "pressure",
        stretch,
        factors,
        values,
        stretch,
        coordinate=relative,
        bulge=thickness / radius,
    )
