"""Cards for ANSYS.

A term of Ogden's law is mu/alpha (sum l^alpha - 3) with mu = mu_p, and the neo-Hookean law
takes mu. The volume's energy is (J - 1)^2/d with d = 2/K. With TB,PRONY the hyperelastic
constants are the instantaneous ones.
"""

from fitting.material.cards.settings import Material
from suas_jax.config.laws.neo_hookean import NeoHookeanSpec


def ansys(material: Material) -> str:
    """The card for ANSYS; without a bulk modulus d is zero: incompressible."""
    unit, d = material.unit, material.compressibility
    text = (
        f"! {material.name}: {material.law.law}, {unit}, "
        f"{'d = 2/K' if d else 'incompressible (d = 0)'}, shear modulus "
        f"{material.shear_modulus:.6g} {unit}\n"
    )
    if material.density is not None:
        text += f"MP,DENS,1,{material.density:.12g}\n"
    text += _hyperelastic(material.instantaneous(), d)
    if material.prony:
        text += "! constants of TB,HYPER are the instantaneous ones\n"
        values = [x for pair in material.prony for x in pair]
        text += _table(f"TB,PRONY,1,1,{len(material.prony)},SHEAR", values)
    return text + (_table("TB,CDM,1,1,3,PSE2", material.mullins) if material.mullins else "")


def _hyperelastic(material: Material, d: float) -> str:
    if (terms := material.ogden) is not None:
        values = [x for term in terms for x in term] + [d] + [0.0] * (len(terms) - 1)
        return _table(f"TB,HYPER,1,1,{len(terms)},OGDEN", values)
    if isinstance(material.law, NeoHookeanSpec):
        return _table("TB,HYPER,1,1,1,NEO", [material.shear_modulus, d])
    offered = "ogden, neo-hookean, mooney-rivlin, yeoh, polynomial"
    degree, values = material.polynomial(offered)
    return _table(f"TB,HYPER,1,1,{degree},POLY", [*values, d] + [0.0] * (degree - 1))


def _table(head: str, values: list[float]) -> str:
    lines = [head]
    for i in range(0, len(values), 6):
        shown = ",".join(f"{value:.12g}" for value in values[i : i + 6])
        lines.append(f"TBDATA,{i + 1},{shown}")
    return "\n".join(lines) + "\n"
