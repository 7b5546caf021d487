"""A TCP relay that delays, holds back or cuts, as a radio link does."""

from __future__ import annotations

import contextlib
import queue
import socket
import threading
import time

TICK_S = 0.005


class WeakNetwork:
    """Carries connections from a port of its own to a port of this machine.

    Args:
        port: Where to.

    Attributes:
        delay_s: Added to everything, each way.
        held: Nothing is carried while this is true; then all of it comes, late.
        refuses: New connections are closed at once.
    """

    def __init__(self, port: int) -> None:
        self._target = ("127.0.0.1", port)
        self.delay_s = 0.0
        self.held = False
        self.refuses = False
        self._closed = False
        self._sockets: list[socket.socket] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """End all connections, and refuse new ones."""
        self.refuses = True
        for each in self._sockets:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End it."""
        self._closed = True
        self.cut()
        self.held = False
        for each in (self._listener, *self._sockets):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                inner, _ = self._listener.accept()
                if self.refuses:
                    inner.close()
                    continue
                try:
                    outer = socket.create_connection(self._target)
                except OSError:
                    inner.close()
                    continue
                for each in (inner, outer):
                    # Without it the kernel holds small pieces back for 40 ms, as no network does.
                    each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._sockets += [inner, outer]
                if self._closed:
                    # Meanwhile.
                    inner.close()
                    outer.close()
                    return
                self._carry(inner, outer)
                self._carry(outer, inner)

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        flowing: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()

        def read() -> None:
            data = b"begin"
            while data:
                try:
                    data = source.recv(1 << 16)
                except OSError:
                    data = b""
                flowing.put((time.monotonic() + self.delay_s, data))

        def write() -> None:
            with contextlib.suppress(OSError):
                while True:
                    due, data = flowing.get()
                    while self.held or time.monotonic() < due:
                        time.sleep(TICK_S)
                    if not data:
                        sink.shutdown(socket.SHUT_WR)
                        return
                    sink.sendall(data)

        for each in (read, write):
            threading.Thread(target=each, daemon=True).start()
