"""Cards for LS-DYNA: *MAT_OGDEN_RUBBER (77_O) and *MAT_HYPERELASTIC_RUBBER (77_H).

A term of Ogden's law is mu/alpha (sum l^alpha - 3). The relaxation is a stress beside the
long-term law: shear moduli G_i = g_i G(0) with decay constants 1/tau_i, of a linear
viscoelastic solid, so that it is that of the fit at small strain only.
"""

from collections.abc import Iterable

from fitting.material.cards.settings import (
    CardError,
    CardSettings,
    missing,
    ogden_terms,
    shear_modulus,
)
from suas_jax.config.law import LawSpec
from suas_jax.config.laws.ogden import OgdenSpec

_PLACES = ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (3, 0))
_MOST_TERMS, _MOST_PRONY = 8, 12


def lsdyna(law: LawSpec, settings: CardSettings) -> str:
    """The card for LS-DYNA; nearly incompressible, by Poisson's ratio."""
    unit, g = settings.stress, shear_modulus(law)
    k = settings.bulk_of(law)
    poisson = (3.0 * k - 2.0 * g) / (2.0 * (3.0 * k + g))
    density = settings.density_there
    if density is None:
        raise CardError("--export lsdyna: the program needs a density: give --density")
    head = f"$ {law.law}, {unit}, shear modulus {g:.6g} {unit}, bulk modulus {k:.6g} {unit}\n"
    first = f"{1:>10d}{density:>10.4g}{poisson:>10.7f}{0:>10d}"
    keyword, rows = _law(law)
    body = [f"*{keyword}_TITLE", settings.name, first, *rows]
    if law.relaxation is not None:
        if len(law.relaxation.g) > _MOST_PRONY:
            raise missing(law, "lsdyna", f"at most {_MOST_PRONY} Prony terms")
        at_once = g / law.relaxation.long_term_share
        pairs = zip(law.relaxation.g, law.relaxation.tau, strict=True)
        body += [_exact([share * at_once, 1.0 / tau]) for share, tau in pairs]
    return head + "\n".join(body) + "\n"


def _law(law: LawSpec) -> tuple[str, list[str]]:
    """Keyword and rows of constants."""
    if isinstance(law, OgdenSpec):
        terms = ogden_terms(law)
        if len(terms) > _MOST_TERMS:
            raise missing(law, "lsdyna", f"Ogden with at most {_MOST_TERMS} terms")
        filled = [*terms, *[(0.0, 0.0)] * (_MOST_TERMS - len(terms))]
        return "MAT_OGDEN_RUBBER", [
            _exact(mu for mu, _ in filled),
            _exact(alpha for _, alpha in filled),
        ]
    coefficients = law.coefficients()
    if coefficients is None or any(v and p not in _PLACES for p, v in coefficients.items()):
        raise missing(law, "lsdyna", "ogden, and polynomials with C10, C01, C11, C20, C02, C30")
    return "MAT_HYPERELASTIC_RUBBER", [
        _exact(coefficients.get(place, 0.0) for place in _PLACES)
    ]


def _exact(values: Iterable[float]) -> str:
    """Numbers in free format, separated by commas: ten columns would cut them."""
    return ",".join(f"{value:.9g}" for value in values)
