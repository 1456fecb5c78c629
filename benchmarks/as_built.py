"""Ten presses against learning from scratch: errors of force and place by number of presses.

Simulated units of the paper's section differ from their drawing by what `suas fit sensor --fit
as-built` looks for, and in ways that it cannot follow exactly: fields of thickness and gap of
random waves on nine nodes, a finer mesh, places 0.5 mm off, forces 0.2 % off, offsets and gains
of channels, noise of two counts, whole counts. Each is pressed at planned and at random places;
the calibrated skin file then finds unseen loads with `LoadEstimator`, as `suas invert` does. A
Gaussian process and a network learn from random presses of the same unit. Prints the table of
docs/as_built.md and draws its figure::

    python benchmarks/as_built.py --units 10 --plot docs/as_built.png
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
from suas_jax.config.geometry import AlongSpec
from suas_jax.figures.style import written
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin, skin_of

SKIN = Path(__file__).parent.parent / "configs/skins/suas.toml"
PLACE_ERROR, FORCE_ERROR, NOISE = 0.5e-3, 2e-3, 2.0
FRAMES, NODES, ELEMENTS = 50, 9, 64
LARGEST, RADIUS = 10.0, 59e-3  # force of calibration [N], radius of the outer face [m]
LEARNED = (10, 30, 100, 300)


def unit_of(spec: SkinSpec, random: np.random.Generator) -> tuple[Skin, np.ndarray]:
    """A unit that differs from its drawing, and its channels' offsets [taxel]."""
    arc = tuple(np.linspace(0, 1, NODES).tolist())
    own = as_built(spec)
    tables = {
        key: AlongSpec(arc=arc, value=(getattr(spec.geometry, key),) * NODES)
        for key in ("thickness", "oil_gap")
    }
    own = own.model_copy(update={"geometry": own.geometry.model_copy(update=tables)})
    inputs = continuous_inputs(own)
    for key in tables:
        x, field = np.array(arc), 0.02 * random.normal() * np.ones(NODES)
        for k in (1, 2, 3):
            wave = np.sin(np.pi * k * x + random.uniform(0, 2 * np.pi))
            field = field + 0.03 / k * random.normal() * wave
        for i, share in enumerate(field):
            inputs[f"geometry.{key}.value.{i}"] *= 1 + share
    stiffness = 1 + 0.08 * random.normal()
    for path in inputs:
        if path.startswith("material.C"):
            inputs[path] *= stiffness
        if "gain" in path:
            inputs[path] = 1 + 0.01 * random.normal()
    inputs["oil.relative_permittivity"] *= 1 + 0.02 * random.normal()
    inputs["oil.fill"] = 1 + 2e-3 * random.normal()
    inputs["geometry.mounting"] = 3e-4 * random.normal()
    skin = skin_of(own, inputs, elements=ELEMENTS, contact=False)
    return skin, 100 * random.normal(size=len(spec.electrodes.taxels))


def data_of(spec: SkinSpec, place: np.ndarray, force: np.ndarray, so: np.ndarray) -> SensorData:
    """Mean readings [press + 1, taxel] of presses, rest last, as logs would give them."""
    at, load = np.append(place, 0.0)[None], np.append(force, 0.0)[None]
    loads, frames = KnownLoads.pushes(at, load), np.arange(at.shape[1])
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
    """A unit, and all that it reads.

    Args:
        spec: the drawing.
        seed: of what differs.
        plan: the presses that are planned.
        tests: how many unseen loads.
    """

    def __init__(self, spec: SkinSpec, seed: int, plan: tuple[Press, ...], tests: int) -> None:
        random = np.random.default_rng(seed)
        skin, offsets = unit_of(spec, random)
        many = LEARNED[-1]
        told = np.concatenate(
            [
                [(press.place, press.force) for press in plan],
                np.stack(
                    [
                        np.deg2rad(random.uniform(-72, 72, many)),
                        random.uniform(LARGEST / 4, LARGEST, many),
                    ],
                    1,
                ),
            ]
        )
        seen = np.stack(
            [np.deg2rad(random.uniform(-70, 70, tests)), random.uniform(2, 12, tests)], 1
        )
        size = told.shape
        errors = np.array([PLACE_ERROR / RADIUS, FORCE_ERROR]) * random.normal(size=size)
        true = told + errors * np.stack([np.ones(len(told)), told[:, 1]], 1)
        lanes = np.concatenate([true, seen, [(0.0, 0.0)]])
        found = forward(skin, Loads.line(*lanes.T))
        good = np.asarray(found.solved) & np.isfinite(np.asarray(found.so)).all(0)
        so = np.asarray(found.so).T + offsets
        rest = so[-1] + NOISE / FRAMES**0.5 * random.normal(size=len(offsets))
        means = so[: len(told)]
        means = means + NOISE / FRAMES**0.5 * random.normal(size=means.shape)
        single = so[len(told) : -1]
        single = np.rint(single + NOISE * random.normal(size=single.shape))
        self.spec, self.rest, self.good = spec, rest, good[: len(told)]
        self.told, self.so, self.planned = told, means, len(plan)
        kept = good[len(told) : -1]
        self.seen, self.single = seen[kept], single[kept]

    def presses(self, kind: str, count: int) -> np.ndarray:
        """Which rows: planned ones in their order, or random ones."""
        rows = np.flatnonzero(self.good)
        rows = rows[rows < self.planned] if kind == "planned" else rows[rows >= self.planned]
        return rows[:count]

    def calibrated(self, rows: np.ndarray, folder: Path) -> SkinSpec:
        """The skin file that some presses give."""
        so = np.concatenate([self.so[rows], self.rest[None]])
        data = data_of(self.spec, *self.told[rows].T, so)
        fit = fit_sensor(data, ["as-built"], place_error=PLACE_ERROR)
        file = folder / "unit.toml"
        file.write_text(calibrated_skin(SKIN, fit))
        return load_skin(file)

    def found(self, spec: SkinSpec) -> np.ndarray:
        """Errors of force and place [m], and whether in their 95 % intervals [load, 4]."""
        variance = NOISE**2 / FRAMES
        estimator = LoadEstimator(spec, rest=self.rest, rest_variance=variance, most_contacts=1)
        rows = []
        pairs = zip(estimator.estimate(self.single), self.seen, strict=True)
        for estimate, (place, force) in pairs:
            if not estimate.contacts:
                rows.append((np.nan, np.nan, 0.0, 0.0))
                continue
            (own,) = estimate.contacts
            off = np.array([own.force / force - 1, RADIUS * (own.angle - place)])
            sd = own.deviation("force") / force, RADIUS * own.deviation("angle")
            rows.append((*off, *(np.abs(off) < 1.96 * np.array(sd))))
        return np.array(rows)

    def learned(self, model: object, count: int) -> np.ndarray:
        """The same of a learned model, which tells no interval."""
        rows = self.presses("random", count)
        predict = model(self.so[rows] - self.rest, *self.told[rows].T)  # type: ignore[operator]
        place, force = predict(self.single - self.rest).T
        none = np.full(len(place), np.nan)
        off = force / self.seen[:, 1] - 1, RADIUS * (place - self.seen[:, 0])
        return np.stack([*off, none, none], 1)


def summary(rows: list[np.ndarray]) -> tuple[float, ...]:
    """Medians of the errors, 95th percentile of the force's, and coverages."""
    every = np.concatenate(rows)
    off = np.abs(every)
    return (
        100 * float(np.nanmedian(off[:, 0])),
        100 * float(np.nanpercentile(off[:, 0], 95)),
        1e3 * float(np.nanmedian(off[:, 1])),
        *(100 * float(np.mean(every[:, k])) for k in (2, 3)),
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
        axes.legend()
    written(figure, file)


def main() -> None:
    """Print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--units", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="first unit's seed")
    parser.add_argument("--tests", type=int, default=60)
    parser.add_argument("--presses", type=int, nargs="+", default=[10])
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args()
    configure()
    spec = load_skin(SKIN)
    most = max(options.presses)
    plan = planned(candidates_of(spec, LARGEST, PLACE_ERROR), most).presses
    print("planned:", "; ".join(press.text for press in plan), flush=True)
    rows: dict[tuple[str, int], list[np.ndarray]] = {}
    with tempfile.TemporaryDirectory() as name:
        for seed in range(options.first, options.first + options.units):
            begin = time.perf_counter()
            unit = Unit(spec, seed, plan, options.tests)
            for label, model in (("Gaussian process", gaussian_process), ("network", network)):
                for count in LEARNED:
                    rows.setdefault((label, count), []).append(unit.learned(model, count))
            rows.setdefault(("as drawn", 0), []).append(unit.found(spec))
            for kind in ("planned", "random"):
                for count in options.presses:
                    own = unit.calibrated(unit.presses(kind, count), Path(name))
                    key = (f"as built, {kind}", count)
                    rows.setdefault(key, []).append(unit.found(own))
                    print(
                        f"unit {seed}, {time.perf_counter() - begin:.0f} s: {key}", flush=True
                    )
            shown = ", ".join(
                f"{kind} {n}: {summary(own[-1:])[0]:.2f} %" for (kind, n), own in rows.items()
            )
            print(f"unit {seed} ({time.perf_counter() - begin:.0f} s): {shown}", flush=True)
    table = {key: summary(own) for key, own in rows.items()}
    print("model, presses | force median %, 95th % | place mm | in 95 %: force, place")
    for (kind, count), row in table.items():
        force, high, place, *inside = row
        shown = ", ".join("-" if np.isnan(x) else f"{x:.1f}" for x in inside)
        print(f"{kind}, {count} | {force:.2f}, {high:.2f} | {place:.2f} | {shown}")
    if options.plot is not None:
        plot(table, options.plot)


if __name__ == "__main__":
    main()
