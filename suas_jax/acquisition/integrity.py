"""What is wrong with a stream of readings: frames lost, sent twice, clocks that wrap or jump.

Nothing is corrected or left out but the device clock, whose wraps and jumps are undone: the
log keeps what came, the flags say what to think of it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from suas_jax.acquisition.frames.reading import Reading
from suas_jax.acquisition.taxel_faults import STUCK_AFTER

# Clocks in use, by their width: 16 and 32 bit milliseconds, 32 bit microseconds.
_MODULI = (65.536, 4294.967296, 65536.0, 4294967.296)
# A clock agrees with the counter, or with the host's clock, to within these shares of the
# time that passed, and this much beyond.
_COUNTER_SHARE, _COUNTER_FRAMES = 0.5, 2.0
_HOST_SHARE, _HOST_DELAY = 0.05, 0.1  # [s]
_SAME_OFFSET = 1e-6  # [s]


class DeviceClock:
    """The clock of one module's readings; `period` [s], from frame to frame, is NaN at first.

    A clock of few bits starts again at zero, and some jump. What a clock says is believed while
    it agrees with the frame counter or with the host's clock; otherwise it has jumped.

    `modulus`: the clock starts again after this [s]; None if unknown, then a usual one is
    recognised.
    """

    def __init__(self, modulus: float | None) -> None:
        self.period = math.nan
        self._modulus = modulus
        self._offset = 0.0  # corrected minus raw device clock [s]
        self._lasting: float | None = None  # the same before the clock jumped

    def restart(self) -> None:
        """Forget everything: the device has started again."""
        self._offset, self._lasting, self.period = 0.0, None, math.nan

    def on_scale(self, reading: Reading) -> float:
        """The device time of a reading that nothing is concluded from [s]."""
        return reading.t_device + self._offset

    def time_of(self, last: Reading, reading: Reading, step: int) -> tuple[float, bool]:
        """The device time on the scale of the last good reading, and whether the clock jumped.

        Wraps are undone. A clock that agrees neither with the counter (`step` frames) nor with
        the host has jumped: the time before the jump is tried again, else time goes on at its
        rate.
        """
        before = last.t_device + self._offset
        elapsed = reading.t_device - last.t_device
        host = reading.t_host - last.t_host
        if math.isnan(elapsed):  # the clock is missing, or was
            return reading.t_device + self._offset, False
        if self._modulus is not None:
            expected = step * self.period if math.isnan(host) else host
            if not math.isnan(expected):
                elapsed += self._modulus * round((expected - elapsed) / self._modulus)
        elif elapsed < 0 < step:
            wraps = [elapsed + modulus for modulus in _MODULI]
            elapsed = next((w for w in wraps if self._plausible(w, step, host)), elapsed)
        if self._plausible(elapsed, step, host):
            # Rounded, so that what a clock counts in microseconds reads as it was sent.
            offset = self._offset + elapsed - (reading.t_device - last.t_device)
            return reading.t_device + round(offset, 6), False
        if self._lasting is not None:
            ended = reading.t_device + self._lasting
            if self._plausible(ended - before, step, host):
                return ended, True
        passed = host if math.isnan(self.period) else step * self.period
        return before + (0.0 if math.isnan(passed) else passed), True

    def follow(
        self, last: Reading, reading: Reading, step: int, t_device: float, jumped: bool
    ) -> None:
        """Keep what the next reading's clock is judged by; the time is that of `time_of`."""
        offset = t_device - reading.t_device
        if math.isnan(offset):
            return
        if not jumped:
            if self._lasting is not None:  # a wrap moves both
                self._lasting += offset - self._offset
        elif self._lasting is None:
            self._lasting = self._offset
        elif abs(offset - self._lasting) < _SAME_OFFSET:
            offset, self._lasting = self._lasting, None
        elapsed = t_device - last.t_device - self._offset
        self._offset = offset
        if elapsed > 0 and step == 1 and not jumped:
            known = not math.isnan(self.period)
            self.period = 0.9 * self.period + 0.1 * elapsed if known else elapsed

    def _plausible(self, elapsed: float, step: int, host: float) -> bool:
        """Whether so much time may have passed on the device's clock [s]."""
        by_counter = step * self.period
        if math.isnan(by_counter):
            return elapsed >= 0 or step <= 0
        frames = abs(elapsed - by_counter) / self.period
        if frames <= _COUNTER_SHARE * abs(step) + _COUNTER_FRAMES:
            return elapsed >= 0 or step <= 0
        if math.isnan(host) or elapsed < 0:
            return False
        return abs(elapsed - host) <= _HOST_DELAY + _HOST_SHARE * host


# Counters in use, by their width: 8, 16, 24, 32 bit.
_SEQ_MODULI = (2**8, 2**16, 2**24, 2**32)
# A frame this many frames back is late; further back, the device has started again.
_LATE = 16
# Sentences about one kind of event; what comes after is flagged and counted all the same.
_MOST_SENTENCES = 5


class Flags(NamedTuple):
    """The flag columns of a log row."""

    lost: int = 0  # frames of this module missing just before this row
    duplicate: int = 0  # 1 if the device sent this frame before (same seq)
    # 1 if it is a new frame with the counts of the one before: the sensor had not refreshed
    repeat: int = 0
    # 1 if the device's counter, or the recording (`suas log --append`), began again
    restart: int = 0
    # 1 if the counter and the clock disagree about how far this row is from the one before;
    # without a checksum that is a damaged row more often than not
    suspect: int = 0
    stuck: int = 0  # the stuck taxels, bit k - 1 for so_k
    # 1 if the device's clock jumped, forwards or back, or came back from a jump; the device
    # time goes on at its rate
    clock_jump: int = 0
    # number of counts in this row where that is not its module's; which taxels they are of is
    # unknown
    other_taxels: int = 0


@dataclass
class Summary:
    """Totals over a stream."""

    rows: int = 0
    lost: int = 0
    duplicates: int = 0
    repeats: int = 0
    restarts: int = 0
    suspects: int = 0
    clock_jumps: int = 0  # frames, not rows
    other_taxels: int = 0  # rows
    stuck: dict[int, list[int]] = field(default_factory=dict)  # module: taxels, from 1


class Integrity:
    """Follows every module of a stream."""

    def __init__(
        self,
        clock_modulus: float | None,  # see `DeviceClock`
        checked: bool,  # a checksum vouches for the readings, so no row is held to be damaged
        *,
        # how many a module has, by module, as the skin file says; what a module sends first,
        # where that is unknown
        taxels: Mapping[int, int] | None = None,
        # the readings continue an earlier recording: the first of every module is flagged as a
        # restart
        resumed: bool = False,
    ) -> None:
        self.summary = Summary()
        self.checked = checked
        self._clock_modulus = clock_modulus
        self._taxels = dict(taxels or {})
        self._resumed = resumed
        self._modules: dict[int, _Module] = {}
        self._jumped: int | None = None  # number of the frame whose clock jumped last
        self._sentences: list[str] = []
        self._said: dict[str, int] = {}

    @property
    def modules(self) -> list[int]:
        """The modules seen, ascending."""
        return sorted(self._modules)

    def judge(self, reading: Reading) -> tuple[float, Flags]:
        """The corrected device time [s] and the flags of the next reading."""
        module = self._modules.get(reading.module)
        first = module is None
        if module is None:
            taxels = self._taxels.setdefault(reading.module, len(reading.counts))
            module = self._modules[reading.module] = _Module(self._clock_modulus, taxels)
        t_device, flags = module.judge(reading, self.checked)
        total = self.summary
        total.rows += 1
        if any(flags):
            total.lost += flags.lost
            total.duplicates += flags.duplicate
            total.repeats += flags.repeat
            total.restarts += flags.restart
            total.suspects += flags.suspect
            if flags.clock_jump:
                self._note_jump(reading, t_device)
            if flags.other_taxels:
                self._note_taxels(reading, module.taxels)
            if flags.stuck:
                bits = range(flags.stuck.bit_length())
                total.stuck[reading.module] = [k + 1 for k in bits if flags.stuck >> k & 1]
        if first and self._resumed:
            flags = flags._replace(restart=1)
        return t_device, flags

    def sentences(self) -> list[str]:
        """What a person should know of the readings judged since the last call."""
        said, self._sentences = self._sentences, []
        return said

    def _note_jump(self, reading: Reading, t_device: float) -> None:
        if reading.seq == self._jumped:
            return  # another module of the same frame
        self._jumped = reading.seq
        self.summary.clock_jumps += 1
        self._say(
            "clock",
            f"the device's clock jumped at frame {reading.seq}: it says {reading.t_device:.6g} "
            f"s where {t_device:.6g} s is expected; t_device_s goes on, t_device_raw_s keeps "
            "what came",
        )

    def _note_taxels(self, reading: Reading, expected: int) -> None:
        self.summary.other_taxels += 1
        self._say(
            f"taxels of {reading.module}",
            f"module {reading.module} sends {len(reading.counts)} counts instead of {expected} "
            f"from frame {reading.seq} on: such rows are flagged other_taxels and not used",
            most=1,
        )

    def _say(self, kind: str, sentence: str, most: int = _MOST_SENTENCES) -> None:
        self._said[kind] = self._said.get(kind, 0) + 1
        if self._said[kind] <= most:
            self._sentences.append(sentence)


class _Module:
    """The last good reading of one module of so many taxels, and what follows from it."""

    def __init__(self, clock_modulus: float | None, taxels: int) -> None:
        self.taxels = taxels
        self._clock = DeviceClock(clock_modulus)
        self._last: Reading | None = None
        self._doubted: Reading | None = None
        self._frames = 0  # frames in which any taxel moved
        self._moved: list[int] = []  # the value of _frames when each taxel last moved

    def judge(self, reading: Reading, checked: bool) -> tuple[float, Flags]:
        t_device, flags = self._in_sequence(reading, checked)
        if len(reading.counts) != self.taxels:
            flags = flags._replace(other_taxels=len(reading.counts), repeat=0, stuck=0)
        return t_device, flags

    def _in_sequence(self, reading: Reading, checked: bool) -> tuple[float, Flags]:
        last = self._last
        if last is None:
            self._last = reading
            return reading.t_device, Flags()
        step = _step(last.seq, reading.seq)
        if step == 0:
            repeated = reading.counts == last.counts
            return self._clock.time_of(last, reading, 0)[0], Flags(
                duplicate=1, suspect=0 if repeated or checked else 1
            )
        confirmed = 0
        if not checked and self._doubtful(last, reading, step):
            doubted, self._doubted = self._doubted, reading
            # A second one that carries on from the first shows that both are right.
            if doubted is None or _step(doubted.seq, reading.seq) != 1:
                return self._clock.on_scale(reading), Flags(suspect=1)
            confirmed = 1
        self._doubted = None
        if -_LATE <= step < 0:
            return self._clock.time_of(last, reading, step)[0], Flags()
        restart = step < 0
        jumped = False
        if restart:
            self._clock.restart()
            t_device = reading.t_device
        else:
            t_device, jumped = self._clock.time_of(last, reading, step)
            self._clock.follow(last, reading, step, t_device, jumped)
        repeat, stuck = self._compare(last.counts, reading.counts)
        self._last = reading
        lost = 0 if restart else step - 1 - confirmed
        return t_device, Flags(lost, 0, repeat, int(restart), 0, stuck, int(jumped))

    def _doubtful(self, last: Reading, reading: Reading, step: int) -> bool:
        """Whether the counter moved much more, or less, than the clock says."""
        period = self._clock.period
        if math.isnan(period) or math.isnan(reading.t_device):
            return False
        if step == 1 or (step < 0 and reading.t_device < last.t_device):
            return False  # as expected, or both began again
        frames = (reading.t_device - last.t_device) / period
        if frames < 0 < step:
            return step > 1  # a clock that wraps while frames are missing is told by the next
        return abs(frames - step) > max(2.0, 0.5 * abs(step))

    def _compare(
        self, before: tuple[int | None, ...], now: tuple[int | None, ...]
    ) -> tuple[int, int]:
        if len(before) != len(now):
            return 0, 0
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
