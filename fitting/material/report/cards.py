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
LS-DYNA    mu/alpha (sum l^alpha - 3)                  mu = mu_p
=========  ==========================================  =========================

Laws that are polynomials of I1 - 3 and I2 - 3 have the same coefficients everywhere except
in ANSYS, whose neo-Hookean law takes mu, and in FEBio, whose Mooney-Rivlin has c1 and c2.
C3 (I2 - 3)^2 is the coefficient C02 of a polynomial of degree two.

All cards are incompressible, or nearly so where a program demands a bulk modulus: then it
is `BULK` times the shear modulus, which the card says. Units are SI (m, kg, s, Pa), or those of
engineers who count in millimetres (mm, t, s, MPa).
"""

import dataclasses
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

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


@dataclasses.dataclass(frozen=True)
class CardSettings:
    """What a card says beside the law.

    Attributes:
        units: "SI" or "mm-N-MPa".
        name: of the material.
        density: [kg/m³]; None leaves it to the user where a program needs none.
    """

    units: str = "SI"
    name: str = "membrane"
    density: float | None = None

    def __post_init__(self) -> None:
        if self.units not in UNITS:
            raise CardError(
                f"--card-units {self.units}: unknown units; allowed: {', '.join(UNITS)}"
            )
        if not re.fullmatch(r"[A-Za-z][\w-]{0,39}", self.name):
            raise CardError(
                f'--card-name "{self.name}": letters, digits, "_" and "-" are allowed, 40 at '
                f"most, beginning with a letter"
            )
        if self.density is not None and not self.density > 0.0:
            raise CardError(f"--density {self.density}: must be greater than zero")

    @property
    def stress(self) -> str:
        """Unit of stress."""
        return UNITS[self.units][0]

    @property
    def density_there(self) -> float | None:
        """Density in the card's units."""
        return None if self.density is None else self.density * UNITS[self.units][2]


UNITS = {"SI": ("Pa", 1.0, 1.0), "mm-N-MPa": ("MPa", 1e-6, 1e-12)}
"""Systems of units: unit of stress, what a pascal and what 1 kg/m³ are in them."""


def card(law: LawSpec, program: str, settings: CardSettings | None = None) -> str:
    """The card of a law for a program.

    Args:
        law: the law; constants that were not given are left out.
        program: abaqus, calculix, ansys, febio, comsol, lsdyna or toml.
        settings: units, name and density.

    Raises:
        CardError: the program is unknown or doesn't have this law.
    """
    if program not in PROGRAMS:
        raise CardError(f"--export {program}: unknown program; allowed: {', '.join(PROGRAMS)}")
    chosen = settings or CardSettings()
    if program == "toml":  # quantities with units, whatever the units
        return _toml(law, chosen)
    return PROGRAMS[program](_in_units(law, UNITS[chosen.units][1]), chosen)


def write_card(
    law: LawSpec, program: str, file: Path, settings: CardSettings | None = None
) -> None:
    """Write the card of a law to a file; see `card`."""
    write_text(file, card(law, program, settings))


def _in_units(law: LawSpec, pascal: float) -> LawSpec:
    """The law with its stresses in another unit."""

    def converted(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(converted(entry) for entry in value)
        return value * pascal

    given = law.model_fields_set
    changes = {
        key: converted(getattr(law, key))
        for key, constant in law.declared().items()
        if key in given and constant.unit == "Pa"
    }
    return law.model_copy(update=changes)


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


def _abaqus_like(law: LawSpec, program: str, settings: CardSettings) -> str:
    unit = settings.stress
    head = f"** {law.law}, {unit}, shear modulus {_modulus(law):.6g} {unit}\n"
    head += f"*MATERIAL, NAME={settings.name.upper()}\n"
    if settings.density_there is not None:
        head += f"*DENSITY\n{settings.density_there:.12g}\n"
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


def _ansys(law: LawSpec, settings: CardSettings) -> str:
    unit = settings.stress
    head = (
        f"! {settings.name}: {law.law}, {unit}, incompressible (d = 0), shear modulus "
        f"{_modulus(law):.6g} {unit}\n"
    )
    if settings.density_there is not None:
        head += f"MP,DENS,1,{settings.density_there:.12g}\n"

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


def _febio(law: LawSpec, settings: CardSettings) -> str:
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
    if settings.density_there is not None:
        lines.insert(0, f"    <density>{settings.density_there:.12g}</density>")
    return (
        f"<!-- {law.law}, {settings.stress}; k is {BULK:g} shear moduli, nearly incompressible "
        f"-->\n"
        f'<material id="1" name="{settings.name}" type="{kind}">\n'
        + "\n".join(lines)
        + "\n</material>\n"
    )


def _comsol(law: LawSpec, settings: CardSettings) -> str:
    unit = settings.stress
    lines = [
        f"% {settings.name}, {law.law}: Parameters > Load from File; incompressible material"
    ]
    if isinstance(law, OgdenSpec):
        for i, (mu, alpha) in enumerate(_ogden_terms(law), 1):
            lines += [f"mu_{i} {mu:.12g}[{unit}]", f"alpha_{i} {alpha:.12g}"]
    elif (coefficients := law.coefficients()) is not None:
        lines += [f"C{i}{j} {value:.12g}[{unit}]" for (i, j), value in coefficients.items()]
    else:
        for key, declared in law.declared().items():
            shown = f"[{unit}]" if declared.unit == "Pa" else ""
            lines.append(f"{key} {getattr(law, key):.12g}{shown}")
    return "\n".join(lines) + "\n"


def _toml(law: LawSpec, settings: CardSettings) -> str:
    return tomlkit.dumps({"material": law.table()})


def _lsdyna(law: LawSpec, settings: CardSettings) -> str:
    """*MAT_OGDEN_RUBBER (77_O) and *MAT_HYPERELASTIC_RUBBER (77_H), fields of 10."""
    unit, g = settings.stress, _modulus(law)
    k = BULK * g
    poisson = (3.0 * k - 2.0 * g) / (2.0 * (3.0 * k + g))
    density = settings.density_there
    if density is None:
        raise CardError("--export lsdyna: the program needs a density: give --density")

    def row(*values: float | int) -> str:
        return "".join(
            f"{value:>10.4g}" if isinstance(value, float) else f"{value:>10d}"
            for value in values
        )

    head = f"$ {law.law}, {unit}, shear modulus {g:.6g} {unit}, bulk modulus {k:.6g} {unit}\n"
    first = f"{1:>10d}{density:>10.4g}{poisson:>10.7f}"
    if isinstance(law, OgdenSpec):
        terms = _ogden_terms(law)
        if len(terms) > 8:
            raise _missing(law, "lsdyna", "Ogden with at most 8 terms")
        padded = [*terms, *[(0.0, 0.0)] * (8 - len(terms))]
        rows = [_exact(mu for mu, _ in padded), _exact(alpha for _, alpha in padded)]
        body = ["*MAT_OGDEN_RUBBER_TITLE", settings.name, first + row(0), *rows]
        return head + "\n".join(body) + "\n"
    coefficients = law.coefficients()
    places = ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (3, 0))
    if coefficients is None or any(v and p not in places for p, v in coefficients.items()):
        raise _missing(
            law, "lsdyna", "ogden, and polynomials with C10, C01, C11, C20, C02, C30"
        )
    values = _exact(coefficients.get(place, 0.0) for place in places)
    body = ["*MAT_HYPERELASTIC_RUBBER_TITLE", settings.name, first + row(0), values]
    return head + "\n".join(body) + "\n"


def _exact(values: Iterable[float]) -> str:
    """Numbers in free format, separated by commas: ten columns would cut them."""
    return ",".join(f"{value:.9g}" for value in values)


PROGRAMS: dict[str, Callable[[LawSpec, CardSettings], str]] = {
    "abaqus": lambda law, settings: _abaqus_like(law, "abaqus", settings),
    "calculix": lambda law, settings: _abaqus_like(law, "calculix", settings),
    "ansys": _ansys,
    "febio": _febio,
    "comsol": _comsol,
    "lsdyna": _lsdyna,
    "toml": _toml,
}
