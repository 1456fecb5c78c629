"""Open a serial port, by any of its names, and say plainly why it can't be opened.

A port is a device file (`/dev/ttyUSB0`, `COM3`), a URL of pyserial (`socket://host:port`), or a
USB device by its numbers, `VID:PID` or `VID:PID:SERIAL`, wherever it is plugged in.
"""

import contextlib
import errno
import os
import re
import select
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import serial
from serial.urlhandler import protocol_socket

_USB = re.compile(r"([0-9A-Fa-f]{4}):([0-9A-Fa-f]{4})(?::(.+))?")
# How long a blocking read waits, so that a request to stop is soon seen [s].
_READ_TIMEOUT = 0.1
_MOST_AT_ONCE = 65536


class PortError(OSError):
    """A port can't be opened or was lost; the message says what to try."""


class _DeviceFile(serial.Serial):
    """A device file whose waiting bytes are kept when it is opened: they are data."""

    def _reset_input_buffer(self) -> None:
        pass


class _Socket(protocol_socket.Serial):
    """A `socket://` port that keeps what comes first, and what came before its end."""

    def reset_input_buffer(self) -> None:
        pass

    def read(self, size: int = 1) -> bytes:
        if not select.select([self._socket], [], [], self._timeout)[0]:
            return b""
        data = self._socket.recv(size)
        if not data:
            raise serial.SerialException("the other end closed it")
        return bytes(data)


class Source(Protocol):
    """Where bytes come from: a serial port, a CAN bus."""

    name: str

    @property
    def is_network(self) -> bool:
        """Whether a silent link may be dead without an error."""

    def read(self) -> bytes:
        """Bytes that have come, possibly none after a short wait; PortError when lost."""

    def waiting(self) -> bytes:
        """Bytes that are there already; never fails."""

    def reopen(self) -> None:
        """Open it again; PortError while that is not possible."""

    def is_gone(self) -> bool:
        """Whether it was unplugged without an error."""

    def close(self) -> None:
        """Let go of it; never fails."""


@dataclass(frozen=True)
class UsbIdentity:
    """What stays the same when a USB device is plugged in again."""

    vid: int
    pid: int
    serial_number: str | None

    def __str__(self) -> str:
        number = f":{self.serial_number}" if self.serial_number else ""
        return f"{self.vid:04x}:{self.pid:04x}{number}"

    def find(self, before: str) -> str | None:
        """The device file it has now; None while it isn't plugged in.

        Of several devices that can't be told apart, the one with the name it had `before`.
        """
        from serial.tools.list_ports import comports

        found = [
            str(port.device)
            for port in comports()
            if (port.vid, port.pid) == (self.vid, self.pid)
            and self.serial_number in (None, port.serial_number)
        ]
        return before if before in found else next(iter(found), None)


class SerialSource:
    """An open port.

    `name`: device file, pyserial URL or VID:PID[:SERIAL]. `baud`: bits per second.
    Raises PortError: it can't be opened.
    """

    def __init__(self, name: str, baud: int) -> None:
        self.name = name
        usb = _USB.fullmatch(name)
        self.usb = UsbIdentity(int(usb[1], 16), int(usb[2], 16), usb[3]) if usb else None
        self._baud = baud
        self._port = self._open()
        if self.usb is None:
            self.usb = _identity(name)

    @property
    def is_network(self) -> bool:
        """Whether a silent link may be dead without an error."""
        return "://" in self.name and not self.name.startswith("loop://")

    def reopen(self) -> None:
        """Open it again after it was lost; the same USB device, wherever it is now."""
        self.close()
        self._port = self._open()

    def read(self) -> bytes:
        """Bytes that have come, after waiting for the first at most 0.1 s; often empty."""
        try:
            # A socket can't say how much is waiting, but returns what there is.
            data = bytes(self._port.read(_MOST_AT_ONCE if self._by_socket else 1))
            return data + self.waiting() if data and not self._by_socket else data
        except (OSError, TypeError) as error:  # pyserial: TypeError when closed meanwhile
            # pyserial's words for a device that is gone speak of something else.
            why = "the device went away" if "readiness" in str(error) else error
            raise PortError(f"{self.name}: the connection was lost ({why})") from None

    def waiting(self) -> bytes:
        """Bytes that are there already."""
        try:
            if self._by_socket:
                return bytes(self._port.read(_MOST_AT_ONCE)) if self._port.in_waiting else b""
            waiting = min(self._port.in_waiting, _MOST_AT_ONCE)
            return bytes(self._port.read(waiting)) if waiting else b""
        except (OSError, TypeError):
            return b""  # the next read says so

    def is_gone(self) -> bool:
        """Whether the device file no longer is the one that was opened."""
        try:
            descriptor = os.fstat(self._port.fileno())
            return os.stat(self._port.port).st_rdev != descriptor.st_rdev
        except (AttributeError, OSError, TypeError, ValueError):
            return not self.is_network and not os.path.exists(str(self._port.port))

    def close(self) -> None:
        """Close the port; never fails."""
        with contextlib.suppress(Exception):  # a device that is gone can't be closed well
            self._port.close()

    def _open(self) -> Any:
        path = self.name
        if self.usb is not None:
            found = self.usb.find(self.name)
            if found is None:
                raise PortError(f"{self.name}: no such USB device is plugged in; {_ports()}")
            path = found
        self._by_socket = path.startswith("socket://")
        try:
            if self._by_socket:
                return _Socket(path, self._baud, timeout=_READ_TIMEOUT)
            if "://" in path:
                return serial.serial_for_url(path, self._baud, timeout=_READ_TIMEOUT)
            return _DeviceFile(path, self._baud, timeout=_READ_TIMEOUT, exclusive=True)
        except (OSError, ValueError) as error:
            raise PortError(_why(self.name, path, self._baud, error)) from None


def _identity(path: str) -> UsbIdentity | None:
    if "://" in path:
        return None
    from serial.tools.list_ports import comports

    real = os.path.realpath(path)
    for port in comports():
        if os.path.realpath(port.device) == real and port.vid is not None:
            return UsbIdentity(port.vid, port.pid, port.serial_number)
    return None


def _ports() -> str:
    from serial.tools.list_ports import comports

    names = [str(port.device) for port in comports() if port.hwid != "n/a"]
    return f"ports here: {', '.join(names)}" if names else "no serial port is plugged in here"


def _why(name: str, path: str, baud: int, error: Exception) -> str:
    """The reason in the user's words, and what to try."""
    number = getattr(error, "errno", None)
    text = str(error)
    if "://" in path:
        return (
            f"{name}: can't connect ({text}); check the address and that the device or its "
            "server is on and has no other client"
        )
    if number == errno.ENOENT or not os.path.exists(path):
        return f"{name}: no such port; {_ports()}. Check the cable and the name"
    if number in (errno.EACCES, errno.EPERM, errno.EROFS):
        return (
            f"{name}: no permission to read and write (it may be read-only for you); join the "
            "group that owns it (often dialout), then log in again"
        )
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
        return f"{name}: busy, another program has it open; end that program{_holders(path)}"
    if number in (errno.ENXIO, errno.ENODEV, errno.EIO):
        return f"{name}: the file is there but no device answers behind it; plug it in again"
    if "baud" in text.lower():
        return f"{name}: the port can't do {baud} baud; try --baud 115200 or another rate"
    if Path(path).is_dir() or Path(path).is_file() or "ioctl" in text or number in (22, 25):
        return f"{name}: not a serial port; {_ports()}"
    return f"{name}: can't be opened ({text})"


def _holders(path: str) -> str:
    """Which processes have the file open, as far as this user may see it."""
    real, holders = os.path.realpath(path), []
    for process in Path("/proc").glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        with contextlib.suppress(OSError):
            if any(os.path.realpath(link) == real for link in (process / "fd").iterdir()):
                command = (process / "comm").read_text().strip()
                holders.append(f"{command} (process {process.name})")
    return f": {', '.join(holders)}" if holders else ""
