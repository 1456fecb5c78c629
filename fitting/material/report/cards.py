"""Material cards for other programs, each in its own convention.

Ogden's law here is sum mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3); per term

=========  ==========================================  =========================
program    energy of a term                            its modulus
=========  ==========================================  =========================
Abaqus     2 mu/alpha^2 (sum l^alpha - 3)              mu = mu_p alpha_p / 2
CalculiX   as Abaqus                                   mu = mu_p alpha_p / 2
ANSYS      mu/alpha (sum l^alpha - 3)                  mu = mu_p
FEBio      c/m^2 (sum l^m - 3)                         c = mu_p alpha_p
COMSOL     mu/alpha (sum l^alpha - 3)                  mu = mu_p
=========  ==========================================  =========================

Laws that are polynomials of I1 - 3 and I2 - 3 have the same coefficients everywhere except
in ANSYS, whose neo-Hookean law takes mu, and in FEBio, whose Mooney-Rivlin has c1 and c2.
C3 (I2 - 3)^2 is the coefficient C02 of a polynomial of degree two.

All cards are incompressible, or nearly so where a program demands a bulk modulus: then it
is `BULK` times the shear modulus, which the card says. Units are SI (Pa).
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import tomlkit

from suas_jax.config.law import LawSpec
from suas_jax.config.laws.arruda_boyce import ArrudaBoyceSpec
from suas_jax.config.laws.neo_hookean import NeoHookeanSpec
from suas_jax.config.laws.ogden import OgdenSpec
from suas_jax.constitutive import build_law
from suas_jax.files.writing import write_text

BULK = 1e4


class CardError(ValueError):
    """A program has no such law, or is not known."""


def card(law: LawSpec, program: str) -> str:
    """The card of a law for a program.

    Args:
        law: the law; constants that were not given are left out.
        program: abaqus, calculix, ansys, febio, comsol or toml.

    Raises:
        CardError: the program is unknown or doesn't have this law.
    """
    if program not in PROGRAMS:
        raise CardError(f"--export {program}: unknown program; allowed: {', '.join(PROGRAMS)}")
    return PROGRAMS[program](law)


def write_card(law: LawSpec, program: str, file: Path) -> None:
    """Write the card of a law to a file; see `card`."""
    write_text(file, card(law, program))


def _modulus(law: LawSpec) -> float:
    """Shear modulus at small strain [Pa]."""
    return float(build_law(law).shear_modulus)


def _ogden_terms(law: OgdenSpec) -> list[tuple[float, float]]:
    """mu_p and alpha_p by term, in the mu/alpha convention."""
    pairs = list(zip(law.mu, law.alpha, strict=True))
    if law.convention == "mu/alpha":
        return pairs
    return [(2.0 * mu / alpha, alpha) for mu, alpha in pairs]


def _missing(law: LawSpec, program: str, offered: str) -> CardError:
    return CardError(
        f"--export {program}: no card for the law {law.law}; {program} is offered for {offered}"
    )


def _degree(coefficients: Mapping[tuple[int, int], float]) -> int:
    return max(i + j for i, j in coefficients)


def _ordered(degree: int) -> list[tuple[int, int]]:
    """(1,0), (0,1), (2,0), (1,1), (0,2), ...: the order of Abaqus and CalculiX."""
    return [(n - j, j) for n in range(1, degree + 1) for j in range(n + 1)]


def _rows(values: list[float], first: int = 8) -> str:
    """Comma-separated values, eight a line."""
    lines = [values[i : i + first] for i in range(0, len(values), first)]
    return "\n".join(", ".join(f"{value:.12g}" for value in line) for line in lines)


def _abaqus_like(law: LawSpec, program: str) -> str:
    head = f"** {law.law}, Pa, shear modulus {_modulus(law):.6g} Pa\n"
    head += "*MATERIAL, NAME=MEMBRANE\n"
    # Zero for D means incompressible in Abaqus (hybrid elements); CalculiX chooses a value
    # of its own, so it gets a stated one.
    d = 0.0 if program == "abaqus" else 2.0 / (BULK * _modulus(law))
    coefficients = law.coefficients()
    if isinstance(law, OgdenSpec):
        terms = _ogden_terms(law)
        limit = 6 if program == "abaqus" else 4
        if len(terms) > limit:
            raise _missing(law, program, f"Ogden with at most {limit} terms")
        values = [x for mu, alpha in terms for x in (0.5 * mu * alpha, alpha)]
        values += [d] + [0.0] * (len(terms) - 1)
        return head + f"*HYPERELASTIC, OGDEN, N={len(terms)}\n{_rows(values)}\n"
    if isinstance(law, ArrudaBoyceSpec):
        return head + f"*HYPERELASTIC, ARRUDA-BOYCE\n{_rows([law.mu, law.lambda_m, d])}\n"
    if coefficients is None:
        raise _missing(
            law, program, "ogden, arruda-boyce, neo-hookean, mooney-rivlin, yeoh, polynomial"
        )
    degree = _degree(coefficients)
    values = [coefficients.get(place, 0.0) for place in _ordered(degree)]
    values += [d] + [0.0] * (degree - 1)
    return head + f"*HYPERELASTIC, POLYNOMIAL, N={degree}\n{_rows(values)}\n"


def _ansys(law: LawSpec) -> str:
    head = f"! {law.law}, Pa, incompressible (d = 0), shear modulus {_modulus(law):.6g} Pa\n"

    def table(kind: str, order: int, values: list[float]) -> str:
        lines = [head + f"TB,HYPER,1,1,{order},{kind}"]
        for i in range(0, len(values), 6):
            shown = ",".join(f"{value:.12g}" for value in values[i : i + 6])
            lines.append(f"TBDATA,{i + 1},{shown}")
        return "\n".join(lines) + "\n"

    if isinstance(law, OgdenSpec):
        terms = _ogden_terms(law)
        values = [x for term in terms for x in term] + [0.0] * len(terms)
        return table("OGDEN", len(terms), values)
    coefficients = law.coefficients()
    if isinstance(law, NeoHookeanSpec):
        return table("NEO", 1, [_modulus(law), 0.0])
    if coefficients is None:
        raise _missing(law, "ansys", "ogden, neo-hookean, mooney-rivlin, yeoh, polynomial")
    degree = _degree(coefficients)
    values = [coefficients.get(place, 0.0) for place in _ordered(degree)] + [0.0] * degree
    return table("POLY", degree, values)


def _febio(law: LawSpec) -> str:
    k = BULK * _modulus(law)
    entries: list[tuple[str, float]]
    coefficients = law.coefficients()
    if isinstance(law, OgdenSpec):
        terms = _ogden_terms(law)
        if len(terms) > 6:
            raise _missing(law, "febio", "Ogden with at most 6 terms")
        kind = "Ogden"
        entries = [(f"c{i}", mu * alpha) for i, (mu, alpha) in enumerate(terms, 1)]
        entries += [(f"m{i}", alpha) for i, (_, alpha) in enumerate(terms, 1)]
    elif (
        coefficients is not None
        and _degree({k_: v for k_, v in coefficients.items() if v}) == 1
    ):
        kind = "Mooney-Rivlin"
        entries = [("c1", coefficients.get((1, 0), 0.0)), ("c2", coefficients.get((0, 1), 0.0))]
    else:
        raise _missing(law, "febio", "ogden, neo-hookean, mooney-rivlin with C1 and C2 only")
    lines = [f"    <{key}>{value:.12g}</{key}>" for key, value in [*entries, ("k", k)]]
    return (
        f"<!-- {law.law}, Pa; k is {BULK:g} shear moduli, nearly incompressible -->\n"
        f'<material id="1" name="membrane" type="{kind}">\n'
        + "\n".join(lines)
        + "\n</material>\n"
    )


def _comsol(law: LawSpec) -> str:
    lines = [f"% {law.law}: Parameters > Load from File; incompressible material"]
    if isinstance(law, OgdenSpec):
        for i, (mu, alpha) in enumerate(_ogden_terms(law), 1):
            lines += [f"mu_{i} {mu:.12g}[Pa]", f"alpha_{i} {alpha:.12g}"]
    elif (coefficients := law.coefficients()) is not None:
        lines += [f"C{i}{j} {value:.12g}[Pa]" for (i, j), value in coefficients.items()]
    else:
        for key, declared in law.declared().items():
            unit = "[Pa]" if declared.unit == "Pa" else ""
            lines.append(f"{key} {getattr(law, key):.12g}{unit}")
    return "\n".join(lines) + "\n"


def _toml(law: LawSpec) -> str:
    return tomlkit.dumps({"material": law.table()})


PROGRAMS: dict[str, Callable[[LawSpec], str]] = {
    "abaqus": lambda law: _abaqus_like(law, "abaqus"),
    "calculix": lambda law: _abaqus_like(law, "calculix"),
    "ansys": _ansys,
    "febio": _febio,
    "comsol": _comsol,
    "toml": _toml,
}
