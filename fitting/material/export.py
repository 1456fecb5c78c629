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
from typing import NamedTuple

from suas_jax.files.writing import write_text

BULK = 1e4


class Law(NamedTuple):
    """A fitted law: its name and constants in SI units.

    Attributes:
        name: a value of `law` in [material].
        constants: by key of [material]; an Ogden law's are in the mu/alpha convention.
        shear_modulus: [Pa].
    """

    name: str
    constants: Mapping[str, float | list[float]]
    shear_modulus: float

    def ogden(self) -> list[tuple[float, float]]:
        """mu_p and alpha_p by term."""
        mu, alpha = self.constants["mu"], self.constants["alpha"]
        assert isinstance(mu, list)
        assert isinstance(alpha, list)
        return list(zip(mu, alpha, strict=True))

    def polynomial(self) -> dict[tuple[int, int], float] | None:
        """Coefficients C_ij of (I1 - 3)^i (I2 - 3)^j; None for other laws."""
        c = {key: value for key, value in self.constants.items() if isinstance(value, float)}
        if self.name == "neo-hookean":
            return {(1, 0): 0.5 * c["mu"]}
        places = {
            "mooney-rivlin": {"C1": (1, 0), "C2": (0, 1), "C3": (0, 2)},
            "yeoh": {"C1": (1, 0), "C2": (2, 0), "C3": (3, 0)},
        }.get(self.name)
        if places is None and self.name == "polynomial":
            places = {key: (int(key[1]), int(key[2])) for key in c}
        return None if places is None else {places[key]: value for key, value in c.items()}


class CardError(ValueError):
    """A program has no such law, or is not known."""


def card(law: Law, program: str) -> str:
    """The card of a law for a program.

    Args:
        law: the law.
        program: abaqus, calculix, ansys, febio, comsol or toml.

    Raises:
        CardError: the program is unknown or doesn't have this law.
    """
    if program not in PROGRAMS:
        raise CardError(f"--export {program}: unknown program; allowed: {', '.join(PROGRAMS)}")
    return PROGRAMS[program](law)


def write_card(law: Law, program: str, file: Path) -> None:
    """Write the card of a law to a file; see `card`."""
    write_text(file, card(law, program))


def _missing(law: Law, program: str, offered: str) -> CardError:
    return CardError(
        f"--export {program}: no card for the law {law.name}; {program} is offered for "
        f"{offered}"
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


def _abaqus_like(law: Law, program: str) -> str:
    head = f"** {law.name}, Pa, shear modulus {law.shear_modulus:.6g} Pa\n"
    head += "*MATERIAL, NAME=MEMBRANE\n"
    # Zero for D means incompressible in Abaqus (hybrid elements); CalculiX chooses a value
    # of its own, so it gets a stated one.
    d = 0.0 if program == "abaqus" else 2.0 / (BULK * law.shear_modulus)
    coefficients = law.polynomial()
    if law.name == "ogden":
        terms = law.ogden()
        limit = 6 if program == "abaqus" else 4
        if len(terms) > limit:
            raise _missing(law, program, f"Ogden with at most {limit} terms")
        values = [x for mu, alpha in terms for x in (0.5 * mu * alpha, alpha)]
        values += [d] + [0.0] * (len(terms) - 1)
        return head + f"*HYPERELASTIC, OGDEN, N={len(terms)}\n{_rows(values)}\n"
    if law.name == "arruda-boyce":
        mu, stretch = law.constants["mu"], law.constants["lambda_m"]
        assert isinstance(mu, float)
        assert isinstance(stretch, float)
        return head + f"*HYPERELASTIC, ARRUDA-BOYCE\n{_rows([mu, stretch, d])}\n"
    if coefficients is None:
        raise _missing(
            law, program, "ogden, arruda-boyce, neo-hookean, mooney-rivlin, yeoh, polynomial"
        )
    degree = _degree(coefficients)
    values = [coefficients.get(place, 0.0) for place in _ordered(degree)]
    values += [d] + [0.0] * (degree - 1)
    return head + f"*HYPERELASTIC, POLYNOMIAL, N={degree}\n{_rows(values)}\n"


def _ansys(law: Law) -> str:
    head = (
        f"! {law.name}, Pa, incompressible (d = 0), shear modulus {law.shear_modulus:.6g} Pa\n"
    )

    def table(kind: str, order: int, values: list[float]) -> str:
        lines = [head + f"TB,HYPER,1,1,{order},{kind}"]
        for i in range(0, len(values), 6):
            shown = ",".join(f"{value:.12g}" for value in values[i : i + 6])
            lines.append(f"TBDATA,{i + 1},{shown}")
        return "\n".join(lines) + "\n"

    if law.name == "ogden":
        terms = law.ogden()
        values = [x for term in terms for x in term] + [0.0] * len(terms)
        return table("OGDEN", len(terms), values)
    coefficients = law.polynomial()
    if law.name == "neo-hookean":
        return table("NEO", 1, [law.shear_modulus, 0.0])
    if coefficients is None:
        raise _missing(law, "ansys", "ogden, neo-hookean, mooney-rivlin, yeoh, polynomial")
    degree = _degree(coefficients)
    values = [coefficients.get(place, 0.0) for place in _ordered(degree)] + [0.0] * degree
    return table("POLY", degree, values)


def _febio(law: Law) -> str:
    k = BULK * law.shear_modulus
    entries: list[tuple[str, float]]
    coefficients = law.polynomial()
    if law.name == "ogden":
        terms = law.ogden()
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
        f"<!-- {law.name}, Pa; k is {BULK:g} shear moduli, nearly incompressible -->\n"
        f'<material id="1" name="membrane" type="{kind}">\n'
        + "\n".join(lines)
        + "\n</material>\n"
    )


def _comsol(law: Law) -> str:
    lines = [f"% {law.name}: Parameters > Load from File; incompressible material"]
    if law.name == "ogden":
        for i, (mu, alpha) in enumerate(law.ogden(), 1):
            lines += [f"mu_{i} {mu:.12g}[Pa]", f"alpha_{i} {alpha:.12g}"]
    elif (coefficients := law.polynomial()) is not None:
        lines += [f"C{i}{j} {value:.12g}[Pa]" for (i, j), value in coefficients.items()]
    else:
        for key, constant in law.constants.items():
            unit = "[Pa]" if key == "mu" else ""
            lines.append(f"{key} {constant:.12g}{unit}")
    return "\n".join(lines) + "\n"


def _toml(law: Law) -> str:
    lines = ["[material]", f'law = "{law.name}"']

    def shown(key: str, value: float) -> str:
        plain = key in ("alpha", "Jm", "lambda_m")
        return f"{value:.12g}" if plain else f'"{value:.12g} Pa"'

    for key, value in law.constants.items():
        if isinstance(value, list):
            lines.append(f"{key} = [{', '.join(shown(key, v) for v in value)}]")
        else:
            lines.append(f"{key} = {shown(key, value)}")
    if law.name == "ogden":
        lines.append('convention = "mu/alpha"')
    return "\n".join(lines) + "\n"


PROGRAMS: dict[str, Callable[[Law], str]] = {
    "abaqus": lambda law: _abaqus_like(law, "abaqus"),
    "calculix": lambda law: _abaqus_like(law, "calculix"),
    "ansys": _ansys,
    "febio": _febio,
    "comsol": _comsol,
    "toml": _toml,
}
