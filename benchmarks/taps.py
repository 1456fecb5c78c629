"""Taps and quick presses on a skin whose film moves: what frames tell, and impulses.

Readings are those of the moving skin (`suas sweep --history`): half sines of 5 N, and a press
that comes in 20 ms and stays, at 0 and 30 degrees. 40 taxels, 100 frames a second, 2 counts of
noise, rounded; tolerances are those of a file that states none, though its numbers are the
true ones here::

    python -m benchmarks.taps
"""

import tempfile
from pathlib import Path

import numpy as np

from fitting.inverse_load.estimate.estimate import LoadEstimate, Tap
from fitting.inverse_load.estimator import LoadEstimator
from suas_jax import configure
from suas_jax.config import load_scene, load_skin
from suas_jax.dynamics.course import history_of
from suas_jax.dynamics.history import history_sweep

_PEAK = 5.0  # [N]
_TAPS = (0.01, 0.03, 0.1, 0.3)  # lengths [s]
_ANGLES = (0, 30)  # [deg]
_REST, _END, _FRAME = 0.3, 1.5, 0.01  # [s]
_RISE = 0.02  # of the press that stays [s]
_DRAWS = 5  # of noise


def skin_file(folder: Path) -> Path:
    """The paper's skin with 40 taxels and densities."""
    text = Path("configs/skins/suas.toml").read_text(encoding="utf-8")
    rows = ",\n".join(f'{{ angle = "{a:.6g} deg" }}' for a in np.linspace(-80, 80, 40))
    text = f"{text[: text.index('taxels = [')]}taxels = [\n{rows}\n]\n"
    text = text.replace("[material]", '[material]\ndensity = "1150 kg/m^3"')
    text = text.replace("[oil]", '[oil]\ndensity = "960 kg/m^3"\nviscosity = "50 cSt"')
    path = folder / "skin.toml"
    path.write_text(text, encoding="utf-8")
    return path


def moved(skin: Path, angle: int, length: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and exact readings under a half sine of a length [s]; of None, a press."""
    scene = skin.with_name("scene.toml")
    load = f'[[load]]\nkind = "line"\nangle = "{angle} deg"\nforce = "{_PEAK} N"\n'
    scene.write_text(f'skin = "{skin.name}"\n{load}', encoding="utf-8")
    rise = length or _RISE
    times = np.unique(
        np.concatenate([np.linspace(0, rise, 11), np.arange(0, _END, _FRAME / 2)])
    )
    push = np.sin(np.pi * times / rise) if length else times / rise
    force = _PEAK * np.where(times < rise, push, 0.0 if length else 1.0)
    history = history_of(times.tolist(), force_N=force.tolist())
    points = history_sweep(load_scene(scene), history).points
    so = np.array([[taxel["so"] for taxel in point["taxels"]] for point in points])
    frames = np.arange(-_REST, times[-1], _FRAME)
    return frames, np.stack([np.interp(frames, times, column) for column in so.T], 1)


def wrong(estimate: LoadEstimate, force: float) -> bool:
    """Whether the sum of forces lies outside of three deviations of what a frame tells."""
    if estimate.contact is None and not estimate.contacts:
        return False  # it tells nothing
    told = sum(c.force for c in estimate.contacts)
    # What may be motion moves all contacts at once.
    error = sum(c.deviation("force") for c in estimate.contacts)
    return not abs(told - force) <= 3 * error


def main() -> None:
    """Print a line a case."""
    configure()
    rng = np.random.default_rng(0)
    print("| press | at | impulse: error, deviation | `ok`, wrong of these | `moving`, wrong |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        skin = skin_file(Path(folder))
        estimator = LoadEstimator(load_skin(skin))
        for length in (*_TAPS, None):
            for angle in _ANGLES:
                times, so = moved(skin, angle, length)
                impulses, counts = [], np.zeros((2, 2), int)
                for _ in range(_DRAWS):
                    read = np.rint(so + rng.normal(0.0, 2.0, so.shape))
                    found = estimator.estimate(read, time=times)
                    impulses += [e.tap for e in found if e.tap is not None]
                    for t, e in zip(times, found, strict=True):
                        force = _force(t, length)
                        for k, status in enumerate(("ok", "moving")):
                            if e.status == status:
                                counts[k] += 1, wrong(e, force)
                print(_line(length, angle, impulses, counts), flush=True)


def _force(t: float, length: float | None) -> float:
    if length is None:
        return float(_PEAK * np.clip(t / _RISE, 0, 1))
    return float(_PEAK * np.sin(np.pi * t / length)) if 0 < t < length else 0.0


def _line(length: float | None, angle: int, taps: list[Tap], counts: np.ndarray) -> str:
    told = "none"
    if taps and length is not None:
        true = 2 / np.pi * _PEAK * length
        error = np.median([tap.impulse / true - 1 for tap in taps])
        own = np.median([tap.deviation / true for tap in taps])
        told = f"{len(taps)} of {_DRAWS}: {100 * error:+.0f} %, {100 * own:.0f} %"
    name = f"{1e3 * length:.0f} ms" if length else "stays"
    (ok, bad), (moving, off) = counts
    return f"| {name} | {angle} deg | {told} | {ok}, {bad} | {moving}, {off} |"


if __name__ == "__main__":
    main()
