"""Ten presses against learning from scratch: errors of force and place by number of presses.

Simulated units of the paper's section, or of a pad (`--skin`), differ from their drawing by
what `suas fit sensor --fit as-built` looks for, and in ways that it cannot follow exactly:
fields of thickness and gap of random waves on more nodes, a finer mesh, places 0.5 mm off,
forces 0.2 % off, offsets and gains of channels, noise of two counts, whole counts. Those of a
section differ in what the model does not have at all, too: another law, a thick spot of 6 mm,
rubber that creeps while a press is held, and a bar that presses an arc of some millimetres
instead of a line, unevenly and a few degrees askew. Each is pressed at planned and at random
places; the calibrated skin file then finds unseen loads with `LoadEstimator`, as `suas invert`
does, with what the presses showed beyond the model and without; loads of a body three times as
wide as well, with `--averaged` from means of 50 frames. A Gaussian process and a network learn
from random presses of the same unit.
Prints the table of docs/as_built.md after each unit; `--plot` draws its figure::

    python -m benchmarks.as_built --units 2 --kinds random --presses 10 100
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.learned_models import gaussian_process, network
from fitting.calibration.next_press import candidates_of, planned
from fitting.calibration.plan import Press
from fitting.inverse_load.estimator import LoadEstimator
from fitting.sensor.fit.calibrate import fit_sensor
from fitting.sensor.logs.data import LogFile, SensorData
from fitting.sensor.logs.known_loads import KnownLoads
from fitting.sensor.model.as_built import as_built
from fitting.sensor.report.skin_file import calibrated_skin
from suas_jax import configure
from suas_jax.config import SkinSpec, continuous_inputs, load_skin
from suas_jax.config.geometry import AlongSpec, SheetSpec
from suas_jax.config.laws.yeoh import YeohSpec
from suas_jax.figures.style import written
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin, skin_of
from suas_jax.skin.plain import plain_geometry

SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"
PLACE_ERROR, FORCE_ERROR, NOISE = 0.5e-3, 2e-3, 2.0
FRAMES = 50
# Nodes of the true fields along the arc and along the axis, and elements, by dimension.
NODES: dict[int, tuple[int, ...]] = {2: (33,), 3: (5, 5)}
ELEMENTS: dict[int, int | tuple[int, int]] = {2: 64, 3: (28, 24)}
DIAMETER = 6e-3  # of the discs that press on a pad [m]
LEARNED = (10, 30, 100, 300)
# Of a section's units beyond the model: height of the spot and its width as a share of the arc;
# the creep's share, its time and how long a press is held [s]; the arc that the bar presses at
# 10 N [m], and that of a wider body; the bar's angle, and how uneven it is.
SPOT, SPOT_WIDTH = 0.10, 0.03
CREEP, CREEP_TIME, HELD = 0.05, 20.0, (5.0, 40.0)
ARC, WIDER, ASKEW, UNEVEN = 5e-3, 15e-3, np.deg2rad(3.0), 0.3


def unit_of(spec: SkinSpec, random: np.random.Generator) -> tuple[Skin, np.ndarray]:
    """A unit that differs from its drawing, and its channels' offsets [taxel]."""
    dimension = spec.geometry.dimension
    at = [np.linspace(0, 1, n) for n in NODES[dimension]]
    own = as_built(spec)
    if dimension == 2:
        # Of the same stiffness at small strain, and stiffening instead of softening.
        modulus = float(skin_of(spec).law.shear_modulus[0])
        law = YeohSpec(C1=modulus / 2, C2=modulus / 20, C3=0.0)
        own = own.model_copy(update={"material": law})
    even = np.ones(NODES[dimension])
    tables: dict[str, AlongSpec | SheetSpec] = {}
    for key in ("thickness", "oil_gap"):
        value = getattr(spec.geometry, key) * even
        if dimension == 2:
            tables[key] = AlongSpec(arc=tuple(at[0].tolist()), value=tuple(value.tolist()))
        else:
            arc, axial = (tuple(x.tolist()) for x in at)
            rows = tuple(map(tuple, value.tolist()))
            tables[key] = SheetSpec(arc=arc, axial=axial, value=rows)
    own = own.model_copy(update={"geometry": own.geometry.model_copy(update=tables)})
    inputs = continuous_inputs(own)
    for key in tables:
        field = 0.02 * random.normal() * even
        for k in (1, 2, 3):
            for x in np.meshgrid(*at, indexing="ij"):
                wave = np.sin(np.pi * k * x + random.uniform(0, 2 * np.pi))
                field = field + 0.03 / k / len(at) ** 0.5 * random.normal() * wave
        nodes = [path for path in inputs if path.startswith(f"geometry.{key}.value.")]
        for path, share in zip(nodes, field.ravel(), strict=True):
            inputs[path] *= 1 + share
        if dimension == 2 and key == "thickness":
            middle = random.uniform(0.2, 0.8)
            bumps = SPOT * np.exp(-(((at[0] - middle) / SPOT_WIDTH) ** 2) / 2)
            for path, share in zip(nodes, bumps, strict=True):
                inputs[path] *= 1 + share
    stiffness = 1 + 0.08 * random.normal()
    for path in inputs:
        if path.startswith("material.C") or path == "material.mu":
            inputs[path] *= stiffness
        if "gain" in path:
            inputs[path] = 1 + 0.01 * random.normal()
    inputs["oil.relative_permittivity"] *= 1 + 0.02 * random.normal()
    inputs["oil.fill"] = 1 + 2e-3 * random.normal()
    inputs["geometry.mounting"] = 3e-4 * random.normal()
    skin = skin_of(own, inputs, elements=ELEMENTS[dimension], contact=False)
    return skin, 100 * random.normal(size=len(skin.electrodes.taxels.angle))


def data_of(spec: SkinSpec, presses: np.ndarray, so: np.ndarray) -> SensorData:
    """Mean readings [press + 1, taxel] of presses, rest last, as logs would give them."""
    angle, axial, force = np.concatenate([presses, np.zeros((1, 3))]).T[:, None]
    loads, frames = KnownLoads.pushes(angle, force, axial), np.arange(angle.size)
    file = LogFile("simulated", "0", len(frames), ("oil",), None)
    # Repeated, as the noise of a mean follows from the number of its frames.
    state = np.repeat(frames, FRAMES)
    many = np.repeat(so.T, FRAMES, 1)
    nothing = np.zeros(len(state))
    oil = np.full(len(frames), np.nan)
    return SensorData(
        spec, many, nothing, nothing.astype(int), state, loads, oil, (file,), (), (), True
    )


class Unit:
    """A unit, and all that it reads. Presses are angles, axial places and forces."""

    def __init__(
        self,
        file: Path,  # the drawing
        seed: int,  # of what differs
        plan: tuple[Press, ...],  # the presses that are planned
        tests: int,  # how many unseen loads
        most: int = LEARNED[-1],  # how many random presses
        largest: float = 10.0,  # force of a press [N]
        averaged: bool = False,  # whether loads are found from means of `FRAMES` frames
    ) -> None:
        spec, random = load_skin(file), np.random.default_rng(seed)
        if not np.isclose(plain_geometry(spec.geometry).half_angle[0], np.pi / 2):
            raise ValueError(f"{file}: units are made of half circles alone")
        self.noise = NOISE / FRAMES**0.5 if averaged else NOISE
        skin, offsets = unit_of(spec, random)
        self.skin, self.radius = skin, float(skin.geometry.outer_size[0])
        self.pad = spec.geometry.dimension == 3
        half = float(skin.geometry.half_angle[0]), spec.geometry.width / 2 * self.pad

        def drawn(count: int, share: float, low: float, high: float) -> np.ndarray:
            where = [
                share * random.uniform(-h, h, count) if h else np.zeros(count) for h in half
            ]
            return np.stack([*where, random.uniform(low, high, count)], 1)

        told = np.concatenate(
            [
                np.reshape([(p.place, p.axial or 0.0, p.force) for p in plan], (-1, 3)),
                drawn(most, 0.6 if self.pad else 0.8, largest / 4, largest),
            ]
        )
        seen = drawn(tests, 0.55 if self.pad else 7 / 9, largest / 5, 1.2 * largest)
        sizes = PLACE_ERROR / self.radius, PLACE_ERROR, FORCE_ERROR
        errors = np.zeros(told.shape)
        kinds = [0, 1, 2] if self.pad else [0, 2]
        errors[:, kinds] = random.normal(size=(len(told), len(kinds)))
        errors *= sizes * np.stack([told[:, 2] ** 0, told[:, 2] ** 0, told[:, 2]], 1)
        lanes = np.concatenate([told + errors, seen, np.zeros((1, 3))])
        self.askew, self.uneven = ASKEW * random.normal(), UNEVEN * random.normal()
        crept = np.exp(-random.uniform(*HELD, len(lanes)) / CREEP_TIME)
        # All stresses fall by the same share, as if the force grew.
        crept = 1.0 if self.pad else 1 / (1 - CREEP * (1 - crept))
        wide = np.full(len(lanes), ARC)
        if not self.pad:
            lanes = np.concatenate([lanes[:-1], seen, lanes[-1:]])
            crept = np.concatenate([crept[:-1], crept[len(told) : -1], crept[-1:]])
            wide = np.concatenate([wide[:-1], np.full(len(seen), WIDER), wide[-1:]])
        found = forward(skin, self._loads(lanes, crept, wide))
        good = np.asarray(found.solved) & np.isfinite(np.asarray(found.so)).all(0)
        so = np.asarray(found.so).T + offsets
        rest = so[-1] + NOISE / FRAMES**0.5 * random.normal(size=len(offsets))
        means = so[: len(told)]
        means = means + NOISE / FRAMES**0.5 * random.normal(size=means.shape)
        single = so[len(told) : -1]
        single = single + self.noise * random.normal(size=single.shape)
        single = single if averaged else np.rint(single)
        self.bodies = 1 if self.pad else 2
        self.file, self.spec, self.rest = file, spec, rest
        self.good = good[: len(told)]
        self.told, self.so, self.planned = told, means, len(plan)
        kept = good[len(told) : -1].reshape(self.bodies, -1).all(0)
        self.seen = seen[kept]
        self.single, *self.wider = single.reshape(self.bodies, len(seen), -1)[:, kept]

    def _loads(self, presses: np.ndarray, crept: np.ndarray | float, wide: np.ndarray) -> Loads:
        """Patches, or bars: even over an arc but for what is uneven of them [press]."""
        angle, axial, force = presses.T
        if self.pad:
            return Loads.patch(angle, axial, force, DIAMETER)
        points, weights = np.polynomial.legendre.leggauss(3)
        half = wide * np.sqrt(force / 10.0) / 2 / self.radius
        share = weights * (1 + self.uneven * points) / 2
        return Loads.line(
            angle + points[:, None] * half,
            share[:, None] * force * crept,
            self.askew + points[:, None] * half,
        )

    def presses(self, kind: str, count: int) -> np.ndarray:
        """Which rows: planned ones in their order, or random ones."""
        rows = np.flatnonzero(self.good)
        rows = rows[rows < self.planned] if kind == "planned" else rows[rows >= self.planned]
        return rows[:count]

    def calibrated(self, rows: np.ndarray, folder: Path) -> SkinSpec:
        """The skin file that some presses give."""
        so = np.concatenate([self.so[rows], self.rest[None]])
        data = data_of(self.spec, self.told[rows], so)
        fit = fit_sensor(data, ["as-built"], place_error=PLACE_ERROR)
        file = folder / "unit.toml"
        file.write_text(calibrated_skin(self.file, fit))
        return load_skin(file)

    def found(self, spec: SkinSpec) -> list[tuple[np.ndarray, ...]]:
        """Errors, body after body, with what presses showed beyond the model, and without.

        Of force and place [m], whether in their 95 % intervals, and the force's told
        deviation [load, 5].
        """
        variance = NOISE**2 / FRAMES
        estimator = LoadEstimator(
            spec,
            rest=self.rest,
            rest_variance=variance,
            noise=self.noise,
            most_contacts=1,
            load_fields=False,  # loads are bars and discs
        )
        ways = []
        for way in dict.fromkeys((estimator.frames.discrepancy, None)):
            estimator.frames.discrepancy = way
            ways.append(tuple(self._errors(estimator, so) for so in (self.single, *self.wider)))
        return [ways[0], ways[-1]]

    def _errors(self, estimator: LoadEstimator, so: np.ndarray) -> np.ndarray:
        rows = []
        for estimate, (angle, axial, force) in zip(
            estimator.estimate(so), self.seen, strict=True
        ):
            if not estimate.contacts:
                rows.append((np.nan, np.nan, 0.0, 0.0, np.nan))
                continue
            (own,) = estimate.contacts
            off = [own.force / force - 1, self.radius * (own.angle - angle)]
            sd = [own.deviation("force") / force, self.radius * own.deviation("angle")]
            if self.pad:
                off.append(own.axial - axial)
                sd.append(own.deviation("axial"))
            inside = np.abs(off) < 1.96 * np.array(sd)
            away = float(np.linalg.norm(off[1:]))
            rows.append((off[0], away, inside[0], inside[1:].mean(), sd[0]))
        return np.array(rows)

    def learned(self, model: object, count: int) -> tuple[np.ndarray, ...]:
        """The same of a learned model, which tells no interval."""
        rows = self.presses("random", count)
        places, force = self.told[rows, : 1 + self.pad], self.told[rows, 2]
        predict = model(self.so[rows] - self.rest, places, force)  # type: ignore[operator]
        every = []
        for so in (self.single, *self.wider):
            *found, strength = predict(so - self.rest).T
            off = np.array(found).T - self.seen[:, : 1 + self.pad]
            off[:, 0] *= self.radius
            none = np.full(len(off), np.nan)
            away = np.linalg.norm(off, axis=1)
            strength = strength / self.seen[:, 2] - 1
            every.append(np.stack([strength, away, none, none, none], 1))
        return tuple(every)


def summary(rows: list[tuple[np.ndarray, ...]]) -> tuple[float, ...]:
    """Medians of the errors, 95th percentile of the force's, coverages, other bodies' force.

    Last the median deviation of the force that is told.
    """
    every, *others = (np.concatenate(bodies) for bodies in zip(*rows, strict=True))
    off, told = np.abs(every), every[np.isfinite(every[:, 4]), 4]
    return (
        100 * float(np.nanmedian(off[:, 0])),
        100 * float(np.nanpercentile(off[:, 0], 95)),
        1e3 * float(np.nanmedian(off[:, 1])),
        *(100 * float(np.mean(every[:, k])) for k in (2, 3)),
        *(100 * float(np.nanmedian(np.abs(own[:, 0]))) for own in others),
        100 * float(np.median(told)) if len(told) else np.nan,
    )


def plot(table: dict[tuple[str, int], tuple[float, ...]], file: Path) -> None:
    """Draw errors of force and of place by number of presses."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    names = ("median error of the force [%]", "median error of the place [mm]")
    for axes, column, label in zip(figure.subplots(1, 2), (0, 2), names, strict=True):
        for kind in dict.fromkeys(kind for kind, _ in table):
            points = [(n, row[column]) for (own, n), row in table.items() if own == kind]
            x, y = np.array(points).T
            if kind == "as drawn":
                axes.axhline(y[0], color="0.5", ls="--", label=kind)
            else:
                axes.plot(x, y, "o-", label=kind)
        axes.set(xscale="log", yscale="log", xlabel="presses of the unit", ylabel=label)
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize="small")
    written(figure, file)


def main() -> None:
    """Print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--skin", type=Path, default=SKIN)
    parser.add_argument("--force", type=float, default=10.0, help="largest of a press [N]")
    parser.add_argument("--units", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="first unit's seed")
    parser.add_argument("--tests", type=int, default=60)
    parser.add_argument("--presses", type=int, nargs="+", default=[10])
    parser.add_argument("--learned", type=int, nargs="+", default=[*LEARNED])
    parser.add_argument("--kinds", nargs="+", default=["planned", "random"])
    parser.add_argument("--averaged", action="store_true", help="loads from means of frames")
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    configure()
    spec = load_skin(options.skin)
    plan: tuple[Press, ...] = ()
    if "planned" in options.kinds:
        most = max(options.presses)
        plan = planned(candidates_of(spec, options.force, PLACE_ERROR), most).presses
        print("planned:", "; ".join(press.text for press in plan), flush=True)
    rows: dict[tuple[str, int], list[tuple[np.ndarray, ...]]] = {}
    with tempfile.TemporaryDirectory() as name:
        for seed in range(options.first, options.first + options.units):
            most = max(options.learned)
            given = options.tests, most, options.force, options.averaged
            unit = Unit(options.skin, seed, plan, *given)
            if not np.isfinite(unit.rest).all():
                print(f"unit {seed} buckles at rest: left out", flush=True)
                continue
            begin = time.process_time()
            for label, model in (("Gaussian process", gaussian_process), ("network", network)):
                for count in options.learned:
                    rows.setdefault((label, count), []).append(unit.learned(model, count))
            rows.setdefault(("as drawn", 0), []).append(unit.found(spec)[0])
            for kind in options.kinds:
                for count in options.presses:
                    own = unit.calibrated(unit.presses(kind, count), Path(name))
                    with_it, without = unit.found(own)
                    rows.setdefault((f"as built, {kind}", count), []).append(without)
                    key = f"as built with correction, {kind}", count
                    rows.setdefault(key, []).append(with_it)
                    spent = time.process_time() - begin
                    record = own.calibration
                    assert record is not None
                    shift = record.place_shift
                    # Half of what presses share, see `shift_of_loads`.
                    low, high = (
                        2e3 * unit.radius * f(shift.shifts if shift else (0.0,))
                        for f in (min, max)
                    )
                    said = f"presses off by {low:.2f} to {high:.2f} mm together, {spent:.0f} s"
                    print(f"unit {seed}, {kind} {count}: {said}", flush=True)
            print(f"unit {seed}, all so far:", flush=True)
            printed({key: summary(own) for key, own in rows.items()})
    if options.plot is not None:
        plot({key: summary(own) for key, own in rows.items()}, options.plot)


def printed(table: dict[tuple[str, int], tuple[float, ...]]) -> None:
    """Print the table."""
    print(
        "model, presses | force median %, 95th % | place mm | in 95 %: force, place, wider % |"
        " deviation told %"
    )
    for (kind, count), (force, high, place, *inside, told) in table.items():
        shown = ", ".join("-" if np.isnan(x) else f"{x:.1f}" for x in inside)
        row = f"{kind}, {count} | {force:.2f}, {high:.2f} | {place:.2f} | {shown} | {told:.1f}"
        print(row, flush=True)


if __name__ == "__main__":
    main()
