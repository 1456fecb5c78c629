"""The SO log's format: what writer and reader share."""

from datetime import UTC, datetime

FORMAT = "suas-so-log"
FORMAT_VERSION = 1
MAX_COUNT = 65535
UNITS = f"t_host_s and t_device_s in seconds, so_k in raw counts (0 to {MAX_COUNT})"
# The paper's Eq. 2: one count is 3.05e-16 F.
DEFAULT_SCALE = "0.305 fF"
KEY_COLUMNS = ("t_host_s", "t_device_s", "seq", "module")
RAW_CLOCK = "t_device_raw_s"
"""Column of the device's clock as it came, before wraps and jumps were undone [s]."""
MEASURED = ("oil_pressure_Pa", RAW_CLOCK)
"""Columns of numbers beside the counts; other further columns are flags."""
# Header key, and comment at the end, that name the next part of a rotated log.
CONTINUED = "continued_in"
# Comment where a recording went on in the same file.
APPENDED = "appended"


class LogFileError(ValueError):
    """A log that can't be read: names the file, the line and the column."""


def log_header(
    *,
    skin: str = "not given",
    scale: str = DEFAULT_SCALE,
    start_time: datetime | None = None,
    **more: str,
) -> dict[str, str]:
    """The header that every log carries, in its order; `more` adds keys after it."""
    start = datetime.now(UTC) if start_time is None else start_time
    if start.tzinfo is None:
        raise ValueError(f"start_time = {start}: a time zone is needed, such as UTC")
    return {
        "format": FORMAT,
        "format_version": str(FORMAT_VERSION),
        "start_time": start.isoformat(timespec="microseconds"),
        "skin": skin,
        "scale": scale,
        "units": UNITS,
    } | more
