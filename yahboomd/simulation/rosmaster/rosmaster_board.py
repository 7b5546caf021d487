"""The Rosmaster expansion board: its firmware's tasks, as its source defines them.

- The interrupt of the serial port writes each byte into the only buffer, also over a waiting frame.
  A task checks for a frame once a millisecond. Nothing is acknowledged.
- A task of 10 ms reads the encoders and runs the incremental speed loops.
- A task of 1 ms answers the latest request and reports, four kinds in a cycle of 41 ms.
- A write of the flash blocks everything: no task runs, no byte is received, outputs stay.
- After a reset it sends its version and sensor, and then nothing for seconds, while it sets its
  inertial sensor up; the interrupt is on all the time, so that a frame waits until the tasks begin.
- When the battery is too low or too high for two seconds, it brakes, and stops counting and
  reporting and ignores most commands until it is reset.
"""

from __future__ import annotations

import struct
from random import Random
from typing import Any

import msgspec

from yahboomd.core.clock import nanoseconds
from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.board import BOOT_NS, NEVER, Emit
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.rosmaster.battery_alarm import BatteryAlarm
from yahboomd.simulation.rosmaster.board_sensor import BoardSensor
from yahboomd.simulation.rosmaster.car_drive import BRAKES, CarDrive
from yahboomd.simulation.rosmaster.car_types import CAR_TYPES, M1, SUNRISE, accepts
from yahboomd.simulation.rosmaster.one_buffer import OneBuffer
from yahboomd.simulation.rosmaster.rosmaster_flash import (
    IN_FLASH,
    WRITE_NS,
    RosmasterStored,
    short,
    single,
    thousandths,
)
from yahboomd.simulation.speed_loop import TICK_NS, MotorControl

FIRMWARE = "3.5.1"
FIRMWARE_OF_M1 = "3.6.5"
LOOK_NS = 1_000_000
CYCLE_NS = 41_000_000
REPORTS = ((1_000_000, 0x0A), (11_000_000, 0x0B), (21_000_000, 0x0C), (31_000_000, 0x0D))
"""When in a cycle which report is sent; the second is 0E for another sensor."""

BATTERY_NS = 100_000_000
BATTERY_FIRST_NS = 93_000_000
"""After the start; until then it reports no voltage at all."""

LATCHED_RESET_NS = 50_000_000
"""The time from a car type to the reset, of a board whose alarm has latched."""

SOLD_AS = RosmasterStored()
SUNRISE_GAINS = {"p": 1.5, "i": 0.08, "d": 0.5}
GAINS_MOST = 10.0
"""Greater stored gains are replaced at the next start."""


class RosmasterBoard:
    """A simulated board of the Rosmaster family."""

    def __init__(
        self, options: SimulationOptions, plant: Plant, emit: Emit, random: Random
    ) -> None:
        self.emit = emit
        flash = options.flash
        sold_as = RosmasterStored(car_type=5 if options.drive == "ackermann" else 1)
        self.flash = flash if isinstance(flash, RosmasterStored) else sold_as
        self._plant = plant
        self._control = MotorControl(plant, options.initial_ticks, options.loop_gain)
        self._drive = CarDrive(plant, self._control, self.flash)
        newer = self.flash.car_type == M1
        self._firmware = options.firmware or (FIRMWARE_OF_M1 if newer else FIRMWARE)
        self._start_up_ns = nanoseconds(options.start_up_s)
        self._sensor = BoardSensor(self.flash.imu, plant, random)
        self._buffer = OneBuffer()
        self._deaf_ns = 0
        self._tick_ns = self._look_ns = self._battery_ns = self._cycle_ns = NEVER
        self._banner_ns = self._listens_ns = self._begins_ns = self._reset_ns = NEVER
        self._clear()

    def _clear(self) -> None:
        """Reset the memory; the flash stays."""
        stored = self.flash
        self._drive.load(stored)
        self._yaw_gains = (stored.yaw_p, stored.yaw_i, stored.yaw_d)
        self._reports = bool(stored.auto_report)
        self._buffer.clear()
        self._alarm = BatteryAlarm()
        self._let_go = False
        self._velocity = (0, 0, 0)
        self._report = 0

    @property
    def next_ns(self) -> int:
        """The time of the next thing that happens inside."""
        return min(self._tick_ns, self._battery_ns, self.speaks_ns)

    @property
    def speaks_ns(self) -> int:
        """The time at which it may next send something."""
        return min(
            *(self._report_ns, self._look_ns, self._banner_ns, self._begins_ns, self._reset_ns)
        )

    @property
    def totals(self) -> Counts:
        """The counters, as the latest run of the speed loops left them."""
        return self._control.totals

    @property
    def steering_deg(self) -> int:
        """The commanded angle of the front wheels, + left."""
        return self._drive.steering_deg

    @property
    def _report_ns(self) -> int:
        return NEVER if self._cycle_ns == NEVER else self._cycle_ns + REPORTS[self._report][0]

    def start(self, now_ns: int) -> None:
        """Start as a board that was powered long ago."""
        self._listens_ns = now_ns
        self._begin(now_ns)
        self._alarm.measure(self._plant.volts, self._drive.car_type)

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:  # noqa: ARG002
        """Lose all but the flash, announce the start, and stay silent during the sensor's setup."""
        self._plant.advance(now_ns)
        self._control.restart()
        self._clear()
        self.hang()
        self._listens_ns = self._banner_ns = now_ns + off_ns + BOOT_NS
        self._begins_ns = self._listens_ns + self._start_up_ns

    def hang(self) -> None:
        """Stop executing, with the outputs as they are."""
        self._tick_ns = self._look_ns = self._battery_ns = self._cycle_ns = NEVER
        self._banner_ns = self._begins_ns = self._listens_ns = self._reset_ns = NEVER

    def set_tick_period(self, now_ns: int, period_ns: int, jitter_ns: int = 0) -> None:  # noqa: ARG002
        """Refuse: this board's periods are fixed.

        Raises:
            ValueError: Always.
        """
        raise ValueError("a rosmaster board counts every 10 ms and reports every 41 ms")

    def receive(self, byte: int, now_ns: int) -> None:
        """Store one byte, as the interrupt does."""
        if now_ns < self._listens_ns or now_ns <= self._deaf_ns:
            return
        self._buffer.receive(byte)
        looks = self._tick_ns != NEVER and self._reset_ns == NEVER
        if self._buffer.waits and self._look_ns == NEVER and looks:
            self._look_ns = (now_ns // LOOK_NS + 1) * LOOK_NS

    def run_due(self, now_ns: int) -> None:
        """Do everything that is due."""
        while (at_ns := self.next_ns) <= now_ns:
            if at_ns == self._reset_ns:
                self.emit(b"\r\nReset MCU\r\n", at_ns)
                self.reset(at_ns, by_power=False)
            elif at_ns == self._banner_ns:
                self._banner_ns = NEVER
                kind = self.flash.imu.upper() or "NONE"
                words = f"\nFirmware Version: V{self._firmware}\nIMU Type: {kind}\n"
                self.emit(words.encode(), at_ns)
            elif at_ns == self._begins_ns:
                self.emit(b"\nHello Yahboom!\n\nstart vTask_Speed\n", at_ns)
                self._begin(at_ns)
            elif at_ns == self._tick_ns:
                self._tick(at_ns)
            elif at_ns == self._look_ns:
                self._look(at_ns)
            elif at_ns == self._report_ns:
                self._send_report(at_ns)
            else:
                self._measure_battery(at_ns)

    # The tasks.

    def _begin(self, now_ns: int) -> None:
        self._begins_ns = NEVER
        self._tick_ns = self._cycle_ns = now_ns
        self._battery_ns = now_ns + BATTERY_FIRST_NS
        self._drive.begin()
        self._replace_gains()
        self._sensor.begin(now_ns)
        self._look_ns = now_ns if self._buffer.waits else NEVER

    def _replace_gains(self) -> None:
        stored = self.flash
        if max(stored.p, stored.i, stored.d) > GAINS_MOST:
            self._set_gains(SOLD_AS.p, SOLD_AS.i, SOLD_AS.d)
            self._keep_gains()
        if max(stored.yaw_p, stored.yaw_i, stored.yaw_d) > GAINS_MOST:
            self._yaw_gains = p, i, d = SOLD_AS.yaw_p, SOLD_AS.yaw_i, SOLD_AS.yaw_d
            self.flash = msgspec.structs.replace(self.flash, yaw_p=p, yaw_i=i, yaw_d=d)

    def _tick(self, now_ns: int) -> None:
        self._tick_ns += TICK_NS
        if self._alarm.latched:
            if not self._let_go:
                self._let_go = True
                self._control.release()
            return
        tuning = self._drive.tuning
        self._control.tick(now_ns, tuning)
        self._control.renew_totals(now_ns, tuning)
        if self._drive.car_type in CAR_TYPES:
            deltas = self._control.deltas
            self._velocity = self._drive.car.body(deltas, self._drive.steering_deg)

    def _measure_battery(self, now_ns: int) -> None:
        """Measure the battery, and brake each time if the alarm is on.

        Between its first brake and its second the speed loops end, and release the motors.
        """
        self._battery_ns += BATTERY_NS
        self._plant.advance(now_ns)
        self._alarm.measure(self._plant.volts, self._drive.car_type)
        if self._alarm.latched:
            self._drive.brake()

    def _look(self, now_ns: int) -> None:
        self._look_ns = NEVER
        found = self._buffer.take()
        if found is not None:
            self._plant.advance(now_ns)
            self._execute(*found, now_ns)

    def _send_report(self, now_ns: int) -> None:
        kind = REPORTS[self._report][1]
        self._report += 1
        if self._report == len(REPORTS):
            self._report = 0
            self._cycle_ns += CYCLE_NS
        if not self._reports or self._alarm.latched:
            return
        if kind == 0x0A:
            self._send_speed(now_ns)
        elif kind == 0x0D:
            self._send(kind, struct.pack("<4i", *self.totals), now_ns)
        elif (report := self._sensor.report(kind, now_ns)) is not None:
            self._send(*report, now_ns)

    def _write_flash(self, now_ns: int, times: int = 1, **values: Any) -> None:  # noqa: ANN401
        """Store values; everything else waits meanwhile."""
        self.flash = msgspec.structs.replace(self.flash, **values)
        if self._report_ns == now_ns:
            self._send_report(now_ns)
        if self._battery_ns == now_ns:
            self._measure_battery(now_ns)
        held_ns = times * WRITE_NS
        self._deaf_ns = max(self._deaf_ns, now_ns) + held_ns
        self._tick_ns += held_ns
        self._cycle_ns += held_ns
        self._battery_ns += held_ns

    # What it sends.

    def _send(self, function: int, payload: bytes, now_ns: int) -> None:
        inside = bytes((len(payload) + 3, function)) + payload
        self.emit(b"\xff\xfb" + inside + bytes((sum(inside) & 0xFF,)), now_ns)

    def _send_speed(self, now_ns: int) -> None:
        velocity = map(short, self._velocity)
        self._send(0x0A, struct.pack("<3hB", *velocity, self._alarm.tenths & 0xFF), now_ns)

    # What it does.

    def _execute(self, function: int, args: bytes, now_ns: int) -> None:
        if self._alarm.latched and function not in {0x0F, 0x15, 0x50}:
            return
        drive, saved = self._drive, args[6] == IN_FLASH
        signed = args[1] - 256 if args[1] > 127 else args[1]
        match function:
            case 0x01:
                self._reports = bool(args[0])
                if args[1] == IN_FLASH:
                    self._keep("report", "auto_report", args[0], now_ns)
            case 0x03 if args[0] == 1:
                drive.turn_servo(args[1])
            case 0x0F if args[0] == IN_FLASH:
                drive.run(BRAKES, 0)
            case 0x10:
                drive.set_outputs(args[:CHANNELS])
            case 0x11:
                drive.run(args[1], args[2] | args[3] << 8)
            case 0x12:
                drive.move(*struct.unpack("<3h", args[1:7]))
            case 0x13:
                self._set_gains(*_gains(args))
                if saved:
                    self._keep_gains()
                    self._write_flash(now_ns)
            case 0x14:
                self._yaw_gains = _gains(args)
                if saved:
                    p, i, d = (thousandths(gain) / 1000.0 for gain in self._yaw_gains)
                    self._write_flash(now_ns, yaw_p=p, yaw_i=i, yaw_d=d)
            case 0x15:
                self._set_type(args[0], saved=args[1] == IN_FLASH, now_ns=now_ns)
            case 0x24 if args[0] == 0:
                # The middle positions of an arm, which is not simulated.
                self._write_flash(now_ns)
            case 0x30 if args[0] == 1 and args[1] <= 180:
                drive.set_centre(args[1])
                if args[2] == IN_FLASH:
                    self._keep("AKM Angle", "steering_centre", args[1], now_ns)
            case 0x31 if args[0] == 1:
                drive.steer(-signed)
            case 0x31 if args[0] == 0x81:
                drive.steer_with_wheels(-signed)
            case 0x50:
                self._answer(args[0], args[1], now_ns)
            case 0xA0 if args[0] == IN_FLASH:
                self._restore(now_ns)
            case _:
                # Lights, buzzer and servos of an arm are not simulated.
                pass

    def _answer(self, function: int, parameter: int, now_ns: int) -> None:
        if function == 0x01:
            self._send_speed(now_ns)
        elif function == 0x51:
            major, minor = (int(part) for part in self._firmware.split(".")[:2])
            self._send(0x51, bytes((major, minor)), now_ns)
        elif function == 0x15:
            self._send(0x15, bytes((self._drive.car_type, 0)), now_ns)
        elif function == 0x30:
            self._send(0x30, bytes((1, self._drive.centre_deg)), now_ns)
        elif (function == 0x13 and 1 <= parameter <= CHANNELS) or (
            function == 0x14 and parameter == CHANNELS + 1
        ):
            gains = self._drive.gains if function == 0x13 else self._yaw_gains
            shown = (thousandths(gain) & 0xFFFF for gain in gains)
            self._send(function, struct.pack("<B3H", parameter, *shown), now_ns)

    def _set_type(self, car_type: int, *, saved: bool, now_ns: int) -> None:
        if accepts(car_type, self._firmware):
            self._drive.set_type(car_type)
            if saved:
                self._keep("carType", "car_type", car_type, now_ns)
            if car_type == SUNRISE:
                self._set_gains(*SUNRISE_GAINS.values())
                if saved:
                    self._keep_gains()
                    self._write_flash(now_ns)
        if self._alarm.latched:
            self._reset_ns = max(self._deaf_ns, now_ns) + LATCHED_RESET_NS

    def _set_gains(self, p: float, i: float, d: float) -> None:
        self._drive.gains = single(p), single(i), single(d)

    def _keep_gains(self) -> None:
        p, i, d = (thousandths(gain) / 1000.0 for gain in self._drive.gains)
        self.flash = msgspec.structs.replace(self.flash, p=p, i=i, d=d)

    def _keep(self, words: str, name: str, value: int, now_ns: int) -> None:
        """Print the stored value, and write the new one if it differs."""
        had = getattr(self.flash, name)
        self.emit(f"FRead {words}:{had}\n".encode(), now_ns)
        if had != value:
            self._write_flash(now_ns, **{name: min(value, 1) if name == "auto_report" else value})

    def _restore(self, now_ns: int) -> None:
        """Store the factory settings and start again; each value that differed takes a write."""
        stored = self.flash
        differ = (
            *(not stored.auto_report, stored.car_type != SOLD_AS.car_type),
            stored.steering_centre != SOLD_AS.steering_centre,
        )
        # The gains, an arm's and two marks are written even if they do not differ.
        self.flash = msgspec.structs.replace(SOLD_AS, imu=stored.imu)
        self._drive.set_centre(SOLD_AS.steering_centre)
        self._reports = True
        self._write_flash(now_ns, times=5 + sum(differ))
        self._reset_ns = self._deaf_ns


def _gains(args: bytes) -> tuple[float, float, float]:
    p, i, d = struct.unpack("<3H", args[:6])
    return p / 1000.0, i / 1000.0, d / 1000.0
