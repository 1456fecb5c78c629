"""Ten known presses find the filling of a skin; how right its forces are afterwards.

    python benchmarks/prestress_presses.py [seed]

The true skin is the paper's with 0.3 % less oil than its file says; both state oil of 1 GPa
and how rubber, oil and wall grow with warmth. The commands of a user: `suas simulate` of ten
presses of 4 to 12 N that are held for a second each, `suas fit sensor --fit
permittivity,gap,fill`, and `suas invert` of logs of other presses, 3 to 12 N within 60 degrees,
at the temperature of the presses, 10 K colder and 10 K warmer, with a column of the
temperature. Printed: what the fit finds, and of every log the errors of the force, means of a
press, by the file that was found and by the first one, and how many loads lie within the
regions of 95 %.
"""

import csv
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
    """A log of presses, angle and force [press, 2], of the true skin, warm so much [degC]."""
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


def told(skin: pathlib.Path, log: pathlib.Path) -> tuple[int, np.ndarray, np.ndarray]:
    """Held frames of a log, the relative errors of the forces told, and their distances.

    Of frames of status `ok`; the errors are of presses, means of their frames. Distances are
    squared, in the deviations that are told.
    """
    rows = [row for row in log.read_text().splitlines() if not row.startswith("#")]
    true = list(csv.DictReader(rows))
    frames = [
        json.loads(line) for line in ran("invert", str(skin), str(log), "--json").splitlines()
    ]
    frames = [frame for frame in frames if "loads" in frame]
    known = np.array(
        [[float(row[f"load_0_{x}"]) for x in ("angle_deg", "force_N")] for row in true]
    )
    held = known[:, 1] > 0
    held[1:-1] &= (known[:-2] == known[2:]).all(1)
    off_by: dict[tuple[float, float], list[float]] = {}
    distances = []
    for (angle, force), frame in zip(known[held], np.array(frames)[held], strict=True):
        if frame["status"] != "ok" or len(frame["loads"]) != 1:
            continue
        (load,) = frame["loads"]
        off = np.array([np.deg2rad(load["angle_deg"] - angle), load["force_N"] - force])
        off_by.setdefault((angle, force), []).append(off[1] / force)
        distances.append(off @ np.linalg.solve(np.array(load["covariance"]), off))
    errors = np.array([np.mean(own) for own in off_by.values()])
    return int(held.sum()), errors, np.array(distances)


def main(seed: int) -> None:
    """Print what the commands tell."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for file, fill in (("true", 0.997), ("file", 1.0)):
            (folder / f"{file}.toml").write_text(skin_file(fill))
        plain, found = folder / "file.toml", folder / "found.toml"
        log = pressed(folder, "presses", np.array(_PRESSES, float), _CLOSED, seed)
        fit = ["fit", "sensor", str(plain), str(log), "--fit", "permittivity,gap,fill"]
        report = json.loads(ran(*fit, "-o", str(found), "--json"))
        value, error = (report[key]["fill"] for key in ("parameters", "standard_errors"))
        print(f"filling {value:.5f} +- {error:.5f}, true 0.99700", flush=True)
        places, forces = rng.uniform(-60, 60, _COUNT), rng.uniform(3, 12, _COUNT)
        for change in (0.0, -10.0, 10.0):
            name = f"at{change:+g}K"
            presses = np.stack([places, forces], 1)
            try:
                log = pressed(folder, name, presses, _CLOSED + change, seed + 1)
            except RuntimeError as error:
                print(f"{change:+g} K: {error}")
                continue
            for label, skin in (("found", found), ("first", plain)):
                held, errors, distances = told(skin, log)
                size = 100 * np.abs(errors)
                inside = (distances < stats.chi2.ppf(0.95, 2)).mean()
                print(
                    f"{change:+g} K, {label} file: {len(distances)} of {held} frames ok, "
                    f"{100 * inside:.0f} % of them in regions of 95 %; force of a press off by "
                    f"{np.median(size):.2f} % (median), {size.max():.2f} % (largest)",
                    flush=True,
                )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
