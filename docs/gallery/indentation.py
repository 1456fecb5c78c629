"""An indentation curve: force and width of contact over the travel of a cylinder."""

from matplotlib.figure import Figure

from suas_jax import configure, load_scene, sweep

configure()
scene = load_scene("configs/scenes/body.toml")
travels = [0.4 * k for k in range(11)]  # [mm]
curve = sweep(scene, depths=[1e-3 * travel for travel in travels])
loads = [point["loads"][0] for point in curve.points]

figure = Figure(figsize=(8, 3.5), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(travels, [load["force_N"] for load in loads], ".-")
left.set(xlabel="travel beyond first touch [mm]", ylabel="force [N]")
right.plot(travels, [2e3 * load["contact_half_width_m"] for load in loads], ".-")
right.set(xlabel="travel beyond first touch [mm]", ylabel="width of contact [mm]")
