"""The wall's share: what the wall carries once the membrane touches it."""

from matplotlib.figure import Figure

from suas_jax import configure, load_scene, sweep

configure()
forces = [5.0 * k for k in range(13)]
curve = sweep(load_scene("configs/scenes/case_b.toml"), forces=forces)
wall = [point["wall"]["force_N"] if point["wall"] else 0.0 for point in curve.points]
oil = [1e-3 * point["oil_pressure_Pa"] for point in curve.points]

figure = Figure(figsize=(8, 3.5), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(forces, wall, ".-")
left.set(xlabel="force [N]", ylabel="force on the wall [N]")
right.plot(forces, oil, ".-")
right.set(xlabel="force [N]", ylabel="oil pressure [kPa]")
