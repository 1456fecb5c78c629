"""Parameters for COMSOL: a term of Ogden's law is mu/alpha (sum l^alpha - 3)."""

from fitting.material.cards.settings import Material


def comsol(material: Material) -> str:
    """Parameters to load from a file; the law is long-term, shares are of the instantaneous."""
    law, unit = material.law, material.unit
    volume = "incompressible" if material.bulk is None else "nearly incompressible"
    lines = [f"% {material.name}, {law.law}: Parameters > Load from File; {volume} material"]
    if (terms := material.ogden) is not None:
        for i, (mu, alpha) in enumerate(terms, 1):
            lines += [f"mu_{i} {mu:.12g}[{unit}]", f"alpha_{i} {alpha:.12g}"]
    elif (coefficients := law.coefficients()) is not None:
        lines += [f"C{i}{j} {value:.12g}[{unit}]" for (i, j), value in coefficients.items()]
    else:
        for key, declared in law.declared().items():
            shown = f"[{unit}]" if declared.unit == "Pa" else ""
            lines.append(f"{key} {getattr(law, key):.12g}{shown}")
    if material.bulk is not None:
        lines.append(f"kappa {material.bulk:.12g}[{unit}]")
    for i, (g, tau) in enumerate(material.prony, 1):
        lines += [f"g_{i} {g:.12g}", f"tau_{i} {tau:.12g}[s]"]
    if material.mullins:
        r, m, beta = (f"{value:.12g}" for value in material.mullins)
        lines += [f"mullins_r {r}", f"mullins_m {m}[{unit}]", f"mullins_beta {beta}"]
    return "\n".join(lines) + "\n"
