"""Connects the keyboard, a gamepad, the screen and the bus for ``yahboomd drive``."""

from __future__ import annotations

import asyncio
import signal
import sys
from contextlib import ExitStack, suppress
from pathlib import Path

from rich.console import RenderableType

from yahboomd.core.bus import keys
from yahboomd.core.clock import Clock, PauseWatch, Schedule, nanoseconds, seconds
from yahboomd.core.daemon.process import deadly
from yahboomd.core.errors import CommandEnded
from yahboomd.tools.screens import drive_screen
from yahboomd.tools.screens.drawing import Part, Screen
from yahboomd.tools.screens.feed import Feed
from yahboomd.tools.screens.gamepad import PadWish
from yahboomd.tools.screens.gamepad_port import GamepadPort
from yahboomd.tools.screens.keyboard import Keys
from yahboomd.tools.screens.teleop import Teleop, Wish, wish

REDRAW_S = 0.1

OLD_S = 0.5
"""Keys that waited for this long because the process did not run move nothing."""


PAD_S = 0.3
"""A gamepad that is held counts for this time; it is looked at three times as often."""

PAD_SPACING_NS = 20_000_000
"""A stick that moves is reported more often than this."""


class Driver:
    """Connects the keyboard, the screen and the bus.

    Args:
        gamepad: Drive by a gamepad, too: by this device, or by the first one for an empty path.
    """

    def __init__(
        self, feed: Feed, teleop: Teleop, clock: Clock, source: str, gamepad: str | None = None
    ) -> None:
        self._feed = feed
        self._teleop = teleop
        self._clock = clock
        self._source = source
        self._pauses = PauseWatch(clock, nanoseconds(OLD_S))
        self._late = False
        self._ended = asyncio.Event()
        self._requests: set[asyncio.Task[None]] = set()
        self._answer: Part = ("", "")
        self._pad: GamepadPort | None = None
        self._pad_words = ""
        self._padded_ns = 0
        if gamepad is not None:
            device = Path(gamepad) if gamepad else None
            self._pad = GamepadPort(
                device,
                clock,
                reads=self._reads,
                wanted=self._pad_wish,
                moved=self._pad_moved,
                lost=self._pad_lost,
            )

    async def run(self) -> None:
        """Drive until the person quits, a signal comes or the terminal goes."""
        loop = asyncio.get_running_loop()
        # A signal to suspend ends the command, because a suspended command stops no robot.
        for number in (*deadly(), signal.SIGTSTP):
            loop.add_signal_handler(number, self._end)
        try:
            with (
                Keys(sys.stdin.fileno(), self._press, self._end, reads=self._reads),
                # The reader of the keys notices when the terminal is gone.
                Screen(sys.stdout.fileno()) as screen,
                ExitStack() as pads,
            ):
                if self._pad is not None:
                    pads.enter_context(self._pad)
                try:
                    await self._loop(screen)
                finally:
                    self._end()
        finally:
            # The zeros are sent first; the rest may take its time.
            with suppress(CommandEnded):
                await self._feed.client.finished()
            for task in self._requests:
                task.cancel()
            await asyncio.gather(*self._requests, return_exceptions=True)

    async def _loop(self, screen: Screen) -> None:
        schedule = Schedule(self._clock, nanoseconds(REDRAW_S))
        try:
            while not self._ended.is_set():
                if self._pauses.detect() is not None:
                    self._let_pad_go()
                self._drive_by_pad()
                self._feed.check()
                screen.draw(*self._drawn())
                await schedule.beat()
        finally:
            schedule.close()

    def _end(self) -> None:
        # Without a command there is nothing to stop.
        if self._feed.client.commanded is not None:
            self._feed.client.stop()
        self._ended.set()

    def _reads(self) -> None:
        self._late = self._pauses.detect() is not None

    def _press(self, key: str) -> None:
        if self._late and wish(key) not in {"stop", "estop", "quit"}:
            self._answer = ("Keys that waited for this program are old: discarded.", "yellow")
            return
        now_ns = self._clock.now_ns()
        if wish(key) not in {"faster", "slower"}:
            # Of keyboard and pad one drives: the pad again once its button is pressed again.
            self._let_pad_go()
        wanted = self._teleop.press(key, now_ns)
        motion = self._teleop.motion(now_ns)
        if motion is not None:
            twist, until_ns = motion
            for_s = seconds(until_ns - now_ns)
            self._feed.client.drive(twist.vx, twist.wz, vy=twist.vy, for_s=for_s)
        elif wanted not in {"faster", "slower"}:
            self._feed.client.stop()
        self._ask(wanted)

    def _ask(self, wanted: Wish | PadWish) -> None:
        if wanted == "quit":
            self._end()
        elif wanted in {"estop", "release"}:
            task = asyncio.create_task(self._estop() if wanted == "estop" else self._release())
            self._requests.add(task)
            task.add_done_callback(self._requests.discard)

    # The gamepad.

    def _pad_wish(self, wanted: PadWish) -> None:
        # A stop is never too late.
        if self._late and wanted not in {"let_go", "estop"}:
            return
        if wanted in {"faster", "slower"}:
            self._teleop.press("+" if wanted == "faster" else "-", self._clock.now_ns())
            return
        self._feed.client.stop()
        self._ask(wanted)

    def _pad_moved(self) -> None:
        if self._late:
            self._let_pad_go()
        if self._clock.now_ns() - self._padded_ns >= PAD_SPACING_NS:
            self._drive_by_pad()

    def _pad_lost(self) -> None:
        self._feed.client.stop()

    def _let_pad_go(self) -> None:
        pad = None if self._pad is None else self._pad.pad
        if pad is not None and pad.held:
            pad.let_go()
            self._feed.client.stop()

    def _drive_by_pad(self) -> None:
        if self._pad is None or self._ended.is_set():
            return
        self._pad.look()
        if self._pad.words != self._pad_words:
            self._pad_words = self._pad.words
            self._answer = (self._pad_words, "" if self._pad.pad is not None else "yellow")
        pad = self._pad.pad
        if pad is None or not pad.held:
            return
        self._padded_ns = self._clock.now_ns()
        forward, left, turn = pad.shares
        linear, angular = self._teleop.linear_m_s, self._teleop.angular_rad_s
        self._feed.client.drive(forward * linear, turn * angular, vy=left * linear, for_s=PAD_S)

    async def _estop(self) -> None:
        client = self._feed.client
        self._answer = ("emergency stop …", "bold red")
        if client.is_open:
            answer = await client.request_by_name(keys.ESTOP, b'{"by":"yahboomd drive"}')
            if answer.answered:
                self._answer = (answer.message, "bold red")
                return
        self._answer = (
            "NO DAEMON ACKNOWLEDGED THE EMERGENCY STOP. Switch the motors' supply off.",
            "bold reverse red",
        )

    async def _release(self) -> None:
        client = self._feed.client
        self._answer = ("asking to release the emergency stop …", "yellow")
        if not client.is_open:
            self._answer = ("There is no daemon to ask.", "yellow")
            return
        answer = await client.request_by_name(keys.ESTOP_RESET)
        self._answer = (answer.message, "green" if answer.success else "yellow")

    def _drawn(self) -> tuple[RenderableType, RenderableType]:
        client = self._feed.client
        return drive_screen.screen(
            self._feed.view(self._clock.now_ns()),
            client.commanded,
            (self._teleop.linear_m_s, self._teleop.angular_rad_s),
            robot=self._feed.robot,
            key=self._source,
            heard=client.heard,
            why=self._feed.why,
            answer=self._answer,
        )
