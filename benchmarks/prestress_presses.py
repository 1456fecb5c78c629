"""Ten known presses find the filling of a skin; how right its forces are afterwards.

    python benchmarks/prestress_presses.py [seed]

The true skin is the paper's with 0.3 % less oil than its file says; both state oil of 1 GPa and
how rubber, oil and wall grow with warmth. The commands of a user: `suas simulate` of ten presses
of 4 to 12 N that are held for a second each, `suas fit sensor --fit permittivity,gap,fill`, and
`suas invert` of logs of other presses, 3 to 12 N within 60 degrees, at the temperature of the
presses, 10 K colder and 10 K warmer, with a column of the temperature. Printed: what the fit
finds, and of every log the errors of the force, by the calibrated and by the first file, and
how many loads lie within the regions of 95 % that are told.
"""

import json
import pathlib
import sys
import tempfile

import numpy as np
from scipy import stats

from benchmarks.material_chain import ran

SKIN = pathlib.Path(__file__).parent.parent / "configs/skins/suas.toml"
_CLOSED = 20.0  # when the skin was closed and its presses were made [degC]
_PRESSES = (
    (-50, 6),
    (-35, 9),
    (-20, 4),
    (-10, 12),
    (0, 7),
    (5, 10),
    (15, 5),
    (30, 11),
    (40, 8),
    (55, 6),
)
_COUNT, _HELD, _CHANGE = 30, 1.0, 0.5  # other presses; how long one is held, and the next takes


def skin_file(fill: float) -> str:
    """The paper's skin with expansions, oil of 1 GPa and a filling."""
    text = SKIN.read_text()
    for old, new in (
        ('model = "incompressible"', 'model = "compressible"\nbulk_modulus = "1 GPa"'),
        ("[oil]\n", f'[oil]\nfill = {fill!r}\nexpansion = "silicone-oil"\n'),
        ("[material]\n", '[wall]\nexpansion = "PLA"\n\n[material]\nexpansion = "EPDM"\n'),
    ):
        text = text.replace(old, new, 1)
    return text


def pressed(
    folder: pathlib.Path, name: str, presses: np.ndarray, warmth: float, seed: int
) -> pathlib.Path:
    """A log of presses, angle and force [press, 2], of the true skin at a temperature [degC]."""
    (folder / f"{name}.toml").write_text(
        f'skin = "true.toml"\n[environment]\ntemperature = "{float(warmth)} degC"\n'
        '[[load]]\nkind = "line"\nangle = "0 deg"\nforce = "0 N"\ndirection = "radial"\n'
    )
    lines = [f"# scene: {name}.toml", "t_s,loads.0.force_N,loads.0.angle_deg"]
    time = 0.0
    for angle, force in presses:
        for size, after in ((0, _CHANGE / 2), (force, _HELD), (force, _CHANGE / 2), (0, 1e-3)):
            lines.append(f"{time:.3f},{float(size)},{float(angle)}")
            time += after
    (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
    log = folder / f"{name}.log.csv"
    ran("simulate", str(folder / f"{name}.csv"), "-o", str(log), "--seed", str(seed))
    rows = log.read_text().splitlines()
    head = next(k for k, row in enumerate(rows) if not row.startswith("#"))
    rows[head] += ",temperature_degC"
    rows[head + 1 :] = [f"{row},{float(warmth)}" for row in rows[head + 1 :]]
    log.write_text("\n".join(rows) + "\n")
    return log


def told(skin: pathlib.Path, log: pathlib.Path) -> dict[str, np.ndarray]:
    """Held frames of one contact: relative error of the force, distance from the region."""
    lines = log.read_text().splitlines()
    names = next(row for row in lines if not row.startswith("#")).split(",")
    true = np.genfromtxt(log, delimiter=",", names=True, comments="#", skip_header=0)
    del names, true
    raise NotImplementedError(skin)


if __name__ == "__main__":
    pass
