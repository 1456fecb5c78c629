"""What frames need of a pad beside its table: kept numbers, to be read without JAX."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fitting.arrays import Floats
from fitting.inverse_load.estimate.place import ArcTable
from fitting.inverse_load.model.kept_key import kept_key
from fitting.inverse_load.pad.input_errors import InputEffects, Stiffening
from fitting.inverse_load.pad.rest import GapLine, gap_line
from fitting.inverse_load.pad.table import PadTable
from suas_jax.config import InputErrors, SkinSpec, continuous_inputs
from suas_jax.files.cache_folder import kept_arrays

if TYPE_CHECKING:
    from suas_jax.scene.skin import Skin

_STIFFENING = "stiffening_"


class PadShape(NamedTuple):
    """Dimensions of one pad; those that vary over it are the means."""

    radius: float  # of the outer face; half its mean width where it is no circle [m]
    thickness: float  # [m]
    half_angle: float  # [rad]
    width: float  # along the axis [m]
    gap: float  # of the oil [m]

    @classmethod
    def of(cls, skin: "Skin") -> "PadShape":
        """That of a pad's model."""
        g = skin.geometry
        sizes = g.outer_size, g.thickness, g.half_angle, g.width, g.oil_gap
        return cls(*(float(x[0]) for x in sizes))

    def edge(self, diameter: float) -> tuple[float, float]:
        """Largest angle [rad] and axial position [m] of a contact that stays on the pad."""
        margin = diameter / 2 + self.thickness / 4
        return self.half_angle - margin / self.radius, self.width / 2 - margin


class PadFacts(NamedTuple):
    """Numbers of one pad."""

    shape: PadShape
    taxels: Floats  # places of the taxels [taxel, (angle, axial)]
    line: GapLine
    arc: ArcTable
    effects: InputEffects  # of its uncertain inputs


def facts_of(
    spec: SkinSpec,
    errors: InputErrors,  # of its inputs
    skin: "Callable[[], Skin]",  # its model, where nothing is kept
    table: PadTable,  # its states
    slots: int,  # contacts that the program for solved states has room for
) -> PadFacts:
    """The facts of a pad, from the cache where they are there."""
    name = kept_key(
        spec,
        errors=[errors.paths, errors.directions, continuous_inputs(errors.spec)],
        table=[table.cap, table.diameter],
    )

    def made() -> dict[str, Any]:
        from fitting.inverse_load.pad.stiffening import effects_of

        model = skin()
        arc = ArcTable.of(spec.geometry, model.geometry)
        *effects, stiffening = effects_of(errors, model, table, slots)
        return {
            "shape": PadShape.of(model),
            "taxels": model.electrodes.taxels.places,
            "line": gap_line(spec, {}),
            "angle": arc.angle,
            "rows": arc.rows,
            "effects": effects,
            **{_STIFFENING + name: x for name, x in vars(stiffening).items()},
        }

    found = kept_arrays(name, made)
    shape = PadShape(*found["shape"].tolist())
    own = {
        name.removeprefix(_STIFFENING): x
        for name, x in found.items()
        if name.startswith(_STIFFENING)
    }
    by_stray, constant, relative = found["effects"]
    return PadFacts(
        shape,
        np.asarray(found["taxels"]),
        GapLine(*found["line"]),
        ArcTable(*shape[:3], found["angle"], found["rows"]),
        InputEffects(by_stray, constant, relative, Stiffening(**own)),
    )
