"""What a page may wish: a slider's value, a place in a log, to play or to stop."""

from typing import Any


def understood(message: dict[str, Any], description: dict[str, Any]) -> tuple[str, Any] | None:
    """Name and value of a wish; None where the message is none.

    Values are kept within what the description of the skin allows.

    Args:
        message: of a page.
        description: of the skin and its controls, as the page got it.
    """
    kind, value = message.get("type"), message.get("value")
    if kind == "set":
        sliders = {slider["name"]: slider for slider in description.get("sliders", ())}
        slider = sliders.get(str(message.get("name")))
        if slider is None or not isinstance(value, int | float):
            return None
        return slider["name"], _within(value, slider["least"], slider["most"])
    if kind == "play" and isinstance(value, bool):
        return "play", value
    timeline = description.get("timeline")
    if timeline and isinstance(value, int | float):
        if kind == "seek":
            return "seek", _within(value, timeline["first"], timeline["last"])
        if kind == "speed" and value in timeline["speeds"]:
            return "speed", float(value)
    return None


def _within(value: float, least: float, most: float) -> float:
    """The value, or the end that it is beyond; the least where it is no number."""
    # Compared as it is: a whole number of 400 digits can't be converted.
    return float(min(max(value, least), most)) if value == value else least
