"""Options whose values have a name of their own: NAME=VALUE, and what stands for VALUE."""


def named_values(text: str | None, option: str, example: str) -> dict[str, str]:
    """Values by name of an option such as --specimen "width=6 mm,thickness=2 mm".

    Raises:
        ValueError: a part is no NAME=VALUE.
    """
    values = {}
    for part in (text or "").split(","):
        if not part.strip():
            continue
        name, equals, value = part.partition("=")
        if not equals or not value.strip():
            raise ValueError(f'{option} {text}: expected "{example}"')
        values[name.strip()] = value.strip()
    return values


def named_file(
    text: str, option: str = "--data", example: str = "uniaxial=A.csv"
) -> tuple[str, str]:
    """Name and file of an option such as --data uniaxial=A.csv.

    Raises:
        ValueError: the name or the file is missing.
    """
    mode, equals, path = text.partition("=")
    if not equals or not path:
        raise ValueError(f"{option} {text}: expected NAME=FILE, for example {example}")
    return mode.strip(), path.strip()


def named_bounds(text: str) -> tuple[str, tuple[float, float]]:
    """Name and bounds of an option such as --bound alpha.0=1:3; either may be left open.

    Raises:
        ValueError: it is no NAME=LOW:HIGH, or the bounds leave nothing between them.
    """
    name, _, limits = text.partition("=")
    low, colon, high = limits.partition(":")
    try:
        if not colon:
            raise ValueError
        ends = (float(low or "-inf"), float(high or "inf"))
    except ValueError:
        raise ValueError(
            f"--bound {text}: expected NAME=LOW:HIGH in SI units, for example alpha.0=1:3"
        ) from None
    if not ends[0] < ends[1]:
        raise ValueError(f"--bound {text}: the lower bound must be below the upper one")
    return name.strip(), ends
