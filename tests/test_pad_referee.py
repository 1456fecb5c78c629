"""Pads against a continuum of hexahedra: stated errors hold, the wall's force included.

tests/data/pad_referee.json is made by ``python -m benchmarks.pad_referee --continuum`` (FElupe
11.3: 27 nodes, exactly incompressible, three meshes a scene, with what they leave unsure).
"""

import pytest

from benchmarks.pad_referee import RTOL, compared, kept

SCENES = {scene["name"]: scene for scene in kept()}
# Of the others `python -m benchmarks.pad_referee --compare` makes the table.
JUDGED = ("ellipse", "wall 18 N", "wall 22 N", "wall 28 N", "light")


@pytest.mark.parametrize("name", SCENES)
def test_meshes_of_the_continuum_agree(name: str) -> None:
    answer = SCENES[name]["continuum"]
    moved = answer["displacements_m"]
    largest = max(abs(value) for value, _ in moved)
    assert max(deviation for _, deviation in moved) < 0.02 * largest
    pressure, deviation = answer["oil_pressure_Pa"]
    assert deviation <= 0.015 * abs(pressure)


@pytest.mark.long  # programs of shells and solids, a minute or more a scene
@pytest.mark.parametrize("name", JUDGED)
def test_the_stated_error_of_a_pad_holds(name: str) -> None:
    found = compared(SCENES[name])
    assert found["status"] == "converged"
    true = max(abs(found["true"]) - found["unsure"], 0.0)
    assert true <= found["stated"], found
    assert not found["rtol_met"] or true <= RTOL, found
    if "wall" in found:
        own = abs(found["wall"]) - found["wall_unsure"]
        assert own <= found["wall_stated"], found


@pytest.mark.long  # programs of their own
@pytest.mark.parametrize("model", ["shell", "solid"])
def test_an_elliptic_pad_is_that_of_the_continuum(model: str) -> None:
    found = compared(SCENES["ellipse"], model=model)
    assert abs(found["pressure"]) < 3e-3
    assert found["displacement"] < 3e-3
