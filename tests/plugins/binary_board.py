"""The device side of ``binary_dialect``, read from its table alone: nothing here imports it."""

from __future__ import annotations

import struct
from binascii import crc_hqx
from collections import deque
from random import Random

import msgspec

from yahboomd.core.model import Counts
from yahboomd.simulation.board import BOOT_NS, NEVER, Emit
from yahboomd.simulation.boards import BoardKind
from yahboomd.simulation.imu import ImuModel, ImuOptions
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.speed_loop import TICK_NS, LoopSettings, MotorControl

REPORT_NS = 40_000_000
IMU_LAG_NS = 20_000_000
"""The sensor is reported in the middle between two reports of the counters."""
CARRY_OUT_NS = 200_000
QUEUE = 8
FASTEST_MM_S = 1000

TUNING = LoopSettings(
    mm_s_per_tick=100.0 * 3.141592653589793 * 67.0 / 1320.0, p=0.8, i=0.06, d=0.5, dead_zone=1600
)


class Stored(msgspec.Struct, frozen=True, kw_only=True):
    """The settings that the board keeps over a reset, and the sensor soldered to it, if any."""

    track_mm: int = 150
    imu: ImuOptions | None = None


class BinaryBoard:
    """Left motors are on 1 and 2, right ones on 3 and 4; those in front on 1 and 3."""

    def __init__(
        self, options: SimulationOptions, plant: Plant, emit: Emit, random: Random
    ) -> None:
        self.emit = emit
        self.flash = options.flash if isinstance(options.flash, Stored) else Stored()
        self.imu = None if self.flash.imu is None else ImuModel(self.flash.imu, random)
        self._plant = plant
        self._control = MotorControl(plant, options.initial_ticks, options.loop_gain)
        self._major, self._minor = (
            int(part) for part in (options.firmware or "1.7").split(".")[:2]
        )
        self._collected = bytearray()
        self._frames: deque[tuple[int, bytes]] = deque()
        self._tick_ns = self._report_ns = self._main_ns = self._imu_ns = NEVER
        self._listens_ns = 0

    @property
    def next_ns(self) -> int:
        return min(self._tick_ns, self._report_ns, self._main_ns, self._imu_ns)

    @property
    def speaks_ns(self) -> int:
        return min(self._report_ns, self._main_ns, self._imu_ns)

    @property
    def totals(self) -> Counts:
        return self._control.totals

    def start(self, now_ns: int) -> None:
        self._listens_ns = now_ns
        self._tick_ns = now_ns + TICK_NS
        self._report_ns = now_ns + REPORT_NS
        self._start_imu()

    def _start_imu(self) -> None:
        self._imu_ns = NEVER if self.imu is None else self._report_ns + IMU_LAG_NS

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:
        self._plant.advance(now_ns)
        self._control.restart()
        self._collected.clear()
        self._frames.clear()
        self._main_ns = NEVER
        self._listens_ns = self._tick_ns = now_ns + off_ns + BOOT_NS
        self._report_ns = self._listens_ns + REPORT_NS
        self._start_imu()

    def hang(self) -> None:
        self._tick_ns = self._report_ns = self._main_ns = self._listens_ns = NEVER
        self._imu_ns = NEVER

    def set_tick_period(self, now_ns: int, period_ns: int, jitter_ns: int = 0) -> None:
        raise ValueError("a board that counts when it reports")

    def receive(self, byte: int, now_ns: int) -> None:
        """Half a frame waits for its end, whatever comes: it swallows the next one."""
        if now_ns < self._listens_ns:
            return
        collected = self._collected
        if not collected and byte != 0xA5:
            return
        collected.append(byte)
        if len(collected) == 2 and byte > 32:
            collected.clear()
        elif len(collected) > 2 and len(collected) == collected[1] + 5:
            inside, crc = bytes(collected[1:-2]), bytes(collected[-2:])
            collected.clear()
            if crc_hqx(inside, 0).to_bytes(2, "little") == crc and len(self._frames) < QUEUE:
                self._frames.append((inside[1], inside[2:]))
                self._main_ns = min(self._main_ns, now_ns + CARRY_OUT_NS)

    def run_due(self, now_ns: int) -> None:
        while (at_ns := self.next_ns) <= now_ns:
            if at_ns == self._tick_ns:
                self._tick_ns += TICK_NS
                self._control.tick(at_ns, TUNING)
            elif at_ns == self._report_ns:
                self._report_ns += REPORT_NS
                self._control.renew_totals(at_ns, TUNING)
                self._say(0x81, struct.pack("<4i", *self._control.totals), at_ns)
            elif at_ns == self._imu_ns:
                self._imu_ns += REPORT_NS
                self._say(0x94, self._measured(at_ns), at_ns)
            else:
                kind, payload = self._frames.popleft()
                self._main_ns = at_ns + CARRY_OUT_NS if self._frames else NEVER
                self._execute(kind, payload, at_ns)

    def _measured(self, now_ns: int) -> bytes:
        assert self.imu is not None
        plant = self._plant
        plant.advance(now_ns)
        twist = plant.chassis.twist([motor.speed_m_s for motor in plant.motors])
        shown = self.imu.sample(now_ns, twist, plant.chassis.pose.theta)
        values = (*shown.gyro_rad_s, *shown.acceleration_m_s2)
        return struct.pack("<6h", *(max(-32768, min(32767, round(1e3 * each))) for each in values))

    def _say(self, kind: int, payload: bytes, now_ns: int) -> None:
        inside = bytes((len(payload), kind)) + payload
        self.emit(b"\xa5" + inside + crc_hqx(inside, 0).to_bytes(2, "little"), now_ns)

    def _execute(self, kind: int, payload: bytes, now_ns: int) -> None:
        if kind == 0x10 and len(payload) == 6:
            vx, vy, wz = struct.unpack("<3h", payload)
            turn = wz * self.flash.track_mm / 2000.0
            speeds = (vx - vy - turn, vx + vy - turn, vx + vy + turn, vx - vy + turn)
            self._control.regulate(
                tuple(max(-FASTEST_MM_S, min(FASTEST_MM_S, round(speed))) for speed in speeds)
            )
        elif kind == 0x11:
            self._plant.advance(now_ns)
            self._control.release()
        elif kind == 0x20:
            self._say(0x90, bytes((self._major, self._minor)), now_ns)
            self._say(0x91, struct.pack("<H", self.flash.track_mm), now_ns)
        elif kind == 0x21 and len(payload) == 2:
            self.flash = Stored(track_mm=struct.unpack("<H", payload)[0])
            self._say(0x92, b"\x01", now_ns)
        elif kind == 0x30:
            self._say(0x93, struct.pack("<H", round(self._plant.volts * 100)), now_ns)


def _make(
    options: SimulationOptions,
    plant: Plant,
    emit: Emit,
    random: Random,
) -> BinaryBoard:
    return BinaryBoard(options, plant, emit, random)


BINARY_BOARD = BoardKind(make=_make, flash=Stored)
