"""Effects of a pad's uncertain inputs, from its model."""

from collections.abc import Mapping

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.pad.input_errors import InputEffects
from fitting.inverse_load.pad.rest import GapLine, gap_line
from fitting.inverse_load.pad.stiffening import stiffening_of
from fitting.inverse_load.pad.table import PadTable
from suas_jax.config import InputErrors, SkinSpec
from suas_jax.config.input_errors import value_of
from suas_jax.scene.skin import Skin

_SMALL = 1e-3  # of a standard deviation, for derivatives at rest
_ELECTRICAL = ("electrodes.", "oil.relative_permittivity", "geometry.oil_gap")


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
