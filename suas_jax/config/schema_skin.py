"""The electrodes of a skin, and the wall that they are on."""

from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import ValidationInfo, field_validator

from suas_jax.config.fields import (
    Angle,
    AsList,
    Length,
    PlacedSpec,
    PositiveLength,
    PositivePressure,
    Spec,
    at_most,
    file_key,
    quantity,
)
from suas_jax.config.substances import WallBulkModulus, WallExpansion
from suas_jax.runtime.registry import model_names

Gain = Annotated[float, quantity("number", above=0.0)]


class TaxelSpec(PlacedSpec):
    """One round electrode on the rigid wall.

    Attributes:
        diameter: of the electrode [m].
        height: above the wall, towards the membrane: what a calibration of single gaps finds.
        gain: of its channel: counts over those of the scale `lsb`, which a calibration finds.
    """

    diameter: PositiveLength = file_key('"4 mm"', 4e-3)
    height: Length = file_key('"0 mm"', 0.0)
    gain: Gain = file_key("1.0", 1.0)


MODULE_TAXELS = 10
"""Taxels of a triangular module, in rows of 1, 2, 3 and 4."""

MOST_TAXELS = 2000
"""Taxels of a skin that are computed; the hardware has up to 320."""


class ModuleSpec(PlacedSpec):
    """One triangular module of ten taxels on the rigid wall, in rows of 1, 2, 3 and 4.

    Lengths along the arc are measured on the wall. Without rotation the single taxel of the
    first row points along +axial; a positive rotation turns the module from +angle towards
    +axial.

    Attributes:
        rotation: of the module about its centroid [rad].
        pitch: distance between neighbouring taxels [m].
        diameter: of the electrodes [m].
        numbering: ``"paper"`` (the taxel at the centroid is number 10), or the numbers that
            the ten places carry, place after place along the rows.
        heights: of the ten electrodes above the wall, towards the membrane, by number [m];
            none where they lie on it.
        gains: of the channels of the ten, by number; none where all are one.
    """

    rotation: Angle = file_key('"0 deg"', 0.0)
    pitch: PositiveLength = file_key('"6.533 mm"', 6.533e-3)
    diameter: PositiveLength = file_key('"4 mm"', 4e-3)
    numbering: Literal["paper"] | tuple[int, ...] = file_key('"paper"', "paper")
    heights: Annotated[tuple[Length, ...], AsList] = file_key(
        '["0 mm", "0 mm", "0 mm", ...]', ()
    )
    gains: Annotated[tuple[Gain, ...], AsList] = file_key("[1.0, 0.99, 1.01, ...]", ())

    @field_validator("heights", "gains")
    @classmethod
    def _ten_or_none(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        if len(values) not in (0, MODULE_TAXELS):
            raise ValueError(f"{MODULE_TAXELS} values are needed, one for each taxel")
        return values

    @field_validator("numbering", mode="before")
    @classmethod
    def _each_number_once(cls, numbering: object) -> object:
        if numbering == "paper":
            return numbering
        every = list(range(1, MODULE_TAXELS + 1))
        whole = isinstance(numbering, list | tuple) and all(type(n) is int for n in numbering)
        if not whole or sorted(numbering) != every:  # type: ignore[call-overload]
            raise ValueError(f'allowed: "paper", or a list of the numbers 1 to {every[-1]}')
        return numbering


class LayerSpec(Spec):
    """A dielectric layer between electrode and oil, or between oil and membrane.

    Attributes:
        thickness: of the layer [m].
        relative_permittivity: of the layer.
    """

    thickness: PositiveLength = file_key('"50 um"')
    relative_permittivity: Annotated[float, quantity("number", at_least=1.0)] = file_key("3.3")


Capacitance: TypeAlias = Literal[  # type: ignore[valid-type]
    tuple(model_names("suas_jax.sensing.capacitances"))
]
"""Models of the capacitance by name, one for each file of the folder."""


class ElectrodesSpec(Spec):
    """The electrodes and their converter.

    Attributes:
        capacitance: model: ``"parallel-plate"`` (the paper's), ``"concentric"``, or
            ``"bare-disc"`` for electrodes without guard.
        stray: capacitance in parallel with each taxel [F].
        layers: dielectrics in series with the oil, such as solder resist or a fabric. They
            take no room from the gap.
        lsb: capacitance of one count [F].
        noise: standard deviation of a reading [counts].
        layout: ``"list"`` (``taxels`` of module 0) or ``"roboskin"`` (``modules``).
        taxels: electrodes of the list layout, in the order of their numbers.
        modules: triangles of the roboskin layout.
    """

    capacitance: Capacitance = file_key('"parallel-plate"', "parallel-plate")
    stray: Annotated[float, quantity("capacitance", at_least=0.0)] = file_key('"0 fF"', 0.0)
    layers: Annotated[tuple[LayerSpec, ...], at_most(32)] = file_key(
        '[ { thickness = "50 um", relative_permittivity = 3.3 } ]', ()
    )
    lsb: Annotated[float, quantity("capacitance", above=0.0)] = file_key('"0.305 fF"', 3.05e-16)
    noise: Annotated[float, quantity("number", at_least=0.0)] = file_key("2.0", 0.0)
    layout: Literal["list", "roboskin"] = file_key('"list"', "list")
    taxels: Annotated[tuple[TaxelSpec, ...], at_most(MOST_TAXELS)] = file_key(
        '[ { angle = "0 deg" } ]', (), validate_default=True
    )
    modules: Annotated[tuple[ModuleSpec, ...], at_most(MOST_TAXELS // MODULE_TAXELS)] = (
        file_key('[ { angle = "0 deg" } ]', (), validate_default=True)
    )

    def with_equal_channels(self) -> Self:
        """The same electrodes, all channels of gain one."""
        taxels = tuple(
            TaxelSpec(**{key: getattr(t, key) for key in t.model_fields_set - {"gain"}})
            for t in self.taxels
        )
        modules = tuple(m.model_copy(update={"gains": ()}) for m in self.modules)
        return self.model_copy(update={"taxels": taxels, "modules": modules})

    @property
    def taxels_by_module(self) -> dict[int, int]:
        """Number of taxels of each module, by its number."""
        if self.layout == "list":
            return {0: len(self.taxels)}
        return dict.fromkeys(range(len(self.modules)), MODULE_TAXELS)

    @property
    def taxel_names(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Module (from 0) and number in it (from 1) of every taxel, in their order."""
        sizes = self.taxels_by_module
        modules = tuple(m for m, size in sizes.items() for _ in range(size))
        return modules, tuple(k for size in sizes.values() for k in range(1, size + 1))

    @field_validator("taxels", "modules")
    @classmethod
    def _of_this_layout(cls, places: tuple[Any, ...], info: ValidationInfo) -> Any:
        """Refuse the electrodes of another layout, and a layout without electrodes."""
        owner = {"taxels": "list", "modules": "roboskin"}[info.field_name or ""]
        layout = info.data.get("layout")
        if layout == owner and not places:
            raise ValueError(
                f'missing or empty; layout = "{owner}" needs at least one, for example '
                f'{info.field_name} = [ {{ angle = "0 deg" }} ]'
            )
        if layout not in (None, owner) and places:
            raise ValueError(f'belongs to layout = "{owner}", but layout is "{layout}"')
        return places


class SoftLayerSpec(Spec):
    """A soft layer on the wall, such as a fabric.

    Attributes:
        thickness: of the layer [m].
        stiffness: pressure per strain [Pa].
    """

    thickness: PositiveLength = file_key('"0.5 mm"')
    stiffness: PositivePressure = file_key('"2 MPa"')


class WallSpec(Spec):
    """The wall, a cylinder around the skin's axis.

    Attributes:
        contact: whether it holds the membrane; if not, contact is reported only.
        layer: a soft layer on it; None where the wall is rigid.
        expansion: growth of its lengths per kelvin [1/K], or the name of what it is made of;
            the clamps go with it.
        bulk_modulus: of what it is made of, against ambient pressure [Pa].
    """

    contact: bool = file_key("true", True)
    layer: SoftLayerSpec | None = file_key(
        '{ thickness = "0.5 mm", stiffness = "2 MPa" }', None
    )
    expansion: WallExpansion | None = file_key('"7e-5 / K"', None)
    bulk_modulus: WallBulkModulus | None = file_key('"3 GPa"', None)

    @field_validator("contact", mode="before")
    @classmethod
    def _true_or_false(cls, value: Any) -> Any:
        if not isinstance(value, bool):
            raise ValueError("true or false is expected")
        return value

    @field_validator("layer")
    @classmethod
    def _only_in_contact(
        cls, layer: SoftLayerSpec | None, info: ValidationInfo
    ) -> SoftLayerSpec | None:
        if layer is not None and info.data.get("contact") is False:
            raise ValueError("has no effect with contact = false; take one of them out")
        return layer
