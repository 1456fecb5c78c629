"""A device's clock: its wraps and jumps undone, so that time goes on at its rate.

A clock of few bits starts again at zero, and some clocks jump. What a clock says is believed
while it agrees with the frame counter or with the host's clock; otherwise it has jumped.
"""

import math

from suas_jax.acquisition.frames.reading import Reading

# Clocks in use, by their width: 16 and 32 bit milliseconds, 32 bit microseconds.
_MODULI = (65.536, 4294.967296, 65536.0, 4294967.296)
# A clock agrees with the counter, or with the host's clock, to within these shares of the
# time that passed, and this much beyond.
_COUNTER_SHARE, _COUNTER_FRAMES = 0.5, 2.0
_HOST_SHARE, _HOST_DELAY = 0.05, 0.1  # [s]
_SAME_OFFSET = 1e-6  # [s]


class DeviceClock:
    """The clock of one module's readings; `period` [s], from frame to frame, is NaN at first.

    Args:
        modulus: the clock starts again after this [s]; None if unknown, then a usual one is
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
        """The device time on the scale of the readings before, and whether the clock jumped.

        Wraps are undone. A clock that agrees neither with the counter nor with the host has
        jumped: the time before the jump is tried again, else time goes on at its rate.

        Args:
            last: the last good reading.
            reading: the next one.
            step: frames from the one to the other.
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
