"""The keyboard, the screen and the bus of ``yahboomd drive``, put together."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import sys

from yahboomd.bus import keys
from yahboomd.cli.screens import ansi, drive_screen
from yahboomd.cli.screens.feed import Feed
from yahboomd.cli.screens.teleop import Teleop
from yahboomd.cli.screens.terminal import Keys
from yahboomd.clock import Clock, Schedule, nanoseconds, seconds
from yahboomd.daemon.process import deadly

REDRAW_S = 0.1


class Driver:
    """The keyboard, the screen and the bus, put together.

    Args:
        feed: What comes from the daemon, and the way to it.
        teleop: Makes commands of keys.
        clock: What tells the time.
        source: The key to command on.
    """

    def __init__(self, feed: Feed, teleop: Teleop, clock: Clock, source: str) -> None:
        self._feed = feed
        self._teleop = teleop
        self._clock = clock
        self._source = source
        self._ended = asyncio.Event()
        self._requests: set[asyncio.Task[None]] = set()
        self._said: ansi.Part = ("", "")
        self._drawn = ""
        self._colours = "NO_COLOR" not in os.environ

    async def run(self) -> None:
        """Drive until the person quits, a signal comes or the terminal goes.

        Raises:
            BusError: The bus can never be reached like this.
        """
        loop = asyncio.get_running_loop()
        # One that would suspend it ends it: a command that sleeps stops no robot.
        numbers = [*deadly(), signal.SIGTSTP]
        for number in numbers:
            loop.add_signal_handler(number, self._end)
        try:
            with Keys(sys.stdin.fileno(), self._press, self._end):
                _write(ansi.ENTER)
                try:
                    await self._loop()
                finally:
                    self._end()
                    _write(ansi.LEAVE)
        finally:
            # In this order: the robot stands before anything that may take its time.
            await self._feed.client.finished()
            for task in self._requests:
                task.cancel()
            await asyncio.gather(*self._requests, return_exceptions=True)
            for number in numbers:
                loop.remove_signal_handler(number)

    async def _loop(self) -> None:
        schedule = Schedule(self._clock, nanoseconds(REDRAW_S))
        try:
            while not self._ended.is_set():
                self._feed.check()
                self._draw()
                await schedule.beat()
        finally:
            schedule.close()

    def _end(self) -> None:
        # A command that only looked on has nothing to take back.
        if self._feed.client.commanded is not None:
            self._feed.client.stop()
        self._ended.set()

    def _press(self, key: str) -> None:
        now_ns = self._clock.now_ns()
        wanted = self._teleop.press(key, now_ns)
        motion = self._teleop.motion(now_ns)
        if motion is not None:
            twist, until_ns = motion
            for_s = seconds(until_ns - now_ns)
            self._feed.client.drive(twist.vx, twist.wz, vy=twist.vy, for_s=for_s)
        elif wanted not in {"faster", "slower"}:
            self._feed.client.stop()
        if wanted == "quit":
            self._end()
        elif wanted in {"estop", "release"}:
            task = asyncio.create_task(self._estop() if wanted == "estop" else self._release())
            self._requests.add(task)
            task.add_done_callback(self._requests.discard)
        self._draw()

    async def _estop(self) -> None:
        client = self._feed.client
        self._said = ("emergency stop …", "bold red")
        if client.is_open:
            answer = await client.request(keys.ESTOP, b'{"by":"yahboomd drive"}', urgent=True)
            if answer.answered:
                self._said = (answer.message, "bold red")
                return
        self._said = (
            "NO DAEMON ACKNOWLEDGED THE EMERGENCY STOP. Switch the motors' supply off.",
            "bold reverse red",
        )

    async def _release(self) -> None:
        client = self._feed.client
        self._said = ("asking to release the emergency stop …", "yellow")
        if not client.is_open:
            self._said = ("There is no daemon to ask.", "yellow")
            return
        answer = await client.request(keys.ESTOP_RESET)
        self._said = (answer.message, "green" if answer.success else "yellow")

    def _draw(self) -> None:
        now_ns = self._clock.now_ns()
        width, height = shutil.get_terminal_size()
        drawn = ansi.frame(
            drive_screen.screen(
                self._feed.view(now_ns),
                self._teleop.view(self._feed.client.commanded),
                robot=self._feed.robot,
                key=self._source,
                heard=self._feed.client.heard,
                why=self._feed.why,
                said=self._said,
                width=width,
                height=height,
                colours=self._colours,
            ),
            height,
        )
        if drawn != self._drawn:
            self._drawn = drawn
            _write(drawn)


def _write(text: str) -> None:
    # Past Python's buffer: what a terminal that hung up did not take would fail again at the end.
    data = text.encode()
    try:
        while data:
            data = data[os.write(sys.stdout.fileno(), data) :]
    except OSError:
        # The terminal is gone; its reader says so, and ends the command.
        return
