"""Parameters for COMSOL: a term of Ogden's law is mu/alpha (sum l^alpha - 3)."""

from fitting.material.cards.settings import CardSettings, ogden_terms
from suas_jax.config.law import LawSpec
from suas_jax.config.laws.ogden import OgdenSpec


def comsol(law: LawSpec, settings: CardSettings) -> str:
    """Parameters to load from a file; the law is long-term, shares are of the instantaneous."""
    unit = settings.stress
    volume = "incompressible" if settings.bulk_there is None else "nearly incompressible"
    lines = [f"% {settings.name}, {law.law}: Parameters > Load from File; {volume} material"]
    if isinstance(law, OgdenSpec):
        for i, (mu, alpha) in enumerate(ogden_terms(law), 1):
            lines += [f"mu_{i} {mu:.12g}[{unit}]", f"alpha_{i} {alpha:.12g}"]
    elif (coefficients := law.coefficients()) is not None:
        lines += [f"C{i}{j} {value:.12g}[{unit}]" for (i, j), value in coefficients.items()]
    else:
        for key, declared in law.declared().items():
            shown = f"[{unit}]" if declared.unit == "Pa" else ""
            lines.append(f"{key} {getattr(law, key):.12g}{shown}")
    if settings.bulk_there is not None:
        lines.append(f"kappa {settings.bulk_there:.12g}[{unit}]")
    if law.relaxation is not None:
        pairs = zip(law.relaxation.g, law.relaxation.tau, strict=True)
        for i, (g, tau) in enumerate(pairs, 1):
            lines += [f"g_{i} {g:.12g}", f"tau_{i} {tau:.12g}[s]"]
    if law.softening is not None:
        part = law.softening
        lines += [
            f"mullins_r {part.r:.12g}",
            f"mullins_m {part.m:.12g}[{unit}]",
            f"mullins_beta {part.beta:.12g}",
        ]
    return "\n".join(lines) + "\n"
