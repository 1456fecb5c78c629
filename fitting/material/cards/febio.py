"""Cards for FEBio.

A term of Ogden's law is c/m^2 (sum l^m - 3), with c = mu_p alpha_p; Mooney-Rivlin has c1 and
c2. Shares of the relaxation are over the long-term modulus, whose own share is one.
"""

from fitting.material.cards.settings import BULK, Material, degree_of

_MOST_TERMS = 6


def febio(material: Material) -> str:
    """The card for FEBio, whose bulk modulus k is `BULK` shear moduli if none is known."""
    kind, entries = _law(material)
    lines = [f"<{k}>{x:.12g}</{k}>" for k, x in [*entries, ("k", material.demanded_bulk)]]
    if material.density is not None:
        lines.insert(0, f"<density>{material.density:.12g}</density>")
    bulk = f"{BULK:g} shear moduli, nearly incompressible"
    if material.bulk is not None:
        bulk = f"{material.bulk:.6g} {material.unit}"
    outer = kind
    if material.prony:
        if len(material.prony) > _MOST_TERMS:
            raise material.missing(f"at most {_MOST_TERMS} Prony terms")
        share, outer = material.long_term_share, "uncoupled viscoelastic"
        lines = [f'<elastic type="{kind}">', *_inside(lines), "</elastic>"]
        series = ["<g0>1</g0>"]
        for i, (g, tau) in enumerate(material.prony, 1):
            series += [f"<g{i}>{g / share:.12g}</g{i}>", f"<t{i}>{tau:.12g}</t{i}>"]
        lines = [*series, *lines]
    note = f"<!-- {material.law.law}, {material.unit}; k is {bulk} -->"
    opening = f'<material id="1" name="{material.name}" type="{outer}">'
    return "\n".join([note, opening, *_inside(lines), "</material>"]) + "\n"


def _inside(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _law(material: Material) -> tuple[str, list[tuple[str, float]]]:
    """FEBio's name of the law, and its constants of shape."""
    if (terms := material.ogden) is not None:
        if len(terms) > _MOST_TERMS:
            raise material.missing(f"Ogden with at most {_MOST_TERMS} terms")
        entries = [(f"c{i}", mu * alpha) for i, (mu, alpha) in enumerate(terms, 1)]
        return "Ogden", entries + [(f"m{i}", alpha) for i, (_, alpha) in enumerate(terms, 1)]
    coefficients = {k: v for k, v in (material.law.coefficients() or {}).items() if v}
    if not coefficients or degree_of(coefficients) != 1:
        raise material.missing("ogden, neo-hookean, mooney-rivlin with C1 and C2 only")
    c1, c2 = coefficients.get((1, 0), 0.0), coefficients.get((0, 1), 0.0)
    return "Mooney-Rivlin", [("c1", c1), ("c2", c2)]
