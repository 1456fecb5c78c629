"""Dimensions of a pad that frames need, as plain numbers."""

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from suas_jax.scene.skin import Skin


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
