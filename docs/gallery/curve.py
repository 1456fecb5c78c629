"""The load-displacement curve of a section, up to 30 N."""

from suas_jax import configure, load_scene, plot_sweep, sweep

configure()
scene = load_scene("configs/scenes/press.toml")
curve = sweep(scene, forces=[5.0 * k for k in range(7)])
pressures = [point["oil_pressure_Pa"] for point in curve.points]
print(f"{1e-3 * pressures[-1]:.2f} kPa at 30 N")
figure = plot_sweep(curve)
