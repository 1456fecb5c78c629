"""Cards for Abaqus and CalculiX, which share a format.

A term of Ogden's law is 2 mu/alpha^2 (sum l^alpha - 3), with mu = mu_p alpha_p / 2. The
hyperelastic constants are the long-term ones. D1 is 2/K.
"""

from fitting.material.cards.settings import Material
from suas_jax.config.laws.arruda_boyce import ArrudaBoyceSpec

_OFFERED = "ogden, arruda-boyce, neo-hookean, mooney-rivlin, yeoh, polynomial"


def abaqus(material: Material) -> str:
    """The card for Abaqus; D1 is zero without a bulk modulus: hybrid elements."""
    moduli = ", MODULI=LONG TERM" if material.prony else ""
    text = _elastic(material, 6, material.compressibility, moduli)
    if material.prony:
        text += "*VISCOELASTIC, TIME=PRONY\n"
        text += "".join(f"{g:.12g}, 0.0, {tau:.12g}\n" for g, tau in material.prony)
    return text + (f"*MULLINS EFFECT\n{_rows(material.mullins)}\n" if material.mullins else "")


def calculix(material: Material) -> str:
    """The card for CalculiX; it chooses a D of its own for zero, so that it gets one."""
    return _elastic(material, 4, 2.0 / material.demanded_bulk)


def _elastic(material: Material, most: int, d: float, moduli: str = "") -> str:
    unit = material.unit
    head = f"** {material.law.law}, {unit}, shear modulus {material.shear_modulus:.6g} {unit}\n"
    head += f"*MATERIAL, NAME={material.name.upper()}\n"
    if material.density is not None:
        head += f"*DENSITY\n{material.density:.12g}\n"
    law, terms = material.law, material.ogden
    if terms is not None:
        if len(terms) > most:
            raise material.missing(f"Ogden with at most {most} terms")
        kind = f"OGDEN, N={len(terms)}"
        values = [x for mu, alpha in terms for x in (0.5 * mu * alpha, alpha)]
        values += [d] + [0.0] * (len(terms) - 1)
    elif isinstance(law, ArrudaBoyceSpec):
        kind, values = "ARRUDA-BOYCE", [law.mu, law.lambda_m, d]
    else:
        degree, values = material.polynomial(_OFFERED)
        kind, values = f"POLYNOMIAL, N={degree}", [*values, d] + [0.0] * (degree - 1)
    return f"{head}*HYPERELASTIC, {kind}{moduli}\n{_rows(values)}\n"


def _rows(values: list[float], most: int = 8) -> str:
    lines = [values[i : i + most] for i in range(0, len(values), most)]
    return "\n".join(", ".join(f"{value:.12g}" for value in line) for line in lines)
