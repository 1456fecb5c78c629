"""Counts of 320 taxels under two fingers, beyond those at rest."""

from suas_jax import configure, load_scene, plot_pad, solve, with_inputs

configure()
pressed = load_scene("configs/scenes/pad_fingers.toml")
released = with_inputs(pressed, {"load.0.force": 0.0, "load.1.force": 0.0})
counts, rest = (
    [taxel["so"] for taxel in solve(scene).report["taxels"]] for scene in (pressed, released)
)
change = [after - before for after, before in zip(counts, rest, strict=True)]
figure = plot_pad(pressed, change, label="counts beyond rest")
