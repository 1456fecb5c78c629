"""Options whose values are quantities with a unit."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from suas_jax.config.quantities import DimensionName


def quantity_of(option: str, text: str, dimension: "DimensionName") -> float:
    """SI value of an option such as ``--diameter "6 mm"``.

    Raises:
        ValueError: not such a quantity; names the option.
    """
    from suas_jax.config.quantities import parse_quantity

    try:
        return parse_quantity(text, dimension)
    except ValueError as error:
        raise ValueError(f'{option} "{text}": {error}') from None
