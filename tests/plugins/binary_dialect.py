"""A board that speaks otherwise than any in the tree: frames with a length and a checksum.

It takes the velocity of the body, not of wheels, and reports its counters by itself every 40 ms,
from the first moment on. Nothing in yahboomd knows of it: :func:`registered` puts it into the
registries while a test runs.

A frame is ``A5 LEN KIND payload CRC CRC`` with LEN the bytes of the payload, numbers in
little-endian order, and CRC-16 (XMODEM) over LEN, KIND and payload.

| kind | to the board | | kind | from the board |
|---|---|---|---|---|
| 10 | vx, vy mm/s, wz mrad/s: i16 each | | 81 | four counters, i32 each |
| 11 | let the motors go | | 90 | firmware: major, minor |
| 20 | read the settings | | 91 | track in mm, u16: the last of the settings |
| 21 | store the track in mm, u16 | | 92 | stored: u8, 1 for yes |
| 30 | read the voltage | | 93 | V/100, u16 |
| | | | 94 | sensor: turn in mrad/s, force in mm/s^2, three i16 each |
"""

from __future__ import annotations

import math
import struct
from binascii import crc_hqx
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import msgspec
from binary_board import BINARY_BOARD

from yahboomd.core.errors import BoardError
from yahboomd.core.model import ImuSensor, Kinematics, Motor
from yahboomd.core.protocol.dialect import (
    Battery,
    Decoded,
    Dialect,
    Findings,
    FramerCounters,
    Inertial,
    Reply,
    Setting,
    SettingValue,
    Totals,
    Units,
    Unrecognised,
    VersionLine,
)
from yahboomd.core.protocol.first_words import FIRST_WORDS
from yahboomd.core.protocol.profiles import MotorProfile
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import BoardSettings, StoredSetting
from yahboomd.simulation.boards import BOARDS

START = 0xA5
LONGEST_PAYLOAD = 32
MM_PER_TICK = math.pi * 67.0 / 1320.0
"""The board's own measure of a count; it cannot be set."""

SENSOR = ImuSensor(
    name="binary",
    gyro_limit_rad_s=8.7,
    gyro_noise_rad_s=1e-3,
    acceleration_limit_m_s2=32.7,
    acceleration_noise_m_s2=0.02,
)


def frame(kind: int, payload: bytes = b"") -> bytes:
    """One frame."""
    inside = bytes((len(payload), kind)) + payload
    return bytes((START,)) + inside + crc_hqx(inside, 0).to_bytes(2, "little")


class Packet(msgspec.Struct, frozen=True, kw_only=True):
    """A frame whose checksum is right."""

    kind: int
    payload: bytes
    size: int
    trailing: int


class PacketFramer:
    """Finds frames by their first byte, length and checksum."""

    def __init__(self) -> None:
        self.counters = FramerCounters()
        self._held = bytearray()

    @property
    def held_bytes(self) -> int:
        return len(self._held)

    def feed(self, data: bytes) -> list[Packet]:
        counters, held = self.counters, self._held
        counters.bytes += len(data)
        held += data
        found: list[Packet] = []
        while held:
            if held[0] != START or (len(held) > 1 and held[1] > LONGEST_PAYLOAD):
                counters.discarded_bytes += 1
                del held[0]
                continue
            if len(held) < 2 or len(held) < (size := held[1] + 5):
                break
            inside, crc = bytes(held[1 : size - 2]), held[size - 2 : size]
            if crc_hqx(inside, 0).to_bytes(2, "little") != crc:
                # What looked like a start was none: the next one may be inside.
                counters.broken_frames += 1
                counters.discarded_bytes += 1
                del held[0]
                continue
            del held[:size]
            counters.frames += 1
            found.append(Packet(kind=inside[1], payload=inside[2:], size=size, trailing=len(held)))
        return found


class Body(msgspec.Struct, frozen=True, kw_only=True):
    """A motion as the velocity of the body; see :class:`~yahboomd.core.protocol.dialect.Motion`."""

    kinematics: Kinematics
    units_per_m_s: float
    track_m: float
    wheel_limits: tuple[float, ...]

    def units(self, speeds: Sequence[float]) -> Units:
        if not all(map(math.isfinite, speeds)):
            raise ValueError(f"The command is {speeds}.")
        vx, vy, wz = (
            sum(factor * speed for factor, speed in zip(row, speeds, strict=True))
            for row in self.kinematics.forward
        )
        # The board divides a turn among the wheels by the track that it stores.
        wz *= 2.0 * self.kinematics.inverse[-1][2] / self.track_m
        vx, vy, wz = (round(each * self.units_per_m_s) for each in (vx, vy, wz))
        return vx, vy, wz


def _track(value: SettingValue) -> str:
    assert isinstance(value, int | float)
    return str(round(value))


class Binary(Dialect, frozen=True, kw_only=True):
    """The dialect as data."""

    name: str = "binary"
    title: str = "board of frames with a checksum"
    # As many bytes as half a frame may still wait for.
    resync: bytes = bytes(LONGEST_PAYLOAD + 5)
    listen_ns: int = 90_000_000
    probe: bytes | None = frame(0x20)
    spacing_ns: int = 5_000_000
    totals_spacing_ns: int = 5_000_000
    question_spacing_ns: int = 5_000_000
    answer_spacing_ns: int = 5_000_000
    baudrate: int = 115_200
    usb_ids: tuple[str, ...] = ("10c4:ea60", "1a86:7523")
    fastest_m_s: float = 1.0
    brake: bytes = frame(0x10, bytes(6))
    cut: bytes | None = frame(0x11)
    sample_period_ns: int | None = 40_000_000
    renews_with_each_line: bool = True
    battery: bytes | None = frame(0x30)
    read_settings: tuple[bytes, ...] = (frame(0x20),)
    settings: tuple[StoredSetting, ...] = (
        StoredSetting(
            field="track_mm",
            command="track",
            label="track",
            unit=" mm",
            least=10,
            most=2000,
            limits="10 to 2000",
            wire=_track,
            frame=lambda text: frame(0x21, struct.pack("<H", int(text))),
            steers=True,
            timeout_s=0.2,
        ),
    )

    def framer(self) -> PacketFramer:
        return PacketFramer()

    def decode(self, item: Packet) -> Decoded:
        try:
            match item.kind:
                case 0x81:
                    a, b, c, d = struct.unpack("<4i", item.payload)
                    return Totals(ticks=(a, b, c, d))
                case 0x90:
                    major, minor = item.payload
                    return VersionLine(version=f"{major}.{minor}", after_reset=False)
                case 0x91:
                    (track_mm,) = struct.unpack("<H", item.payload)
                    return Setting(name="track_mm", value=track_mm, last=True)
                case 0x92:
                    (done,) = item.payload
                    return Reply(command="track", ok=bool(done), text=f"stored: {done}")
                case 0x93:
                    return Battery(volts=struct.unpack("<H", item.payload)[0] / 100.0)
                case 0x94:
                    p, q, r, x, y, z = (n / 1e3 for n in struct.unpack("<6h", item.payload))
                    return Inertial(
                        sensor=SENSOR, gyro_rad_s=(p, q, r), acceleration_m_s2=(x, y, z)
                    )
        except (struct.error, ValueError):
            pass
        return Unrecognised(text=f"{item.kind:02x} {item.payload.hex(' ')}")

    def recognises(self, item: Packet) -> bool:
        return not isinstance(self.decode(item), Unrecognised)

    def silence(self, volts: float | None, settings: BoardSettings) -> str:
        return f"It has {volts} V."

    def findings(self, settings: BoardSettings, profile: MotorProfile) -> Findings:
        if settings.get("track_mm"):
            return Findings()
        return Findings(unfit=("The board stores no track. Run `yahboomd probe --write`.",))

    def motion(
        self,
        kinematics: Kinematics,
        motors: tuple[Motor, ...],
        settings: BoardSettings | None,
        *,
        scale: float,
    ) -> Body:
        track_mm = (settings or {}).get("track_mm")
        if not isinstance(track_mm, int) or track_mm <= 0:
            raise BoardError("The board turns by the track that it stores, and stores none.")
        units = MM_PER_TICK / motors[0].metres_per_tick * scale
        return Body(
            kinematics=kinematics,
            units_per_m_s=units,
            track_m=track_mm / 1000.0,
            wheel_limits=(1000.0 / units,) * len(kinematics.wheels),
        )

    def speeds(self, units: Units) -> bytes:
        return frame(0x10, struct.pack("<3h", *(max(-32768, min(32767, each)) for each in units)))


BINARY = Binary()


@contextmanager
def registered() -> Iterator[None]:
    """Have yahboomd know the board: a row in each registry, and nothing else."""
    DIALECTS[BINARY.name] = BINARY
    BOARDS[BINARY.name] = BINARY_BOARD
    FIRST_WORDS[BINARY.name] = BINARY.resync + frame(0x11)
    try:
        yield
    finally:
        for registry in (DIALECTS, BOARDS, FIRST_WORDS):
            del registry[BINARY.name]  # type: ignore[attr-defined]
