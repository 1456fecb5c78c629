"""`suas examples`: the skins, scenes, materials and test data that ship with the program."""

from pathlib import Path
from typing import Annotated

import typer

from fitting.cli.contract import Overwrite, bad_input
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_outputs, write_bytes


def register(app: typer.Typer) -> None:
    """Add this module's command to the program."""
    app.command("examples")(examples)


def examples(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Where to put them; made if it is missing.")
    ] = Path("configs"),
    overwrite: Overwrite = False,
) -> None:
    """Copy the example skins, scenes, materials and test data into a folder.

    Exit status: 0 copied, 2 bad input.
    """
    with bad_input():
        from suas_jax.config.presets import shipped_folder

        source = shipped_folder()
        files = sorted(path for path in source.rglob("*") if path.suffix in {".toml", ".csv"})
        copies = {folder / path.relative_to(source): path for path in files}
        for copy in copies:
            copy.parent.mkdir(parents=True, exist_ok=True)
        check_outputs(copies, overwrite=overwrite)
        for copy, path in copies.items():
            write_bytes(copy, path.read_bytes())
    say(f"{folder}: {len(copies)} files", err=True)
    say(f"try: suas solve {folder / 'scenes' / 'case_b.toml'}", err=True)
