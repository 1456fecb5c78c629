"""Loads for another process: JSON lines over TCP, the newest first to be sent.

A client connects and reads lines, which are those of `suas invert --json`. One that reads too
slowly misses lines (their `seq` shows it), and delays neither the estimate nor others.
"""

import contextlib
import socket
import threading
from collections import deque
from typing import Self

from fitting.inverse_load.live.stream import LiveFrame, LiveWatcher, json_line

_WAITING = 4  # lines kept for a client that is busy
_MOST_CLIENTS = 16
_STALLED = 5.0  # a client that takes nothing for so long is left [s]


class LineServer(LiveWatcher):
    """Sends a line a frame to every client.

    Args:
        address: HOST:PORT to listen at; port 0 takes a free one.

    Attributes:
        address: the host and port that it listens at.

    Raises:
        ValueError: the address is none.
        OSError: it can't be listened at.
    """

    def __init__(self, address: str) -> None:
        self._listener = socket.create_server(host_and_port(address, "--serve"))
        self.address: tuple[str, int] = self._listener.getsockname()[:2]
        self._clients: dict[socket.socket, deque[bytes]] = {}
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
            with self._news:
                if len(self._clients) >= _MOST_CLIENTS:
                    client.close()
                    continue
                self._clients[client] = deque(maxlen=_WAITING)
            threading.Thread(
                target=self._send, args=(client,), name="suas serve client", daemon=True
            ).start()

    def _send(self, client: socket.socket) -> None:
        client.settimeout(_STALLED)
        with contextlib.suppress(OSError), client:
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


def host_and_port(address: str, option: str) -> tuple[str, int]:
    """Host and port of HOST:PORT.

    Raises:
        ValueError: it is none.
    """
    host, _, port = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")  # of an address of IPv6
    if not host or not port.isdecimal() or int(port) > 65535:
        raise ValueError(
            f'{option} "{address[:80]}": expected HOST:PORT, for example 127.0.0.1:8701'
        )
    return host, int(port)
