"""A scene: a skin, what loads it, where it is, and how to solve it."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from suas_jax.config.consistency import contradictions
from suas_jax.config.fields import Spec
from suas_jax.config.schema_calibration import CalibrationSpec
from suas_jax.config.schema_load import EnvironmentSpec, LoadSpec
from suas_jax.config.schema_material import MaterialSpec
from suas_jax.config.schema_oil import AnyOilSpec
from suas_jax.config.schema_skin import ElectrodesSpec, GeometrySpec
from suas_jax.config.schema_solve import SolveSpec


class SkinSpec(Spec):
    """A skin: dimensions, material, oil, and electrodes if it senses.

    Attributes:
        geometry: the dimensions.
        material: the membrane's law and constants.
        oil: how the oil answers.
        electrodes: what is sensed; None for nothing.
        calibration: where fitted numbers come from; None in a file written by hand.
    """

    geometry: GeometrySpec
    material: MaterialSpec
    oil: AnyOilSpec
    electrodes: ElectrodesSpec | None = None
    calibration: CalibrationSpec | None = None

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
        environment: the surroundings; None leaves ambient pressure out.
        solve: how to solve.
    """

    loads: tuple[LoadSpec, ...] = Field(default=(), alias="load")
    environment: EnvironmentSpec | None = None
    solve: SolveSpec = SolveSpec()

    @property
    def skin(self) -> SkinSpec:
        """The skin alone."""
        given = {name: getattr(self, name) for name in SkinSpec.model_fields}
        return SkinSpec(**{name: value for name, value in given.items() if value is not None})
