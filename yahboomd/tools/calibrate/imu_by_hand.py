"""``yahboomd calibrate imu``: a turn by hand shows how the inertial sensor is mounted."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from yahboomd.core.errors import Refused

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Coroutine

    from yahboomd.core.config import Config
    from yahboomd.core.messages.native import ImuSample
    from yahboomd.core.model import Vector3
    from yahboomd.tools.calibrate.estimates.hand_turn import Mounted
    from yahboomd.tools.terminal.asking import Person

REST_S = 3.0
FIRST_WITHIN_S = 2.0
LONGEST_GAP_NS = 200_000_000


class _Gathered:
    """Samples as they come: their means, and the integral of the gyro by their stamps."""

    def __init__(self) -> None:
        self.count = 0
        self.turn: list[float] = [0.0] * 3
        self.force: list[float] = [0.0] * 3
        self.angles: list[float] = [0.0] * 3
        self.lost = False
        self._before: ImuSample | None = None

    def add(self, sample: ImuSample, bias: Vector3) -> None:
        before, self._before = self._before, sample
        self.count += 1
        for axis in range(3):
            self.turn[axis] += sample.gyro_rad_s[axis]
            self.force[axis] += sample.acceleration_m_s2[axis]
        if before is None:
            return
        gap_ns = sample.stamp_ns - before.stamp_ns
        self.lost = self.lost or not 0 < gap_ns < LONGEST_GAP_NS
        for axis in range(3):
            rate = 0.5 * (sample.gyro_rad_s[axis] + before.gyro_rad_s[axis])
            self.angles[axis] += (rate - bias[axis]) * gap_ns * 1e-9


async def turn_by_hand(
    stream: Callable[[], AsyncIterator[ImuSample]], person: Person, config: Config, turns: float
) -> Mounted:
    """Ask the person to turn the robot, and judge its sensor's samples.

    Raises:
        Refused: No samples come, or they cannot be trusted.
    """
    from yahboomd.tools.calibrate.estimates.hand_turn import judge

    try:
        await asyncio.wait_for(anext(stream()), FIRST_WITHIN_S)
    except TimeoutError as error:
        raise Refused(
            "The board sends no samples of an inertial sensor. `yahboomd status --json` names the "
            "sensor in board.imu if the board has one."
        ) from error
    mark = "Put the robot on the floor, its side along a straight edge, and take your hands off."
    await person.confirm("rest", f"{mark} {person.enter}, then wait {REST_S:g} s.")
    rest = await _gather(stream(), asyncio.sleep(REST_S), (0.0, 0.0, 0.0))
    bias, force = (
        (each[0] / rest.count, each[1] / rest.count, each[2] / rest.count)
        for each in (rest.turn, rest.force)
    )
    asked = person.confirm(
        "turned",
        f"Turn it {turns:g} times to the left, flat on the floor, back to the edge: counter-"
        f"clockwise from above. {person.enter} when it is there.",
    )
    moved = await _gather(stream(), asked, bias)
    if moved.lost:
        raise Refused("Samples were lost on the way: there is no result. Try again.")
    x, y, z = moved.angles
    imu = config.imu
    found = judge(
        (x, y, z),
        force,
        turns,
        axes=imu.axes,
        gyro_axes=imu.gyro_axes,
        scale=imu.gyro_scale or 1.0,
    )
    if found.doubts:
        raise Refused(f"{' '.join(found.doubts)} There is no result. Try again.")
    return found


async def _gather(
    samples: AsyncIterator[ImuSample], until: Coroutine[Any, Any, object], bias: Vector3
) -> _Gathered:
    gathered = _Gathered()
    ended = asyncio.ensure_future(until)
    coming = asyncio.ensure_future(anext(samples))
    try:
        while not ended.done():
            await asyncio.wait({ended, coming}, return_when=asyncio.FIRST_COMPLETED)
            if coming.done():
                gathered.add(coming.result(), bias)
                coming = asyncio.ensure_future(anext(samples))
        ended.result()
    finally:
        for each in (ended, coming):
            each.cancel()
            await asyncio.gather(each, return_exceptions=True)
    if gathered.count < 2:
        raise Refused("The samples of the inertial sensor ended.")
    return gathered


def show_mounted(found: Mounted, config: Config, person: Person) -> None:
    """Show the axes to configure."""
    imu = config.imu
    right = (found.axes, found.gyro_axes) == (
        imu.axes,
        "" if imu.gyro_axes == imu.axes else imu.gyro_axes,
    )
    if right:
        person.say("The axes are right.")
    else:
        person.say(
            "The axes are wrong: put this into the configuration, and restart the daemon. Which "
            "axis points forward is guessed; the heading does not depend on it."
        )
    facts: dict[str, Any] = {"axes": found.axes, "gyro_scale": round(found.gyro_scale, 6)}
    lines = ["[imu]", f'axes = "{found.axes}"']
    if found.gyro_axes:
        facts["gyro_axes"] = found.gyro_axes
        lines.append(f'gyro_axes = "{found.gyro_axes}"')
    lines.append(f"gyro_scale = {found.gyro_scale:g}")
    person.result("\n".join(lines), facts)
