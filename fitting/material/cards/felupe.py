"""Cards for FElupe: a Python module whose `umat` is the material.

A term of Ogden's law is 2 mu/alpha^2 (sum l^alpha - 3), with mu = mu_p alpha_p / 2. The law is
isochoric: a solid adds the bulk modulus, `SolidBodyNearlyIncompressible(umat, field, bulk)`.
"""

from fitting.material.cards.settings import (
    CardSettings,
    missing,
    ogden_terms,
    shear_modulus,
)
from suas_jax.config.law import LawSpec
from suas_jax.config.laws.arruda_boyce import ArrudaBoyceSpec
from suas_jax.config.laws.ogden import OgdenSpec

_MODELS = "mat.models.hyperelastic"
_POLYNOMIAL = '''from tensortrax.math import trace
from tensortrax.math.linalg import det


def energy(C, **unused):
    """Strain energy, a polynomial of I1 - 3 and I2 - 3."""
    J3 = det(C) ** (-1 / 3)
    I1 = J3 * trace(C)
    I2 = (I1**2 - J3**2 * trace(C @ C)) / 2
    return {terms}


'''


def felupe(law: LawSpec, settings: CardSettings) -> str:
    """The card for FElupe: the virgin law, and its softening."""
    modulus = f"shear modulus {shear_modulus(law):.6g} {settings.stress}"
    head = f'"""{settings.name}: {law.law}, {modulus}."""\n\n'
    imports, energy, constants = _law(law)
    text = head + "import felupe.constitution.tensortrax as mat\n" + imports + "\n"
    if settings.density_there is not None:
        text += f"density = {settings.density_there:.12g}\n"
    if settings.bulk_there is not None:
        text += f"bulk = {settings.bulk_there:.12g}\n"
    arguments = [energy, *constants]
    if law.softening is not None:
        part = law.softening
        if constants:
            call = f"{energy}(C, {', '.join(constants)})"
            text += f"\n\ndef energy(C, **unused):\n    return {call}\n\n\n"
        arguments = [f"{_MODELS}.ogden_roxburgh", "material=energy"]
        arguments += [f"r={part.r:.12g}", f"m={part.m:.12g}", f"beta={part.beta:.12g}"]
        arguments.append("nstatevars=1")
    return text + f"umat = mat.Hyperelastic({', '.join(arguments)})\n"


def _law(law: LawSpec) -> tuple[str, str, list[str]]:
    """What stands before the material, its energy's name, and its constants."""
    if isinstance(law, OgdenSpec):
        terms = ogden_terms(law)
        mu = ", ".join(f"{0.5 * m * a:.12g}" for m, a in terms)
        alpha = ", ".join(f"{a:.12g}" for _, a in terms)
        return "", f"{_MODELS}.ogden", [f"mu=[{mu}]", f"alpha=[{alpha}]"]
    if isinstance(law, ArrudaBoyceSpec):
        constants = [f"C1={law.mu:.12g}", f"limit={law.lambda_m:.12g}"]
        return "", f"{_MODELS}.arruda_boyce", constants
    coefficients = law.coefficients()
    if coefficients is None:
        raise missing(
            law, "felupe", "ogden, arruda-boyce, neo-hookean, mooney-rivlin, yeoh, polynomial"
        )
    parts = [
        " * ".join([f"{value:.12g}", *_power("I1", i), *_power("I2", j)])
        for (i, j), value in coefficients.items()
    ]
    return _POLYNOMIAL.replace("{terms}", " + ".join(parts)), "energy", []


def _power(name: str, exponent: int) -> list[str]:
    return [f"({name} - 3) ** {exponent}"] if exponent else []
