"""A CAN bus as a source of bytes, over python-can (`pip install suas-jax[can]`)."""

import contextlib
import os
import struct
import time
from typing import Any

from suas_jax.acquisition.ports.serial_port import PortError

# A CAN message as the source hands it over: identifier, time stamp [s], length, data.
RECORD = struct.Struct("<IdB8s")
_BITRATE = 1_000_000  # the iCub's
_READ_TIMEOUT = 0.1  # [s]
_MOST_AT_ONCE = 512


class CanSource:
    """An open CAN bus, see `Source`.

    `name`: `socketcan:can0`, `slcan:/dev/ttyACM0`; without a prefix, a device file or URL is
    taken for slcan, any other name for socketcan. `baud`: of an slcan adapter's serial line.
    Raises PortError: it can't be opened, or python-can is not installed.
    """

    is_network = False

    def __init__(self, name: str, baud: int) -> None:
        self.name = name
        self._baud = baud
        kind, colon, channel = name.partition(":")
        if not colon or kind not in ("slcan", "socketcan"):
            kind, channel = ("slcan" if "/" in name or "COM" in name else "socketcan"), name
        self._kind, self._channel = kind, channel
        self._bus = self._open()

    def reopen(self) -> None:
        """Open it again after it was lost."""
        self.close()
        self._bus = self._open()

    def read(self) -> bytes:
        """Messages that have come, after waiting for the first at most 0.1 s."""
        return self._received(_READ_TIMEOUT)

    def waiting(self) -> bytes:
        """Messages that are there already."""
        try:
            return self._received(0.0)
        except PortError:
            return b""

    def is_gone(self) -> bool:
        """Whether the adapter's device file is no longer there."""
        return (
            self._kind == "slcan"
            and "://" not in self._channel
            and not os.path.exists(self._channel)
        )

    def close(self) -> None:
        """Leave the bus; never fails."""
        with contextlib.suppress(Exception):  # an adapter that is gone can't be closed well
            self._bus.shutdown()

    def _received(self, timeout: float) -> bytes:
        from can import CanError

        records: list[bytes] = []
        while len(records) < _MOST_AT_ONCE:
            try:
                message = self._bus.recv(0.0 if records else timeout)
            except ValueError:  # python-can: a damaged slcan line
                records.append(RECORD.pack(0x300, 0.0, 0, b""))
                continue
            except (CanError, OSError, TypeError) as error:
                if records:
                    break
                raise PortError(f"{self.name}: the bus was lost ({error})") from None
            if message is None:
                break
            if message.is_error_frame or message.is_remote_frame or message.is_extended_id:
                continue
            data = bytes(message.data)[:8]
            stamp = message.timestamp or time.time()
            records.append(RECORD.pack(message.arbitration_id, stamp, len(data), data))
        return b"".join(records)

    def _open(self) -> Any:
        try:
            import can
        except ImportError:
            raise PortError(
                'the format "roboskin" needs python-can: pip install "suas-jax[can]"'
            ) from None
        options: dict[str, Any] = {"interface": self._kind, "channel": self._channel}
        if self._kind == "slcan":
            options |= {
                "tty_baudrate": self._baud,
                "bitrate": _BITRATE,
                "sleep_after_open": 0.0,
            }
        try:
            return can.Bus(**options)
        except (can.CanError, OSError, ValueError) as error:
            raise PortError(
                f"{self.name}: the CAN bus can't be opened ({error}); a bus is named "
                "socketcan:can0 (bring it up first: ip link set can0 up type can bitrate "
                "1000000) or slcan:/dev/ttyACM0"
            ) from None
