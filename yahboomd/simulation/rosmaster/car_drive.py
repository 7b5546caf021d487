"""The motors and the steering of the Rosmaster firmware, by the type of the car."""

from __future__ import annotations

import math

from yahboomd.core.model import CHANNELS
from yahboomd.simulation.motors import PWM_MAX
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.rosmaster.car_types import (
    CAR_TYPES,
    KEEPS_ANGLE,
    M1,
    R2,
    SUNRISE,
    X3_PLUS,
    CarType,
    limited,
)
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored, single
from yahboomd.simulation.speed_loop import LoopSettings, MotorControl, beyond

BRAKED = 1
"""An output inside the motors' dead zone shorts them."""

STOPS, BRAKES = 0, 7
"""The states of function 11 that are not a velocity."""

COUNTS_TURNED_ROUND = {X3_PLUS, SUNRISE, M1}
"""The types whose encoders the firmware reads with the other sign, as these cars are wired. That of
the M1 is inferred: one was shipped with the type of an X3 Plus, and drove."""

LIMITS_BODY = {X3_PLUS, M1}
"""The types that limit vx and vy before the wheels."""

SERVO_MOST_DEG = 180


class CarDrive:
    """Motors, speed loops and steering.

    Attributes:
        car_type: The type in memory.
        steering_deg: The latest commanded angle of the front wheels, + left.
        centre_deg: The servo's angle that counts as straight ahead.
        gains: P, I, D of the speed loops.

    Args:
        stored: The initial settings of the flash. The simulated car is built to match them.
    """

    def __init__(self, plant: Plant, control: MotorControl, stored: RosmasterStored) -> None:
        self._plant = plant
        self._control = control
        self._turned_round = stored.car_type in COUNTS_TURNED_ROUND
        self._straight_deg = stored.steering_centre
        self.load(stored)
        self.begin()

    def load(self, stored: RosmasterStored) -> None:
        """Load the stored settings, with the wheels straight."""
        self.car_type = stored.car_type
        self.gains = (single(stored.p), single(stored.i), single(stored.d))
        self.steering_deg = 0
        self.centre_deg = stored.steering_centre
        self._ahead = 0

    def begin(self) -> None:
        """Turn the servo to straight ahead."""
        self.turn_servo(self.centre_deg)

    @property
    def car(self) -> CarType:
        """The row of the type in memory; the X3's if the table has none for it."""
        return CAR_TYPES.get(self.car_type, CAR_TYPES[1])

    @property
    def tuning(self) -> LoopSettings:
        """The settings of the speed loops."""
        p, i, d = self.gains
        car = self.car
        return LoopSettings(
            mm_s_per_tick=car.mm_s_per_tick,
            p=p,
            i=i,
            d=d,
            dead_zone=car.dead_zone,
            most_output=PWM_MAX - car.dead_zone,
            counts_inverted=(self.car_type in COUNTS_TURNED_ROUND) != self._turned_round,
        )

    # The commands.

    def move(self, vx: int, vy: int, wz: int) -> None:
        """Function 12: mm/s, mm/s and mrad/s. Zeros brake on every type of car."""
        if vx == vy == wz == 0:
            self.brake()
        elif self.car_type in LIMITS_BODY:
            most = self.car.clamp_mm_s
            self._command(max(-most, min(most, vx)), max(-most, min(most, vy)), wz)
        else:
            self._command(vx, vy, wz)

    def run(self, state: int, speed: int) -> None:
        """Function 11, and 0F as its state 7: one of eight states, the speed in 10 mm/s."""
        car = CAR_TYPES.get(self.car_type)
        if car is None:
            return
        speed = speed * 10 & 0xFFFF
        if self.car_type in LIMITS_BODY:
            speed = min(speed, car.clamp_mm_s)
        if state in {STOPS, BRAKES}:
            if car.axles_mm:
                self._ahead = 0
                if state == BRAKES:
                    self.steer(0)
            if state == STOPS and speed == 0:
                self._control.release()
            else:
                self.brake()
        elif state < BRAKES:
            self._command(*car.run(state, speed))

    def set_outputs(self, shares: bytes) -> None:
        """Function 10: open loop. Speed loops that are on set the outputs again when they run."""
        above = (PWM_MAX - self.car.dead_zone) / 100.0
        signed = (share - 256 if share > 127 else share for share in shares)
        zone = self.car.dead_zone
        self._control.override(tuple(beyond(int(each * above), zone) for each in signed))

    def brake(self) -> None:
        """Short the motors, and end the speed loops."""
        self._control.drive((BRAKED,) * CHANNELS)

    def steer(self, angle_deg: int) -> None:
        """Turn the front wheels, + left."""
        self.steering_deg = limited(angle_deg)
        self.turn_servo(self.centre_deg - self.steering_deg)

    def steer_with_wheels(self, angle_deg: int) -> None:
        """Function 31 with 81: adapt the speeds of the rear wheels to the angle, too."""
        self.steer(angle_deg)
        angle = single(self.steering_deg * single(math.pi / 180.0))
        self._control.regulate(CAR_TYPES[R2].rear_wheels(self._ahead, angle))

    def set_centre(self, angle_deg: int) -> None:
        """Function 30: turn the servo to the new centre at once."""
        self.centre_deg = angle_deg
        self.turn_servo(angle_deg)

    def turn_servo(self, angle_deg: int) -> None:
        """Function 03 of the first servo, which steers; its angle falls to the left."""
        if 0 <= angle_deg <= SERVO_MOST_DEG:
            self._plant.steer(self._straight_deg - angle_deg)

    def set_type(self, car_type: int) -> None:
        """Change the type of the car."""
        if car_type == self.car_type:
            return
        self.car_type = car_type
        if car_type == R2:
            self.turn_servo(self.centre_deg)

    def _command(self, vx: int, vy: int, wz: int) -> None:
        car = CAR_TYPES.get(self.car_type)
        if car is None:
            return
        if car.axles_mm:
            self._steer_and_drive(car, vx, vy, wz)
        elif vx == wz == 0 and (vy == 0 or not car.sideways):
            self.brake()
        else:
            self._control.regulate(car.wheels(vx, vy, wz))

    def _steer_and_drive(self, car: CarType, vx: int, vy: int, wz: int) -> None:
        self._ahead = vx
        angle_deg = self.steering_deg if vy == KEEPS_ANGLE else limited(vy)
        if vx == 0:
            self.brake()
            self.steer(angle_deg)
            return
        speeds, angle_deg = car.steered(vx, wz, angle_deg)
        self.steer(angle_deg)
        self._control.regulate(speeds)
