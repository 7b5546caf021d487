"""A CH340 on a virtual USB socket of this kernel (vhci-hcd), with a serial line behind it.

    usbip_ch340.py SOCKET DEVICE PRODUCT        such as 0 /run/board 7523

The kernel's own ch341 driver finds it and makes a tty of it. This program answers the driver's
questions, and passes bytes to and from DEVICE. Ends when it is unplugged.
"""

from __future__ import annotations

import os
import selectors
import socket
import struct
import sys
import tty
from pathlib import Path

ATTACH = Path("/sys/devices/platform/vhci_hcd.0/attach")
SUBMIT, UNLINK, SUBMITTED, UNLINKED = 1, 2, 3, 4
FULL_SPEED = 2
EPIPE, ECONNRESET = -32, -104

DEVICE = "1201 1001 ff 00 00 08 861a {product} 6402 00 02 00 01"
CONFIGURATION = (
    "09 02 2700 01 01 00 80 30"
    "09 04 00 00 03 ff 01 02 00"
    "07 05 82 02 2000 00"  # bulk in, 32 bytes
    "07 05 02 02 2000 00"  # bulk out
    "07 05 81 03 0800 01"  # interrupt in: the lines' state
)
NAME = "USB Serial".encode("utf-16-le")
BULK_IN = 2
KEPT = 256
"""Bytes that wait for the host; of more, the oldest are lost, as on the chip."""


class Ch340:
    """The chip's side of the USB/IP conversation."""

    def __init__(self, line: int, kernel: socket.socket, product: int) -> None:
        self._line = line
        self._kernel = kernel
        text = DEVICE.format(product=struct.pack("<H", product).hex())
        self._device = bytes.fromhex(text)
        self._waiting: dict[int, tuple[int, int]] = {}
        self._received = b""

    def serve(self, period_s: float | None = None) -> None:
        """Answer until it is unplugged; call :meth:`passed` once a period at least."""
        loop = selectors.DefaultSelector()
        loop.register(self._kernel, selectors.EVENT_READ)
        loop.register(self._line, selectors.EVENT_READ)
        while True:
            self.passed()
            for key, _ in loop.select(period_s):
                if key.fileobj is self._kernel:
                    self._from_kernel()
                else:
                    self._received = (self._received + os.read(self._line, 4096))[-KEPT:]
                    self._deliver()

    def passed(self) -> None:
        """Notice the time."""

    def _from_kernel(self) -> None:
        head = self._exactly(48)
        command, number, _, direction, endpoint = struct.unpack(">5I", head[:20])
        if command == UNLINK:
            (which,) = struct.unpack(">I", head[20:24])
            status = ECONNRESET if self._waiting.pop(which, None) else 0
            self._kernel.sendall(struct.pack(">5Ii24x", UNLINKED, number, 0, 0, 0, status))
            return
        _, length = struct.unpack(">Ii", head[20:28])
        data = self._exactly(length) if direction == 0 and length else b""
        if endpoint == 0:
            answer = self._control(head[40:48])
            if answer is None:
                self._done(number, EPIPE)
            elif direction:
                self._done(number, 0, answer[:length])
            else:
                self._done(number, 0, taken=length)
        elif direction == 0:
            os.write(self._line, data)
            self._done(number, 0, taken=length)
        else:
            self._waiting[number] = (endpoint, length)
            self._deliver()

    def _control(self, setup: bytes) -> bytes | None:
        kind, request, value, _, _ = struct.unpack("<BBHHH", setup)
        if kind & 0x60 == 0x40:  # the vendor's own
            known = {0x5F: b"\x31\x00", 0x95: b"\x9f\xee" if value == 0x0706 else b"\x00\x00"}
            return known.get(request, b"")
        if kind == 0x80 and request == 6:  # descriptors
            return {
                (1, 0): self._device,
                (2, 0): bytes.fromhex(CONFIGURATION),
                (3, 0): b"\x04\x03\x09\x04",
                (3, 2): bytes([len(NAME) + 2, 3]) + NAME,
            }.get((value >> 8, value & 0xFF))
        if kind == 0x80 and request == 0:
            return b"\x00\x00"
        return b"" if kind & 0x80 == 0 else None

    def _deliver(self) -> None:
        for number, (endpoint, length) in list(self._waiting.items()):
            if endpoint == BULK_IN and self._received:
                data, self._received = self._received[:length], self._received[length:]
                del self._waiting[number]
                self._done(number, 0, data)

    def _done(self, number: int, status: int, data: bytes = b"", taken: int = 0) -> None:
        actual = len(data) or taken
        head = struct.pack(">5I5i8x", SUBMITTED, number, 0, 0, 0, status, actual, 0, 0, 0)
        self._kernel.sendall(head + data)

    def _exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            more = self._kernel.recv(size - len(data))
            if not more:
                sys.exit(0)
            data += more
        return data


def main() -> None:
    where, path, product = int(sys.argv[1]), sys.argv[2], int(sys.argv[3], 16)
    line = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    Ch340(line, attached(where), product).serve()


def attached(where: int) -> socket.socket:
    """The conversation with the kernel about what is plugged into a socket."""
    ours, kernels = socket.socketpair()
    ATTACH.write_text(f"{where} {kernels.fileno()} {where + 1} {FULL_SPEED}")
    kernels.close()
    return ours


if __name__ == "__main__":
    main()
