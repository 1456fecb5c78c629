"""Counts per newton of every taxel, wherever 8 N press."""

import numpy as np
from matplotlib.figure import Figure

from suas_jax import Loads, configure, load_jacobian, load_skin, skin_of

configure()
skin = skin_of(load_skin("configs/skins/suas.toml"))
angles = np.linspace(-65.0, 65.0, 66)
_, slopes = load_jacobian(skin, Loads.line(np.radians(angles), np.full_like(angles, 8.0)))
by_force = np.asarray(slopes)[1, 0]  # [taxel, place]
most = np.abs(by_force).max()

figure = Figure(figsize=(6, 3.5), layout="constrained")
axes = figure.subplots()
numbers = np.arange(1, len(by_force) + 1)
drawn = axes.pcolormesh(angles, numbers, by_force, cmap="RdBu_r", vmin=-most, vmax=most)
axes.set(xlabel="angle of the load [deg]", ylabel="taxel")
figure.colorbar(drawn, label="counts per newton")
