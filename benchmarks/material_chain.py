"""From a raw file to a force: how often the true force lies within the 95 % that are told.

    python benchmarks/material_chain.py [chains] [seed] [law]

Each chain is a rubber (Mooney-Rivlin, shear modulus 0.3 to 1 MPa, of which C2 has 15 ± 8 %)
whose specimens, and whose skin, scatter by 3 %. Five specimens are pulled to a stretch of 1.8
(40 readings each, noise of 1 %). The commands of a user follow: `suas fit material` with a law
(yeoh: none of I2) and `--export toml`, a skin file of that [material] in which all else is
exact, `suas range`, and `suas invert` of a frame of the true skin under one load. Printed:
whether the true forces, of the load and of first contact at the crown, lie within 95 %.
"""

import json
import pathlib
import sys
import tempfile

import numpy as np
from scipy import stats
from typer.testing import CliRunner

from fitting.cli.app import app

_SCATTER, _SPECIMENS, _READINGS, _NOISE = 0.03, 5, 40, 0.01
_PAPER = 32.6e6  # shear modulus of the paper's skin, which touches its wall at 38 to 83 N [Pa]
_TAXELS = ", ".join(
    f'{{ angle = "{angle} deg", axial = "0 mm", diameter = "4 mm" }}'
    for angle in range(-80, 81, 10)
)
_SKIN = f"""[geometry]
inner_radius = "57.5 mm"
thickness = "1.5 mm +- 0"
half_angle = "90 deg"
width = "123 mm"
oil_gap = "5 mm +- 0"
[oil]
model = "incompressible"
relative_permittivity = "2.2 +- 0"
[electrodes]
lsb = "0.305 fF +- 0"
noise = 2.0
layout = "list"
taxels = [ {_TAXELS} ]
"""


def ran(*arguments: str) -> str:
    """What a command prints. Raises RuntimeError: it fails."""
    result = CliRunner().invoke(app, list(arguments))
    if result.exit_code != 0:
        raise RuntimeError(f"suas {' '.join(arguments)}: {result.output} {result.stderr}")
    return str(result.stdout)


def mooney(modulus: float, share: float) -> str:
    """The [material] table of a rubber."""
    first, second = 0.5 * modulus * (1.0 - share), 0.5 * modulus * share
    return (
        f'[material]\nlaw = "mooney-rivlin"\nC1 = "{first!r} Pa +- 0"\n'
        f'C2 = "{second!r} Pa +- 0"\n'
    )


def first_contact(skin: pathlib.Path) -> np.ndarray:
    """Force at the crown at which the wall is touched, and its 95 % interval [N]."""
    report = json.loads(ran("range", str(skin), "--angles", "1", "--json"))
    contact = report["angles"][0]["first_contact"]
    return np.array([contact.get(f"{x}_N", np.nan) for x in ("force", "low95", "high95")])


def chain(
    rng: np.random.Generator,  # draws the chain
    law: str,  # that is fitted
    # true force of first contact over the shear modulus: in plane strain a Mooney-Rivlin skin
    # is neo-Hookean
    contact: float,
    folder: pathlib.Path,  # for the files
) -> dict[str, tuple[float, np.ndarray]]:
    """True force, what is told, and the ends of its 95 % interval, of load and contact [N]."""
    modulus = float(np.exp(rng.uniform(np.log(0.3e6), np.log(1e6))))
    share = float(np.clip(0.15 + 0.08 * rng.standard_normal(), 0.0, 0.4))
    stretch = np.linspace(1.0, 1.8, _READINGS + 1)[1:]
    lines = ["stretch,nominal_stress_Pa,specimen"]
    for k in range(_SPECIMENS):
        stress = modulus * (stretch - stretch**-2) * (1.0 - share + share / stretch)
        stress = stress * np.exp(_SCATTER * rng.standard_normal())
        stress = stress * (1.0 + _NOISE * rng.standard_normal(_READINGS))
        lines += [f"{x:.8g},{y:.8g},{k}" for x, y in zip(stretch, stress, strict=True)]
    (folder / "test.csv").write_text("\n".join(lines) + "\n")
    test, card = f"uniaxial={folder / 'test.csv'}", folder / "material.toml"
    ran("fit", "material", "--law", law, "--data", test, "--export", f"toml={card}", "--json")
    (folder / "skin.toml").write_text(_SKIN + card.read_text())
    own = modulus * float(np.exp(_SCATTER * rng.standard_normal()))
    (folder / "true.toml").write_text(_SKIN + mooney(own, share))
    angle, force = rng.uniform(-50.0, 50.0), own / _PAPER * rng.uniform(8.0, 25.0)
    (folder / "scene.toml").write_text(
        f'skin = "true.toml"\n[[load]]\nkind = "line"\nangle = "{angle!r} deg"\n'
        f'force = "{force!r} N"\ndirection = "radial"\n'
    )
    log = folder / "log.csv"
    options = ["--rate", "10", "--duration", "0.1", "--seed", str(rng.integers(1 << 30))]
    ran("simulate", str(folder / "scene.toml"), "-o", str(log), *options)
    frame = json.loads(
        ran("invert", str(folder / "skin.toml"), str(log), "--json").splitlines()[0]
    )
    (load,) = frame["loads"]
    reach = stats.norm.ppf(0.975) * np.sqrt(load["covariance"][1][1])
    told = load["force_N"] + reach * np.array([0.0, -1.0, 1.0])
    return {
        "load": (force, told),
        "first contact": (contact * own, first_contact(folder / "skin.toml")),
    }


def main(chains: str = "60", seed: str = "0", law: str = "yeoh") -> None:
    """Print each chain, and the shares within."""
    rng = np.random.default_rng(int(seed))
    found: dict[str, list[tuple[bool, float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        rubber = pathlib.Path(folder) / "rubber.toml"
        rubber.write_text(_SKIN + mooney(0.5e6, 0.0))
        contact = float(first_contact(rubber)[0]) / 0.5e6
        for k in range(int(chains)):
            own = pathlib.Path(folder) / str(k)
            own.mkdir()
            for name, (force, (told, low, high)) in chain(rng, law, contact, own).items():
                inside = bool(low <= force <= high)
                found.setdefault(name, []).append(
                    (inside, told / force - 1.0, 0.5 * (high - low) / told)
                )
                print(
                    f"{k:3} {name:13} {force:.4f} N, told {told:.4f} ({low:.4f} to {high:.4f})"
                    f"{'' if inside else ' OUTSIDE'}",
                    flush=True,
                )
    for name, rows in found.items():
        inside, off, width = np.array(rows, dtype=float).T
        print(
            f"{name}: {int(inside.sum())} of {len(rows)} true forces within 95 %; median error "
            f"{np.median(np.abs(off)):.1%}, median half width {np.median(width):.1%}"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
