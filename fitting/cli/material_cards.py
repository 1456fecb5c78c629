"""The part of `suas fit material` that writes material cards for other programs."""

from pathlib import Path
from typing import TYPE_CHECKING

from fitting.cli.options import quantity_of
from fitting.material.cards.card import PROGRAMS, left_out, write_card
from fitting.material.cards.settings import CardError, CardSettings

if TYPE_CHECKING:
    from fitting.material.fit.result import MaterialFit


def card_settings(
    cards: list[tuple[str, str]],
    units: str,
    name: str,
    density: float | None,
    bulk_modulus: str | None,
) -> CardSettings:
    """What the options say of the cards.

    Args:
        cards: program and file of each.
        units: of all of them.
        name: of the material.
        density: [kg/m3], if it is given.
        bulk_modulus: with its unit, if it is given.

    Raises:
        ValueError: names the option that can't be used.
    """
    bulk_value = None
    if bulk_modulus is not None:
        bulk_value = quantity_of("--bulk-modulus", bulk_modulus, "stress")
    settings = CardSettings(units, name, density, bulk_value)
    for program, _ in cards:
        if program not in PROGRAMS:
            allowed = ", ".join(PROGRAMS)
            raise CardError(f"--export {program}: unknown program; allowed: {allowed}")
    return settings


def write_cards(
    fit: "MaterialFit", cards: list[tuple[str, str]], settings: CardSettings
) -> list[dict[str, str]]:
    """Write the cards; one that a program can't have is reported, and stops nothing.

    Args:
        fit: of the law.
        cards: program and file of each.
        settings: of all of them.
    """
    found = []
    for name, file in cards:
        message = ""
        try:
            write_card(fit.material(), name, Path(file), settings)
            if remark := left_out(fit.material(), name):
                message = f"{file}: the card is {remark}"
        except CardError as error:
            message = str(error)
        found.append({"program": name, "file": file, "message": message})
    return found
