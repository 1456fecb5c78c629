"""What is wrong with a stream of readings: frames lost, sent twice, clocks that wrap.

Nothing is corrected or left out but the device clock, which is unwrapped: the log keeps what
came, the flags say what to think of it.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from suas_jax.acquisition.frames.reading import Reading

# Counters and clocks in use, by their width: 8, 16, 24, 32 bit counters; 16 and 32 bit
# milliseconds, 32 bit microseconds.
_SEQ_MODULI = (2**8, 2**16, 2**24, 2**32)
_CLOCK_MODULI = (65.536, 4294.967296, 65536.0, 4294967.296)
# A frame this many frames back is late; further back, the device has started again.
_LATE = 16
# A taxel that keeps its count while its neighbours move for this many frames is stuck.
STUCK_AFTER = 100


class Flags(NamedTuple):
    """The flag columns of a log row.

    Attributes:
        lost: frames of this module missing just before this row.
        duplicate: 1 if the device sent this frame before (same seq).
        repeat: 1 if it is a new frame with the counts of the one before: the sensor had not
            refreshed.
        restart: 1 if the device's counter began again.
        suspect: 1 if the counter and the clock disagree about how far this row is from the
            one before; without a checksum that is a damaged row more often than not.
        stuck: the stuck taxels, bit k - 1 for so_k.
    """

    lost: int = 0
    duplicate: int = 0
    repeat: int = 0
    restart: int = 0
    suspect: int = 0
    stuck: int = 0


@dataclass
class Summary:
    """Totals over a stream."""

    rows: int = 0
    lost: int = 0
    duplicates: int = 0
    repeats: int = 0
    restarts: int = 0
    suspects: int = 0
    stuck: dict[int, list[int]] = field(default_factory=dict)  # module: taxels, from 1


class Integrity:
    """Follows every module of a stream.

    Args:
        clock_modulus: the device clock starts again after this [s]; None if unknown, then a
            usual one is recognised.
        checked: a checksum vouches for the readings, so no row is held to be damaged.
    """

    def __init__(self, clock_modulus: float | None, checked: bool) -> None:
        self.summary = Summary()
        self.checked = checked
        self._clock_modulus = clock_modulus
        self._modules: dict[int, _Module] = {}

    @property
    def modules(self) -> list[int]:
        """The modules seen, ascending."""
        return sorted(self._modules)

    def judge(self, reading: Reading) -> tuple[float, Flags]:
        """The unwrapped device time [s] and the flags of the next reading."""
        module = self._modules.get(reading.module)
        if module is None:
            module = self._modules[reading.module] = _Module(self._clock_modulus)
        t_device, flags = module.judge(reading, self.checked)
        total = self.summary
        total.rows += 1
        if any(flags):
            total.lost += flags.lost
            total.duplicates += flags.duplicate
            total.repeats += flags.repeat
            total.restarts += flags.restart
            total.suspects += flags.suspect
            if flags.stuck:
                bits = range(flags.stuck.bit_length())
                total.stuck[reading.module] = [k + 1 for k in bits if flags.stuck >> k & 1]
        return t_device, flags


class _Module:
    """The last good reading of one module, and what follows from it."""

    def __init__(self, clock_modulus: float | None) -> None:
        self._modulus = clock_modulus
        self._last: Reading | None = None
        self._doubted: Reading | None = None
        self._period = math.nan  # of the device clock, per frame [s]
        self._offset = 0.0  # unwrapped minus raw device clock [s]
        self._frames = 0  # frames in which any taxel moved
        self._moved: list[int] = []  # the value of _frames when each taxel last moved

    def judge(self, reading: Reading, checked: bool) -> tuple[float, Flags]:
        last = self._last
        if last is None:
            self._accept(reading, reading.t_device)
            return reading.t_device, Flags()
        step = _step(last.seq, reading.seq)
        if step == 0:
            repeated = reading.counts == last.counts
            return self._unwrapped(last, reading, 0), Flags(
                duplicate=1, suspect=0 if repeated or checked else 1
            )
        confirmed = 0
        if not checked and self._doubtful(last, reading, step):
            doubted, self._doubted = self._doubted, reading
            # A second one that carries on from the first shows that both are right.
            if doubted is None or _step(doubted.seq, reading.seq) != 1:
                return reading.t_device + self._offset, Flags(suspect=1)
            confirmed = 1
        self._doubted = None
        if -_LATE <= step < 0:
            return self._unwrapped(last, reading, step), Flags()
        restart = step < 0
        if restart:
            self._offset, self._period = 0.0, math.nan
            t_device = reading.t_device
        else:
            t_device = self._unwrapped(last, reading, step)
            self._offset = t_device - reading.t_device
            self._follow_period(last, reading, step)
        repeat, stuck = self._compare(last.counts, reading.counts)
        self._accept(reading, t_device)
        lost = 0 if restart else step - 1 - confirmed
        return t_device, Flags(lost, 0, repeat, int(restart), 0, stuck)

    def _accept(self, reading: Reading, t_device: float) -> None:
        self._last = reading
        if not math.isnan(reading.t_device):
            self._offset = t_device - reading.t_device

    def _follow_period(self, last: Reading, reading: Reading, step: int) -> None:
        period = (reading.t_device - last.t_device) / step
        if period > 0 and step == 1:
            known = not math.isnan(self._period)
            self._period = 0.9 * self._period + 0.1 * period if known else period

    def _doubtful(self, last: Reading, reading: Reading, step: int) -> bool:
        """Whether the counter moved much more, or less, than the clock says."""
        if math.isnan(self._period) or math.isnan(reading.t_device):
            return False
        if step == 1 or (step < 0 and reading.t_device < last.t_device):
            return False  # as expected, or both began again
        frames = (reading.t_device - last.t_device) / self._period
        if frames < 0 < step:
            return step > 1  # a clock that wraps while frames are missing is told by the next
        return abs(frames - step) > max(2.0, 0.5 * abs(step))

    def _unwrapped(self, last: Reading, reading: Reading, step: int) -> float:
        """The device time on the scale of the readings before, the clock's wraps undone."""
        elapsed = reading.t_device - last.t_device
        host = reading.t_host - last.t_host
        host = 0.0 if math.isnan(host) else host
        if self._modulus is not None and not math.isnan(elapsed):
            elapsed += self._modulus * round((host - elapsed) / self._modulus)
        elif elapsed < 0 < step:
            expected = host if math.isnan(self._period) else step * self._period
            wraps = [elapsed + modulus for modulus in _CLOCK_MODULI]
            likely = [w for w in wraps if abs(w - expected) <= 0.5 + 2 * expected]
            # No usual clock: it goes on at the rate it had.
            elapsed = min(likely, key=lambda w: abs(w - expected), default=expected)
        if math.isnan(elapsed):  # the clock is missing, or was
            return reading.t_device + self._offset
        offset = self._offset + elapsed - (reading.t_device - last.t_device)
        return reading.t_device + round(offset, 6)

    def _compare(
        self, before: tuple[int | None, ...], now: tuple[int | None, ...]
    ) -> tuple[int, int]:
        if len(self._moved) != len(now):
            self._moved = [self._frames] * len(now)
        if before == now:
            return 1, 0
        self._frames += 1
        oldest = self._frames - STUCK_AFTER
        stuck = 0
        moved = self._moved
        for k, (a, b) in enumerate(zip(before, now, strict=False)):
            if a != b or b is None:
                moved[k] = self._frames
            elif moved[k] <= oldest:
                stuck |= 1 << k
        return 0, stuck


def _step(before: int, now: int) -> int:
    """Frames from one number to another, over the wrap of a counter of a usual width."""
    step = now - before
    if step >= 0:
        return step
    for modulus in _SEQ_MODULI:
        if before < modulus and step % modulus <= min(_LATE, modulus // 16):
            return step % modulus
    return step
