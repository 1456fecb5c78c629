"""The parameters of a law in a fit, derived from the law's declaration."""

from collections.abc import Callable

from fitting.material.laws.ogden_parameters import OgdenFamily
from fitting.material.laws.parameters import AbstractFamily, Constant, Family
from suas_jax.config.law import Constant as Declaration
from suas_jax.config.schema_scene import LAWS
from suas_jax.constitutive import registry

# Laws whose constants come as lists, one entry a term.
_BY_TERMS: dict[str, Callable[[int], AbstractFamily]] = {"ogden": OgdenFamily}


def family(law: str, terms: int | None = None) -> AbstractFamily:
    """The constants of a law to be fitted.

    Args:
        law: a value of `law` in [material].
        terms: number of terms (Ogden 1 to 6, Mooney-Rivlin and Yeoh 1 to 3 constants) or
            degree (polynomial 1 to 3); None takes the usual number.

    Raises:
        ValueError: the law is unknown or has no such number of terms.
    """
    if law not in LAWS:
        raise ValueError(f"--law {law}: unknown law; allowed: auto, {', '.join(LAWS)}")
    spec = LAWS[law]
    most = spec.most_terms()
    count = (spec.usual_terms or most) if terms is None else terms
    if not 1 <= count <= most:
        allowed = "1" if most == 1 else f"1 to {most}"
        raise ValueError(f"--terms {count}: {law} allows {allowed}")
    if law in _BY_TERMS:
        return _BY_TERMS[law](count)
    chosen = {k: c for k, c in spec.declared().items() if c.since <= count}
    bound = len(spec.half_modulus) > 1 and set(spec.half_modulus) <= chosen.keys()
    alone = spec.half_modulus[:1]
    parts = tuple(
        _part(key, declared, positive=declared.positive or key in alone)
        for key, declared in chosen.items()
    )
    # Where several numbers of constants are compared, the name tells them apart.
    shown = f"{law}-{count}" if len(spec.compared) > 1 else law
    return Family(law, parts, registry.LAWS[law], modulus_is_sum=bound, shown=shown)


def candidates() -> list[tuple[str, int]]:
    """Laws and numbers of terms that are compared, by rising number of constants."""
    every = [(law, terms) for law, spec in LAWS.items() for terms in spec.compared]
    return sorted(every, key=lambda pair: family(*pair).size)


def _part(name: str, declared: Declaration, *, positive: bool) -> Constant:
    kind = "above I1" if declared.limits_i1 else "positive" if positive else "free"
    usual = (-0.3, 0.3) if kind == "free" else (-1.0, 1.0)
    start = declared.start or usual
    return Constant(name, kind, declared.unit, declared.degree, start)
