"""A scene: a skin, what loads it, where it is, and how to solve it; laws, oils and sections."""

from typing import TYPE_CHECKING, Annotated, Any, Self, Union

from pydantic import Discriminator, Field, Tag, model_validator

from suas_jax.config.consistency import contradictions
from suas_jax.config.fields import Spec
from suas_jax.config.geometry import GeometrySpec
from suas_jax.config.law import LawSpec
from suas_jax.config.oil import OilSpec
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.config.schema_load import BodyLoadSpec, EnvironmentSpec, LoadSpec, ReferenceSpec
from suas_jax.config.schema_skin import ElectrodesSpec, WallSpec
from suas_jax.config.schema_solve import SolveSpec
from suas_jax.runtime.registry import model_classes

LAW_FILES = "suas_jax.config.laws"
LAWS: dict[str, type[LawSpec]] = model_classes(LAW_FILES, LawSpec)
"""The declarations by name, one for each file of `suas_jax.config.laws`."""

if TYPE_CHECKING:
    MaterialSpec = LawSpec
else:
    MaterialSpec = Annotated[Union[tuple(LAWS.values())], Field(discriminator="law")]  # noqa: UP007


OILS: dict[str, type[OilSpec]] = model_classes("suas_jax.config.oils", OilSpec)
"""The declarations by name, one for each file of `suas_jax.config.oils`."""

if TYPE_CHECKING:
    AnyOilSpec = OilSpec
else:
    AnyOilSpec = Annotated[Union[tuple(OILS.values())], Field(discriminator="model")]  # noqa: UP007

SECTIONS: dict[str, type[GeometrySpec]] = model_classes(
    "suas_jax.config.sections", GeometrySpec
)
"""The declarations by name, one for each file of the folder."""

DEFAULT_SECTION = "circle"
NO_ELECTRODES = (
    "the skin has no [electrodes], so there is nothing to sense: add them to the skin file"
)
"""What is said where something is asked of the taxels of a skin that has none."""


def _section(table: Any) -> str:
    given = table.get("section") if isinstance(table, dict) else getattr(table, "section", None)
    return given if isinstance(given, str) else DEFAULT_SECTION


if TYPE_CHECKING:
    AnyGeometrySpec = GeometrySpec
else:
    AnyGeometrySpec = Annotated[
        Union[tuple(Annotated[spec, Tag(name)] for name, spec in SECTIONS.items())],  # noqa: UP007
        Discriminator(_section),
    ]


class SkinSpec(Spec):
    """A skin: dimensions, material, oil, and electrodes if it senses.

    Attributes:
        geometry: the dimensions.
        material: the membrane's law and constants.
        oil: how the oil answers.
        electrodes: what is sensed; None for nothing.
        wall: what holds the membrane.
        reference: when it was closed.
        environment: where it is used; None leaves ambient pressure out.
        calibration: where fitted numbers come from; None in a file written by hand.
    """

    geometry: AnyGeometrySpec
    material: MaterialSpec
    oil: AnyOilSpec
    electrodes: ElectrodesSpec | None = None
    wall: WallSpec = WallSpec()
    reference: ReferenceSpec = ReferenceSpec()
    environment: EnvironmentSpec | None = None
    calibration: CalibrationSpec | None = None

    @property
    def sensing(self) -> ElectrodesSpec:
        """The electrodes; ValueError where the skin has none."""
        if self.electrodes is None:
            raise ValueError(NO_ELECTRODES)
        return self.electrodes

    @property
    def unloaded(self) -> "SceneSpec":
        """The scene in which nothing presses it."""
        return SceneSpec(**{name: getattr(self, name) for name in self.model_fields_set})

    def responding(self, response: str) -> Self:
        """The same with one of its material's two elastic responses, where it relaxes."""
        if self.material.relaxation is None:
            return self
        material = self.material.model_copy(update={"response": response})
        return self.model_copy(update={"material": material})

    def require_plane_strain(self, what: str) -> None:
        """Refuse a skin whose curved ends are clamped for `what`, which begins the message.

        Raises ValueError: the skin is three-dimensional.
        """
        if self.geometry.dimension != 2:
            raise ValueError(
                f'{what} works in plane strain alone, and geometry.ends = "clamped" makes '
                'this skin three-dimensional; set geometry.ends = "sliding" for its section'
            )

    @model_validator(mode="after")
    def _without_contradictions(self) -> Self:
        found = contradictions(dict(self))
        if found:
            raise ValueError("; ".join(f"{key}: {advice}" for key, advice in found))
        return self


class SceneSpec(SkinSpec):
    """A skin with what loads it.

    Attributes:
        loads: what acts from outside, in the order of the file (``[[load]]``).
        solve: how to solve.
    """

    loads: tuple[LoadSpec, ...] = Field(default=(), alias="load")
    solve: SolveSpec = SolveSpec()

    @property
    def bodies(self) -> tuple[BodyLoadSpec, ...]:
        """The rigid bodies among its loads, in the order of the file."""
        return tuple(load for load in self.loads if load.kind == "body")

    def require_no_bodies(self, what: str) -> None:
        """Refuse rigid bodies for `what`, which begins the message.

        Raises ValueError: the scene has a body.
        """
        if self.bodies:
            raise ValueError(
                f'{what} takes dead forces only, not a [[load]] with kind = "body"; use a '
                "line or a patch, or `suas solve` and `suas sweep`"
            )

    @property
    def rtol(self) -> float:
        """Wanted relative error; by default 1e-3 in plane strain, 1e-2 in three dimensions."""
        default = 1e-3 if self.geometry.dimension == 2 else 1e-2
        return self.solve.rtol or default

    @property
    def skin(self) -> SkinSpec:
        """The skin alone."""
        given = {name: getattr(self, name) for name in SkinSpec.model_fields}
        return SkinSpec(**{name: value for name, value in given.items() if value is not None})
