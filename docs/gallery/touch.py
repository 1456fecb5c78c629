"""From counts to loads: twenty noisy frames of one press, and the interval that is stated."""

import numpy as np
from matplotlib.figure import Figure

from fitting import LoadEstimator
from suas_jax import Loads, configure, forward, load_skin, skin_of

configure()
spec = load_skin("configs/skins/suas.toml")
counts = forward(skin_of(spec), Loads.line([0.2], [8.0])).so.T
noise = np.random.default_rng(0).normal(0.0, spec.electrodes.noise, (20, counts.shape[1]))
found = [frame.contacts[0] for frame in LoadEstimator(spec).estimate(counts + noise)]

figure = Figure(figsize=(6, 3.5), layout="constrained")
axes = figure.subplots()
axes.plot([np.degrees(c.angle) for c in found], [c.force for c in found], "o")
axes.plot(np.degrees(0.2), 8.0, "+", markersize=14, label="true load")
axes.set(xlabel="angle [deg]", ylabel="force [N]")
axes.legend()
