"""A TCP relay that stalls, as a radio link does, and then delivers all bytes at once."""

from __future__ import annotations

import contextlib
import socket
import threading


class StalledRelay:
    """Carries one connection after another from a port of its own to an endpoint.

    Args:
        endpoint: Where to, such as ``tcp/127.0.0.1:7448``.
    """

    def __init__(self, endpoint: str) -> None:
        host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
        self._target = (host, int(port))
        self._flows = threading.Event()
        self._flows.set()
        self._sockets: list[socket.socket] = []
        self._closed = False
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def stall(self) -> None:
        """Carry nothing towards the target from now on."""
        self._flows.clear()

    def flow(self) -> None:
        """Deliver again, first the queued bytes."""
        self._flows.set()

    def close(self) -> None:
        """Cut all connections."""
        self._flows.set()
        self._closed = True
        for each in (self._listener, *self._sockets):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                inner, _ = self._listener.accept()
                try:
                    outer = socket.create_connection(self._target)
                except OSError:
                    inner.close()
                    continue
                self._sockets += [inner, outer]
                if self._closed:
                    # Meanwhile.
                    inner.close()
                    outer.close()
                    return
                for source, sink, stalls in ((inner, outer, True), (outer, inner, False)):
                    threading.Thread(
                        target=self._carry, args=(source, sink, stalls), daemon=True
                    ).start()

    def _carry(self, source: socket.socket, sink: socket.socket, stalls: bool) -> None:
        piled_up = b""
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                if stalls and not self._flows.is_set():
                    piled_up = data
                    while not self._flows.wait(0.005):
                        with contextlib.suppress(BlockingIOError):
                            # The other direction goes on, on the same socket.
                            piled_up += source.recv(1 << 16, socket.MSG_DONTWAIT)
                    data = piled_up
                sink.sendall(data)
