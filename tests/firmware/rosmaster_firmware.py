"""The vendor's Rosmaster firmware 3.5.1 as the board of a simulated robot: the judge of that board.

It is compiled for this machine by `make firmware`, with a scheduler, a line and motors of its rig.
The rig's motors stand still here: the encoders' timers are those of the plant, and its motors get
what is in the timers of the outputs.
"""

from __future__ import annotations

import _ctypes
import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from random import Random
from typing import Any

from vendor_firmware import ROSMASTER_LIBRARY, rig

from yahboomd.core.clock import nanoseconds
from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.board import BOOT_NS, NEVER, Emit
from yahboomd.simulation.boards import BOARDS, BoardKind
from yahboomd.simulation.motors import PWM_MAX
from yahboomd.simulation.options import PLAIN_GAIN, SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.rosmaster.car_drive import BRAKED, SERVO_MOST_DEG
from yahboomd.simulation.rosmaster.rosmaster_flash import WRITE_NS, RosmasterStored, thousandths

MS = 1_000_000
LATCHED_RESET_NS = 50 * MS

_ENCODERS = ((2, 1), (4, -1), (5, -1), (3, 1))
"""For each motor of an X3 the timer that counts it, and the sign with which it is read."""

_TURNED_ROUND = {2, 6}

_OUTPUTS = (((8, 2), (8, 1)), ((8, 4), (8, 3)), ((1, 4), (1, 1)), ((1, 2), (1, 3)))
"""For each motor timer and channel that turn it forward, and those that turn it backward."""

_TIMER, _COUNT, _CHANNEL = 0x50, 0x24, 0x30
"""Bytes of a timer, and where in it are the count and, 4 for each, the channels."""

_FLASH = {
    "car_type": 0x04,
    "auto_report": 0x06,
    "yaw_p": 0x20,
    "yaw_i": 0x22,
    "yaw_d": 0x24,
    "p": 0x30,
    "i": 0x32,
    "d": 0x34,
    "steering_centre": 0x70,
}
_GAINS = frozenset({"p", "i", "d", "yaw_p", "yaw_i", "yaw_d"})


class FirmwareRosmaster:
    """The firmware, with the plant's motors and steering."""

    def __init__(
        self,
        options: SimulationOptions,
        plant: Plant,
        emit: Emit,
        random: Random,
    ) -> None:
        self.emit = emit
        stored = options.flash
        sold_as = RosmasterStored(car_type=5 if options.drive == "ackermann" else 1)
        stored = stored if isinstance(stored, RosmasterStored) else sold_as
        self._plant = plant
        self._signs = [-sign if stored.car_type in _TURNED_ROUND else sign for _, sign in _ENCODERS]
        self._straight_deg = stored.steering_centre
        self._start_up_ns = nanoseconds(options.start_up_s)
        self._imu = 0 if stored.imu == "icm20948" else 1
        self._listens_ns = self._ms_ns = NEVER
        self._reset_ns = NEVER
        os.environ["ROSMASTER_FIRMWARE"] = str(ROSMASTER_LIBRARY)
        values = {
            at: thousandths(getattr(stored, name)) if name in _GAINS else getattr(stored, name)
            for name, at in _FLASH.items()
        }
        self._rig: Any = rig("rosmaster/rosmaster_board").Board(
            car=1,
            type_=stored.car_type,
            imu="mpu" if self._imu else "icm",
            flash=values,
            # No motors of its own.
            vmax=0.0,
            counts=0.0,
        )
        # Until it has measured its supply, and its tasks are in phase with the robot's start.
        self._rig.lib.fw_set(self._imu, ctypes.c_double(plant.volts))
        for _ in range(1599):
            self._rig.lib.fw_ms()
        self._rig.get()
        self._attach(0)

    def _attach(self, start_up_ns: int) -> None:
        lib = self._rig.lib
        self._begins_ms = start_up_ns // MS
        self._since_ms = 0
        base = ctypes.addressof((ctypes.c_char * (9 * _TIMER)).in_dll(lib, "fake_tim"))

        def register(timer: int, at: int) -> ctypes.c_uint16:
            return ctypes.c_uint16.from_address(base + timer * _TIMER + at)

        self._counters = [register(timer, _COUNT) for timer, _ in _ENCODERS]
        self._outputs = [
            tuple(register(timer, _CHANNEL + 4 * channel) for timer, channel in pair)
            for pair in _OUTPUTS
        ]
        self._totals = [ctypes.c_int.in_dll(lib, f"g_Encoder_M{n}_Now") for n in (1, 2, 3, 4)]
        self._seen: Counts | None = None
        self._writes = lib.fw_flash_writes()
        self._out: tuple[int, ...] = ()
        self.servo_deg = self._straight_deg

    # What it has.

    @property
    def totals(self) -> Counts:
        a, b, c, d = (total.value for total in self._totals)
        return a, b, c, d

    @property
    def latched(self) -> bool:
        """Whether its battery's alarm is on."""
        return bool(self._rig.tr.latched)

    @property
    def outputs(self) -> tuple[int, ...]:
        """The outputs in PWM units; :data:`BRAKED` where both sides of a motor are on."""
        found = []
        for ahead, back in self._outputs:
            shorted = ahead.value >= PWM_MAX and back.value >= PWM_MAX
            found.append(BRAKED if shorted else ahead.value - back.value)
        return tuple(found)

    @property
    def flash(self) -> RosmasterStored:
        """What it stores."""
        page = (ctypes.c_uint16 * 1024)()
        self._rig.lib.fw_flash_get(page)
        imu = "mpu9250" if self._imu else "icm20948"
        values = {name: page[at // 2] for name, at in _FLASH.items()}
        gains = {name: values[name] / 1000.0 for name in _GAINS}
        return RosmasterStored(**{**values, **gains, "imu": imu})

    # The robot's end.

    @property
    def next_ns(self) -> int:
        return 0

    @property
    def speaks_ns(self) -> int:
        return self._ms_ns

    def start(self, now_ns: int) -> None:
        self._listens_ns = now_ns
        self._ms_ns = now_ns

    def receive(self, byte: int, now_ns: int) -> None:
        if now_ns >= self._listens_ns and self._reset_ns == NEVER:
            self._rig.put((byte,))

    def run_due(self, now_ns: int) -> None:
        while self._ms_ns <= now_ns:
            at_ns = self._ms_ns
            self._ms_ns += MS
            if at_ns >= self._reset_ns:
                self.reset(at_ns, by_power=False)
            else:
                self._step(at_ns)

    def _step(self, at_ns: int) -> None:
        lib, plant, truth = self._rig.lib, self._plant, self._rig.tr
        plant.advance(at_ns)
        # Its timers are set up as its tasks begin.
        ticks = plant.ticks
        if self._seen is not None:
            for timer, sign, new, old in zip(
                self._counters, self._signs, ticks, self._seen, strict=True
            ):
                if new != old:
                    timer.value = timer.value - sign * (new - old)
        self._since_ms += 1
        if self._since_ms >= self._begins_ms:
            self._seen = ticks
        twist = plant.chassis.twist([motor.speed_m_s for motor in plant.motors])
        self._rig.o.hand_w, self._rig.o.push_v = twist.wz, twist.vx
        lib.fw_set(self._imu, ctypes.c_double(plant.volts))
        resets = lib.fw_ms()
        outputs = self.outputs
        if outputs != self._out:
            self._out = outputs
            plant.set_outputs(outputs)
        # The rig turns its wheels before the firmware's tasks: this is the angle before them.
        servo_deg = round(90.0 - truth.steer * 57.29577951308232)
        # The vendor's servo takes no other angle; the rig's does.
        if servo_deg != self.servo_deg and 0 <= servo_deg <= SERVO_MOST_DEG:
            self.servo_deg = servo_deg
            plant.steer(self._straight_deg - servo_deg)
        data = self._rig.get()
        if data:
            self.emit(data, at_ns)
        if resets and self._reset_ns == NEVER:
            # The firmware waits where the rig resets it at once.
            writes = lib.fw_flash_writes() - self._writes
            waits_ns = LATCHED_RESET_NS if self.latched else 0
            self._reset_ns = at_ns + writes * WRITE_NS + waits_ns
        self._writes = lib.fw_flash_writes()

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:
        self._plant.advance(now_ns)
        self._plant.set_outputs((0,) * CHANNELS)
        self._reset_ns = NEVER
        old = self._rig.lib
        self._rig.get()
        self._rig.load(self._start_up_ns / 1e9)
        _ctypes.dlclose(old._handle)
        self._attach(self._start_up_ns)
        self._listens_ns = now_ns + off_ns + BOOT_NS
        self._ms_ns = self._listens_ns + MS

    def set_tick_period(self, now_ns: int, period_ns: int, jitter_ns: int = 0) -> None:
        raise ValueError("a rosmaster board counts every 10 ms and reports every 41 ms")

    def hang(self) -> None:
        self._ms_ns = NEVER


@contextmanager
def firmware_instead_of_simulated() -> Iterator[None]:
    """Have each simulated Rosmaster board be the vendor's firmware."""
    before = BOARDS["rosmaster"]
    BOARDS["rosmaster"] = BoardKind(make=FirmwareRosmaster, flash=RosmasterStored)
    try:
        yield
    finally:
        BOARDS["rosmaster"] = before


def like_the_firmwares(
    car_type: int, *, volts: float, start_up_s: float = 10.5
) -> SimulationOptions:
    """An R2 (5) or an X3 with the firmware's gain, for robots that are compared with it."""
    steers = car_type == 5
    return SimulationOptions(
        dialect="rosmaster",
        drive="ackermann" if steers else "mecanum",
        ratio=19.0 if steers else 30.0,
        wheel_radius_m=0.03425 if steers else 0.0325,
        wheel_base_m=0.23537 if steers else 0.16,
        wheel_separation_m=0.1911 if steers else 0.169,
        flash=RosmasterStored(car_type=car_type),
        loop_gain=PLAIN_GAIN,
        motor_dead_zone=1400,
        battery_volts=volts,
        rated_volts=volts,
        start_up_s=start_up_s,
    )
