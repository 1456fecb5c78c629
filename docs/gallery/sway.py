"""A tall ellipse sways to one side: the stable branch beyond 2.65 N."""

from suas_jax import configure, plot_solution, scene_from_dict, solve

configure()
scene = scene_from_dict(
    {
        "skin": "configs/skins/suas.toml",
        "geometry": {
            "section": "ellipse",
            "half_angle": "90 deg",
            "inner_semi_axes": ["57.5 mm", "70 mm"],
        },
        "load": [{"kind": "line", "angle": "0 deg", "force": "3.2 N"}],
    }
)
solution = solve(scene)
print(f"symmetric up to {3.2 * solution.report['stable_factor']:.2f} N")
figure = plot_solution(solution)
