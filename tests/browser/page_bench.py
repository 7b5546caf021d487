"""The page in a real browser, on a real server, daemon and simulated board; judged on the wire."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from chromium import Chromium, Page
from process_priority import DAEMON_NICE, prefer
from real_robot import Client, Process, RealRobot, free_endpoint, wait_for
from truth_tail import Tail
from weak_network import WeakNetwork

from yahboomd.simulation.heard import HostBytes

SPEEDS = re.compile(r"\$spd:([-\d,]+)#")

STOPS_WITHIN_S = 1.0
"""From the loss to the last frame with motion: 0.5 s are the daemon's own timeout, 0.2 s its ramp,
the rest is this machine's."""

HELD_NS = 250_000_000
"""The daemon repeats a speed at least at this period."""

QUIET_S = 1.6
"""Then nothing that waited anywhere moves the robot: zeros are sent for a second."""


class PageBench:
    """Board, daemon and server; pages are opened in a browser that lives longer.

    Args:
        folder: For all files.
        browser: It opens the pages.
        simulate: More arguments of ``yahboomd simulate``.
        run: More arguments of ``yahboomd run``.
        web: More arguments of ``yahboomd web``.
        listen: The address of the server; another one than loopback demands tokens.
    """

    def __init__(
        self,
        folder: Path,
        browser: Chromium,
        *,
        simulate: tuple[str, ...] = (),
        run: tuple[str, ...] = (),
        web: tuple[str, ...] = (),
        listen: str = "127.0.0.1",
    ) -> None:
        self.browser = browser
        heard = folder / "heard"
        self.robot = RealRobot(folder, simulate=["--heard", str(heard), *simulate], run=run)
        self._wire = Tail(heard, HostBytes)
        self._motions: dict[int, list[int]] = {}
        self.port = int(free_endpoint().rsplit(":", 1)[1])
        self._listen = f"{listen}:{self.port}"
        self._web = web
        self._environ = {"XDG_STATE_HOME": str(folder), "STATE_DIRECTORY": str(folder)}
        self.network = WeakNetwork(self.port)
        self.server = self.start_server()
        self.application = Client("client", self.robot.endpoint)

    @property
    def url(self) -> str:
        """The page, through the weak network."""
        return f"http://127.0.0.1:{self.network.port}/"

    @property
    def direct_url(self) -> str:
        """The page, without the weak network: this process has no part in its delays."""
        return f"http://127.0.0.1:{self.port}/"

    def start_server(self) -> Process:
        """Start (another) server on the same port."""
        self.server = Process(
            "web",
            *("--listen", self._listen, "--connect", self.robot.endpoint, *self._web),
            environ=self._environ,
        )
        prefer(self.server.process, DAEMON_NICE)
        self.server.says("answers")
        return self.server

    def links(self) -> tuple[str, str]:
        """The link to drive, and the one to watch."""
        shown = Process("web", "--listen", self._listen, "--show-link", environ=self._environ)
        assert shown.end_by_itself() == 0, shown.output
        driver, *_, viewer = re.findall(r"#\S+", shown.output)
        return self.url + driver, self.url + viewer

    @contextmanager
    def page(self, url: str = "", **looks: Any) -> Iterator[Page]:
        """A page; closed afterwards."""
        page = self.browser.open(url or self.url, **looks)
        try:
            yield page
        finally:
            page.close()

    def ready(self, page: Page) -> Page:
        """Wait until a page may drive."""
        page.until("document.querySelector('.pad:not(.barred)') !== null")
        page.says(".limit output", "m/s")
        return page

    def close(self) -> None:
        """End all of it."""
        self.application.close()
        self.server.end()
        print(self.server.output)
        self.network.close()
        self.robot.close()
        self._wire.close()

    # On the wire.

    def motions(self, since_ns: int = 0) -> dict[int, list[int]]:
        """The speeds of the wheels in the frames that command motion, by their moments."""
        for heard in self._wire.news():
            # A board that is late reads several frames at once.
            for number, text in enumerate(SPEEDS.findall(heard.data)):
                speeds = [int(each) for each in text.split(",")]
                if any(speeds):
                    self._motions[heard.t_ns + number] = speeds
        return {t_ns: speeds for t_ns, speeds in self._motions.items() if t_ns > since_ns}

    def is_moving(self) -> bool:
        """Whether the wheels turn in truth."""
        return max(map(abs, self.robot.truth()[-1].speed_m_s)) > 0.05

    def press(self, page: Page, *, up: float = 0.8, right: float = 0.0) -> tuple[float, float]:
        """Put a thumb on the joystick; returns once the wheels turn.

        If this machine is too busy to drive, the page or the server ends it; then try again.
        """
        self.ready(page)
        place = self.place(page, right, up)
        self.drives(page, lambda: self.put_down(page, place), page.lift)
        return place

    def put_down(self, page: Page, place: tuple[float, float]) -> None:
        """Land on the middle of the joystick, which drives nothing, and move to a place of it."""
        page.touch(page.middle(".pad"))
        page.touch(place, kind="touchMove")

    def hold(self, page: Page, key: str) -> None:
        """Hold a key down; returns once the wheels turn."""
        self.drives(page, lambda: page.key(key, down=True), lambda: page.key(key, down=False))

    def drives(self, page: Page, begin: Callable[[], object], end: Callable[[], object]) -> None:
        def drives() -> bool:
            if not page.says_driving():
                end()
                self.ready(page)
                begin()
            return self.is_moving() and bool(self.motions(time.monotonic_ns() - HELD_NS))

        try:
            wait_for(drives, "the wheels turn")
        except pytest.fail.Exception:
            print(page.text("body"))
            raise

    def place(self, page: Page, right: float, up: float) -> tuple[float, float]:
        """A point of the joystick, by its radius."""
        x, y = page.middle(".pad")
        radius: float = page.evaluate("document.querySelector('.pad').clientWidth / 2")
        return x + right * radius, y - up * radius

    def stops_after(self, loss: Callable[[], object]) -> float:
        """Lose the thumb: the wheels stop in time, and nothing moves them afterwards.

        Returns:
            Seconds from the loss to the last frame with motion.
        """
        loss()
        # Not before, because a busy browser is slow.
        lost_ns = time.monotonic_ns()
        self.robot.settled_truth()
        quiet_ns = time.monotonic_ns() + round(QUIET_S * 1e9)
        wait_for(lambda: self.robot.truth()[-1].t_ns > quiet_ns, "1.6 s of quiet")
        late_s = (max(self.motions(), default=lost_ns) - lost_ns) / 1e9
        print(f"the last frame with motion: {late_s * 1e3:.0f} ms after the loss")
        assert late_s < STOPS_WITHIN_S
        return late_s

    def stays(self) -> None:
        """The robot stands, and goes on to for 1.6 s."""
        since_ns = time.monotonic_ns()
        quiet_ns = since_ns + round(QUIET_S * 1e9)
        wait_for(lambda: self.robot.truth()[-1].t_ns > quiet_ns, "1.6 s of quiet")
        assert not self.motions(since_ns)
        assert not self.is_moving()

    def release(self, page: Page) -> None:
        """Release the stop, or clear the fault, by the page's button."""
        page.until("document.querySelector('#release').checkVisibility()")
        # Daemon and page refuse for a second after a command for motion or a stop.
        button = "document.querySelector('#release:not([hidden])')?.click()"
        wait_for(
            lambda: page.evaluate(button) or page.text("#state") == "standing", "it is released"
        )

    def recover(self) -> None:
        """As it was at first: the network is good, nothing is engaged, no page has control."""
        self.network.delay_s, self.network.held, self.network.refuses = 0.0, False, False
        # Whatever the newest status is: one that was engaged just now may not be in it yet.
        reset = "yahboomd/estop/reset"
        wait_for(lambda: self.application.ask(reset)["success"], "the stop is released")

    def sent_by(self, page: Page) -> list[tuple[float, dict[str, Any]]]:
        """The frames that a page sent to the server, with their moments in seconds."""
        return [
            (event["params"]["timestamp"], json.loads(event["params"]["response"]["payloadData"]))
            for event in page.browser.events
            if event.get("sessionId") == page.session
            and event["method"] == "Network.webSocketFrameSent"
        ]

    def make_events(self) -> None:
        """Have the daemon publish events: the board is unplugged for a moment."""
        events = self.application.samples.setdefault("events", [])
        known = len(events)
        self.robot.do("unplug 0.3")
        wait_for(
            lambda: "connected" in [event["kind"] for event in events[known:]], "it is back again"
        )
        self.application.in_state("standing")
