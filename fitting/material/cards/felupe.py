"""Cards for FElupe: a Python module whose `umat` is the material.

A term of Ogden's law is 2 mu/alpha^2 (sum l^alpha - 3), with mu = mu_p alpha_p / 2. The law is
isochoric: a solid adds the bulk modulus, `SolidBodyNearlyIncompressible(umat, field, bulk)`.
"""

from fitting.material.cards.settings import Material
from suas_jax.config.laws.arruda_boyce import ArrudaBoyceSpec

_OFFERED = "ogden, arruda-boyce, neo-hookean, mooney-rivlin, yeoh, polynomial"
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


def felupe(material: Material) -> str:
    """The card for FElupe: the virgin law, and its softening."""
    modulus = f"shear modulus {material.shear_modulus:.6g} {material.unit}"
    text = f'"""{material.name}: {material.law.law}, {modulus}."""\n\n'
    imports, energy, constants = _law(material)
    text += "import felupe.constitution.tensortrax as mat\n" + imports + "\n"
    if material.density is not None:
        text += f"density = {material.density:.12g}\n"
    if material.bulk is not None:
        text += f"bulk = {material.bulk:.12g}\n"
    arguments = [energy, *constants]
    if material.mullins:
        if constants:
            call = f"{energy}(C, {', '.join(constants)})"
            text += f"\n\ndef energy(C, **unused):\n    return {call}\n\n\n"
        pairs = zip(("r", "m", "beta"), material.mullins, strict=True)
        constants = [f"{name}={value:.12g}" for name, value in pairs]
        arguments = [f"{_MODELS}.ogden_roxburgh", "material=energy", *constants, "nstatevars=1"]
    return text + f"umat = mat.Hyperelastic({', '.join(arguments)})\n"


def _law(material: Material) -> tuple[str, str, list[str]]:
    """What stands before the material, its energy's name, and its constants."""
    law = material.law
    if (terms := material.ogden) is not None:
        mu = ", ".join(f"{0.5 * m * a:.12g}" for m, a in terms)
        alpha = ", ".join(f"{a:.12g}" for _, a in terms)
        return "", f"{_MODELS}.ogden", [f"mu=[{mu}]", f"alpha=[{alpha}]"]
    if isinstance(law, ArrudaBoyceSpec):
        constants = [f"C1={law.mu:.12g}", f"limit={law.lambda_m:.12g}"]
        return "", f"{_MODELS}.arruda_boyce", constants
    parts = [
        " * ".join([f"{value:.12g}", *_power("I1", i), *_power("I2", j)])
        for (i, j), value in material.coefficients(_OFFERED).items()
    ]
    return _POLYNOMIAL.replace("{terms}", " + ".join(parts)), "energy", []


def _power(name: str, exponent: int) -> list[str]:
    return [f"({name} - 3) ** {exponent}"] if exponent else []
