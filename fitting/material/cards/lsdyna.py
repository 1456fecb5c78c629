"""Cards for LS-DYNA: *MAT_OGDEN_RUBBER (77_O) and *MAT_HYPERELASTIC_RUBBER (77_H).

A term of Ogden's law is mu/alpha (sum l^alpha - 3). The relaxation is a stress beside the
long-term law: shear moduli G_i = g_i G(0) with decay constants 1/tau_i, of a linear
viscoelastic solid, so that it is that of the fit at small strain only.
"""

from collections.abc import Iterable

from fitting.material.cards.settings import CardError, Material

_PLACES = ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (3, 0))
_MOST_TERMS, _MOST_PRONY = 8, 12
_OFFERED = "ogden, and polynomials with C10, C01, C11, C20, C02, C30"


def lsdyna(material: Material) -> str:
    """The card for LS-DYNA; nearly incompressible, by Poisson's ratio."""
    unit, g, k = material.unit, material.shear_modulus, material.demanded_bulk
    poisson = (3.0 * k - 2.0 * g) / (2.0 * (3.0 * k + g))
    if material.density is None:
        raise CardError("--export lsdyna: the program needs a density: give --density")
    head = f"$ {material.law.law}, {unit}, shear modulus {g:.6g} {unit}, "
    head += f"bulk modulus {k:.6g} {unit}\n"
    first = f"{1:>10d}{material.density:>10.4g}{poisson:>10.7f}{0:>10d}"
    if (terms := material.ogden) is not None:
        if len(terms) > _MOST_TERMS:
            raise material.missing(f"Ogden with at most {_MOST_TERMS} terms")
        filled = [*terms, *[(0.0, 0.0)] * (_MOST_TERMS - len(terms))]
        keyword, rows = "MAT_OGDEN_RUBBER", [*map(_exact, zip(*filled, strict=True))]
    else:
        coefficients = material.coefficients(_OFFERED)
        if any(value and place not in _PLACES for place, value in coefficients.items()):
            raise material.missing(_OFFERED)
        values = [coefficients.get(place, 0.0) for place in _PLACES]
        keyword, rows = "MAT_HYPERELASTIC_RUBBER", [_exact(values)]
    if len(material.prony) > _MOST_PRONY:
        raise material.missing(f"at most {_MOST_PRONY} Prony terms")
    at_once = g / material.long_term_share
    rows += [_exact([share * at_once, 1.0 / tau]) for share, tau in material.prony]
    return head + "\n".join([f"*{keyword}_TITLE", material.name, first, *rows]) + "\n"


def _exact(values: Iterable[float]) -> str:
    """Numbers in free format, separated by commas: ten columns would cut them."""
    return ",".join(f"{value:.9g}" for value in values)
