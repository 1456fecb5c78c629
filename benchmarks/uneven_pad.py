"""Contacts on an uneven pad by the file of the unit and by its drawing.

Tables of docs/as_built_method.md.

The unit's thickness and gap are random waves on five by five nodes; readings come from a finer
mesh, in whole counts with a noise of two. All numbers of both files are stated as exact, so
that intervals hold what table, mesh and noise leave open::

    python -m benchmarks.uneven_pad --seed 1
"""

import argparse
import re
import tempfile
from pathlib import Path

import numpy as np

from fitting.inverse_load.estimator import LoadEstimator
from fitting.inverse_load.pad.table import PadResolution
from suas_jax import configure
from suas_jax.config import SkinSpec, load_skin
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import skin_of
from tests.test_pad_estimation import ORDERED, small_pad

FINER, DIAMETER, PRESSES = (18, 16), 6e-3, 24
RESOLUTION = PadResolution((14, 12), 6e-3, (3, 3), FINER)
NODES = np.linspace(0, 1, 5)


def sheet(mean: float, random: np.random.Generator) -> str:
    """A table of a length in TOML, of random waves around a mean [m]."""
    field = 0.02 * random.normal() * np.ones((5, 5))
    for k in (1, 2, 3):
        for x in np.meshgrid(NODES, NODES, indexing="ij"):
            size = 0.03 / k / 2**0.5 * random.normal()
            field = field + size * np.sin(np.pi * k * x + random.uniform(0, 2 * np.pi))
    rows = [[f'"{x:.6f} mm"' for x in row] for row in 1e3 * mean * (1 + field)]
    value = ", ".join(f"[{', '.join(row)}]" for row in rows)
    return f"{{ arc = {NODES.tolist()}, axial = {NODES.tolist()}, value = [{value}] }}"


def errors_told(rows: list[tuple[tuple[float, ...], tuple[float, ...]]]) -> str:
    """Errors of contacts in words, and how many lie in their 95 % intervals.

    A row has the errors of a contact and their deviations: of the force as a share, of the
    place along arc and axis [m].
    """
    off, sd = np.abs(np.array(rows)).swapaxes(0, 1)
    away = 1e3 * np.hypot(off[:, 1], off[:, 2])
    inside = 100 * (off < 1.96 * sd).mean(0)
    return (
        f"force {100 * np.median(off[:, 0]):.2f} %, worst {100 * off[:, 0].max():.2f} %; "
        f"place {np.median(away):.2f} mm; in 95 %: {inside.round(1)}; "
        f"median deviation of force {100 * np.median(sd[:, 0]):.1f} %"
    )


def report(
    name: str,
    spec: SkinSpec,
    frames: np.ndarray,
    rest: np.ndarray,
    loads: np.ndarray,
    radius: float,
) -> None:
    """Print errors of force and place, and how many lie in their 95 % intervals."""
    estimator = LoadEstimator(
        spec, rest=rest, rest_variance=4 / 50, most_contacts=1, resolution=RESOLUTION
    )
    rows = []
    for estimate, (angle, axial, force) in zip(estimator.estimate(frames), loads, strict=True):
        (own,) = estimate.contacts
        off = own.force / force - 1, radius * (own.angle - angle), own.axial - axial
        sd = (
            own.deviation("force") / force,
            radius * own.deviation("angle"),
            own.deviation("axial"),
        )
        rows.append((off, sd))
    print(
        f"{name}: {errors_told(rows)}\n"
        f"table's error of force [%], middle to edges: "
        f"{(100 * estimator.table.force_error).round(2).tolist()}, of place [mm]: "
        f"{(1e3 * estimator.table.place_error).round(2).tolist()}, of readings: "
        f"{100 * estimator.table.reading_error:.2f} %"
    )


def main() -> None:
    """Simulate a unit, estimate its contacts by both files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    random = np.random.default_rng(parser.parse_args().seed)
    configure()
    text = small_pad(ORDERED).replace("60 deg", "90 deg")
    for exact in ('"2 MPa"', "2.2", '"0.1 fF"'):
        text = text.replace(exact, f'"{exact.strip(chr(34))} +- 0"')
    text = text.replace("[oil]", '[oil]\nfill = "1 +- 0"')
    text = text.replace("[material]", 'mounting = "0 % +- 0"\n[material]')
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "skin.toml"
        file.write_text(text)
        drawn = load_skin(file)
        for key in ("thickness", "oil_gap"):
            value = sheet(getattr(drawn.geometry, key), random)
            text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", text)
        file.write_text(text)
        unit = load_skin(file)
    truth = skin_of(unit, elements=FINER, contact=False)
    half, width = 0.55 * float(truth.geometry.half_angle[0]), 0.55 * unit.geometry.width / 2
    sizes = (-half, half), (-width, width), (1.5, 6.0)
    loads = np.stack([random.uniform(*x, PRESSES) for x in sizes], 1)
    lanes = np.concatenate([loads, np.zeros((1, 3))])
    so = np.asarray(forward(truth, Loads.patch(*lanes.T, DIAMETER)).so).T
    frames = np.rint(so[:-1] + 2 * random.normal(size=so[:-1].shape))
    radius = float(truth.geometry.outer_size[0])
    for name, spec in (("as built", unit), ("as drawn", drawn)):
        report(name, spec, frames, so[-1], loads, radius)


if __name__ == "__main__":
    main()
