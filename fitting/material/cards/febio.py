"""Cards for FEBio.

A term of Ogden's law is c/m^2 (sum l^m - 3), with c = mu_p alpha_p; Mooney-Rivlin has c1 and
c2. Shares of the relaxation are over the long-term modulus, whose own share is one.
"""

from fitting.material.cards.settings import (
    CardSettings,
    degree_of,
    missing,
    ogden_terms,
)
from suas_jax.config.law import LawSpec
from suas_jax.config.laws.ogden import OgdenSpec

_MOST_TERMS = 6


def febio(law: LawSpec, settings: CardSettings) -> str:
    """The card for FEBio, whose bulk modulus k is `BULK` shear moduli if none is known."""
    kind, entries = _law(law)
    entries.append(("k", settings.bulk_of(law)))
    lines = [f"<{key}>{value:.12g}</{key}>" for key, value in entries]
    density = []
    if settings.density_there is not None:
        density = [f"<density>{settings.density_there:.12g}</density>"]
    note = f"<!-- {law.law}, {settings.stress}; k is {settings.bulk_in_words()} -->"
    opening = f'<material id="1" name="{settings.name}" type="{{}}">'
    if law.relaxation is None:
        body = [opening.format(kind), *_inside([*density, *lines]), "</material>"]
        return "\n".join([note, *body]) + "\n"
    share, count = law.relaxation.long_term_share, len(law.relaxation.g)
    if count > _MOST_TERMS:
        raise missing(law, "febio", f"at most {_MOST_TERMS} Prony terms")
    pairs = enumerate(zip(law.relaxation.g, law.relaxation.tau, strict=True), 1)
    series = ["<g0>1</g0>"]
    for i, (g, tau) in pairs:
        series += [f"<g{i}>{g / share:.12g}</g{i}>", f"<t{i}>{tau:.12g}</t{i}>"]
    elastic = [f'<elastic type="{kind}">', *_inside([*density, *lines]), "</elastic>"]
    body = [opening.format("uncoupled viscoelastic"), *_inside([*series, *elastic])]
    return "\n".join([note, *body, "</material>"]) + "\n"


def _inside(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _law(law: LawSpec) -> tuple[str, list[tuple[str, float]]]:
    """FEBio's name of the law, and its constants of shape."""
    if isinstance(law, OgdenSpec):
        terms = ogden_terms(law)
        if len(terms) > _MOST_TERMS:
            raise missing(law, "febio", f"Ogden with at most {_MOST_TERMS} terms")
        entries = [(f"c{i}", mu * alpha) for i, (mu, alpha) in enumerate(terms, 1)]
        entries += [(f"m{i}", alpha) for i, (_, alpha) in enumerate(terms, 1)]
        return "Ogden", entries
    coefficients = {k: v for k, v in (law.coefficients() or {}).items() if v}
    if coefficients and degree_of(coefficients) == 1:
        c1, c2 = coefficients.get((1, 0), 0.0), coefficients.get((0, 1), 0.0)
        return "Mooney-Rivlin", [("c1", c1), ("c2", c2)]
    raise missing(law, "febio", "ogden, neo-hookean, mooney-rivlin with C1 and C2 only")
