"""Random frames for a Rosmaster board: every function, valid and spoilt."""

from __future__ import annotations

import struct
from random import Random


def frame(function: int, *payload: int) -> bytes:
    inside = bytes((len(payload) + 3, function, *payload))
    return b"\xff\xfc" + inside + bytes((sum(inside) & 0xFF,))


def command(random: Random, car_type: int) -> bytes:
    """Any command, valid by itself; most car types are this one."""
    number = random.randrange
    small = lambda: random.choice((0, 0, 1, 20, 100, 255, number(-400, 401)))  # noqa: E731
    wide = lambda: number(-0x8000, 0x8000)  # noqa: E731
    save = random.choice((0, 0, 0, 0x5F, number(256)))
    match random.choices(
        ("motion", "run", "outputs", "gains", "type", "report", "stop", "ask", "steer", "rest"),
        (30, 14, 10, 7, 5, 4, 4, 18, 10, 6),
    )[0]:
        case "motion":
            of = random.choice((small, small, small, wide))
            return frame(0x12, number(256), *struct.pack("<3h", of(), of(), of()))
        case "run":
            speed = random.choice((0, 5, 30, 100, number(0x10000)))
            state = random.choice((*range(9), number(256)))
            # The highest bit of the first byte holds the heading, which is not simulated.
            return frame(0x11, number(128), state, speed & 0xFF, speed >> 8)
        case "outputs":
            of = random.choice((lambda: 0, lambda: number(20), lambda: number(256)))
            return frame(0x10, of(), of(), of(), of())
        case "gains":
            of = random.choice(
                (lambda: number(1500), lambda: number(1500), lambda: number(0x10000))
            )
            usual = random.random() < 0.6
            values = (800, 60, 500) if usual else (of(), of() // 8, of())
            return frame(random.choice((0x13, 0x13, 0x14)), *struct.pack("<3H", *values), save)
        case "type":
            others = random.choice((*range(9), number(256)))
            return frame(0x15, random.choice((car_type, car_type, car_type, others)), save)
        case "report":
            return frame(0x01, random.choice((0, 1, 1, 1, number(256))), save)
        case "stop":
            return frame(0x0F, random.choice((0x5F, 0x5F, number(256))))
        case "ask":
            what = random.choice(
                (0x01, 0x13, 0x14, 0x15, 0x51, 0x30, 0x20, 0x23, 0x24, number(256))
            )
            return frame(0x50, what, random.choice((*range(7), number(256))))
        case "steer":
            if random.random() < 0.3:
                return frame(
                    0x30, random.choice((1, 1, 0, 2)), random.choice((90, 80, number(256))), save
                )
            return frame(0x31, random.choice((1, 1, 0x81, number(256))), number(256))
    function = random.choice(
        (*range(2, 7), *range(0x20, 0x25), 0x40, 0x60, 0xA1, 0xFF, number(256))
    )
    # All servos at once are none of the rig's, and the others are above.
    if function in {0x04, 0x0F, 0x11, 0xA0}:
        function = 0x02
    return frame(function, random.choice((0, 1, number(256))), *random.randbytes(number(14)))


def spoilt(data: bytes, random: Random) -> bytes:
    """The same with something wrong."""
    number = random.randrange
    match number(7):
        case 0:
            return data[: number(len(data))]
        case 1:
            at = number(len(data))
            return data[:at] + bytes((data[at] ^ (1 << number(8)),)) + data[at + 1 :]
        case 2:
            return b"\xff" + data
        case 3:
            return data[:2] + bytes((number(32),)) + data[3:]
        case 4:
            return random.randbytes(number(25))
        case 5:
            return b"$spd:300,0,300,0#"
    at = number(len(data))
    return data[:at] + data[at + 1 :]
