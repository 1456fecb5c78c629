"""A cylinder pressed into a section: where the skin touches it, and how wide."""

from suas_jax import configure, load_scene, plot_solution, solve

configure()
solution = solve(load_scene("configs/scenes/body.toml"))
body = solution.report["loads"][0]
print(f"{body['force_N']:.2f} N over {2e3 * body['contact_half_width_m']:.1f} mm")
figure = plot_solution(solution)
