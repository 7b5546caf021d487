"""The Rosmaster expansion board: its firmware's tasks, as their source has them.

- The interrupt of the serial port writes each byte into the one buffer there is, also over a frame
  that waits. A task looks once a millisecond whether one does. Nothing is acknowledged.
- A task of 10 ms reads the encoders and runs the incremental speed loops.
- A task of 1 ms answers the latest request and reports, four kinds in a cycle of 41 ms.
- After a reset it says what it is, and then nothing for seconds, while its inertial sensor is set
  up; the interrupt is on all the time, so that a frame waits until the tasks begin.
- Where the battery is too low or too high for two seconds it brakes, and stops counting, reporting
  and most listening until it is reset.
"""

from __future__ import annotations

import math
import struct
from random import Random

import msgspec

from yahboomd.core.clock import nanoseconds
from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.board import BOOT_NS, NEVER, Emit
from yahboomd.simulation.imu import SENSORS, ImuModel
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.rosmaster.car_types import CAR_TYPES, CarType
from yahboomd.simulation.rosmaster.one_buffer import OneBuffer
from yahboomd.simulation.speed_loop import TICK_NS, LoopSettings, MotorControl

FIRMWARE = "3.5.1"
LOOK_NS = 1_000_000
CYCLE_NS = 41_000_000
REPORTS = ((1_000_000, 0x0A), (11_000_000, 0x0B), (21_000_000, 0x0C), (31_000_000, 0x0D))
"""When in a cycle which report is sent; the second is 0E for another sensor."""

BATTERY_TICKS = 10
"""The battery is looked at with every tenth run of the speed loops."""
ALARM_AFTER = 20
LOW_V, HIGH_V = 9.6, 13.0
SUNRISE, IGNORED_V = 6, (6.5, 8.5)
"""The car with two cells, and its limits. For the others no alarm is raised in between."""

SCALES_MPU = (3754.9, 1671.84, 1.0 / 0.15e-6)
SCALES_ICM = (1000.0, 1000.0, 1e9)
"""Counts of the registers for 1 rad/s, 1 m/s^2 and 1 T."""

DEAD_ZONE = 1600
IN_FLASH = 0x5F
BRAKED = 1
"""An output inside the motors' dead zone shorts them."""


class RosmasterStored(msgspec.Struct, frozen=True, kw_only=True):
    """The settings that the board keeps over a reset, and the sensor that is soldered to it.

    Attributes:
        car_type: As :data:`CAR_TYPES` has it.
        auto_report: 1 where it reports by itself.
        imu: ``mpu9250``, ``icm20948``, or empty.
    """

    car_type: int = 1
    auto_report: int = 1
    p: float = 0.8
    i: float = 0.06
    d: float = 0.5
    imu: str = "mpu9250"


class RosmasterBoard:
    """A simulated board of the Rosmaster family.

    Attributes:
        steering_deg: The angle of the front wheels of a car that steers, + left.
    """

    def __init__(
        self, options: SimulationOptions, plant: Plant, emit: Emit, random: Random
    ) -> None:
        self.emit = emit
        flash = options.flash
        sold_as = RosmasterStored(car_type=5 if options.drive == "ackermann" else 1)
        self.flash = flash if isinstance(flash, RosmasterStored) else sold_as
        self.steering_deg = 0
        plant.steer(0.0)
        self._plant = plant
        self._control = MotorControl(plant, options.initial_ticks, options.loop_gain)
        self._firmware = options.firmware or FIRMWARE
        self._start_up_ns = nanoseconds(options.start_up_s)
        sensor = SENSORS.get(self.flash.imu)
        self._imu = None if sensor is None else ImuModel(sensor, random)
        self._gyro_zero: tuple[float, ...] = (0.0, 0.0, 0.0)
        self._stored = self.flash
        self._reports = bool(self.flash.auto_report)
        self._buffer = OneBuffer()
        self._alarms = 0
        self._latched = False
        self._ticks = 0
        self._cycle_ns = NEVER
        self._report = 0
        self._tick_ns = self._look_ns = self._banner_ns = self._listens_ns = NEVER
        self._begins_ns = NEVER

    @property
    def next_ns(self) -> int:
        """The time of the next thing that happens inside."""
        return min(self._tick_ns, self._report_ns, self._look_ns, self._banner_ns, self._begins_ns)

    @property
    def speaks_ns(self) -> int:
        """The time at which it may next send something."""
        return min(self._report_ns, self._look_ns, self._banner_ns, self._begins_ns)

    @property
    def totals(self) -> Counts:
        """The counters, as the latest run of the speed loops left them."""
        return self._control.totals

    @property
    def _report_ns(self) -> int:
        return NEVER if self._cycle_ns == NEVER else self._cycle_ns + REPORTS[self._report][0]

    @property
    def _car(self) -> CarType:
        return CAR_TYPES.get(self._stored.car_type, CAR_TYPES[1])

    @property
    def _tuning(self) -> LoopSettings:
        stored = self._stored
        return LoopSettings(
            mm_s_per_tick=self._car.mm_s_per_tick,
            p=stored.p,
            i=stored.i,
            d=stored.d,
            dead_zone=DEAD_ZONE,
        )

    def start(self, now_ns: int) -> None:
        """Be a board that was powered long ago."""
        self._listens_ns = now_ns
        self._begin(now_ns)

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:  # noqa: ARG002
        """Lose all but the flash, announce the start, and be silent while the sensor is set up."""
        self._plant.advance(now_ns)
        self._control.restart()
        self._stored = self.flash
        self._reports = bool(self.flash.auto_report)
        self._buffer.clear()
        self._latched = False
        self._alarms = 0
        self._tick_ns = self._look_ns = self._cycle_ns = NEVER
        self._listens_ns = self._banner_ns = now_ns + off_ns + BOOT_NS
        self._begins_ns = self._listens_ns + self._start_up_ns

    def hang(self) -> None:
        """Stop executing, with the outputs as they are."""
        self._tick_ns = self._look_ns = self._cycle_ns = NEVER
        self._banner_ns = self._begins_ns = self._listens_ns = NEVER

    def set_tick_period(self, now_ns: int, period_ns: int, jitter_ns: int = 0) -> None:  # noqa: ARG002
        """Nothing that can be changed.

        Raises:
            ValueError: Always.
        """
        raise ValueError("a rosmaster board counts every 10 ms and reports every 41 ms")

    def receive(self, byte: int, now_ns: int) -> None:
        """The interrupt."""
        if now_ns < self._listens_ns:
            return
        self._buffer.receive(byte)
        if self._buffer.waits and self._look_ns == NEVER and self._tick_ns != NEVER:
            self._look_ns = (now_ns // LOOK_NS + 1) * LOOK_NS

    def run_due(self, now_ns: int) -> None:
        """Do everything that is due."""
        while (at_ns := self.next_ns) <= now_ns:
            if at_ns == self._banner_ns:
                self._banner_ns = NEVER
                kind = self.flash.imu.upper() or "NONE"
                words = f"\nFirmware Version: V{self._firmware}\nIMU Type: {kind}\n"
                self.emit(words.encode(), at_ns)
            elif at_ns == self._begins_ns:
                self.emit(b"\nHello Yahboom!\n\nstart vTask_Speed\n", at_ns)
                self._begin(at_ns)
            elif at_ns == self._tick_ns:
                self._tick(at_ns)
            elif at_ns == self._report_ns:
                self._send_report(at_ns)
            else:
                self._look(at_ns)

    # The tasks.

    def _begin(self, now_ns: int) -> None:
        self._begins_ns = NEVER
        self._tick_ns = now_ns + TICK_NS
        self._cycle_ns, self._report = now_ns, 0
        # It takes one reading for the gyro's zero, wherever it moves.
        self._gyro_zero = (0.0, 0.0, 0.0)
        if self._imu is not None:
            self._gyro_zero = self._measured(now_ns)[0]
        self._look_ns = now_ns + LOOK_NS if self._buffer.waits else NEVER

    def _tick(self, now_ns: int) -> None:
        self._tick_ns += TICK_NS
        self._ticks += 1
        if not self._latched:
            tuning = self._tuning
            self._control.tick(now_ns, tuning)
            self._control.renew_totals(now_ns, tuning)
        if self._ticks % BATTERY_TICKS == 0 and not self._latched:
            self._plant.advance(now_ns)
            volts = self._plant.volts
            bad = not IGNORED_V[0] <= volts <= IGNORED_V[1]
            if self._stored.car_type != SUNRISE:
                bad = bad and not LOW_V <= volts <= HIGH_V
            self._alarms = self._alarms + 1 if bad else 0
            if self._alarms > ALARM_AFTER:
                self._latched = True
                self._brake(now_ns)

    def _look(self, now_ns: int) -> None:
        self._look_ns = NEVER
        found = self._buffer.take()
        if found is not None:
            self._execute(*found, now_ns)

    def _send_report(self, now_ns: int) -> None:
        kind = REPORTS[self._report][1]
        self._report += 1
        if self._report == len(REPORTS):
            self._report = 0
            self._cycle_ns += CYCLE_NS
        if not self._reports or self._latched:
            return
        if kind == 0x0A:
            self._send_speed(now_ns)
        elif kind == 0x0D:
            self._send(kind, struct.pack("<4i", *self.totals), now_ns)
        elif self._imu is not None:
            self._send_sensor(kind, now_ns)

    # What it sends.

    def _send(self, function: int, payload: bytes, now_ns: int) -> None:
        inside = bytes((len(payload) + 3, function)) + payload
        self.emit(b"\xff\xfb" + inside + bytes((sum(inside) & 0xFF,)), now_ns)

    def _send_speed(self, now_ns: int) -> None:
        self._plant.advance(now_ns)
        velocity = self._car.body(self._control.speeds_mm_s(self._tuning), self.steering_deg)
        tenths = max(0, min(255, int(self._plant.volts * 10.0)))
        self._send(0x0A, struct.pack("<3hB", *map(_short, velocity), tenths), now_ns)

    def _send_sensor(self, kind: int, now_ns: int) -> None:
        if kind == 0x0C:
            theta = math.remainder(self._plant.chassis.pose.theta, math.tau)
            self._send(kind, struct.pack("<3h", 0, 0, _short(theta * 1e4)), now_ns)
            return
        gyro, force, field = self._measured(now_ns)
        turned = tuple(value - zero for value, zero in zip(gyro, self._gyro_zero, strict=True))
        mpu = self.flash.imu == "mpu9250"
        scales = SCALES_MPU if mpu else SCALES_ICM
        values = [
            _short(scale * value)
            for scale, vector in zip(scales, (turned, force, field), strict=True)
            for value in vector
        ]
        self._send(0x0B if mpu else 0x0E, struct.pack("<9h", *values), now_ns)

    def _measured(self, now_ns: int) -> tuple[tuple[float, ...], ...]:
        assert self._imu is not None
        plant = self._plant
        plant.advance(now_ns)
        twist = plant.chassis.twist([motor.speed_m_s for motor in plant.motors])
        return tuple(self._imu.sample(now_ns, twist, plant.chassis.pose.theta))

    # What it does.

    def _execute(self, function: int, args: bytes, now_ns: int) -> None:
        if self._latched and function not in {0x0F, 0x15, 0x50}:
            return
        if function == 0x01:
            self._reports = bool(args[0])
            if args[1] == IN_FLASH:
                self._store(auto_report=args[0])
        elif function == 0x0F and args[0] == IN_FLASH:
            self._brake(now_ns)
        elif function == 0x10:
            self._plant.advance(now_ns)
            self._control.drive(tuple(_open_loop(value) for value in args[:CHANNELS]))
        elif function == 0x11 and args[1] in {0, 7} and self._stored.car_type in CAR_TYPES:
            if args[1] == 0 and args[2] == args[3] == 0:
                self._plant.advance(now_ns)
                self._control.release()
            else:
                self._brake(now_ns)
        elif function == 0x12:
            vx, vy, wz = struct.unpack("<3h", args[1:7])
            self._move(vx, vy, wz, now_ns)
        elif function == 0x13:
            p, i, d = (single(value / 1000.0) for value in struct.unpack("<3H", args[:6]))
            if max(p, i, d) <= 10.0:
                self._set(False, p=p, i=i, d=d)
                if args[6] == IN_FLASH:
                    p, i, d = (thousandths(gain) / 1000.0 for gain in (p, i, d))
                    self._store(p=p, i=i, d=d)
        elif function == 0x15:
            if args[0] in CAR_TYPES:
                self._set(args[1] == IN_FLASH, car_type=args[0])
        elif function == 0x50:
            self._answer(args[0], args[1], now_ns)

    def _move(self, vx: int, vy: int, wz: int, now_ns: int) -> None:
        if vx == vy == wz == 0:
            self._brake(now_ns)
            return
        speeds, self.steering_deg = self._car.wheels(vx, vy, wz)
        self._plant.advance(now_ns)
        self._plant.steer(self.steering_deg)
        if self._car.axles_mm and vx == 0:
            self._brake(now_ns)
        else:
            self._control.regulate(speeds)

    def _brake(self, now_ns: int) -> None:
        self._plant.advance(now_ns)
        self._control.drive((BRAKED,) * CHANNELS)

    def _answer(self, function: int, parameter: int, now_ns: int) -> None:
        stored = self._stored
        if function == 0x01:
            self._send_speed(now_ns)
        elif function == 0x51:
            major, minor = (int(part) for part in self._firmware.split(".")[:2])
            self._send(0x51, bytes((major, minor)), now_ns)
        elif function == 0x15:
            self._send(0x15, bytes((stored.car_type, 0)), now_ns)
        elif function == 0x13 and 1 <= parameter <= CHANNELS:
            gains = (thousandths(gain) for gain in (stored.p, stored.i, stored.d))
            self._send(0x13, struct.pack("<B3H", parameter, *gains), now_ns)

    def _set(self, in_flash: bool, **values: float) -> None:
        self._stored = msgspec.structs.replace(self._stored, **values)
        if in_flash:
            self._store(**values)

    def _store(self, **values: float) -> None:
        self.flash = msgspec.structs.replace(self.flash, **values)


def single(value: float) -> float:
    """The number as the board's float of 32 bits."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def thousandths(gain: float) -> int:
    """A gain as the board shows and stores it: multiplied as such a float, and cut."""
    return int(single(single(gain) * 1000.0))


def _open_loop(value: int) -> int:
    """Outputs of the motor function: a share of 100, above the dead zone."""
    signed = value - 256 if value > 127 else value
    if signed == 0:
        return 0
    effect = min(abs(signed), 100) * (3600 - DEAD_ZONE) // 100
    return int(math.copysign(DEAD_ZONE + effect, signed))


def _short(value: float) -> int:
    """Convert a number to 16 bits, as the board does."""
    return (int(value) + 0x8000) % 0x1_0000 - 0x8000
