"""Cards for Abaqus and CalculiX, which share a format.

A term of Ogden's law is 2 mu/alpha^2 (sum l^alpha - 3), with mu = mu_p alpha_p / 2. The
hyperelastic constants are the long-term ones. D1 is 2/K.
"""

from fitting.material.cards.settings import (
    CardSettings,
    degree_of,
    missing,
    ogden_terms,
    polynomial_terms,
    shear_modulus,
)
from suas_jax.config.law import LawSpec
from suas_jax.config.laws.arruda_boyce import ArrudaBoyceSpec
from suas_jax.config.laws.ogden import OgdenSpec


def abaqus(law: LawSpec, settings: CardSettings) -> str:
    """The card for Abaqus; D1 is zero without a bulk modulus: hybrid elements."""
    moduli = ", MODULI=LONG TERM" if law.relaxation is not None else ""
    d = settings.compressibility_there
    text = _head(law, settings) + _hyperelastic(law, "abaqus", 6, d, moduli)
    if law.relaxation is not None:
        text += "*VISCOELASTIC, TIME=PRONY\n"
        for g, tau in zip(law.relaxation.g, law.relaxation.tau, strict=True):
            text += f"{g:.12g}, 0.0, {tau:.12g}\n"
    if law.softening is not None:
        part = law.softening
        text += f"*MULLINS EFFECT\n{part.r:.12g}, {part.m:.12g}, {part.beta:.12g}\n"
    return text


def calculix(law: LawSpec, settings: CardSettings) -> str:
    """The card for CalculiX; it chooses a D of its own for zero, so that it gets one."""
    d = 2.0 / settings.bulk_of(law)
    return _head(law, settings) + _hyperelastic(law, "calculix", 4, d)


def _head(law: LawSpec, settings: CardSettings) -> str:
    unit = settings.stress
    head = f"** {law.law}, {unit}, shear modulus {shear_modulus(law):.6g} {unit}\n"
    head += f"*MATERIAL, NAME={settings.name.upper()}\n"
    if settings.density_there is not None:
        head += f"*DENSITY\n{settings.density_there:.12g}\n"
    return head


def _hyperelastic(law: LawSpec, program: str, most: int, d: float, moduli: str = "") -> str:
    coefficients = law.coefficients()
    if isinstance(law, OgdenSpec):
        terms = ogden_terms(law)
        if len(terms) > most:
            raise missing(law, program, f"Ogden with at most {most} terms")
        values = [x for mu, alpha in terms for x in (0.5 * mu * alpha, alpha)]
        values += [d] + [0.0] * (len(terms) - 1)
        return f"*HYPERELASTIC, OGDEN, N={len(terms)}{moduli}\n{_rows(values)}\n"
    if isinstance(law, ArrudaBoyceSpec):
        values = [law.mu, law.lambda_m, d]
        return f"*HYPERELASTIC, ARRUDA-BOYCE{moduli}\n{_rows(values)}\n"
    if coefficients is None:
        raise missing(
            law, program, "ogden, arruda-boyce, neo-hookean, mooney-rivlin, yeoh, polynomial"
        )
    degree = degree_of(coefficients)
    values = [*polynomial_terms(coefficients), d] + [0.0] * (degree - 1)
    return f"*HYPERELASTIC, POLYNOMIAL, N={degree}{moduli}\n{_rows(values)}\n"


def _rows(values: list[float], most: int = 8) -> str:
    """Comma-separated values, eight a line."""
    lines = [values[i : i + most] for i in range(0, len(values), most)]
    return "\n".join(", ".join(f"{value:.12g}" for value in line) for line in lines)
