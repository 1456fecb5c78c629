"""What commands that solve a scene have in common: its file, and what overrides it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from suas_jax.config import SceneSpec

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, SI units in the keys.")]
Model = Annotated[
    str | None, typer.Option(help='"auto", "shell" or "solid"; overrides the scene.')
]
Rtol = Annotated[float | None, typer.Option(help="Wanted relative error; overrides the scene.")]


def scene_of(path: Path, model: str | None, rtol: float | None) -> "SceneSpec":
    """The scene of a file, with what the options override.

    Args:
        path: the file.
        model: of the membrane; None leaves the file's.
        rtol: wanted relative error; None leaves the file's.

    Raises:
        ConfigError: the file or an option can't be understood.
    """
    from suas_jax.config import load_scene, with_solve

    scene = load_scene(path)
    if model is not None:
        scene = with_solve(scene, source="--model", model=model)
    if rtol is not None:
        scene = with_solve(scene, source="--rtol", rtol=rtol)
    return scene
