"""All pages: beats and samples to them, their frames to the robot."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Coroutine, Mapping
from pathlib import Path
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from yahboomd import __version__
from yahboomd.core.bus import keys
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.clock import Clock, Schedule
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import EventSample, SetPoseRequest
from yahboomd.core.model import Twist2d, velocity_problem
from yahboomd.web.camera import CameraFeed
from yahboomd.web.page_calibration import FORMS
from yahboomd.web.page_commands import (
    CALIBRATES,
    LAPSE_NS,
    PERIOD_NS,
    VIEWER,
    Beats,
    PageCommands,
    PageRefusal,
    Wanted,
    late,
)
from yahboomd.web.page_moves import NO_MOVES, PageMoves
from yahboomd.web.page_session import (
    Control,
    Drive,
    Go,
    HoldFrame,
    LetGo,
    PageFrame,
    PageSession,
    RequestFrame,
    Seen,
    StopFrame,
    Tool,
    part,
    read_frame,
    sample_part,
)
from yahboomd.web.page_tools import UNKNOWN, PageTools, ToolSettings
from yahboomd.web.phone_sessions import ENDED, PhoneSession, PhoneSessions
from yahboomd.web.robot_feed import RobotFeed, daemon_part

MAX_PAGES = 64
MAX_VIEWERS = 48
"""The most pages of viewers among them, so that drivers always find room."""

MAX_REQUESTS = 4
"""The most requests of one page at once."""

EVENTS = 100
"""The number of newest events that a page gets when it connects."""

STOP_S = 0.001
"""The delay of a page's next frame after each of its emergency stops."""

NS_PER_MS = 1_000_000

REFUSALS_NS = 200_000_000
"""The least time between two refusals reported to a page."""

POLICY, FULL, SESSION_ENDED = 1008, 1013, 4401
"""Codes of a closed WebSocket: the page broke a rule; too many pages; its session has ended."""

VIEWS = ("drive", "map", "wheels", "health", "calibrate", "record", "boxes", "phones")

SERVICES = {
    "release": keys.ESTOP_RESET,
    "reset_odometry": keys.ODOMETRY_RESET,
    "set_pose": keys.ODOMETRY_SET_POSE,
}
"""The service of each request."""

ANOTHERS = "Another page has control of the robot. Take control first."


class PageHub:
    """Serves the pages of one robot.

    Args:
        phones: The folder of phones' sessions; None if everybody who reaches the page may drive.

    Attributes:
        sessions: Those sessions, if there are any.
    """

    def __init__(
        self,
        options: BusOptions,
        clock: Clock,
        settings: ToolSettings,
        source: str = keys.CMD_VEL_WEB,
        phones: Path | None = None,
    ) -> None:
        self._clock = clock
        self.sessions = (
            PhoneSessions(phones, clock, ended=self._session_ended, renamed=self._show_control)
            if phones
            else None
        )
        self._beats = Beats(clock)
        self._pages: dict[int, PageSession] = {}
        self._numbers = 0
        self._events: deque[bytes] = deque(maxlen=EVENTS)
        self._driver: tuple[int | None, str | None] = (None, None)
        self.robot = RobotFeed(
            options,
            clock,
            source,
            changed=self._robot_changed,
            happened=self._event_came,
        )
        self.moves = PageMoves(self.robot, lambda: self._show({"move": self.moves.shown()}))
        self.camera = CameraFeed(settings.camera, clock) if settings.camera else None
        self.fleet = settings.fleet
        self._aims = False
        self._has_moves, self._problem = False, ""
        self._commands = PageCommands(
            clock,
            self._put,
            obstacle=self._obstacle,
            changed=self._show_control,
            lapsed=self._lapsed,
            kept=self._keeps_control,
        )
        self.tools = PageTools(options, clock, settings, source, self._show)

    async def run(self) -> None:
        """Follow the robot and send beats, until cancelled.

        Raises:
            BusError: The endpoint, the namespace or the file cannot be used.
        """
        schedule = Schedule(self._clock, PERIOD_NS)
        tasks: list[asyncio.Task[Any]] = [
            asyncio.create_task(schedule.run(self._beat), name="web-beat")
        ]
        if self.sessions is not None:
            tasks.append(asyncio.create_task(self.sessions.run(), name="web-sessions"))
        try:
            await self.robot.run()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await self.moves.close()
            await self.tools.close()
            if self.fleet is not None:
                await self.fleet.close()
            self._commands.close()

    def stop(self) -> None:
        """Stop the robot if a page drives it; call this before the bus is closed."""
        self._commands.end()
        self.tools.calibration.end()

    def lets_in(self, phone: PhoneSession | None) -> bool:
        """Whether a page of this phone may be served: its session is valid, or none is needed."""
        return self.sessions is None or (phone is not None and phone in self.sessions.all)

    async def attend(self, socket: WebSocket, phone: PhoneSession | None) -> None:
        """Serve one page until it leaves, or its session ends."""
        if not self.lets_in(phone):
            # It ended while the WebSocket was opened.
            await socket.close(SESSION_ENDED, ENDED)
            return
        role = "driver" if phone is None else phone.role
        viewers = sum(each.role == "viewer" for each in self._pages.values())
        if len(self._pages) >= MAX_PAGES or (role == "viewer" and viewers >= MAX_VIEWERS):
            await socket.close(FULL, f"{len(self._pages)} pages are open already. Close one.")
            return
        self._numbers += 1
        page = PageSession(self._numbers, phone, socket, self._clock, self._beats.latest)
        self._pages[page.number] = page
        page.queue(self._hello(page))
        page.queue(daemon_part(self.robot))
        page.queue(self._control(page))
        page.queue(b'{"type":"events","samples":[' + b",".join(self._events) + b"]}")
        page.show(self.robot.known | self.tools.shown() | {"move": self.moves.shown()})
        if role == "driver":
            self.tools.recordings.driver_came(page.number)
        if phone is not None:
            phone.pages += 1
        sending = asyncio.create_task(page.send(), name="web-send")
        receiving = asyncio.create_task(self._receive(page, socket), name="web-receive")
        over: list[asyncio.Future[Any]] = [sending, receiving, page.ended]
        try:
            await asyncio.wait(over, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._leave(page)
            for task in (sending, receiving, *page.requests):
                task.cancel()
            await asyncio.gather(sending, receiving, *page.requests, return_exceptions=True)
        if page.ended.done():
            await socket.close(SESSION_ENDED, page.ended.result())

    def _leave(self, page: PageSession) -> None:
        """It has no part in anything any more: the wheels stop if it drives."""
        if self._pages.pop(page.number, None) is not None:
            self._commands.closed(page.number)
            self.tools.recordings.page_left(page.number)
            if page.phone is not None:
                page.phone.pages -= 1

    def _session_ended(self, session: PhoneSession, words: str) -> None:
        for page in [each for each in self._pages.values() if each.phone is session]:
            self._leave(page)
            # A closed WebSocket has room for 123 bytes of it.
            page.ended.set_result(words.encode()[:123].decode(errors="ignore"))

    def has_control(self, session: PhoneSession) -> bool:
        """Whether a page of this phone has control."""
        page = self._pages.get(self._commands.driver or 0)
        return page is not None and page.phone is session

    # From the pages.

    async def _receive(self, page: PageSession, socket: WebSocket) -> None:
        while True:
            try:
                text = await socket.receive_text()
            except WebSocketDisconnect:
                return
            except KeyError:
                # A binary frame.
                text = ""
            frame = read_frame(text)
            if isinstance(frame, StopFrame):
                # Before any limit; the pause leaves time for others if a page floods us with stops.
                self._stop(page, frame)
                await asyncio.sleep(STOP_S)
                continue
            if page.ended.done():
                return
            if not page.may_send():
                await socket.close(POLICY, "This page sends more than a page does.")
                return
            if frame is None:
                await socket.close(POLICY, "This page sent what no page sends.")
                return
            self._handle(page, frame)

    def _handle(self, page: PageSession, frame: PageFrame) -> None:
        match frame:
            case Drive() | Go():
                if (refusal := self._command(page, frame)) is not None:
                    self._refuse(page, refusal, "go" if isinstance(frame, Go) else "drive")
            case Control(want=want, if_free=if_free):
                if page.role != "driver":
                    self._refuse(page, VIEWER, "drive")
                elif not want:
                    self._commands.give_back(page.number)
                elif self._commands.driver is None or not if_free:
                    self._commands.take_control(page.number)
            case RequestFrame() | Tool() if len(page.requests) >= MAX_REQUESTS:
                page.answer(frame.id, ok=False, text="One thing after the other.")
            case RequestFrame() | Tool():
                self._begin(page, self._carry_out(page, frame))
            case HoldFrame():
                if (refusal := self._hold(page, frame)) is not None:
                    self._refuse(page, refusal, "hold")
            case LetGo():
                self.tools.calibration.let_go(page.number)
            case Seen(beat=beat):
                age_ns = self._beats.age_ns(beat, page.joined)
                if age_ns is not None:
                    page.show({"delay": part("delay", beat=beat, age_ms=age_ns // NS_PER_MS)})
            case StopFrame():
                pass

    def _command(self, page: PageSession, frame: Drive | Go) -> PageRefusal | None:
        if page.role != "driver":
            return VIEWER
        wanted: Wanted
        if isinstance(frame, Go):
            wanted = frame
        elif (problem := velocity_problem(frame.vx, frame.vy, frame.wz)) is not None:
            return PageRefusal(why="invalid", text=problem[1])
        else:
            wanted = Twist2d(vx=frame.vx, vy=frame.vy, wz=frame.wz)
        age_ns = self._beats.age_ns(frame.beat, page.joined)
        return self._commands.command(page.number, wanted, age_ns)

    def _put(self, wanted: Wanted) -> None:
        if isinstance(wanted, Go):
            self._aims = True
            self.moves.hold(wanted)
            return
        self.moves.let_go()
        self._aims = self._aims and wanted.is_zero
        # Such a zero would hold control, and the next move would have to wait for its end.
        if not self._aims:
            self.robot.put(wanted)

    def _obstacle(self, wanted: Wanted) -> PageRefusal | None:
        if isinstance(wanted, Go) and not self.robot.has_moves:
            return self.robot.obstacle() or NO_MOVES
        if self.tools.calibration.page is not None:
            return CALIBRATES
        return self.robot.obstacle()

    def _keeps_control(self) -> bool:
        """A calibration needs control; whoever repairs a stopped robot relies on it."""
        return self.tools.calibration.page is not None or self.robot.state == "estopped"

    def _hold(self, page: PageSession, frame: HoldFrame) -> PageRefusal | None:
        if (refusal := late(self._beats.age_ns(frame.beat, page.joined))) is not None:
            return refusal
        words = self.tools.calibration.hold(page.number, frame.question)
        return PageRefusal(why="not_calibrating", text=words) if words else None

    async def _carry_out(self, page: PageSession, frame: RequestFrame | Tool) -> None:
        if page.ended.done():
            return
        if refusal := self._refusal(page, frame):
            page.answer(frame.id, ok=False, text=refusal)
        elif isinstance(frame, Tool):
            done, words = await self.tools.use(page.number, frame)
            page.answer(frame.id, ok=done, text=words)
        elif (key := SERVICES.get(frame.do)) is None:
            page.answer(frame.id, ok=False, text=UNKNOWN)
        else:
            self._commands.used(page.number)
            pose = SetPoseRequest(x=frame.x, y=frame.y, theta=frame.theta)
            payload = encode(pose, "json") if key == keys.ODOMETRY_SET_POSE else b"{}"
            found = await self.robot.request(key, payload)
            page.answer(frame.id, ok=found.success, text=found.message, data=found.data)

    def _refusal(self, page: PageSession, frame: RequestFrame | Tool) -> str:
        """Why a request is refused, or empty; a page that may calibrate gets control."""
        if page.role != "driver":
            return VIEWER.text
        calibrates = isinstance(frame, Tool) and frame.do == "calibrate"
        if isinstance(frame, Tool) and not calibrates:
            return ""
        if self._commands.driver not in {None, page.number}:
            # The driver relies on the pose and on the stop.
            return ANOTHERS
        if calibrates:
            if (obstacle := self.robot.obstacle()) is not None:
                return obstacle.text
            self._commands.take_control(page.number)
        return ""

    def _begin(self, page: PageSession, work: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(work, name="web-request")
        page.requests.add(task)
        task.add_done_callback(page.requests.discard)

    def _stop(self, page: PageSession, frame: StopFrame) -> None:
        asked = self.robot.engage()

        async def answer() -> None:
            found = await asyncio.shield(asked)
            page.answer(frame.id, ok=found.success, text=found.message)

        # Limits the answers to a page that repeats it endlessly.
        if len(page.requests) < 4 * MAX_REQUESTS:
            self._begin(page, answer())

    def _refuse(self, page: PageSession, refusal: PageRefusal, what: str) -> None:
        now_ns = self._clock.now_ns()
        if now_ns - page.refused_ns < REFUSALS_NS:
            return
        page.refused_ns = now_ns
        age_ms = None if refusal.age_ns is None else refusal.age_ns // NS_PER_MS
        page.queue(part("refused", what=what, why=refusal.why, age_ms=age_ms, text=refusal.text))

    # To the pages.

    def _beat(self, _due_ns: int) -> None:
        parts = {"beat": part("beat", beat=self._beats.beat())}
        if not self._pages:
            return
        parts |= self.robot.fresh()
        if (self._commands.driver, self.robot.driver) != self._driver:
            self._show_control()
        if (self.robot.has_moves, self.robot.problem) != (self._has_moves, self._problem):
            self._robot_changed()
        self._show(parts)

    def _hello(self, page: PageSession) -> bytes:
        return part(
            "hello",
            page=page.number,
            role=page.role,
            robot=self.robot.name,
            version=__version__,
            limits=self.robot.limits or None,
            battery_curve=self.robot.battery_curve,
            barred=self.robot.barred,
            no_moves="" if self._has_moves else NO_MOVES.text,
            lapse_ms=LAPSE_NS // NS_PER_MS,
            source=self.robot.source,
            camera=self.camera is not None,
            fleet=self.fleet is not None,
            views=VIEWS,
            calibrations=FORMS,
        )

    def _control(self, page: PageSession) -> bytes:
        driver = self.robot.driver
        page_driver = self._pages.get(self._commands.driver or 0)
        return part(
            "control",
            mine=page.number == self._commands.driver,
            driver="the page" if driver == self.robot.source else driver,
            page_driver=self._commands.driver,
            name="" if page_driver is None else page_driver.name,
        )

    def _show_control(self) -> None:
        self._driver = (self._commands.driver, self.robot.driver)
        self.tools.calibration.control_changed(self._commands.driver)
        for page in self._pages.values():
            page.show({"control": self._control(page)})

    def _show(self, parts: Mapping[str, bytes]) -> None:
        for page in self._pages.values():
            page.show(parts)

    def _robot_changed(self) -> None:
        self._has_moves, self._problem = self.robot.has_moves, self.robot.problem
        daemon = daemon_part(self.robot)
        for page in self._pages.values():
            page.queue(self._hello(page))
            page.queue(daemon)

    def _event_came(self, event: EventSample) -> None:
        self._events.append(encode(event, "json"))
        known = sample_part("event", event)
        for page in self._pages.values():
            page.queue(known)

    def _lapsed(self, page: int, refusal: PageRefusal) -> None:
        if (session := self._pages.get(page)) is not None:
            session.refused_ns = 0
            self._refuse(session, refusal, "go" if self._aims else "drive")
