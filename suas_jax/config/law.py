"""What the declaration of a material law consists of; the laws are in `suas_jax.config.laws`.

Tables of files, checks, fits, comparisons, the help and material cards are derived from it.
"""

import dataclasses
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import BeforeValidator, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema

from suas_jax.config.fields import PlacedError, Spec, file_key, quantity
from suas_jax.config.inelastic import RelaxationSpec, SofteningSpec
from suas_jax.config.quantities import format_quantity
from suas_jax.config.schema_calibration import Names, rows_of_numbers
from suas_jax.config.substances import RubberBulkModulus, RubberExpansion
from suas_jax.config.tolerance import text_of


@dataclasses.dataclass(frozen=True)
class Constant:
    """One constant of a law; stands in the annotation of its key."""

    dimension: Literal["stress", "number"] = "stress"  # ``"stress"`` [Pa] or ``"number"``
    positive: bool = False  # whether it must be greater than zero
    # (i, j) of the product (I1 - 3)^i (I2 - 3)^j that a stress multiplies. It sets the
    # constant's natural size in a fit, and its place in a polynomial law.
    degree: tuple[int, int] = (1, 0)
    since: int = 1  # smallest number of terms (or degree) of the law that has this constant
    # whether I1 - 3 can't exceed it, so that a fit keeps it above all data
    limits_i1: bool = False
    # range of the dimensionless parameter that a fit starts from: the logarithm of a positive
    # constant, else the constant over its natural size
    start: tuple[float, float] | None = None

    @property
    def unit(self) -> str:
        """SI unit, ``"1"`` for a number."""
        return "Pa" if self.dimension == "stress" else "1"

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Validate the key as a quantity of this dimension and sign."""
        check = quantity(self.dimension, above=0.0 if self.positive else None)
        return check.__get_pydantic_core_schema__(source, handler)


class CorrelationSpec(Spec):
    """How the stated deviations of a material's constants belong together.

    Attributes:
        of: keys of [material], with their indices, such as "mu.0" or "relaxation.g.0".
        matrix: correlations, one row for each.
    """

    of: Names = file_key('["C1", "C2"]')
    matrix: Annotated[tuple[tuple[float, ...], ...], BeforeValidator(rows_of_numbers)] = (
        file_key("[[1.0, -0.9], [-0.9, 1.0]]")
    )

    @model_validator(mode="after")
    def _are_correlations(self) -> Self:
        count, rows = len(self.of), self.matrix
        if len(rows) != count or any(len(row) != count for row in rows):
            raise PlacedError("matrix", f"{count} rows of as many numbers are needed")
        if not all(
            abs(rows[i][j]) <= 1.0 and abs(rows[i][j] - rows[j][i]) < 1e-6 and rows[i][i] == 1.0
            for i in range(count)
            for j in range(count)
        ):
            raise PlacedError(
                "matrix", "must be symmetric, with ones on its diagonal and none larger"
            )
        return self

    def table(self) -> dict[str, Any]:
        """The table of a file."""
        return {"of": list(self.of), "matrix": [list(row) for row in self.matrix]}


class LawSpec(Spec):
    """The [material] table of a law: base of the declarations in `suas_jax.config.laws`.

    A declaration has one field a constant, annotated with its `Constant`, and the class
    variables below where its values differ from these.

    Attributes:
        law: the law's name.
        response: which elastic response the skin is solved with: that of the law's constants,
            which are the long-term ones, or the instantaneous one, whose stress constants are
            larger by one over the long-term share of `relaxation`.
        relaxation: of the stress; None where it is not known.
        softening: of the stress below the largest load before; None where it is not known.
        density: of the material; None where nothing moves fast [kg/m^3].
        expansion: growth of the material's lengths per kelvin [1/K], or the name of a rubber;
            None where it is not known.
        bulk_modulus: against ambient pressure [Pa]; None for a material that keeps its volume.
        correlation: between constants whose deviations are stated; None where they are
            independent.
        note: what whoever uses the material should know; commands say it.
        half_modulus: keys whose sum is half the shear modulus of small strain, which must be
            positive; empty where the signs of the constants alone see to that.
        usual_terms: number of terms (or degree) of a fit that asks for none; 0 for all.
        compared: numbers of terms that ``--law auto`` tries.
        is_polynomial: whether the constants are the coefficients of
            (I1 - 3)^i (I2 - 3)^j, with (i, j) their degrees.
    """

    law: str
    response: Literal["long-term", "instantaneous"] = file_key('"long-term"', "long-term")
    relaxation: RelaxationSpec | None = file_key(
        '{ g = [0.2, 0.1], tau = ["0.1 s", "10 s"] }', None
    )
    softening: SofteningSpec | None = file_key('{ r = 1.9, m = "50 kPa", beta = 0.1 }', None)
    density: Annotated[float, quantity("density", above=0.0)] | None = file_key(
        '"1100 kg/m^3"', None
    )
    expansion: RubberExpansion | None = file_key('"1.6e-4 / K"', None)
    bulk_modulus: RubberBulkModulus | None = file_key('"2 GPa"', None)
    correlation: CorrelationSpec | None = file_key(
        '{ of = ["relaxation.g.0", "relaxation.g.1"], matrix = [[1, -0.9], [-0.9, 1]] }', None
    )

    note: str | None = file_key('"from a fast test"', None)

    half_modulus: ClassVar[tuple[str, ...]] = ()
    usual_terms: ClassVar[int] = 0
    compared: ClassVar[tuple[int, ...]] = ()
    is_polynomial: ClassVar[bool] = False

    @classmethod
    def declared(cls) -> dict[str, Constant]:
        """The law's constants by key. An entry of a list is declared as all its entries."""
        found = {}
        for name, field in cls.model_fields.items():
            inside = (entry for part in get_args(field.annotation) for entry in _marks(part))
            for mark in (*field.metadata, *inside):
                if isinstance(mark, Constant):
                    found[name] = mark
        return found

    @classmethod
    def most_terms(cls) -> int:
        """Largest number of terms (or degree) of the law."""
        return max(constant.since for constant in cls.declared().values())

    @classmethod
    def unit(cls, key: str) -> str:
        """SI unit of a constant, ``"1"`` for a number; its key may carry an index: ``mu.0``."""
        return cls.declared()[key.split(".")[0]].unit

    def coefficients(self) -> dict[tuple[int, int], float] | None:
        """Coefficients C_ij of (I1 - 3)^i (I2 - 3)^j by (i, j); None for other laws."""
        if not self.is_polynomial:
            return None
        return {
            constant.degree: getattr(self, key)
            for key, constant in self.declared().items()
            if key in self.model_fields_set
        }

    def table(self) -> dict[str, Any]:
        """The [material] table of a file: what was given, quantities as text with units."""

        def shown(key: str, value: Any) -> Any:
            if isinstance(value, tuple):
                return [shown(key, entry) for entry in value]
            if isinstance(value, str):
                return value
            return (
                text_of(value, 1.0, "") if self.unit(key) == "1" else text_of(value, 1e6, "MPa")
            )

        own = [key for key in type(self).model_fields if key not in LawSpec.model_fields]
        keys = [key for key in (*own, "response") if key in self.model_fields_set]
        table = {"law": self.law} | {key: shown(key, getattr(self, key)) for key in keys}
        if self.note is not None:
            table["note"] = self.note
        for key, unit, name in (
            ("density", 1.0, "kg/m^3"),
            ("expansion", 1.0, "/ K"),
            ("bulk_modulus", 1e6, "MPa"),
        ):
            value = getattr(self, key)
            if value is not None:
                table[key] = f"{value / unit:.12g} {name}"
        for key in ("relaxation", "softening", "correlation"):
            part = getattr(self, key)
            if part is not None:
                table[key] = part.table()
        return table

    @model_validator(mode="after")
    def _correlates_what_is_given(self) -> Self:
        for name in self.correlation.of if self.correlation is not None else ():
            value: Any = self
            for part in name.split("."):
                if isinstance(value, tuple) and part.isdigit() and int(part) < len(value):
                    value = value[int(part)]
                elif isinstance(value, Spec) and part in value.model_fields_set:
                    value = getattr(value, part)
                else:
                    value = None
            if not isinstance(value, float):
                raise PlacedError("correlation", f'of: "{name}" is not a number of this table')
        return self

    @model_validator(mode="after")
    def _instantaneous_of_what_relaxes(self) -> Self:
        if self.response == "instantaneous" and self.relaxation is None:
            raise PlacedError(
                "response",
                "the instantaneous response needs the relaxation of the stress: add "
                'relaxation = { g = [...], tau = [...] }, or take "long-term"',
            )
        return self

    @model_validator(mode="after")
    def _stiff_at_small_strain(self) -> Self:
        keys = self.half_modulus
        if keys and sum(getattr(self, key) for key in keys) <= 0.0:
            given = [key for key in keys if key in self.model_fields_set]
            sizes = [
                f"{key} is {format_quantity(getattr(self, key), 'stress')}" for key in keys
            ]
            raise PlacedError(
                given[-1],
                f"{' + '.join(keys)}, half the shear modulus of small strain, must be greater "
                f"than zero, but {' and '.join(sizes)}",
            )
        return self


def _marks(annotation: Any) -> tuple[Any, ...]:
    return getattr(annotation, "__metadata__", ())
