"""A skin that sinks: what the water's pressure does while 20 N press."""

import numpy as np
from matplotlib.figure import Figure

from suas_jax import configure, load_scene, solve, with_inputs

configure()
scene = load_scene("configs/scenes/deep_sea.toml")
depths = np.linspace(0.0, 300.0, 7)
reports = [solve(with_inputs(scene, {"environment.depth": depth})).report for depth in depths]
figure = Figure(figsize=(6, 3.5), layout="constrained")
axes = figure.subplots()
axes.plot(depths, [1e3 * report["loads"][0]["displacement_m"] for report in reports], "o-")
axes.set(xlabel="depth [m]", ylabel="displacement under the load [mm]")
