"""Material cards for other programs, each in its own convention.

Ogden's law here is sum mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3); what a term is
elsewhere stands in `programs`. Polynomials of I1 - 3 and I2 - 3 have the same
coefficients everywhere except in ANSYS, whose neo-Hookean law takes mu, and in FEBio, whose
Mooney-Rivlin has c1 and c2. C3 (I2 - 3)^2 is C02 of a polynomial of degree two.

Without a bulk modulus cards are incompressible, or nearly so where a program demands one: then
it is `BULK` times the shear modulus, which the card says. Units are SI (m, kg, s, Pa), or those
of engineers who count in millimetres (mm, t, s, MPa).
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import tomlkit

from fitting.material.cards import programs
from fitting.material.cards.settings import UNITS, CardError, CardSettings, Material, in_units
from suas_jax.config.law import LawSpec
from suas_jax.files.writing import write_text


class Program(NamedTuple):
    """A program that reads cards."""

    write: Callable[[Material], str]  # makes the card
    comment: str  # begins a line of remarks
    relaxes: bool  # whether the card holds the relaxation of the stress
    softens: bool  # whether it holds the softening


PROGRAMS: dict[str, Program] = {
    "abaqus": Program(programs.abaqus, "**", True, True),
    "calculix": Program(programs.calculix, "**", False, False),
    "ansys": Program(programs.ansys, "!", True, True),
    "febio": Program(programs.febio, "", True, False),
    "comsol": Program(programs.comsol, "%", True, True),
    "lsdyna": Program(programs.lsdyna, "$", True, False),
    "felupe": Program(programs.felupe, "#", False, True),
    "toml": Program(
        lambda material: tomlkit.dumps({"material": material.law.table()}), "#", True, True
    ),
}
"""Programs by name; "toml" is the [material] table of a skin."""


def require_program(name: str) -> None:
    """Raise a CardError that names the programs, where there are no cards for one."""
    if name not in PROGRAMS:
        raise CardError(f"--export {name}: unknown program; allowed: {', '.join(PROGRAMS)}")


def card(law: LawSpec, program: str, settings: CardSettings | None = None) -> str:
    """The card of a law for one of `PROGRAMS`. Raises CardError: there is none of this law."""
    require_program(program)
    chosen = settings or CardSettings()
    # The table of a skin has quantities with units, whatever the units.
    pascal = 1.0 if program == "toml" else UNITS[chosen.units][1]
    there = law if pascal == 1.0 else in_units(law, pascal)
    text = PROGRAMS[program].write(Material(there, program, chosen))
    remark, mark = left_out(law, program), PROGRAMS[program].comment
    if not remark:
        return text
    return f"{mark} {remark}\n{text}" if mark else f"<!-- {remark} -->\n{text}"


def left_out(law: LawSpec, program: str) -> str:
    """What of a material the card of a program does not hold, in words; "" for nothing."""
    known = PROGRAMS[program]
    parts = []
    if law.relaxation is not None and not known.relaxes:
        parts.append("relaxation: the constants are the long-term ones")
    if law.softening is not None and not known.softens:
        parts.append("softening: the constants are those of the virgin material")
    return f"without {'; without '.join(parts)}" if parts else ""


def write_card(
    law: LawSpec, program: str, file: Path, settings: CardSettings | None = None
) -> None:
    """Write the card of a law to a file; see `card`."""
    write_text(file, card(law, program, settings))


def write_cards(
    law: LawSpec, cards: Sequence[tuple[str, str]], settings: CardSettings
) -> list[dict[str, str]]:
    """Write cards, each a program and a file; one that a program can't have is reported."""
    found = []
    for program, file in cards:
        message = ""
        try:
            write_card(law, program, Path(file), settings)
            if remark := left_out(law, program):
                message = f"{file}: the card is {remark}"
        except CardError as error:
            message = str(error)
        found.append({"program": program, "file": file, "message": message})
    return found
