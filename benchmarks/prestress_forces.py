"""How wrong a force is read by a file that ignores filling, mounting, warmth and depth.

A true skin that carries one of them is pressed by 5 N at the crown, on a pad by a disc of 6 mm.
The file without it reads the force under which its own skin is dented as deep. Run::

    python benchmarks/prestress_forces.py table --plot docs/prestress_forces.png
    python benchmarks/prestress_forces.py study --frames 300

``study`` draws skins of the paper's section from the tolerances that estimates allow for
(filling 0.3 %, mounting 0.05 %, 5 K, and those of stiffness, thickness, gap and converter), one
a load of 2 to 12 N within 60 degrees, and has `LoadEstimator` find the loads of each from its
readings with a file that states none of it. Skins that their stress buckles at rest are left
out. Wrong is a frame of status ``ok`` whose truth lies outside its own 99.9 % region.
"""

import argparse
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from fitting.inverse_load.estimate.estimate import Contact
from fitting.inverse_load.estimator import LoadEstimator
from suas_jax import configure
from suas_jax.config import InputErrors, SkinSpec, UncertainQuantity, input_errors, load_skin
from suas_jax.config.input_errors import as_assembled, value_of
from suas_jax.config.oils.compressible import CompressibleOilSpec
from suas_jax.config.schema_load import EnvironmentSpec
from suas_jax.equilibrium.balance import State
from suas_jax.equilibrium.buckling import stress_effect
from suas_jax.numerics.array_types import Lanes
from suas_jax.runtime.compiled import COMPILED
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin, skin_of

SKINS = Path(__file__).parent.parent / "configs/skins"
FORCE, DISC = 5.0, 6e-3
FORCES = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.5, 10.0, 12.0])
ZERO_CELSIUS = 273.15
NOISE = 2.0  # of a reading [counts]
_TOGETHER = 200  # skins of the study
CASES = {
    "oil.fill": (
        "filling",
        "%",
        100,
        -100,
        (0.995, 0.997, 0.998, 0.999, 1.001, 1.002, 1.003, 1.005),
    ),
    "geometry.mounting": ("mounting", "%", 100, 0, (-1e-3, -5e-4, -2e-4, -1e-4, 1e-4, 2e-4)),
    "environment.temperature": (
        "warmth",
        "K",
        1,
        -20 - ZERO_CELSIUS,
        tuple(ZERO_CELSIUS + t for t in (0, 10, 15, 17.5, 20, 22, 24)),
    ),
    "environment.depth": ("depth", "m", 1, 0, (0.0, 20.0, 100.0, 200.0, 300.0)),
}
"""By input: its name, its unit, the factor and offset to it, and the values tried."""


def named(spec: SkinSpec, **values: float) -> SkinSpec:
    """A skin that states all of it: oil of 1 GPa, expansions of EPDM, silicone oil and PLA."""
    oil = CompressibleOilSpec(
        relative_permittivity=spec.oil.relative_permittivity,
        bulk_modulus=1e9,
        expansion=9.6e-4,
        fill=values.get("oil.fill", 1.0),
    )
    around = EnvironmentSpec(
        temperature=values.get("environment.temperature", 20 + ZERO_CELSIUS),
        depth=values.get("environment.depth", 0.0),
    )
    mounting = values.get("geometry.mounting", 0.0)
    return spec.model_copy(
        update={
            "oil": oil,
            "environment": around,
            "material": spec.material.model_copy(update={"expansion": 1.6e-4}),
            "wall": spec.wall.model_copy(update={"expansion": 7e-5}),
            "geometry": spec.geometry.model_copy(update={"mounting": mounting}),
        }
    )


def joined(skins: list[Skin]) -> Skin:
    """Skins in lanes."""

    def lanes(*parts: Any) -> Any:
        return jnp.concatenate(parts, -1) if eqx.is_array(parts[0]) else parts[0]

    skin: Skin = jax.tree.map(lanes, *skins)
    return skin


def dents(specs: list[SkinSpec], forces: np.ndarray) -> np.ndarray:
    """Deepest dents of skins under forces at the crown [m]; NaN without a state."""
    force = jnp.asarray(forces)[None]
    none = jnp.zeros_like(force)
    if specs[0].geometry.dimension == 3:
        loads = Loads.patch(none, none, force, none + DISC)
    else:
        loads = Loads.line(none, force)
    found = forward(joined([skin_of(spec, contact=False) for spec in specs]), loads)
    gap = specs[0].geometry.mean_gap - np.asarray(found.min_gap)
    return np.where(np.asarray(found.solved), gap, np.nan)


def error_of(ignoring: np.ndarray, dent: float) -> float:
    """Relative error of the force that the ignoring file reads from a dent."""
    return float(np.interp(dent, ignoring, FORCES, right=np.nan)) / FORCE - 1


def table(plot: Path | None) -> None:
    """Print the errors of section and pad, and draw them."""
    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    axes = dict(zip(CASES, figure.subplots(2, 2).ravel(), strict=True))
    for file, label in (("suas.toml", "section"), ("suas-pad.toml", "pad")):
        spec = load_skin(SKINS / file)
        tried = [named(spec, **{path: v}) for path, case in CASES.items() for v in case[-1]]
        forces = np.append(FORCES, np.full(len(tried), FORCE))
        every = dents([named(spec)] * len(FORCES) + tried, forces)
        ignoring, rest = every[: len(FORCES)], iter(every[len(FORCES) :])
        for path, (name, unit, factor, offset, values) in CASES.items():
            shown = [factor * v + offset for v in values]
            found = [next(rest) for _ in values]
            errors = [100 * error_of(ignoring, u) for u in found]
            print(
                label,
                name,
                *(f"{x:+.4g} {unit}: {e:+.1f} %" for x, e in zip(shown, errors, strict=True)),
                flush=True,
            )
            axes[path].plot(shown, errors, "o-", label=label)
            axes[path].set_xlabel(f"{name} [{unit}]")
    for ax in axes.values():
        ax.axhline(0, color="grey", lw=0.5)
        ax.set_ylabel("error of 5 N [%]")
    axes["oil.fill"].legend()
    if plot is not None:
        figure.savefig(plot, dpi=110)


def study(frames: int, seed: int) -> None:
    """Print how often loads of drawn skins lie outside of what their estimates state."""
    rng = np.random.default_rng(seed)
    plain = load_skin(SKINS / "suas.toml")
    whole = named(plain)
    file = whole.model_copy(
        update={
            "oil": whole.oil.model_copy(update={"fill": None}),
            "environment": None,
            "geometry": plain.geometry,
        }
    )
    errors = input_errors(as_assembled(file))
    rest = np.asarray(
        skin_of(file).electrodes.read_even_film(jnp.array([plain.geometry.mean_gap]))
    )
    estimators = {
        label: LoadEstimator(spec, rest=rest[:, 0], rest_variance=NOISE**2 / 100)
        for label, spec in (("ignored", exact_file(file)), ("as nuisances", file))
    }
    left_out, distances = 0, {label: np.zeros(0) for label in estimators}
    for begin in range(0, frames, _TOGETHER):
        count = min(_TOGETHER, frames - begin)
        angle = np.deg2rad(rng.uniform(-60, 60, count))
        force = rng.uniform(2, 12, count)
        change = drawn_change(errors, angle, force, rng)
        known = ~np.isnan(change).any(1)
        left_out += int(count - known.sum())
        noise = NOISE * rng.standard_normal(change.shape)
        counts = (change + noise + rest[:, 0])[known]
        for label, estimator in estimators.items():
            told = estimator.estimate(counts)
            found = [
                outside(estimate.contacts[0], a, f)
                for estimate, a, f in zip(told, angle[known], force[known], strict=True)
                if estimate.status == "ok" and len(estimate.contacts) == 1
            ]
            distances[label] = np.append(distances[label], found)
    print(f"{frames} skins, {left_out} of which buckle at rest or find no equilibrium")
    for label, distance in distances.items():
        # Of regions that hold as many as they should, in those that are told.
        wider = [
            np.sqrt(np.quantile(distance, share) / stats.chi2.ppf(share, 2))
            for share in (0.68, 0.95, 0.99)
        ]
        wrong = int((distance > stats.chi2.ppf(0.999, 2)).sum())
        print(
            f"{label}: {wrong} wrong of {len(distance)} ok; regions that hold 68, 95, 99 % "
            f"would be {', '.join(f'{x:.2f}' for x in wider)} times as wide",
            flush=True,
        )


def drawn_change(
    errors: InputErrors, angle: np.ndarray, force: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Changes of readings under loads, of skins drawn from errors of their file [frame, taxel].

    NaN where a skin buckles at rest, or has no equilibrium.
    """
    draws = rng.standard_normal((len(angle), len(errors))) @ errors.directions
    at = np.array([value_of(errors.spec, path) for path in errors.paths])
    skin = joined(
        [
            skin_of(errors.spec, dict(zip(errors.paths, row, strict=True)), contact=False)
            for row in at + draws
        ]
    )
    none = np.zeros((1, len(angle)))
    idle, pushed = (forward(skin, Loads.line(angle[None], x)) for x in (none, force[None]))
    loads = Loads.line(angle[None], none + 1.0)
    share = np.asarray(COMPILED.run(buckling_share, skin, loads, idle.state))
    known = np.asarray(idle.solved & pushed.solved) & (share < 1)
    return np.where(known, np.asarray(pushed.so - idle.so), np.nan).T


@eqx.filter_jit
def buckling_share(skin: Skin, loads: Loads, rest: State) -> Lanes:
    """Of what buckles skins, by their stress at rest."""
    return stress_effect(skin.problem(loads), rest).share


def outside(load: Contact, angle: float, force: float) -> float:
    """Squared distance of a true load from an estimate, in its deviations."""
    off = np.array([load.angle - angle, load.force - force])
    return float(off @ np.linalg.solve(np.asarray(load.covariance)[:2, :2], off))


def exact_file(spec: SkinSpec) -> SkinSpec:
    """The file of a person who is sure that none of it is there."""
    return spec.model_copy(
        update={
            "oil": spec.oil.model_copy(update={"fill": UncertainQuantity(1.0, 0.0)}),
            "geometry": spec.geometry.model_copy(
                update={"mounting": UncertainQuantity(0.0, 0.0)}
            ),
            "environment": EnvironmentSpec(
                temperature=UncertainQuantity(20 + ZERO_CELSIUS, 0.0)
            ),
        }
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("table", "study"))
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    configure()
    if options.what == "table":
        table(options.plot)
    else:
        study(options.frames, options.seed)
