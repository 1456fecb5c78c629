"""Natural modes of the paper's skin, with its oil and the water outside."""

from suas_jax import configure, load_scene, modes, plot_modes

configure()
found = modes(load_scene("configs/scenes/film.toml"), count=4)
print(f"quasi-static to 1 % below {found.bandwidth:.3g} Hz")
figure = plot_modes(found)
