"""Rubber that creeps: 20 N held for a minute and released."""

import numpy as np

from suas_jax import configure, history_of, history_sweep, load_scene, plot_sweep

configure()
scene = load_scene("configs/scenes/hold.toml")
since = np.geomspace(0.1, 60.0, 12)
times = np.concatenate([[0.0, 0.05], since, 60.0 + since])
press = history_of(times, force_N=np.where((times > 0) & (times <= 60.0), 20.0, 0.0))
curve = history_sweep(scene, press)
last = curve.points[-1]
print(f"{1e3 * last['max_displacement_m']:.3f} mm are left {last['t_s'] - 60:.0f} s after")
figure = plot_sweep(curve)
