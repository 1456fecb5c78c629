"""What one percent of every dimension changes: exact derivatives of the smallest gap."""

from matplotlib.figure import Figure

from suas_jax import configure, continuous_inputs, gradient, load_scene, solve

configure()
scene = load_scene("configs/scenes/press.toml")
slopes = gradient(solve(scene), "min_gap_m")
values = continuous_inputs(scene)
effects = {name: 1e4 * slopes[name] * values[name] for name in slopes}  # [um per percent]
largest = sorted(effects, key=lambda name: abs(effects[name]))[-8:]

figure = Figure(figsize=(6, 3.5), layout="constrained")
axes = figure.subplots()
axes.barh(largest, [effects[name] for name in largest])
axes.set(xlabel="change of the smallest gap for 1 % more [um]")
