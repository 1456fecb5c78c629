"""Loads for another process: JSON lines over TCP, the newest first to be sent.

A client connects, sends the server's token as a line, and reads lines, which are those of
`suas invert --json`. One that reads too slowly misses lines (their `seq` shows it), and delays
neither the estimate nor others. One that does not send the token is sent nothing.
"""

import contextlib
import socket
import threading
import time
from collections import deque
from typing import Self

from fitting.credential import LONGEST, is_token, own_token
from fitting.inverse_load.live.stream import LiveFrame, LiveWatcher, json_line

_WAITING = 4  # lines kept for a client that is busy
_MOST_CLIENTS = 16
_STALLED = 5.0  # a client that takes nothing, or shows no token, for so long is left [s]


class LineServer(LiveWatcher):
    """Sends a line a frame to every client.

    It listens at an address HOST:PORT; port 0 takes a free one.
    Raises ValueError: the address is none, or the environment's token is.
    Raises OSError: it can't be listened at.
    """

    def __init__(self, address: str) -> None:
        self.token = own_token()  # what a client sends first, with a line feed behind it
        self._listener = socket.create_server(host_and_port(address, "--serve"))
        # the host and port that it listens at
        self.address: tuple[str, int] = self._listener.getsockname()[:2]
        self._clients: dict[socket.socket, deque[bytes]] = {}
        self._strangers = threading.BoundedSemaphore(_MOST_CLIENTS)
        self._news = threading.Condition()
        self._open = True

    def __enter__(self) -> Self:
        threading.Thread(target=self._accept, name="suas serve", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._news:
            self._open = False
            self._news.notify_all()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # wakes the thread that accepts
        self._listener.close()

    def estimated(self, frame: LiveFrame) -> None:
        """Hand a frame's line to every client."""
        with self._news:
            if not self._clients:
                return
            line = (json_line(frame) + "\n").encode()
            for waiting in self._clients.values():
                waiting.append(line)
            self._news.notify_all()

    def _accept(self) -> None:
        while self._open:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            if not self._strangers.acquire(blocking=False):
                client.close()
                continue
            threading.Thread(
                target=self._send, args=(client,), name="suas serve client", daemon=True
            ).start()

    def _admitted(self, client: socket.socket) -> bool:
        """Whether a client shows the token in time and there is room for it."""
        try:
            if not is_token(_first_line(client, time.monotonic() + _STALLED), self.token):
                return False
        finally:
            self._strangers.release()
        with self._news:
            if len(self._clients) >= _MOST_CLIENTS:
                return False
            self._clients[client] = deque(maxlen=_WAITING)
        return True

    def _send(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError), client:
            if not self._admitted(client):
                return
            client.settimeout(_STALLED)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            waiting = self._clients[client]
            while True:
                with self._news:
                    while not waiting and self._open:
                        self._news.wait()
                    if not waiting:
                        break
                    lines = b"".join(waiting)
                    waiting.clear()
                client.sendall(lines)
        with self._news:
            self._clients.pop(client, None)


def _first_line(client: socket.socket, end: float) -> bytes:
    """What a client sends up to its first line feed, or as much as a token can have.

    Raises TimeoutError: there is no line at the end [s].
    """
    line = b""
    while b"\n" not in line and len(line) <= LONGEST + 1:
        client.settimeout(max(end - time.monotonic(), 1e-3))
        more = client.recv(LONGEST + 2)
        if not more:
            break
        line += more
    return line.partition(b"\n")[0].removesuffix(b"\r")


def host_and_port(address: str, option: str) -> tuple[str, int]:
    """Host and port of HOST:PORT. Raises ValueError: it is none."""
    host, _, port = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")  # of an address of IPv6
    if not host or not port.isdecimal() or int(port) > 65535:
        raise ValueError(
            f'{option} "{address[:80]}": expected HOST:PORT, for example 127.0.0.1:8701'
        )
    return host, int(port)
