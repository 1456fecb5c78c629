"""Options that commands have for pads in three dimensions."""

from fitting.cli.quantity_option import quantity_of


def pad_settings(diameter: str | None, pressure_noise: str | None) -> dict[str, float | None]:
    """What options say of contacts and pressure, in SI units; those given alone.

    Args:
        diameter: a length, or "free", which is None in the result.
        pressure_noise: a pressure.

    Raises:
        ValueError: an option can't be understood.
    """
    settings: dict[str, float | None] = {}
    if diameter is not None:
        free = diameter == "free"
        settings["diameter"] = None if free else quantity_of("--diameter", diameter, "length")
    if pressure_noise is not None:
        noise = quantity_of("--pressure-noise", pressure_noise, "pressure")
        settings["pressure_noise"] = noise
    return settings
