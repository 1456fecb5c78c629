"""What rubber, oil and gap make of a section in time: creep, lowest mode, bandwidth.

A dent's growth under a held force is the rubber's, frequency and damping are the film's. Each
rubber is pressed at the crown by a force in proportion to its modulus; the lowest
mode is that at rest, in water::

    python benchmarks/creep_and_modes.py

Rubbers by their moduli; their relaxation is an assumption of the usual size: of EPDM 10 % in a
second, 6 % in half a minute and 5 % in a quarter of an hour, of silicone half of that.
"""

from pathlib import Path

import numpy as np

from suas_jax import configure
from suas_jax.config import SceneSpec, load_scene
from suas_jax.config.inelastic import RelaxationSpec
from suas_jax.config.laws.neo_hookean import NeoHookeanSpec
from suas_jax.config.schema_load import LineLoadSpec
from suas_jax.dynamics.course import History
from suas_jax.dynamics.history import history_sweep
from suas_jax.dynamics.modes import modes

SCENE = Path(__file__).parent.parent / "configs/scenes/film.toml"
TAU = (1.0, 30.0, 900.0)
RUBBERS = {
    "EPDM of the paper, 32.6 MPa": (32.6e6, (0.10, 0.06, 0.05)),
    "EPDM, 7 MPa (90 Shore A)": (7e6, (0.10, 0.06, 0.05)),
    "EPDM, 1.2 MPa (60 Shore A)": (1.2e6, (0.10, 0.06, 0.05)),
    "silicone, 0.4 MPa": (0.4e6, (0.05, 0.03, 0.025)),
}
VISCOSITIES = (10e-6, 50e-6, 1000e-6)
GAPS = (3e-3, 5e-3)
AREA = 1.5e-7  # force over modulus that dents the paper's section by about a millimetre [m^2]


def scene_of(
    modulus: float, shares: tuple[float, ...], viscosity: float, gap: float
) -> SceneSpec:
    """The paper's section with another rubber, oil and gap."""
    scene = load_scene(SCENE)
    relaxation = RelaxationSpec(g=shares, tau=TAU)
    law = NeoHookeanSpec(mu=modulus, density=1150.0, relaxation=relaxation)
    oil = scene.oil.model_copy(update={"viscosity": viscosity * 960.0})
    geometry = scene.geometry.model_copy(update={"oil_gap": gap})
    return scene.model_copy(update={"material": law, "oil": oil, "geometry": geometry})


def creep(scene: SceneSpec, force: float) -> tuple[float, float, float]:
    """Dent at once [m], and its growth after a minute and an hour, relative."""
    times = np.array([0.0, 0.0, 60.0, 3600.0])
    load = LineLoadSpec(angle=0.0, force=force)
    # The film's own time is the modes'; here the oil moves at once.
    still = {"density": None, "viscosity": None}
    oil = scene.oil.model_copy(update=still)
    law = scene.material.model_copy(update={"density": None})
    pressed = scene.model_copy(update={"loads": (load,), "oil": oil, "material": law})
    history = History(times, {"force_N": np.array([0.0, force, force, force])})
    rows = history_sweep(pressed, history).points
    dents = [row["loads"][0]["inner_displacement_m"] for row in rows]
    return dents[1], dents[2] / dents[1] - 1, dents[3] / dents[1] - 1


def main() -> None:
    """Print the table."""
    for name, (modulus, shares) in RUBBERS.items():
        force = AREA * modulus
        dent, minute, hour = creep(scene_of(modulus, shares, 50e-6, 5e-3), force)
        print(
            f"{name}: {force:.3g} N dents {1e3 * dent:.3g} mm at once, "
            f"+{100 * minute:.1f} % in 1 min, +{100 * hour:.1f} % in 1 h",
            flush=True,
        )
        for gap in GAPS:
            for viscosity in VISCOSITIES:
                found = modes(scene_of(modulus, shares, viscosity, gap), 1)
                mode = found.modes[0]
                print(
                    f"  gap {1e3 * gap:.3g} mm, {1e6 * viscosity:.4g} cSt: "
                    f"{mode['undamped_Hz']:.3g} Hz, damping {mode['damping_ratio']:.3g}, "
                    f"bandwidth {found.bandwidth:.3g} Hz",
                    flush=True,
                )


if __name__ == "__main__":
    configure()
    main()
