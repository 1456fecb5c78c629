"""Cards for ANSYS.

A term of Ogden's law is mu/alpha (sum l^alpha - 3) with mu = mu_p, and the neo-Hookean law
takes mu. The volume's energy is (J - 1)^2/d with d = 2/K. With TB,PRONY the hyperelastic
constants are the instantaneous ones.
"""

from fitting.material.cards.settings import (
    CardSettings,
    degree_of,
    instantaneous,
    missing,
    ogden_terms,
    polynomial_terms,
    shear_modulus,
)
from suas_jax.config.law import LawSpec
from suas_jax.config.laws.neo_hookean import NeoHookeanSpec
from suas_jax.config.laws.ogden import OgdenSpec


def ansys(law: LawSpec, settings: CardSettings) -> str:
    """The card for ANSYS; without a bulk modulus d is zero: incompressible."""
    unit, d = settings.stress, settings.compressibility_there
    volume = "d = 2/K" if d else "incompressible (d = 0)"
    head = (
        f"! {settings.name}: {law.law}, {unit}, {volume}, shear modulus "
        f"{shear_modulus(law):.6g} {unit}\n"
    )
    if settings.density_there is not None:
        head += f"MP,DENS,1,{settings.density_there:.12g}\n"
    text = head + _hyperelastic(instantaneous(law), d)
    if law.relaxation is not None:
        pairs = zip(law.relaxation.g, law.relaxation.tau, strict=True)
        values = [x for pair in pairs for x in pair]
        count = len(law.relaxation.g)
        text += "! constants of TB,HYPER are the instantaneous ones\n"
        text += _table(f"TB,PRONY,1,1,{count},SHEAR", values)
    if law.softening is not None:
        part = law.softening
        text += _table("TB,CDM,1,1,3,PSE2", [part.r, part.m, part.beta])
    return text


def _hyperelastic(law: LawSpec, d: float) -> str:
    if isinstance(law, OgdenSpec):
        terms = ogden_terms(law)
        values = [x for term in terms for x in term] + [d] + [0.0] * (len(terms) - 1)
        return _table(f"TB,HYPER,1,1,{len(terms)},OGDEN", values)
    if isinstance(law, NeoHookeanSpec):
        return _table("TB,HYPER,1,1,1,NEO", [shear_modulus(law), d])
    coefficients = law.coefficients()
    if coefficients is None:
        raise missing(law, "ansys", "ogden, neo-hookean, mooney-rivlin, yeoh, polynomial")
    degree = degree_of(coefficients)
    values = polynomial_terms(coefficients) + [d] + [0.0] * (degree - 1)
    return _table(f"TB,HYPER,1,1,{degree},POLY", values)


def _table(head: str, values: list[float]) -> str:
    lines = [head]
    for i in range(0, len(values), 6):
        shown = ",".join(f"{value:.12g}" for value in values[i : i + 6])
        lines.append(f"TBDATA,{i + 1},{shown}")
    return "\n".join(lines) + "\n"
