"""The electrodes of a skin."""

from __future__ import annotations

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, ValidationInfo, field_validator, model_validator

from suas_jax.config.fields import (
    Angle,
    AsList,
    Length,
    PositiveLength,
    Spec,
    angle_or_arc,
    at_most,
    quantity,
)
from suas_jax.runtime.registry import model_names

Gain = Annotated[float, quantity("number", above=0.0)]


class TaxelSpec(Spec):
    """One round electrode on the rigid wall.

    Attributes:
        angle: of its centre, from the symmetry axis, positive towards +x [rad].
        arc: of its centre, along the undeformed inner face from its middle [m]; instead of
            the angle.
        axial: of its centre, from mid-width [m].
        diameter: of the electrode [m].
        height: above the wall, towards the membrane: what a calibration of single gaps finds.
        gain: of its channel: counts over those of the scale `lsb`, which a calibration finds.
    """

    angle: Angle | None = Field(default=None, examples=['"-30 deg"'])
    arc: Length | None = Field(default=None, examples=['"-22 mm"'])
    axial: Length = Field(default=0.0, examples=['"0 mm"'])
    diameter: PositiveLength = Field(default=4e-3, examples=['"4 mm"'])
    height: Length = Field(default=0.0, examples=['"0 mm"'])
    gain: Gain = Field(default=1.0, examples=["1.0"])

    @model_validator(mode="after")
    def _placed(self) -> Self:
        angle_or_arc(self.angle, self.arc)
        return self


MODULE_TAXELS = 10
"""Taxels of a triangular module, in rows of 1, 2, 3 and 4."""

MOST_TAXELS = 2000
"""Taxels of a skin that are computed; the hardware has up to 320."""


class ModuleSpec(Spec):
    """One triangular module of ten taxels on the rigid wall, in rows of 1, 2, 3 and 4.

    Lengths along the arc are measured on the wall. Without rotation the single taxel of the
    first row points along +axial; a positive rotation turns the module from +angle towards
    +axial.

    Attributes:
        angle: of the module's centroid, from the symmetry axis, positive towards +x [rad].
        arc: of the centroid, along the undeformed inner face from its middle [m]; instead of
            the angle.
        axial: of the module's centroid, from mid-width [m].
        rotation: of the module about its centroid [rad].
        pitch: distance between neighbouring taxels [m].
        diameter: of the electrodes [m].
        numbering: ``"paper"`` (the taxel at the centroid is number 10), or the numbers that
            the ten places carry, place after place along the rows.
        heights: of the ten electrodes above the wall, towards the membrane, by number [m];
            none where they lie on it.
        gains: of the channels of the ten, by number; none where all are one.
    """

    angle: Angle | None = Field(default=None, examples=['"0 deg"'])
    arc: Length | None = Field(default=None, examples=['"22 mm"'])
    axial: Length = Field(default=0.0, examples=['"0 mm"'])
    rotation: Angle = Field(default=0.0, examples=['"0 deg"'])
    pitch: PositiveLength = Field(default=6.533e-3, examples=['"6.533 mm"'])
    diameter: PositiveLength = Field(default=4e-3, examples=['"4 mm"'])
    numbering: Literal["paper"] | tuple[int, ...] = Field(default="paper", examples=['"paper"'])
    heights: Annotated[tuple[Length, ...], AsList] = Field(
        default=(), examples=['["0 mm", "0 mm", "0 mm", ...]']
    )
    gains: Annotated[tuple[Gain, ...], AsList] = Field(
        default=(), examples=["[1.0, 0.99, 1.01, ...]"]
    )

    @model_validator(mode="after")
    def _placed(self) -> Self:
        angle_or_arc(self.angle, self.arc)
        return self

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

    thickness: PositiveLength = Field(examples=['"50 um"'])
    relative_permittivity: Annotated[float, quantity("number", at_least=1.0)] = Field(
        examples=["3.3"]
    )


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

    capacitance: Capacitance = Field(default="parallel-plate", examples=['"parallel-plate"'])
    stray: Annotated[float, quantity("capacitance", at_least=0.0)] = Field(
        default=0.0, examples=['"0 fF"']
    )
    layers: Annotated[tuple[LayerSpec, ...], at_most(32)] = Field(
        default=(), examples=['[ { thickness = "50 um", relative_permittivity = 3.3 } ]']
    )
    lsb: Annotated[float, quantity("capacitance", above=0.0)] = Field(
        default=3.05e-16, examples=['"0.305 fF"']
    )
    noise: Annotated[float, quantity("number", at_least=0.0)] = Field(
        default=0.0, examples=["2.0"]
    )
    layout: Literal["list", "roboskin"] = Field(default="list", examples=['"list"'])
    taxels: Annotated[tuple[TaxelSpec, ...], at_most(MOST_TAXELS)] = Field(
        default=(), validate_default=True, examples=['[ { angle = "0 deg" } ]']
    )
    modules: Annotated[tuple[ModuleSpec, ...], at_most(MOST_TAXELS // MODULE_TAXELS)] = Field(
        default=(), validate_default=True, examples=['[ { angle = "0 deg" } ]']
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

    @field_validator("taxels")
    @classmethod
    def _taxels_of_a_list(
        cls, taxels: tuple[TaxelSpec, ...], info: ValidationInfo
    ) -> tuple[TaxelSpec, ...]:
        _belongs_to("taxels", bool(taxels), "list", info.data.get("layout"))
        return taxels

    @field_validator("modules")
    @classmethod
    def _modules_of_roboskin(
        cls, modules: tuple[ModuleSpec, ...], info: ValidationInfo
    ) -> tuple[ModuleSpec, ...]:
        _belongs_to("modules", bool(modules), "roboskin", info.data.get("layout"))
        return modules


def _belongs_to(key: str, given: bool, owner: str, layout: str | None) -> None:
    """Refuse the electrodes of another layout, and a layout without electrodes."""
    if layout == owner and not given:
        raise ValueError(
            f'missing or empty; layout = "{owner}" needs at least one, for example '
            f'{key} = [ {{ angle = "0 deg" }} ]'
        )
    if layout not in (None, owner) and given:
        raise ValueError(f'belongs to layout = "{owner}", but layout is "{layout}"')
