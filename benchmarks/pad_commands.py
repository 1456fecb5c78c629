"""A pad's unit through the commands: press it, find it, and find unseen presses with its file.

The unit differs from its drawing by random waves of thickness and gap on five by five nodes
(`benchmarks.uneven_pad`), stiffness, filling, mounting, permittivity and gains of channels.
`suas simulate` plays ten known presses, rest and twelve unseen presses; `suas fit sensor --fit
as-built`, `suas baseline` and `suas invert` do the rest. Prints processor times, what was found
of the unit, and errors of the unseen presses. ``--small`` takes a thick pad of 35 taxels::

    python -m benchmarks.pad_commands --small
"""

import argparse
import json
import re
import resource
import subprocess
import tempfile
import tomllib
from pathlib import Path

import numpy as np

from benchmarks.uneven_pad import errors_told, sheet
from suas_jax.acquisition.log.log_file import group_frames, read_log
from suas_jax.config import load_skin
from suas_jax.skin.plain import plain_geometry
from tests.test_pad_estimation import ORDERED, SKIN

DRAWING = Path(__file__).parent.parent / "configs/skins/suas-pad.toml"
SCENE = """skin = "unit.toml"
[[load]]
kind = "patch"
angle = "0 deg"
axial = "0 mm"
diameter = "6 mm"
force = "5 N"
"""
STIFFER = 1.08
Presses = list[tuple[float, float, float]]  # angle [deg], axial position [m], force [N]


def small(random: np.random.Generator) -> tuple[str, str, Presses, Presses]:
    """Drawing and unit of a thick pad of 35 taxels, known presses, and unseen ones."""
    texts = []
    for gains in ([""] * 35, [f", gain = {1 + 0.01 * random.normal():.5f}" for _ in ORDERED]):
        rows = [
            f'{{ angle = "{a} deg", axial = "{z} mm"{g} }},'
            for (a, z), g in zip(ORDERED, gains, strict=True)
        ]
        texts.append(SKIN.replace("TAXELS", "\n".join(rows)).replace("60 deg", "90 deg"))
    drawing, unit = texts
    unit = unit.replace('"2 MPa"', f'"{2 * STIFFER} MPa"')
    unit = _uneven(unit, 5e-3, 1.002, 0.03, random)
    known = [(a, z, f) for z in (-0.028, 0, 0.028) for a, f in ((-50, 5), (0, 6), (50, 5))]
    return drawing, unit, [*known, (25, 0.014, 3)], _unseen(random, 0.027, (1.5, 6))


def shipped(random: np.random.Generator) -> tuple[str, str, Presses, Presses]:
    """The same of the shipped pad of 320 taxels."""
    drawing = DRAWING.read_text()

    def gains(_: re.Match[str]) -> str:
        own = ", ".join(f"{1 + 0.01 * random.normal():.5f}" for _ in range(10))
        return f'diameter = "4 mm", gains = [{own}] }}'

    law = f'law = "mooney-rivlin"\nC1 = "{20.7 * STIFFER} MPa"\nC2 = "{-4.4 * STIFFER} MPa"'
    unit = drawing.replace('preset = "epdm-paper"', f'{law}\nC3 = "{77 * STIFFER} kPa"')
    unit = re.sub(r'diameter = "4 mm" \}', gains, unit)
    unit = _uneven(unit, 1.5e-3, 1.001, 0.02, random)
    known = [(a, z, 8.0) for z in (-0.032, 0, 0.032) for a in (-48, 0, 48)]
    return drawing, unit, [*known, (24, 0.016, 4.0)], _unseen(random, 0.033, (2, 10))


def _uneven(
    text: str, thickness: float, fill: float, mounting: float, random: np.random.Generator
) -> str:
    text = re.sub(r"(?m)^relative_permittivity = 2.2", f"fill = {fill}\n\\g<0>44", text)
    text = re.sub(r"(?m)^ends .*$", f'\\g<0>\nmounting = "{mounting} %"', text)
    for key, mean in (("thickness", thickness), ("oil_gap", 5e-3)):
        text = re.sub(rf"(?m)^{key} .*$", f"{key} = {sheet(mean, random)}", text)
    return text


def _unseen(random: np.random.Generator, axial: float, forces: tuple[float, float]) -> Presses:
    sizes = (-45, 45), (-axial, axial), forces
    return [tuple(random.uniform(*x) for x in sizes) for _ in range(12)]  # type: ignore[misc]


def path(presses: Presses) -> str:
    """A load path: rest, ramp, a second's hold, ramp of every press."""
    rows, t = (
        ["# scene: scene.toml", "t_s,loads.0.force_N,loads.0.angle_deg,loads.0.axial_m"],
        0.0,
    )
    for angle, axial, force in presses:
        for dt, own in ((0.0, 0), (0.8, 0), (0.2, force), (1.0, force), (0.2, 0)):
            t += dt
            rows.append(f"{t:.3f},{own},{angle:.2f},{axial:.5f}")
        t += 0.05
    return "\n".join([*rows, f"{t + 1:.3f},0,{angle:.2f},{axial:.5f}"]) + "\n"


def suas(folder: Path, *arguments: str) -> str:
    """Run a command in a folder; prints the processor time it took."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run = subprocess.run(
        ["suas", *arguments], cwd=folder, check=True, stdout=subprocess.PIPE, text=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"{spent:.0f} s of processor time: suas {' '.join(arguments)}", flush=True)
    return run.stdout


def score(lines: str, log: Path, skin: Path) -> None:
    """Print errors of held presses' forces and places, and how many lie in 95 % intervals."""
    radius = float(plain_geometry(load_skin(skin).geometry).outer_size[0])
    frames = [json.loads(line) for line in lines.splitlines()]
    own = read_log(log)
    first = np.searchsorted(own.seq, group_frames(own).seq)
    names = "load_0_force_N", "load_0_angle_deg", "load_0_axial_mm"
    true = np.array([own.flags[name].astype(float)[first] for name in names]).T
    held = np.flatnonzero((true[:, 0] > 0) & (np.roll(true[:, 0], 1) == true[:, 0]))
    rows, lost = [], 0
    for k in held:
        loads = frames[k]["loads"]
        if len(loads) != 1:
            lost += 1
            continue
        force, angle, axial = true[k]
        found, (arc, axis, size) = loads[0], np.sqrt(np.diag(loads[0]["covariance"]))[:3]
        off = (
            found["force_N"] / force - 1,
            radius * np.deg2rad(found["angle_deg"] - angle),
            found["axial_m"] - 1e-3 * axial,
        )
        rows.append((off, (size / force, radius * arc, axis)))
    print(f"{len(rows)} frames, {lost} without one contact: {errors_told(rows)}")


def main() -> None:
    """Run the commands."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--seed", type=int, default=11)
    options = parser.parse_args()
    make = small if options.small else shipped
    drawing, unit, known, unseen = make(np.random.default_rng(options.seed))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rest = "# scene: scene.toml\nt_s,loads.0.force_N\n0,0\n20,0\n"
        texts = {"drawing.toml": drawing, "unit.toml": unit, "scene.toml": SCENE}
        texts |= {"press.csv": path(known), "unseen.csv": path(unseen), "rest.csv": rest}
        for file, text in texts.items():
            (folder / file).write_text(text)
        for k, log in enumerate(("press", "unseen", "rest")):
            files = f"{log}.csv", "-o", f"{log}.log.csv"
            suas(folder, "simulate", *files, "--rate", "5", "--seed", str(k))
        fit = ["drawing.toml", "press.log.csv", "--fit", "as-built", "--place-error", "0.5 mm"]
        suas(folder, "fit", "sensor", *fit, "-o", "built.toml")
        record = tomllib.loads((folder / "built.toml").read_text())["calibration"]
        for what in zip(
            record["parameters"], record["values"], record["standard_errors"], strict=True
        ):
            if not what[0].startswith("geometry."):
                print("{}: {:.6g} +- {:.2g}".format(*what))
        suas(folder, "baseline", "rest.log.csv", "-o", "rest.json")
        for file in ("built.toml", "drawing.toml"):
            log, options_ = "unseen.log.csv", ("--baseline", "rest.json", "--contacts", "1")
            lines = suas(folder, "invert", file, log, *options_, "--json")
            score(lines, folder / log, folder / file)


if __name__ == "__main__":
    main()
