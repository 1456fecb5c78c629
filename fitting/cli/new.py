"""`suas new`, commented files to start from, and `suas examples`, the files that ship."""

import math
import os
import re
from pathlib import Path
from typing import Annotated

from fitting.cli.contract import Overwrite, bad_input
from fitting.cli.options import argument, option
from suas_jax.acquisition.terminal import say
from suas_jax.files.writing import check_output, check_outputs, write_bytes, write_text

# The paper's skin [m, rad].
_INNER_RADIUS, _OIL_GAP, _WIDTH, _HALF_ANGLE = 57.5e-3, 5e-3, 123e-3, math.pi / 2
_DIAMETER = 4e-3  # of an electrode [m]
_MOST_MODULES = 200

_FILE = argument("File to write.", metavar="FILE")

_SKIN = """\
# {title}
# Every quantity has its unit; what is not stated has a default (docs/skins.md).

[geometry]
{dimensions}thickness    = "1.5 mm"       # of the membrane
width        = "123 mm"       # {width}
oil_gap      = "5 mm"         # between membrane and rigid wall, at rest
# mounting   = "0 % +- 0.05 %" # length of the membrane over its seat's, less one; taken if
#                              # not stated, `suas fit sensor --fit fill,mounting` finds it
ends         = "{ends}"{ends_note}

[material]
preset = "epdm-paper"         # 32.6 MPa by a fast test, where EPDM of 60 Shore A has 1.2 MPa;
# shore = "60 A"              # instead, where the hardness is all that is known
# or a law with its constants, as `suas fit material` writes it:
# law = "neo-hookean"
# mu = "32.6 MPa"

[oil]
model = "incompressible"      # or compressible, aerated, vented
relative_permittivity = 2.2   # a mineral or silicone oil; `suas fit sensor` finds it
# fill = "1.000 +- 0.003"     # its volume over the film's when closed; taken if not stated

[electrodes]
capacitance = "parallel-plate"
stray = "0 fF"                # in parallel with every taxel
lsb   = "0.305 fF"            # capacitance of one count
noise = 2.0                   # standard deviation of a reading, counts: `suas health`
{layout}"""

_SECTIONS = {
    "circle": """\
inner_radius = "57.5 mm"      # of the membrane's inner face, undeformed
half_angle   = "90 deg"       # from the symmetry axis to a clamped edge
""",
    "ellipse": """\
section = "ellipse"           # the membrane's inner face, undeformed: x = a sin t, y = b cos t
inner_semi_axes = ["57.5 mm", "45 mm"] # a, half the width at the base, and b, the height
half_angle   = "90 deg"       # t at a clamped edge
""",
    "flat-topped": """\
section = "path"              # the membrane's inner face, undeformed, from the left clamp on
path = [                      # pieces with common tangents; arcs turn clockwise
  { line = "20 mm" },
  { radius = "30 mm", angle = "90 deg" },
  { line = "27.5 mm" },
]
mirror = true                 # the path ends at the crown, its mirror image follows
start = "90 deg"              # direction of the first piece, from +x
""",
}

_ELECTRODES = """\
layout = "list"               # electrodes one by one, by angle or arc from the middle
taxels = [
{rows}]
"""

_TRIANGLES = """\
layout = "roboskin"           # {rows} rows of {columns} triangles with edges of {edge:.4g} mm
modules = [                   # in the order of their numbers, from 0
{modules}]
"""

_SCENE = """\
# Loads on a skin: `suas solve {name}` finds oil pressure, gaps and counts.

skin = "{skin}"

[[load]]
kind = "{kind}
{along}
{place}force = "5 N"                 # in all; negative pulls outwards
direction = "radial"          # or "vertical", or an angle such as "10 deg"

# A further load:
# [[load]]
# kind = "pressure"
# pressure = "1 kPa"

[solve]
rtol = {rtol}                   # wanted relative error of displacement and pressure
"""


def skin(
    file: Annotated[Path, _FILE] = Path("skin.toml"),
    pad: Annotated[
        str | None,
        option(
            "A pad in three dimensions, covered with so many ROBOSKIN triangles along "
            "axis and arc, such as 4x8; without it a section with eight taxels.",
            metavar="ROWSxCOLUMNS",
        ),
    ] = None,
    section: Annotated[
        str, option(f"Shape of the section: {', '.join(_SECTIONS)}.")
    ] = "circle",
    overwrite: Overwrite = False,
) -> None:
    """Write a skin file: the paper's dimensions, every key explained.

    Exit status: 0 written, 2 bad input.
    """
    with bad_input():
        check_output(file, overwrite=overwrite)
        if section not in _SECTIONS:
            raise ValueError(f'--section "{section}": allowed: {", ".join(_SECTIONS)}')
        if pad is not None and section != "circle":
            raise ValueError("--pad covers a circle; leave --section out")
        text = _section_text(section) if pad is None else _pad_text(*_counts(pad))
        write_text(file, text)
    say(f"{file}: change what differs in your skin, then suas new scene --skin {file}")


def scene(
    file: Annotated[Path, argument("File to write.", metavar="FILE")] = Path("scene.toml"),
    skin: Annotated[Path, option("Skin file that the loads act on.")] = Path("skin.toml"),
    overwrite: Overwrite = False,
) -> None:
    """Write a scene file: a load on a skin, every key explained.

    Exit status: 0 written, 2 bad input.
    """
    with bad_input():
        check_output(file, overwrite=overwrite)
        from suas_jax.config import load_skin

        geometry = load_skin(skin).geometry
        dimension = geometry.dimension
        text = _SCENE.format(
            name=file,
            skin=Path(os.path.relpath(skin.resolve(), file.parent.resolve())).as_posix(),
            kind=_KINDS[dimension],
            along=_ALONG[geometry.has_angle],
            place=_PLACE if dimension == 3 else "",
            rtol="1e-2" if dimension == 3 else "1e-3",
        )
        write_text(file, text)
    say(f"{file}: suas solve {file}")


_KINDS = {
    2: 'line"                 # a dead force, even over the width',
    3: 'patch"                # a dead force, even over a patch',
}
_ALONG = {
    True: 'angle = "20 deg"              # from the symmetry axis, positive towards +x',
    False: 'arc = "20 mm"                 # of the inner face from its middle, towards +x',
}
_PLACE = """\
axial = "10 mm"               # from the middle of the pad
diameter = "6 mm"             # or size = ["6 mm", "6 mm"], along arc and axis
"""


def _counts(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"\s*(\d{1,3})\s*[x×]\s*(\d{1,3})\s*", text)
    if found is None or not 0 < int(found[1]) * int(found[2]) <= _MOST_MODULES:
        raise ValueError(
            f'--pad "{text}": expected rows along the axis x triangles along the arc, such as '
            f"4x8, at most {_MOST_MODULES} in all"
        )
    return int(found[1]), int(found[2])


def _section_text(section: str) -> str:
    places = [f'angle = "{angle} deg"' for angle in range(-70, 71, 20)]
    if section == "flat-topped":  # which knows no angles
        places = [f'arc = "{arc} mm"' for arc in range(-77, 78, 22)]
    rows = [f'  {{ {at}, axial = "0 mm", diameter = "4 mm" }},\n' for at in places]
    shape = {"circle": "a half-cylinder", "ellipse": "half an ellipse"}.get(
        section, "a flat top"
    )
    return _SKIN.format(
        title=f"A skin in plane strain: {shape} over oil, its straight edges clamped.",
        dimensions=_SECTIONS[section],
        width="over which loads are even",
        ends="sliding",
        ends_note='      # plane strain; "clamped": a pad in three dimensions',
        layout=_ELECTRODES.format(rows="".join(rows)),
    )


def _pad_text(rows: int, columns: int) -> str:
    from suas_jax.sensing.tiling import pad_layout

    layout = pad_layout(
        rows,
        columns,
        wall_radius=_INNER_RADIUS - _OIL_GAP,
        half_angle=_HALF_ANGLE,
        width=_WIDTH,
    )
    if layout.pitch <= _DIAMETER:
        raise ValueError(
            f"--pad {rows}x{columns}: the taxels of triangles of {1e3 * layout.edge:.1f} mm "
            f"are {1e3 * layout.pitch:.2f} mm apart, less than their diameter of "
            f"{1e3 * _DIAMETER:g} mm; fewer rows or columns are needed"
        )
    modules = [
        f'  {{ angle = "{math.degrees(t.angle):.6g} deg", axial = "{1e3 * t.axial:.6g} mm", '
        f'rotation = "{math.degrees(t.rotation):g} deg", '
        f'pitch = "{1e3 * layout.pitch:.5g} mm", '
        f'diameter = "{1e3 * _DIAMETER:g} mm" }},\n'
        for t in layout.triangles
    ]
    return _SKIN.format(
        title="A pad in three dimensions: a half-cylinder over oil, clamped on all four sides.",
        dimensions=_SECTIONS["circle"],
        width="between the clamped ends",
        ends="clamped",
        ends_note='      # all four sides; "sliding": plane strain',
        layout=_TRIANGLES.format(
            rows=rows, columns=columns, edge=1e3 * layout.edge, modules="".join(modules)
        ),
    )


def examples(
    folder: Annotated[
        Path,
        argument("Where to copy them; the folder is made if it is missing.", metavar="FOLDER"),
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
