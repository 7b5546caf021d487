"""Random words for the four-channel board: valid, malformed, cut short, and too close together."""

from __future__ import annotations

from random import Random

import msgspec

MS = 1_000_000

SETTLED_NS = 30 * MS
"""Longer than one pass of the board's main loop through all its streams, and any answer takes."""

FATAL = 14
LONGEST = 50


class Step(msgspec.Struct, frozen=True):
    """Bytes that follow each other, after a pause.

    Attributes:
        settled: A write of the flash that has begun is waited for.
        power_fails: The board's supply fails for a moment behind them.
    """

    pause_ns: int
    data: bytes
    settled: bool = False
    power_fails: bool = False


KINDS = ("calm",) * 6 + ("streams",) * 3 + ("close",) * 5 + ("flash",) * 3 + ("power", "hang")


class Commands:
    """A source of random commands."""

    def __init__(self, random: Random) -> None:
        self._random = random

    def block(self, kind: str) -> list[Step]:
        """Commands of a kind.

        Args:
            kind: ``calm``: one after the other; ``streams``: while lines come; ``close``: too close
                together; ``flash``: while it is written; ``power``: the supply fails; ``hang``: the
                last one has as many numbers as hang the board.
        """
        random = self._random
        steps: list[Step] = []
        if kind == "streams":
            digits = random.choice(("1,0,0", "1,1,0", "1,0,1", "1,1,1", "0,1,0", "0,0,1", "0,1,1"))
            steps.append(self._after(f"$upload:{digits}#".encode()))
        if kind in ("calm", "streams") and random.random() < 0.5:
            steps.append(self._after(self._valid(random.choice((b"spd", b"pwm")))))
        for _ in range(random.randint(3, 10)):
            if kind == "flash":
                # Whatever comes within a write.
                writes = self._valid(random.choice((b"mline", b"deadzone", b"wdiameter", b"MPID")))
                steps.append(self._after(writes))
                steps += [
                    Step(random.randrange(60 * MS), self.words(upload=False))
                    for _ in range(random.randint(1, 3))
                ]
                continue
            steps.append(self._after(self.words(upload=kind == "streams")))
            if kind == "close":
                steps += [
                    Step(random.randrange(4 * MS), self.words(upload=False))
                    for _ in range(random.randint(1, 3))
                ]
        if kind == "power":
            steps.append(self._after(self._valid(random.choice((b"mline", b"MPID", b"spd")))))
            steps.append(Step(random.randrange(100 * MS), b"", power_fails=True))
            steps.append(Step(50 * MS, b"$read_flash#"))
        if kind == "hang":
            name = random.choice((b"spd", b"pwm"))
            numbers = b",".join(
                b"%d" % random.randrange(10) for _ in range(random.randint(FATAL - 1, FATAL + 3))
            )
            steps.append(self._after(b"$%s:%s#" % (name, numbers)))
        return steps

    def _after(self, data: bytes) -> Step:
        pause_ns = SETTLED_NS + self._random.randrange(20 * MS)
        if self._random.random() < 0.05:
            # Long enough for speed loops to reach their limits.
            pause_ns += 1500 * MS
        return Step(pause_ns, data, settled=True)

    def words(self, *, upload: bool) -> bytes:
        """One command, or what is left of it."""
        random = self._random
        names = [b"spd", b"spd", b"spd", b"pwm", b"pwm", b"read_vol", b"read_flash"]
        names += [b"mtype", b"deadzone", b"mline", b"mphase", b"wdiameter", b"MPID"]
        names += [b"upload"] * 2 * upload + [b"flash_reset"] * (random.random() < 0.1)
        data = self._valid(random.choice(names))
        chance = random.random()
        if chance < 0.45:
            return data
        if chance < 0.75:
            return self._malformed(data)
        if chance < 0.90:
            return self._damaged(data)
        return random.choice(
            (
                b"$speed:100,0,100,0#",
                b"$read#",
                b"$data#",
                b"$#",
                b"#",
                b"\r\n",
                b"$$read_vol#",
                b"$ read_vol#",
                b"$UPLOAD:1,0,0#",
                b"$" + b"x" * random.randint(40, 70) + b"#",
                b"\n" * random.randint(1, 70),
                b"$read_vol" + b"y" * random.randint(0, 60) + b"#",
                b"$x#$read_vol#",
                bytes(random.randrange(32, 127) for _ in range(random.randint(1, 30))),
            )
        )

    def _valid(self, name: bytes) -> bytes:
        random = self._random
        match name:
            case b"spd":
                most = random.choice((30, 300, 300, 1000))
                args = b",".join(b"%d" % random.randint(-most, most) for _ in range(4))
                if random.random() < 0.2:
                    args = b"0,0,0,0"
            case b"pwm":
                most = random.choice((100, 1500, 3600))
                args = b",".join(b"%d" % random.randint(-most, most) for _ in range(4))
            case b"mtype":
                args = b"%d" % random.choice((1, 1, 1, 2, 3, 4))
            case b"deadzone":
                args = b"%d" % random.choice((1600, 1600, 1300, 1900, random.randrange(3601)))
            case b"mline":
                args = b"%d" % random.choice((11, 11, 13, random.randrange(1, 1000)))
            case b"mphase":
                args = b"%d" % random.choice((30, 30, 20, random.randrange(1, 100)))
            case b"wdiameter":
                args = random.choice((b"67", b"67.00", b"48", b"%.3f" % random.uniform(10, 150)))
            case b"MPID":
                gains = [b"0.8", b"0.06", b"0.5"]
                if random.random() < 0.4:
                    gains[random.randrange(3)] = b"%.3f" % random.uniform(0, 1)
                args = b",".join(gains)
            case b"upload":
                args = b",".join(b"%d" % random.randrange(2) for _ in range(3))
            case _:
                return b"$%s#" % name
        return b"$%s:%s#" % (name, args)

    def _malformed(self, data: bytes) -> bytes:
        """Another spelling of the name, another character behind it, other numbers."""
        random = self._random
        name, colon, args = data[1:-1].partition(b":")
        if random.random() < 0.3:
            name = random.choice((name.lower(), name.upper(), name.title(), name[:-1], name + b"x"))
        if random.random() < 0.2:
            colon = random.choice((b"=", b" ", b"", b"::", b",", b"x"))
        fields = args.split(b",")
        for _ in range(random.randint(0, 2)):
            place = random.randrange(len(fields))
            fields[place] = random.choice(
                (
                    b"",
                    b"x",
                    b"-",
                    b"-1",
                    b"0",
                    b"%d" % random.randint(-70000, 70000),
                    b"%d" % random.choice((32767, 32768, 65535, 65536, 3600, 3601, 2000, 40000)),
                    b"%d" % random.randint(-(10**11), 10**11),
                    b"%.3f" % random.uniform(-100, 100),
                    b"1e%d" % random.randint(-3, 6),
                    b" %d " % random.randint(-500, 500),
                    b"+%d" % random.randint(0, 500),
                    b"\r\n7",
                    fields[place] + b"x",
                    b"0" + fields[place],
                )
            )
        if random.random() < 0.2:
            fields += [b"%d" % random.randrange(10) for _ in range(random.randint(1, 8))]
        if random.random() < 0.2:
            del fields[random.randrange(len(fields)) :]
        separator = random.choice((b",", b",", b",", b", ", b",,", b" ", b";"))
        args = separator.join(fields)[: LONGEST + 2 - len(name)]
        return b"$%s%s%s#" % (name, colon, args)

    def _damaged(self, data: bytes) -> bytes:
        """Bytes that a line has lost, changed or made up; none is a whole command's end."""
        random = self._random
        damaged = bytearray(data)
        for _ in range(random.randint(1, 2)):
            place = random.randrange(len(damaged))
            match random.randrange(4):
                case 0:
                    del damaged[place]
                case 1:
                    damaged[place] ^= 1 << random.randrange(7)
                case 2:
                    damaged.insert(place, random.choice(b"$#,:-0 \n"))
                case _:
                    damaged = damaged[: place + 1]
            if not damaged:
                break
        return bytes(damaged)
