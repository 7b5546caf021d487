"""The keyboard, the screen and the bus of ``yahboomd drive``, put together."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import sys

from yahboomd.bus import keys
from yahboomd.bus.publishers import BusPublisher
from yahboomd.cli import ansi, drive_screen
from yahboomd.cli.feed import Feed
from yahboomd.cli.teleop import Teleop
from yahboomd.cli.terminal import Keys
from yahboomd.clock import Clock, Schedule, nanoseconds
from yahboomd.messages.codecs import encode
from yahboomd.messages.native import VelocityCommand
from yahboomd.model import STANDSTILL, Twist2d

PERIOD_S = 0.05
"""Commands come twenty times a second while a key is held."""

DRAW_EVERY = 2
"""Screens are drawn for every second of these beats."""

LAST_ZEROS = 4
"""Zeros at the end, a beat apart: one of them may get lost."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


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
        self._publisher: BusPublisher | None = None
        self._published = False
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
        for number in SIGNALS:
            loop.add_signal_handler(number, self._ended.set)
        try:
            with Keys(sys.stdin.fileno(), self._press, self._ended.set):
                _write(ansi.ENTER)
                try:
                    await self._loop()
                finally:
                    self._teleop.stop(self._clock.now_ns())
                    _write(ansi.LEAVE)
        finally:
            # In this order: the robot stands before anything that may take its time.
            await self._last_zeros()
            for task in self._requests:
                task.cancel()
            await asyncio.gather(*self._requests, return_exceptions=True)
            for number in SIGNALS:
                loop.remove_signal_handler(number)

    async def _loop(self) -> None:
        schedule = Schedule(self._clock, nanoseconds(PERIOD_S))
        beats = 0
        try:
            while not self._ended.is_set():
                self._feed.check()
                self._open_publisher()
                self._publish()
                if beats % DRAW_EVERY == 0:
                    self._draw()
                beats += 1
                await schedule.beat()
        finally:
            schedule.close()

    def _press(self, key: str) -> None:
        now_ns = self._clock.now_ns()
        before = self._teleop.command(now_ns)
        wanted = self._teleop.press(key, now_ns)
        if self._teleop.command(now_ns) != before:
            # At once: a change that waited for the next beat would be 25 ms late on average.
            self._publish()
        if wanted == "quit":
            self._ended.set()
        elif wanted in {"estop", "release"}:
            task = asyncio.create_task(self._estop() if wanted == "estop" else self._release())
            self._requests.add(task)
            task.add_done_callback(self._requests.discard)
        self._draw()

    def _open_publisher(self) -> None:
        client = self._feed.client
        if self._publisher is None and client is not None:
            self._publisher = client.publisher(
                self._source,
                encoding="application/json;VelocityCommand",
                priority="real_time",
                express=True,
            )

    def _publish(self) -> None:
        command = self._teleop.command(self._clock.now_ns())
        if command is not None and self._publisher is not None:
            self._put(self._publisher, command)

    def _put(self, publisher: BusPublisher, twist: Twist2d) -> None:
        command = VelocityCommand(
            vx=twist.vx,
            vy=twist.vy,
            wz=twist.wz,
            stamp_ns=self._clock.wall_ns(),
            source="yahboomd drive",
        )
        publisher.put(encode(command, "json"))
        self._published = True

    async def _last_zeros(self) -> None:
        # Who only looked on has nothing to take back, and stops nobody else's driving.
        if self._publisher is None or not self._published:
            return
        for _ in range(LAST_ZEROS):
            self._put(self._publisher, STANDSTILL)
            await asyncio.sleep(PERIOD_S)

    async def _estop(self) -> None:
        client = self._feed.client
        self._said = ("emergency stop …", "bold red")
        if client is not None:
            answer = await client.request(keys.ESTOP, b'{"engaged":true}', urgent=True)
            if answer.answered:
                self._said = (answer.message, "bold red")
                return
        self._said = (
            "NOBODY ACKNOWLEDGED THE EMERGENCY STOP. Switch the motors' supply off.",
            "bold reverse red",
        )

    async def _release(self) -> None:
        client = self._feed.client
        self._said = ("asking to release the emergency stop …", "yellow")
        if client is None:
            self._said = ("There is no daemon to ask.", "yellow")
            return
        answer = await client.request(keys.ESTOP_RESET)
        self._said = (answer.message, "green" if answer.success else "yellow")

    def _draw(self) -> None:
        now_ns = self._clock.now_ns()
        width, height = shutil.get_terminal_size()
        publisher = self._publisher
        drawn = ansi.frame(
            drive_screen.screen(
                self._feed.view(now_ns),
                self._teleop.view(now_ns),
                robot=self._feed.robot,
                key=self._source,
                heard=publisher is not None and publisher.has_subscribers,
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
