"""Counts while 12 N slide over a section: every load in a lane of one batch."""

import numpy as np
from matplotlib.figure import Figure

from suas_jax import Loads, configure, forward, load_skin, skin_of

configure()
skin = skin_of(load_skin("configs/skins/suas.toml"))
angles = np.linspace(-65.0, 65.0, 66)
forces = np.full_like(angles, 12.0)
output = forward(skin, Loads.line(np.radians(angles), forces))
rest = forward(skin, Loads.line([0.0], [0.0]))

figure = Figure(figsize=(6, 3.5), layout="constrained")
axes = figure.subplots()
axes.plot(angles, (output.so - rest.so).T, label=[f"taxel {k + 1}" for k in range(8)])
axes.set(xlabel="angle of the load [deg]", ylabel="counts beyond rest")
axes.legend(ncols=2, fontsize="small")
