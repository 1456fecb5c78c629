"""Contacts on pads that nobody has tuned anything for.

    python -m benchmarks.random_pads [--pads N] [--seed S]

Pads of random dimensions and laws with 50 to 150 taxels, single contacts of 3 to 70 % of the
force of first contact at the crown and pairs of 15 to 40 % each, 18 mm apart or more, solved on
36 x 30 elements. 2 counts of noise and rounding; the skin's tolerances are those that are taken
where a file states none. A new table is made for every pad: one to two minutes each.
"""

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.pad_estimation import measured, readings_off_the_wall
from fitting.inverse_load.estimator import LoadEstimate, LoadEstimator
from suas_jax import configure
from suas_jax.config import SkinSpec, load_skin
from suas_jax.config.sections.circle import CircleSpec
from suas_jax.scene.skin import skin_of

FINE = (36, 30)
SINGLES, PAIRS, APART = 40, 20, 18e-3
SKIN = """
[geometry]
inner_radius = "{radius} mm"
thickness = "{thickness} mm"
half_angle = "{half_angle} deg"
width = "{width} mm"
oil_gap = "{gap} mm"
ends = "clamped"
[material]
{law}
[oil]
model = "incompressible"
relative_permittivity = 2.2
[electrodes]
lsb = "0.305 fF"
noise = 2.0
taxels = [{taxels}]
"""
LAWS = (
    'law = "mooney-rivlin"\nC1 = "0.4 MPa"\nC2 = "0.1 MPa"',
    'law = "neo-hookean"\nmu = "1.2 MPa"',
    'law = "ogden"\nconvention = "mu/alpha"\nmu = ["0.6 MPa", "0.02 MPa"]\nalpha = [1.6, 4.0]',
)


def random_skin(random: np.random.Generator, law: str, folder: Path) -> SkinSpec:
    radius, half_angle = random.uniform(35, 80), random.uniform(55, 90)
    width = radius * random.uniform(1, 2.5)
    along = np.linspace(-0.75, 0.75, random.integers(8, 15)) * half_angle
    axially = np.linspace(-0.36, 0.36, random.integers(6, 11)) * width
    taxels = ",".join(
        f'\n  {{ angle = "{a:.3f} deg", axial = "{z:.3f} mm", diameter = "4 mm" }}'
        for a in along
        for z in axially
    )
    numbers = {"thickness": random.uniform(1, 3), "gap": random.uniform(3, 7)}
    numbers |= {"radius": radius, "half_angle": half_angle, "width": width}
    path = folder / "skin.toml"
    text = {name: f"{value:.3f}" for name, value in numbers.items()}
    path.write_text(SKIN.format(law=law, taxels=taxels, **text))
    return load_skin(path)


def random_contacts(
    random: np.random.Generator, spec: SkinSpec, force: float
) -> list[np.ndarray]:
    """Angle, axial position and force [frame] [contact, 3]."""
    g = spec.geometry
    assert isinstance(g, CircleSpec)
    most = np.array([0.6 * g.half_angle, 0.3 * g.width])
    frames = [
        np.array([[*random.uniform(-most, most), np.exp(random.uniform(*np.log([0.03, 0.7])))]])
        for _ in range(SINGLES)
    ]
    while len(frames) < SINGLES + PAIRS:
        places = random.uniform(-most, most, (2, 2))
        apart = np.diff(places, axis=0)[0] * [g.inner_radius, 1.0]
        if np.hypot(*apart) > APART:
            frames.append(np.append(places, random.uniform(0.15, 0.4, (2, 1)), 1))
    return [frame * [1, 1, force] for frame in frames]


def errors(estimate: LoadEstimate, truth: np.ndarray, radius: float) -> np.ndarray | None:
    """Errors in standard deviations [contact, 3], each contact's nearest; None if too few."""
    found = []
    for angle, axial, force in truth:
        away = [
            np.hypot(radius * (c.angle - angle), c.axial - axial) for c in estimate.contacts
        ]
        nearest = estimate.contacts[int(np.argmin(away))]
        if nearest.covariance is None:
            return None
        wrong = [nearest.angle - angle, nearest.axial - axial, nearest.force - force]
        found.append(wrong / np.sqrt(np.diag(nearest.covariance)))
    return np.array(found)


def study(spec: SkinSpec, random: np.random.Generator) -> None:
    estimator, g = LoadEstimator(spec), spec.geometry
    assert isinstance(g, CircleSpec)
    touch = float(estimator.table.first_contact_at(np.zeros(1), np.zeros(1))[0])
    contacts = random_contacts(random, spec, touch)
    skin = skin_of(spec, elements=FINE, contact=False)
    solved = []
    for frame in contacts:
        # One program for all: a second contact without a force changes nothing.
        pair = frame if len(frame) > 1 else np.concatenate([frame, frame * [1, 1, 0]])
        read = readings_off_the_wall(skin, pair)
        if read is not None:
            solved.append((frame, read[0]))
    found = estimator.estimate(measured(np.array([so for _, so in solved]), 1))
    statuses, other, pulls = Counter(e.status for e in found), Counter(), []
    for (truth, _), estimate in zip(solved, found, strict=True):
        if len(estimate.contacts) != len(truth):
            other[len(truth), len(estimate.contacts), estimate.status] += 1
        elif estimate.status == "ok":
            own = errors(estimate, truth, g.inner_radius)
            pulls += [] if own is None else list(own)
    size = f"radius {1e3 * g.inner_radius:.0f} mm, {1e3 * g.mean_thickness:.1f} mm thick"
    print(f"{size}, first contact at {touch:.2f} N: {len(found)} frames, {dict(statuses)}")
    print(f"  another number of contacts (true, found, status): {dict(other)}")
    rms, largest = np.sqrt(np.square(pulls).mean(0)), np.abs(pulls).max(0)
    print("  rms of error over stated (angle, axial, force):", rms.round(2), end=", ")
    print("largest:", largest.round(1))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--pads", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    configure()
    random = np.random.default_rng(options.seed)
    for k in range(options.pads):
        with tempfile.TemporaryDirectory() as folder:
            study(random_skin(random, LAWS[k % len(LAWS)], Path(folder)), random)


if __name__ == "__main__":
    main()
