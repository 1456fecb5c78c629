"""What filling, mounting, warmth and dimensions do to a pad, as changes of its stiffness.

Stresses, the oil's pressure and forces are proportional to the constants of the material, so
that so much more modulus does exactly what so much less force does. An error of another input
of the membrane does nearly that; how much it amounts to depends on place and force: 0.05 % of
mounting is -18 % at 1 N and -13 % at 12 N on the shipped pad, and a tenth more near the crown
than near the ends. It is solved at a few of them, where n makes n dF most like the change of
the readings, and lies in between elsewhere.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.model.kept_key import kept_key
from fitting.inverse_load.pad.input_errors import InputEffects, Stiffening
from fitting.inverse_load.pad.rest import GapLine, gap_line
from fitting.inverse_load.pad.table import PadTable
from suas_jax.config import InputErrors, SkinSpec
from suas_jax.config.input_errors import value_of
from suas_jax.equilibrium.state import State
from suas_jax.files.cache_folder import kept_arrays
from suas_jax.mechanics.pad.net import NetTopology
from suas_jax.mesh.pad_plan import PadPlan
from suas_jax.scene.forward import forward
from suas_jax.scene.loads import Loads
from suas_jax.scene.skin import Skin, skin_of

# Shares of the pad's edges, along arc and axis: of its own mirror image, and of other pads.
_PLACES = np.array([0.0, 0.65])
_BOTH_SIDES = np.array([-0.65, 0.0, 0.65])
_FORCES = np.array([0.08, 0.8])  # shares of the table's largest force there
_LIGHTER = 0.02  # by which the force is less, relative
_STEP = 0.2  # of an error of one standard deviation
_SMALL = 1e-3  # of the same, for the modulus and at rest
_ELECTRICAL = ("electrodes.", "oil.relative_permittivity", "geometry.oil_gap")


def stiffening_of(
    errors: InputErrors,  # of a pad's inputs
    mechanical: Mapping[str, Floats],
    skin: Skin,  # the model of the pad
    table: PadTable,  # of its states
    slots: int,  # contacts that the program for solved states has room for
) -> Stiffening:
    """Changes of stiffness by some errors, from solved states; those are kept.

    `mechanical` has the changes of the membrane's and the oil's inputs by each error [error],
    by path.
    """
    spec, even = errors.spec, np.zeros(len(errors))
    steps = {}
    for path, change in mechanical.items():
        if path.startswith("material.") and path != "material.expansion":
            even += change * _by_constant(spec, path, float(np.abs(change).max()))
        else:
            steps[path] = _STEP * float(np.linalg.norm(change))
    even_pad = skin.geometry.symmetric and spec.geometry.mirrored_along_axis
    share = _PLACES if even_pad else _BOTH_SIDES
    edges = table.angle[-1] * share, table.axial[-1] * share
    cap = np.exp(table.largest(*(x.ravel() for x in np.meshgrid(*edges, indexing="ij")))[0])
    force = cap.reshape(len(share), len(share), 1) * _FORCES
    more = {"elements": skin.elements, "diameter": table.diameter}
    name = kept_key(spec, steps=steps, places=[edges, force], **more)

    def solved() -> dict[str, Floats]:
        return {"change": _solved(spec, steps, skin, (*edges, force), table.diameter, slots)}

    change = kept_arrays(name, solved)["change"] if steps else np.zeros((*force.shape, 0))
    by_step = np.array([mechanical[path] / step for path, step in steps.items()])
    return Stiffening(even, by_step.reshape(len(steps), len(errors)).T, *edges, force, change)


def _by_constant(spec: SkinSpec, path: str, size: float) -> float:
    """Relative change of the shear modulus by a constant of the material."""
    moduli = []
    for side in (-1.0, 1.0):
        inputs = {path: value_of(spec, path) + side * _SMALL * size}
        law = skin_of(spec, inputs, contact=False).law
        moduli.append(float(np.ravel(law.shear_modulus)[0]))
    return (moduli[1] - moduli[0]) / (_SMALL * size * (moduli[0] + moduli[1]))


def _solved(
    spec: SkinSpec,
    steps: Mapping[str, float],
    skin: Skin,
    nodes: tuple[Floats, Floats, Floats],
    diameter: float,
    slots: int,
) -> Floats:
    """Changes of stiffness by steps of inputs [angle, axial, force, path]."""
    angle, axial, force = nodes
    places = np.meshgrid(angle, axial, np.arange(force.shape[-1]), indexing="ij")
    loads = np.stack([places[0], places[1], force], -1).reshape(-1, 3)
    changed = [
        skin_of(
            spec, {path: value_of(spec, path) + step}, elements=skin.elements, contact=False
        )
        for path, step in steps.items()
    ]
    rows = []
    for load in np.concatenate([loads, np.zeros((1, 3))]):
        # All from the state of the file's pad, on its mesh.
        own, near = solved_contact(skin, load, diameter, slots)
        lighter = load * np.array([1.0, 1.0, 1 - _LIGHTER])
        others = [(skin, lighter), *((other, load) for other in changed)]
        found = [solved_contact(pad, x, diameter, slots, near)[0] for pad, x in others]
        rows.append([own, *found])
    so = np.array(rows)[..., :-1]  # [load, skin, taxel], rest last
    less = (so[:-1, 1:2] - so[:-1, :1]) / _LIGHTER
    moved = so[:, 2:] - so[:, :1]
    by = moved[:-1] - moved[-1]
    used = np.isfinite(less) & np.isfinite(by)
    by, along = np.where(used, by, 0.0), np.where(used, less, 0.0)
    size = (along**2).sum(-1)
    change = (by * along).sum(-1) / np.where(size > 0, size, np.inf)
    return np.asarray(change.reshape(*force.shape, len(steps)))


class Nearby(NamedTuple):
    """A state that others begin with."""

    mesh: PadPlan | None
    state: State


def solved_contact(
    skin: Skin,
    parameters: Floats,  # angle, axial position, force, and a diameter where it is estimated
    diameter: float,  # else [m]
    slots: int,  # contacts that the program has room for
    near: Nearby | None = None,  # where to begin; from rest if None
) -> tuple[Floats, Nearby]:
    """Readings and the oil's pressure under one contact, from the model [channel].

    Channels are NaN where no state was found.
    """
    size = parameters[3] if len(parameters) > 3 else diameter
    unused = [[*parameters[:2], 0.0, size]] * (slots - 1)
    columns = np.array([[*parameters[:3], size], *unused]).T
    loads = Loads.patch(*columns[..., None])
    skin = skin.around(loads) if near is None else replace(skin, mesh=near.mesh)
    assert skin.mesh is not None
    if near is None:  # one program serves states from rest and from others
        zero, shape = jnp.zeros(1), NetTopology(*skin.mesh.axes).free.shape
        near = Nearby(skin.mesh, State(jnp.zeros((*shape, 1)), zero, zero))
    found = forward(skin, loads, near.state)
    row = np.append(np.asarray(found.so)[:, 0], np.asarray(found.oil_pressure))
    if not bool(found.solved[0]):
        return np.full_like(row, np.nan), near
    return row, Nearby(near.mesh, found.state)


def solved_channels(skin: Skin, parameters: Floats, diameter: float, slots: int) -> Floats:
    """The same of single contacts [frame, channel]; parameters are [frame, parameter]."""
    return np.array([solved_contact(skin, x, diameter, slots)[0] for x in parameters])


def effects_of(
    errors: InputErrors,
    skin: Skin,  # the model of the pad they are of
    table: PadTable,  # its states
    slots: int,  # contacts that the program for solved states has room for
) -> InputEffects:
    """What errors of a pad's inputs do."""
    taxels, count = len(table.rest), len(errors)
    by_stray, constant, relative = np.zeros((3, count, taxels))
    mechanical: dict[str, Floats] = {}
    for e, direction in enumerate(errors.directions):
        change = dict(zip(errors.paths, direction.tolist(), strict=True))
        change = {path: size for path, size in change.items() if size}
        electrical = {p: s for p, s in change.items() if p.startswith(_ELECTRICAL)}
        if electrical:
            by_stray[e], constant[e], relative[e] = _at_rest(errors.spec, electrical)
        for path in change.keys() - electrical.keys():
            mechanical.setdefault(path, np.zeros(count))[e] = change[path]
    # In an order that does not change, which names what is kept.
    mechanical = {path: mechanical[path] for path in errors.paths if path in mechanical}
    stiffening = stiffening_of(errors, mechanical, skin, table, slots)
    return InputEffects(by_stray, constant, relative, stiffening)


def _at_rest(spec: SkinSpec, change: Mapping[str, float]) -> tuple[Floats, Floats, Floats]:
    """Derivatives of the readings at rest along a change of electrical inputs."""
    low, high = (_gap_line(spec, change, side * _SMALL) for side in (-1.0, 1.0))
    by_stray, constant, slope = ((b - a) / (2 * _SMALL) for a, b in zip(low, high, strict=True))
    return by_stray, constant, slope / _gap_line(spec, change, 0.0).slope


def _gap_line(spec: SkinSpec, change: Mapping[str, float], size: float) -> GapLine:
    """With inputs changed by a share of an error."""
    return gap_line(spec, {p: value_of(spec, p) + size * by for p, by in change.items()})
