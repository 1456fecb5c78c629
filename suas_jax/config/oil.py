"""What the declaration of an oil model consists of; models are in `suas_jax.config.oils`."""

import contextlib
from typing import Annotated, Any, ClassVar

from pydantic import PlainValidator, ValidationInfo

from suas_jax.config.fields import (
    PositiveNumber,
    Quantity,
    Spec,
    file_key,
    quantity,
    quantity_of,
)
from suas_jax.config.substances import OilExpansion
from suas_jax.config.tolerance import UncertainQuantity

FLUIDS = {"air": 1.0006, "transformer-oil": 2.2, "mineral-oil": 2.2, "silicone-oil": 2.7}
"""Relative permittivities at 20 to 25 degrees Celsius and below 1 MHz, by name.

Air: the usual textbook figure at 1 bar. Mineral oil, of which transformer oil is a grade:
2.2 to 2.4 by grade and temperature; silicone oil (polydimethylsiloxane): 2.5 to 2.8 by
viscosity: typical handbook and suppliers' figures (measured to IEC 60247). Measure yours, or
fit it: moisture alone raises them by per cents.
"""


# Factors between permittivities of one fluid: one that is named is of some grade, a number is
# known.
_SAME_NAME, _SAME_NUMBER = 1.2, 1.1


def refuse_other_fluid(fluid: str, permittivity: float | None, where: str) -> None:
    """Refuse a log of a skin that was filled with something else than the skin file's oil.

    `fluid` is what the log names: "oil" or nothing, a name of `FLUIDS`, or a relative
    permittivity; `permittivity` is the skin file's, None where it states none.
    Raises ValueError: it is another fluid, or no fluid.
    """
    name = fluid.strip().lower()
    if name in ("", "oil"):
        return
    value = FLUIDS.get(name)
    if value is None:
        with contextlib.suppress(ValueError):
            value = float(name)
    if value is None or not value >= 1.0:
        raise ValueError(
            f'{where}, fluid "{fluid}": allowed: oil, {", ".join(FLUIDS)}, or a relative '
            "permittivity"
        )
    same = _SAME_NAME if name in FLUIDS else _SAME_NUMBER
    own = 2.0 if permittivity is None else float(permittivity)
    unknown = permittivity is None and name != "air"
    if unknown or 1 / same < value / own < same:
        return
    filled = "oil" if permittivity is None else f"oil of permittivity {own:.4g}"
    raise ValueError(
        f'{where}: its fluid is "{fluid}" (permittivity {value:.4g}), the skin file\'s is '
        f"{filled}: take the log with the skin filled as the file says, or put "
        "oil.relative_permittivity right"
    )


def _fluid(value: object, info: ValidationInfo) -> float:
    """A fluid by its name, or its relative permittivity."""
    if isinstance(value, str) and value.strip()[:1].isalpha():
        if value in FLUIDS:
            return FLUIDS[value]
        names = ", ".join(f'"{name}"' for name in FLUIDS)
        raise ValueError(f"unknown fluid; give its relative permittivity, or one of {names}")
    at_least_one: Any = quantity("number", at_least=1.0)
    number: float = at_least_one.func(value, info)
    return number


def _viscosity(value: object, info: ValidationInfo) -> float:
    """A dynamic viscosity, or a kinematic one times the density [Pa s]."""
    strict = bool(info.context and info.context.get("units_required"))
    found, density = None, info.data.get("density")
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            found = quantity_of(value, "kinematic viscosity")
    if found is None:
        found = quantity_of(value, "viscosity", bare_numbers=not strict)
    elif density is None:
        raise ValueError(
            "a kinematic viscosity needs the oil's density; add it, for example density = "
            '"960 kg/m^3", or give the dynamic one, for example "48 mPa s"'
        )
    elif isinstance(found, UncertainQuantity):
        found = UncertainQuantity(found * density, found.deviation * density)
    else:
        found *= density
    if found < 0.0:
        raise ValueError("must not be less than zero")
    return found


class OilSpec(Spec):
    """The oil between the wall and the membrane: base of the models in `suas_jax.config.oils`.

    Attributes:
        model: name of the model.
        relative_permittivity: of the oil, or the name of a fluid; None where
            nothing is sensed.
        density: of the oil; None where nothing moves fast [kg/m^3].
        viscosity: dynamic [Pa s]; a file may give the kinematic one, as its unit tells.
        expansion: growth of its volume per kelvin [1/K], or the name of an oil; None where
            it is not known.
        fill: its volume over the film's when the skin was closed; None where it just fills it.
        trapped: whether the oil's pressure is unknown (else it is zero).
        yields: whether its volume changes with the pressure.
    """

    model: str
    relative_permittivity: Annotated[float, PlainValidator(_fluid)] | None = file_key(
        "2.2", None
    )
    density: Annotated[float, quantity("density", above=0.0)] | None = file_key(
        '"960 kg/m^3"', None
    )
    viscosity: Annotated[float, Quantity(_viscosity, dimension="viscosity")] | None = file_key(
        '"50 cSt"', None
    )
    expansion: OilExpansion | None = file_key('"9.6e-4 / K"', None)
    fill: PositiveNumber | None = file_key('"1.000 +- 0.002"', None)

    trapped: ClassVar[bool] = True
    yields: ClassVar[bool] = True
