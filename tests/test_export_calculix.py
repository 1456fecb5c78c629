"""Cards for CalculiX, computed by CalculiX itself where it is installed."""

import pathlib
import re
import shutil
import subprocess

import jax.numpy as jnp
import numpy as np
import pytest

from fitting.material.cards.card import card
from fitting.material.cards.settings import CardSettings
from suas_jax.config import (
    ArrudaBoyceSpec,
    LawSpec,
    MooneyRivlinSpec,
    NeoHookeanSpec,
    OgdenSpec,
    YeohSpec,
)
from suas_jax.constitutive import build_law, uniaxial

PROGRAM = shutil.which("ccx")
LAWS: dict[str, LawSpec] = {
    "ogden": OgdenSpec(mu=(6.3e5, 1.2e3, -1e4), alpha=(1.3, 5.0, -2.0), convention="mu/alpha"),
    "neo-hookean": NeoHookeanSpec(mu=3e5),
    "mooney-rivlin": MooneyRivlinSpec(C1=2e5, C2=5e4),
    "yeoh": YeohSpec(C1=2e5, C2=-1e3, C3=5e2),
    "arruda-boyce": ArrudaBoyceSpec(mu=3e5, lambda_m=3.0),
}
CUBE = """*NODE, NSET=ALL
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
*ELEMENT, TYPE=C3D8, ELSET=CUBE
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=PULLED
2, 3, 6, 7
{card}
*SOLID SECTION, ELSET=CUBE, MATERIAL=MEMBRANE
*BOUNDARY
1, 1, 3
4, 1
5, 1
8, 1
2, 2
5, 2
6, 2
2, 3
3, 3
4, 3
*STEP, NLGEOM, INC=1000
*STATIC
0.1, 1.0
*BOUNDARY
PULLED, 1, 1, {travel}
*NODE PRINT, NSET=PULLED, TOTALS=ONLY
RF
*END STEP
"""


@pytest.mark.skipif(PROGRAM is None, reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("stretch", [0.8, 1.6])
def test_calculix_gives_the_fitted_stress_back(
    name: str, stretch: float, tmp_path: pathlib.Path
) -> None:
    assert PROGRAM is not None
    text = card(LAWS[name], "calculix", CardSettings("mm-N-MPa"))
    job = tmp_path / "cube.inp"
    job.write_text(CUBE.format(card=text.strip(), travel=stretch - 1.0))
    subprocess.run([PROGRAM, "cube"], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    # The last time step's force over a face of unit area.
    found = re.findall(r"total force.*\n\s*\n\s*(\S+)", (tmp_path / "cube.dat").read_text())
    expected = float(uniaxial(build_law(LAWS[name]), jnp.asarray(stretch)).nominal) / 1e6
    assert np.isclose(float(found[-1]), expected, rtol=1e-3)
