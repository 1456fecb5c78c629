"""Are the stated errors of pads true? `suas solve` against a continuum of FElupe.

    python -m benchmarks.pad_referee --continuum [KIND ...] [--seed S] [--sizes F]
    python -m benchmarks.pad_referee --compare [KIND ...]

`--continuum` solves one random pad of every kind (see `KINDS`) with hexahedra on three meshes,
a minute or more each, and keeps the answers in tests/data/pad_referee.json; it needs FElupe.
With a mesh A, B of twice its elements through the thickness and C of elements two thirds as
long, the answer is A + 1.5 (C - A) + 1.2 (B - A), sure to 0.75 |C - A| + 0.3 |B - A|.
`--compare` solves all kept pads with ``model = "auto"`` and ``rtol = 5e-3``.
"""

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from suas_jax.config import PatchLoadSpec, SceneSpec, scene_from_dict, with_solve
from suas_jax.files.writing import write_text

KEPT = Path(__file__).parent.parent / "tests" / "data" / "pad_referee.json"
RTOL = 5e-3
EPDM = {"law": "mooney-rivlin", "C1": "20.7 MPa", "C2": "-4.4 MPa", "C3": "77 kPa"}
NEO_HOOKEAN = {"law": "neo-hookean", "mu": "1.2 MPa"}
YEOH = {"law": "yeoh", "C1": "0.6 MPa", "C2": "-10 kPa", "C3": "1 kPa"}
OGDEN = {
    "law": "ogden",
    "mu": ["0.6 MPa", "0.02 MPa"],
    "alpha": [1.6, 4.0],
    "convention": "mu/alpha",
}
MODULI = {"mooney-rivlin": 32.6e6, "neo-hookean": 1.2e6, "yeoh": 1.2e6, "ogden": 0.52e6}
TRAPPED: dict[str, Any] = {"model": "incompressible"}
_POINT = 1.35  # displacement under a patch: this times F R / (E t^2)


class Kind(NamedTuple):
    """What pads of a kind have in common; of the rest, numbers are drawn."""

    law: dict[str, Any] = EPDM  # of the membrane
    ratio: tuple[float, float] = (0.02, 0.04)  # thickness over radius, from and to
    size: tuple[float, float] = (4, 10)  # of patches [mm], from and to
    # displacement that is aimed at, in thicknesses, from and to
    sink: tuple[float, float] = (0.3, 1.5)
    oil: dict[str, Any] = TRAPPED  # how it answers
    half_angle: tuple[float, float] = (60, 90)  # from and to [deg]
    length: tuple[float, float] = (1.0, 2.0)  # in radii, from and to
    at: str = "crown"  # of the patch: the crown, a clamped end, beside the crown
    signs: tuple[int, ...] = (1,)  # of the patches' forces
    turn: float = 0.0  # of the forces [deg]
    force: float | None = None  # in place of what is aimed at [N]
    tall: float = 1.0  # height over half width of an ellipse


_SHIPPED: dict[str, Any] = {"half_angle": (90, 90), "size": (6, 6)}
KINDS = {
    "ellipse": Kind(force=6.0, tall=45 / 57.5, **_SHIPPED),
    "wall 18 N": Kind(force=18.0, **_SHIPPED),
    "wall 22 N": Kind(force=22.0, **_SHIPPED),
    "wall 28 N": Kind(force=28.0, **_SHIPPED),
    "light": Kind(force=0.5, **_SHIPPED),
    "thick": Kind(NEO_HOOKEAN, ratio=(0.08, 0.12), sink=(0.1, 0.4)),
    "thickest": Kind(YEOH, ratio=(0.15, 0.2), sink=(0.05, 0.2), size=(8, 20)),
    "pull": Kind(YEOH, signs=(-1,)),
    "small patch": Kind(NEO_HOOKEAN, size=(2, 3), ratio=(0.03, 0.05), length=(0.7, 1.2)),
    "large patch": Kind(OGDEN, size=(15, 20), oil={"model": "compressible"}, length=(1.5, 2)),
    "vented": Kind(NEO_HOOKEAN, oil={"model": "vented"}, sink=(0.1, 0.4)),
    "thin": Kind(EPDM, ratio=(0.01, 0.013), half_angle=(45, 50), length=(0.5, 0.8)),
    "long": Kind(OGDEN, ratio=(0.05, 0.08), length=(3.5, 4)),
    "end": Kind(EPDM, at="end", ratio=(0.03, 0.05)),
    "opposite": Kind(YEOH, at="beside", signs=(1, -1), ratio=(0.03, 0.05)),
    "inclined": Kind(NEO_HOOKEAN, at="beside", turn=30.0, ratio=(0.03, 0.05)),
}


def sample(name: str, seed: int) -> dict[str, Any]:
    """Tables of a scene of a kind; those in contact with the wall are the shipped pad."""
    kind = KINDS[name]
    rng = np.random.default_rng([seed, list(KINDS).index(name)])
    radius, ratio = 1e-3 * rng.uniform(35, 65), math.exp(rng.uniform(*np.log(kind.ratio)))
    half, length = rng.uniform(*kind.half_angle), radius * rng.uniform(*kind.length)
    thickness, size = radius * ratio, rng.uniform(*kind.size, 2)
    if kind.force is not None:
        radius, thickness, length = 57.5e-3, 1.5e-3, 123e-3
    stiffness = 3 * MODULI[kind.law["law"]] * thickness**2 / radius / _POINT
    sink = thickness * math.exp(rng.uniform(*np.log(kind.sink)))
    force = kind.force or stiffness * sink
    angle, axial = 0.0, 0.0
    if kind.at == "beside":
        angle = rng.uniform(0.3, 0.6) * half
    if kind.at == "end":
        axial = 1e3 * length / 2 - size[1] / 2 - rng.uniform(1.0, 3.0)
    loads = [
        {
            "kind": "patch",
            "angle": f"{angle * (-1) ** k:.2f} deg",
            "axial": f"{axial:.2f} mm",
            "size": [f"{x:.2f} mm" for x in size],
            "force": f"{sign * force:.4g} N",
            "direction": f"{kind.turn} deg" if kind.turn else "radial",
        }
        for k, sign in enumerate(kind.signs)
    ]
    inner = 1e3 * radius
    shape: dict[str, Any] = {"inner_radius": f"{inner:.2f} mm"}
    if kind.tall != 1:
        axes = [f"{inner:.2f} mm", f"{inner * kind.tall:.2f} mm"]
        shape = {"section": "ellipse", "inner_semi_axes": axes}
    gap = 5e-3 if kind.force else max(5e-3, 4 * sink)
    geometry = shape | {
        "thickness": f"{1e3 * thickness:.3f} mm",
        "half_angle": f"{half:.1f} deg",
        "width": f"{1e3 * length:.2f} mm",
        "oil_gap": f"{1e3 * gap:.2f} mm",
        "ends": "clamped",
    }
    oil = kind.oil
    if oil["model"] == "compressible":
        oil = oil | {"bulk_modulus": "2 MPa"}
    solve = {"model": "auto", "rtol": RTOL}
    return {
        "geometry": geometry,
        "material": kind.law,
        "oil": oil,
        "load": loads,
        "solve": solve,
    }


def continuum(
    spec: SceneSpec,  # the scene
    sizes: float = 1.0,  # factor on those of all elements
    log: Any = print,  # prints what each mesh says
) -> dict[str, Any]:
    """A pad's answer by hexahedra: values with their deviations."""
    from benchmarks.felupe_pad import FelupePad

    membrane, patches, compliance = _membrane(spec)
    g, least = spec.geometry, min(min(p.size) for p in patches)
    decay = math.sqrt(membrane.semi_axes[0] * g.mean_thickness)
    coarse = 0.5 * decay, min(1.0 * decay, 0.7 * decay * max(1.0, g.width / 0.1))
    fine = min(least / 2, coarse[0])
    room = min(g.width / 2 - abs(p.axial) - p.size[1] / 2 for p in patches)
    edge = min(coarse[0] / 2, room / 2.5)
    symmetric = (
        len(patches) == 1 and patches[0].angle == 0 and patches[0].turn == 0,
        all(p.axial == 0 for p in patches),
    )
    tried, first = [], None
    for scale, across in ((sizes, 1), (sizes, 2), (2 / 3 * sizes, 1)):
        start = time.perf_counter()
        lengths = scale * fine, (scale * coarse[0], scale * coarse[1])
        options = {"symmetric": symmetric, "compliance": compliance, "edge": scale * edge}
        pad = FelupePad(membrane, patches, *lengths, across, **options)
        if first is None:
            *_, steps = pad.system.follow(pad.load, [0.3, 0.6, 0.85, 1.0])
            first = pad
        else:
            pad.take(first)
            steps = pad.system.advance(pad.load)
        found = {
            "oil_pressure_Pa": pad.system.oil,
            "wall_force_N": pad.wall_force(),
            "displacements_m": [pad.under(p, across) for p in patches],
            "inner_displacements_m": [pad.under(p, 0) for p in patches],
        }
        tried.append(found)
        log(f"{pad.number.shape} {pad.system.unknowns} unknowns, {steps} corrections,")
        log(f"  {time.perf_counter() - start:.0f} s: {found}", flush=True)
    answer: dict[str, Any] = {}
    for key in tried[0]:
        a, b, c = (np.asarray(x[key], float) for x in tried)
        value = a + 1.5 * (c - a) + 1.2 * (b - a)
        deviation = 0.75 * np.abs(c - a) + 0.3 * np.abs(b - a)
        answer[key] = np.stack([value, deviation], -1).tolist()
    return answer


def _membrane(spec: SceneSpec) -> tuple[Any, list[Any], float | None]:
    """A scene for FElupe: membrane, patches, compliance of the oil."""
    from benchmarks.felupe_laws import MooneyRivlin, Ogden, Yeoh
    from benchmarks.felupe_pad import Membrane, Patch
    from suas_jax.config import continuous_inputs

    known = continuous_inputs(spec)
    m = {key[9:]: value for key, value in known.items() if key.startswith("material.")}
    law: Any
    if spec.material.law == "ogden":
        pairs = [(m[f"mu.{k}"], m[f"alpha.{k}"]) for k in range(len(m) // 2)]
        law = Ogden(*zip(*pairs, strict=True))
    elif spec.material.law == "yeoh":
        law = Yeoh(m["C1"], m["C2"], m["C3"])
    elif spec.material.law == "neo-hookean":
        law = MooneyRivlin(m["mu"] / 2)
    else:
        law = MooneyRivlin(m["C1"], m["C2"], m["C3"])
    g = spec.geometry
    radius = known.get("geometry.inner_radius")
    axes = (
        (known["geometry.inner_semi_axes.0"], known["geometry.inner_semi_axes.1"])
        if (radius is None)
        else (radius, radius)
    )
    half = known["geometry.half_angle"]
    membrane = Membrane(
        axes, g.mean_thickness, half, g.width, law, g.mean_gap if radius else None
    )
    patches = []
    for load in spec.loads:
        assert isinstance(load, PatchLoadSpec)
        assert load.size is not None
        turn = 0.0 if isinstance(load.direction, str) else load.direction
        angle = load.angle or 0.0
        patches.append(
            Patch(angle, load.axial, load.size, force=load.force, turn=turn, tilt=load.tilt)
        )
    compliance: float | None = 0.0
    if spec.oil.model == "vented":
        compliance = None
    elif spec.oil.model == "compressible":
        inner = axes[0]
        film = half * (inner**2 - (inner - g.mean_gap) ** 2) * g.width
        compliance = film / known["oil.bulk_modulus"]
    return membrane, patches, compliance


def kept() -> list[dict[str, Any]]:
    """Scenes and their answers by the continuum."""
    return list(json.loads(KEPT.read_text())) if KEPT.exists() else []


def compared(scene: dict[str, Any], **solve_table: Any) -> dict[str, Any]:
    """A kept scene by `suas solve`: true and stated errors, deviations of the truth.

    Args:
        scene: as `kept` gives it.
        solve_table: keys of [solve] that differ.
    """
    from suas_jax.scene.solve import solve

    report = solve(with_solve(scene_from_dict(scene["tables"]), **solve_table)).report
    truth = scene["continuum"]
    moved, deviations = np.array(truth["displacements_m"]).T
    scale = np.abs(moved).max()
    own = np.array([load["displacement_m"] for load in report["loads"]])
    errors = [*((own - moved) / scale)]
    unsure = [*(deviations / scale)]
    pressure, deviation = truth["oil_pressure_Pa"]
    if pressure != 0:
        errors.append(report["oil_pressure_Pa"] / pressure - 1)
        unsure.append(deviation / abs(pressure))
    worst = int(np.argmax(np.abs(errors)))
    found = {
        "name": scene["name"],
        "model": report["model"],
        "status": report["status"],
        "rtol_met": report["rtol_met"],
        "stated": report["error_estimate"],
        "true": float(errors[worst]),
        "unsure": float(unsure[worst]),
        "pressure": float(errors[-1]) if pressure != 0 else 0.0,
        "displacement": float(np.abs(errors[: len(own)]).max()),
    }
    force, deviation = truth["wall_force_N"]
    if force > 0 and report["wall"] is not None:
        found["wall"] = report["wall"]["force_N"] / force - 1
        found["wall_unsure"] = deviation / force
        found["wall_stated"] = report["wall"]["force_error_N"] / force
    return found


def main() -> None:
    """Solve pads by the continuum, or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--continuum", nargs="*", metavar="KIND")
    parser.add_argument("--compare", nargs="*", metavar="KIND")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sizes", type=float, default=1.0, help="factor on the elements'")
    options = parser.parse_args()
    console = Console(width=140)
    if options.continuum is not None:
        for name in options.continuum or KINDS:
            print(name, flush=True)
            tables = sample(name, options.seed)
            try:
                answer = continuum(scene_from_dict(tables), options.sizes)
            except RuntimeError as error:
                print(f"  {error}", flush=True)
                continue
            own = {"name": name, "seed": options.seed, "tables": tables, "continuum": answer}
            others = [x for x in kept() if (x["name"], x["seed"]) != (name, options.seed)]
            write_text(KEPT, json.dumps([*others, own], indent=1) + "\n")
    if options.compare is not None:
        from suas_jax import configure

        configure()
        columns = ("scene", "model", "met", "stated", "true", "of pressure", "truth to")
        table = Table(*columns, "wall's force", "stated")
        for scene in kept():
            if options.compare and scene["name"] not in options.compare:
                continue
            found = compared(scene)
            print(found, flush=True)
            cells = [found["name"], found["model"], str(found["rtol_met"])]
            cells += [f"{found[key]:.1e}" for key in ("stated", "true", "pressure", "unsure")]
            wall = f"{100 * found['wall']:+.1f} %" if "wall" in found else ""
            stated = found.get("wall_stated")
            table.add_row(*cells, wall, "" if stated is None else f"{stated:.1e}")
        console.print(table)


if __name__ == "__main__":
    main()
