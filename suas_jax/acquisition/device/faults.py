"""What goes wrong on the way from a device to a host, on demand and repeatably."""

import math
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from suas_jax.acquisition.frames.reading import Reading

# The device's clock counts microseconds in 32 bits [s].
_CLOCK_MODULUS = 2**32 * 1e-6
_ALLOWED = (
    "corrupt=P, drop=P, duplicate=P (probabilities from 0 to 1), unplug=AT or unplug=AT:FOR, "
    "clock-wrap=AT, clock-jump=AT:BY or clock-jump=AT:BY:FOR, restart=AT (seconds), "
    "taxels=AT:N, stuck=MODULE/TAXEL, seed=N"
)


@dataclass(frozen=True)
class Faults:
    """What goes wrong, on demand."""

    corrupt: float = 0.0  # probability that a byte is changed to another one
    drop: float = 0.0  # probability that a row is not sent
    duplicate: float = 0.0  # probability that a row is sent twice
    # the port vanishes this long after the start [s]; None: never
    unplug_at: float | None = None
    unplug_for: float = 1.0  # and comes back after this long [s]
    # the device's clock starts so that it wraps after this long [s]
    wrap_clock_at: float | None = None
    # time after which the device's clock jumps, by how much, and for how long [s]
    clock_jump: tuple[float, float, float] | None = None
    restart_at: float | None = None  # counter and clock begin again after this long [s]
    # time after which every module sends so many counts only [s]
    taxels_at: tuple[float, int] | None = None
    # taxels (module, taxel from 1) that keep their first count
    stuck: tuple[tuple[int, int], ...] = ()
    seed: int = 0  # of all random faults

    def __post_init__(self) -> None:
        for name in ("corrupt", "drop", "duplicate"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"fault {name} = {value}: a probability from 0 to 1")


_READ: dict[str, Callable[[str], dict[str, Any]]] = {
    "corrupt": lambda text: {"corrupt": float(text)},
    "drop": lambda text: {"drop": float(text)},
    "duplicate": lambda text: {"duplicate": float(text)},
    "unplug": lambda text: _unplug(*map(float, text.split(":"))),
    "clock-wrap": lambda text: {"wrap_clock_at": float(text)},
    "clock-jump": lambda text: {"clock_jump": _jump(*map(float, text.split(":")))},
    "restart": lambda text: {"restart_at": float(text)},
    "taxels": lambda text: {"taxels_at": _pair(text, ":", float)},
    "stuck": lambda text: {"stuck": (_pair(text, "/", int),)},
    "seed": lambda text: {"seed": int(text)},
}
"""What the value of each fault says."""


def _unplug(at: float, away: float = 1.0) -> dict[str, float]:
    return {"unplug_at": at, "unplug_for": away}


def _jump(at: float, by: float, lasting: float = math.inf) -> tuple[float, float, float]:
    return at, by, lasting


def _pair(text: str, between: str, first: Callable[[str], Any]) -> tuple[Any, int]:
    at, count = text.split(between)
    return first(at), int(count)


def parse_faults(texts: Iterable[str]) -> Faults:
    """Faults from the command line, each `NAME=VALUE`.

    Raises ValueError: naming what is allowed.
    """
    values: dict[str, Any] = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            found = _READ[name](value)
        except (KeyError, TypeError, ValueError):
            raise ValueError(f'--fault "{text}": allowed are {_ALLOWED}') from None
        if name == "stuck":
            found["stuck"] = values.get("stuck", ()) + found["stuck"]
        values |= found
    return Faults(**values)


class Injector:
    """Applies faults to what a device sends; the same seed gives the same faults."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._random = random.Random(faults.seed)
        self._until_damage = self._next_damage()
        self._stuck: dict[tuple[int, int], int | None] = {}
        self._first: float | None = None  # device time of the first reading [s]
        self._again: Reading | None = None  # first reading after the device's restart

    def copies(self) -> int:
        """How often the next row is sent: 0, 1 or 2 times."""
        faults = self._faults
        if faults.drop and self._random.random() < faults.drop:
            return 0
        if faults.duplicate and self._random.random() < faults.duplicate:
            return 2
        return 1

    def distorted(self, reading: Reading) -> Reading:
        """The reading as the device sends it: clock, counter and counts with their faults."""
        faults = self._faults
        self._first = reading.t_device if self._first is None else self._first
        since = reading.t_device - self._first
        if faults.taxels_at is not None and since >= faults.taxels_at[0]:
            reading = reading._replace(counts=reading.counts[: faults.taxels_at[1]])
        if faults.clock_jump is not None:
            at, by, lasting = faults.clock_jump
            if at <= since < at + lasting:
                reading = reading._replace(t_device=reading.t_device + by)
        if faults.restart_at is not None and since >= faults.restart_at:
            self._again = again = self._again or reading
            reading = reading._replace(
                seq=reading.seq - again.seq, t_device=reading.t_device - again.t_device
            )
        if faults.wrap_clock_at is not None:
            shifted = reading.t_device + _CLOCK_MODULUS - faults.wrap_clock_at
            reading = reading._replace(t_device=shifted % _CLOCK_MODULUS)
        if faults.stuck:
            counts = list(reading.counts)
            for module, taxel in faults.stuck:
                if module == reading.module and taxel <= len(counts):
                    key = (module, taxel)
                    counts[taxel - 1] = self._stuck.setdefault(key, counts[taxel - 1])
            reading = reading._replace(counts=tuple(counts))
        return reading

    def damaged(self, data: bytes) -> bytes:
        """The next bytes of the stream, some changed."""
        if self._until_damage >= len(data):
            self._until_damage -= len(data)
            return data
        changed = bytearray(data)
        while self._until_damage < len(data):
            changed[self._until_damage] ^= self._random.randrange(1, 256)
            self._until_damage += 1 + self._next_damage()
        self._until_damage -= len(data)
        return bytes(changed)

    def _next_damage(self) -> int:
        """Bytes until the next one to damage: geometric, one draw per damaged byte."""
        p = self._faults.corrupt
        if p == 0.0:
            return 2**62
        if p == 1.0:
            return 0
        return int(math.log(1.0 - self._random.random()) / math.log1p(-p))
