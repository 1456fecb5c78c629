"""A flat-topped skin: a section of lines and arcs, pressed beside its middle."""

from suas_jax import configure, plot_solution, scene_from_dict, solve

configure()
load = {"kind": "line", "arc": "15 mm", "force": "4 N"}
scene = scene_from_dict({"skin": "configs/skins/suas-flat-topped.toml", "load": [load]})
solution = solve(scene)
print(f"{1e3 * solution.report['min_gap_m']:.2f} mm are left of the gap of 5 mm")
figure = plot_solution(solution)
