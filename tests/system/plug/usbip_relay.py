"""A CP2104 on a virtual USB socket, whose GPIO 0 holds the relay in a board's motor supply.

    usbip_relay.py SOCKET CONTROL        such as 3 /run/control0

The kernel's own cp210x driver makes a GPIO chip of it. Here a retriggerable monostable is modelled:
each rising edge holds the relay for HOLD_S. Once it falls, the board's motors have no power. Like a
Raspberry Pi's, its outputs keep their level when the program that set it has ended. Prints what
happens, and when.
"""

from __future__ import annotations

import os
import socket
import sys
import time

from usbip_ch340 import Ch340, attached

HOLD_S = 0.45
DEVICE = bytes.fromhex("1201 0002 00 00 00 40 c410 60ea 0001 00 02 00 01")
PART, PORT_CONFIG, MODE, READ_LATCH, WRITE_LATCH = 0x370B, 0x370C, 0x3711, 0x00C2, 0x37E1


class RelayChip(Ch340):
    """The chip with the circuit and the relay behind its first line."""

    def __init__(self, kernel: socket.socket, control: str) -> None:
        # Its serial line says nothing.
        super().__init__(os.eventfd(0), kernel, 0xEA60)
        self._device = DEVICE
        self._control_path = control
        self._latch = 0
        self._edge_s = -HOLD_S
        self.holds = True

    def passed(self) -> None:
        holds = time.monotonic() - self._edge_s < HOLD_S
        if holds != self.holds:
            self.holds = holds
            with socket.socket(socket.AF_UNIX) as control:
                control.connect(self._control_path)
                control.sendall(b"repair all\n" if holds else b"motor-dead all\n")
                control.recv(100)
            print("holds" if holds else "falls", time.monotonic_ns(), flush=True)

    def _control(self, setup: bytes) -> bytes | None:
        kind, request = setup[:2]
        value, index = (int.from_bytes(setup[at : at + 2], "little") for at in (2, 4))
        if kind & 0x60 != 0x40:
            return super()._control(setup)
        if request == 0xFF and value == WRITE_LATCH:
            before, self._latch = self._latch, self._latch & ~index | (index >> 8) & index & 0xFF
            if self._latch & ~before & 1:
                self._edge_s = time.monotonic()
                print("edge", time.monotonic_ns(), flush=True)
            return b""
        # All four lines are push-pull outputs, and none has another function.
        answers = {
            PART: b"\x04",
            PORT_CONFIG: bytes.fromhex("000f 0000 0000 00000000 0000 00"),
            MODE: b"\x00\x00",
            READ_LATCH: bytes([self._latch]),
        }
        return answers.get(value, bytes(64)) if kind & 0x80 else b""


def main() -> None:
    where, control = int(sys.argv[1]), sys.argv[2]
    RelayChip(attached(where), control).serve(period_s=0.05)


if __name__ == "__main__":
    main()
