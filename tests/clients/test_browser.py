"""A real Chromium: the page drives the robot; pages of other origins neither move nor read it."""

from __future__ import annotations

import http.server
import json
import os
import shutil
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import web_programs
from client_programs import Missing
from real_robot import Client, Process, RealRobot, free_endpoint, wait_for
from web_gateway import Gateway, configuration

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]

EVIL = "evil.example"
FORWARD, LEFT = "[aria-label=forward]", "[aria-label='turn left']"


class Browser:
    """Chromium, driven through ``browser.mjs``."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        chromium = shutil.which("chromium") or shutil.which("chromium-browser")
        node = shutil.which("node")
        if chromium is None or node is None:
            pytest.skip("there is no chromium or no node here (Debian: chromium, nodejs)")
        try:
            driver = web_programs.playwright()
        except Missing as missing:
            pytest.skip(str(missing))
        self._log = (folder / "browser.log").open("w")
        script = Path(__file__).with_name("browser.mjs")
        self.process = subprocess.Popen(
            [node, script, chromium, driver, folder / "profile", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
        )

    def __call__(self, *order: Any) -> Any:
        """Carry out one order; returns its result."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        assert line, f"the browser ended: {self._log.name}"
        answer = json.loads(line)
        assert "error" not in answer, answer["error"]
        return answer["value"]

    def close(self) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        try:
            self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
        self._log.close()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    # A name that the attacker owns, and that resolves to this machine: DNS rebinding.
    made = Browser(
        tmp_path_factory.mktemp("browser"), f"--host-resolver-rules=MAP {EVIL} 127.0.0.1"
    )
    yield made
    made.close()


@pytest.fixture
def robot(real_robot: Callable[..., RealRobot]) -> RealRobot:
    made = real_robot()
    made.daemon.says("Connected")
    return made


@pytest.fixture
def gateway(robot: RealRobot, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Gateway]:
    """A gateway before the robot; its clients may drive, unless the test is marked ``watching``."""
    try:
        program, page = web_programs.gateway_program(), web_programs.typescript()
    except Missing as missing:
        pytest.skip(str(missing))
    drive = request.node.get_closest_marker("watching") is None
    made = Gateway(tmp_path, robot.endpoint, zenohd=program, page=page, drive=drive)
    yield made
    made.close()


@pytest.fixture
def page(browser: Browser, gateway: Gateway) -> Iterator[str]:
    """The robot's page, connected."""
    browser("open", "robot", gateway.origin)
    wait_for(lambda: "standing" in browser("text", "robot", "#status"), "the page is connected")
    wait_for(lambda: "x 0." in browser("text", "robot", "#pose"), "the page has a pose")
    yield "robot"
    with suppress(AssertionError):  # The test closed it.
        browser("close", "robot")


def drives(robot: RealRobot) -> None:
    """Wait until it moves at the speed of the page."""
    wait_for(lambda: max(map(abs, robot.truth()[-1].speed_m_s)) > 0.15, "the robot drives")


def assert_stops(robot: RealRobot) -> None:
    """It stands, after the daemon's timeout and as much again for this machine's delays."""
    before = robot.travelled_m() / 2
    robot.settled_truth()
    assert robot.travelled_m() / 2 - before < 0.25


def test_the_page_drives_while_a_button_is_held_and_stops_when_it_is_released(
    browser: Browser, page: str, robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    browser("hold", page, FORWARD)
    drives(robot)
    assert app.in_state("driving")["driver"] == "cmd_vel"
    browser("release", page)
    assert_stops(robot)
    assert robot.truth()[-1].x > 0.05
    # Its commands carry stamps, and each counts.
    refused = app.latest("status")["command"]["sources"]["cmd_vel"]["refused"]
    assert not any(refused.values())


def test_leaving_the_button_with_the_pointer_down_still_ends_with_the_release(
    browser: Browser, page: str, robot: RealRobot
) -> None:
    browser("hold", page, FORWARD)
    drives(robot)
    browser("leave", page)
    browser("release", page)
    assert_stops(robot)


def cut(browser: Browser, gateway: Gateway) -> None:
    os.kill(gateway.children()["nginx"], signal.SIGSTOP)
    gateway.send(signal.SIGSTOP)


def kill_gateway(browser: Browser, gateway: Gateway) -> None:
    gateway.send(signal.SIGKILL)


HANG = "void setTimeout(() => { for (const end = Date.now() + 4000; Date.now() < end; ); })"

# Chromium without a display never hides a page, so the event is made.
HIDE = """void (Object.defineProperty(document, "hidden", { value: true }),
  document.dispatchEvent(new Event("visibilitychange")))"""

LOSSES: dict[str, Callable[[Browser, Gateway], Any]] = {
    "the page is closed": lambda browser, _: browser("close", "robot"),
    "another tab comes before it": lambda browser, _: browser("cover", "robot"),
    "it is hidden": lambda browser, _: browser("evaluate", "robot", HIDE),
    "the page leaves for another one": lambda browser, _: browser(
        "evaluate", "robot", "void (location.href = 'about:blank')"
    ),
    "its process crashes": lambda browser, _: browser("crash", "robot"),
    "its script hangs": lambda browser, _: browser("evaluate", "robot", HANG),
    "the network is cut": cut,
    "the gateway dies": kill_gateway,
}  # fmt: skip


@pytest.mark.parametrize("loss", LOSSES)
def test_a_robot_that_a_page_drives_stops_by_itself_when(
    browser: Browser, page: str, gateway: Gateway, robot: RealRobot, loss: str
) -> None:
    browser("hold", page, FORWARD)
    drives(robot)
    LOSSES[loss](browser, gateway)
    assert_stops(robot)
    assert robot.daemon.process.poll() is None


@pytest.mark.parametrize("loss", LOSSES)
def test_a_move_that_a_page_started_is_over_when(
    browser: Browser,
    page: str,
    gateway: Gateway,
    robot: RealRobot,
    service: Process,
    client: Callable[..., Client],
    loss: str,
) -> None:
    app = client("client", robot.endpoint)

    def driven() -> bool:
        # A busy machine ends moves, as it should.
        if app.ask("yahboomd/moves").get("state", "ended") == "ended":
            browser("click", page, "#moves")
        return max(map(abs, robot.truth()[-1].speed_m_s)) > 0.15

    wait_for(driven, "the robot drives")
    LOSSES[loss](browser, gateway)
    assert_stops(robot)
    end = app.ask("yahboomd/moves")
    assert end["state"] == "ended"
    # The plugin drops the token of a page that is closed; of one that is stalled come no beats.
    assert end["reason"] in {"client_gone", "client_silent", "cancelled", "taken_over"}, end
    print(loss, end["reason"])


def test_the_page_stops_releases_sets_the_pose_reads_the_configuration_and_drives_a_square(
    browser: Browser, page: str, robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    browser("click", page, "#estop")
    assert "the web page" in app.in_state("estopped")["why"]
    wait_for(lambda: "estopped" in browser("text", page, "#status"), "the page shows it")
    browser("hold", page, FORWARD)
    browser("release", page)
    assert robot.travelled_m() == 0.0
    wait_for(
        lambda: browser("click", page, "#release") or app.latest("status")["state"] == "standing",
        "the release",
    )
    browser("click", page, "#square")
    wait_for(lambda: browser("text", page, "#answer") == "The square is closed.", "the square")
    truth = robot.settled_truth()
    assert (truth.x**2 + truth.y**2) ** 0.5 < 0.05
    assert robot.travelled_m() / 2 > 2.0
    browser("click", page, "#zero")
    wait_for(lambda: app.latest("pose")["x"] == 0.0, "the pose is set")
    browser("click", page, "#config")
    wait_for(lambda: '"zenoh"' in browser("text", page, "#data"), "the configuration")


@pytest.mark.watching
def test_under_the_configuration_as_shipped_the_page_stops_the_robot_and_says_why_it_does_not_drive(
    browser: Browser, page: str, gateway: Gateway, robot: RealRobot, client: Callable[..., Client]
) -> None:
    assert "not drive it" in gateway.log.read_text()
    browser("hold", page, FORWARD)
    wait_for(lambda: "gateway.json5" in browser("text", page, "#answer"), "the page says why")
    browser("release", page)
    assert robot.travelled_m() == 0.0
    browser("click", page, "#estop")
    client("client", robot.endpoint).in_state("estopped")


def test_the_page_connects_again_after_a_restart_of_the_daemon(
    browser: Browser, page: str, robot: RealRobot
) -> None:
    assert robot.daemon.end() == 0
    wait_for(lambda: "not connected" in browser("text", page, "#status"), "the page says so")
    robot.start_daemon()
    wait_for(lambda: "standing" in browser("text", page, "#status"), "the page is connected")
    browser("hold", page, FORWARD)
    drives(robot)
    browser("release", page)
    assert_stops(robot)


# -- pages of other origins

ATTACK = Path(__file__).with_name("attack.js").read_text()


ATTEMPTS = (
    "GET /zenoh",
    "OPTIONS /rest/cmd_vel",
    "GET /rest/yahboomd/estop/reset",
    "POST /rest/yahboomd/odometry/set_pose",
)


class Site:
    """A website of an attacker's: an empty page on a port of this machine."""

    def __init__(self) -> None:
        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "text/html")
                self.end_headers()
                self.wfile.write(b"<!doctype html><title>evil</title><body>")

            def log_message(self, *_: object) -> None:
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever)
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


@pytest.fixture
def site() -> Iterator[Site]:
    made = Site()
    yield made
    made.close()


def attack(browser: Browser, origin: str, bases: list[str]) -> list[str]:
    """The result of all attempts of a page on an origin."""
    browser("open", "evil", origin)
    try:
        outcomes: list[str] = browser("evaluate", "evil", f"({ATTACK})({json.dumps(bases)})")
        return outcomes
    finally:
        browser("close", "evil")


@pytest.mark.parametrize("host", [EVIL, "127.0.0.1"])
def test_a_page_of_another_origin_neither_moves_releases_sets_nor_reads_the_robot(
    browser: Browser,
    gateway: Gateway,
    robot: RealRobot,
    client: Callable[..., Client],
    site: Site,
    host: str,
) -> None:
    app = client("client", robot.endpoint)
    app.in_state("standing")
    assert app.ask("yahboomd/estop")["success"]
    before = app.in_state("estopped")["bus"]
    # The gateway by each of its names, and the ports of the plugins, which are in another network.
    bases = [f"http://{name}:{gateway.port}" for name in ("127.0.0.1", "localhost", EVIL)]
    bases += [f"http://127.0.0.1:{port}" for port in (8000, 10000)]
    outcomes = attack(browser, f"http://{host}:{site.port}", bases)
    assert not [each for each in outcomes if each.startswith(("OPEN", "READ"))]
    refused = gateway.refused()
    for attempt in ATTEMPTS:
        assert any(attempt in line for line in refused), attempt
    status = app.in_state("estopped")
    assert status["bus"]["requests"] == before["requests"]
    assert status["command"]["sources"]["cmd_vel"]["accepted"] == 0
    assert app.latest("pose")["x"] == 0.0
    assert robot.travelled_m() == 0.0


def test_the_same_attempts_move_a_robot_whose_plugins_are_open(
    browser: Browser, robot: RealRobot, client: Callable[..., Client], site: Site, tmp_path: Path
) -> None:
    """Without the gateway the attack above succeeds."""
    try:
        program = web_programs.gateway_program()
    except Missing as missing:
        pytest.skip(str(missing))
    text = configuration(drive=True).replace("tcp/127.0.0.1:7448", robot.endpoint)
    bases = []
    for port in ("127.0.0.1:8000", "127.0.0.1:10000"):
        free = free_endpoint().removeprefix("tcp/")
        text = text.replace(port, free)
        bases.append(f"http://{free}")
    (tmp_path / "open.json5").write_text(text)
    app = client("client", robot.endpoint)
    app.in_state("standing")
    before = app.latest("status")["bus"]["requests"]
    with subprocess.Popen([program, "-c", tmp_path / "open.json5"]) as process:
        try:
            wait_for(lambda: all(map(listens, bases)), "both plugins listen")
            outcomes = attack(browser, f"http://{EVIL}:{site.port}", bases)
            assert f"OPEN websocket {bases[1]}" in outcomes
            assert f"READ 200 {bases[0]}" in outcomes
            wait_for(lambda: robot.travelled_m() > 0.0, "one PUT moved it")
            wait_for(lambda: app.latest("pose")["x"] > 0.9, "a form set its pose")
            assert app.latest("status")["bus"]["requests"] > before
        finally:
            process.terminate()


def listens(base: str) -> bool:
    host, port = base.removeprefix("http://").split(":")
    with socket.socket() as probe:
        return probe.connect_ex((host, int(port))) == 0


def test_no_other_site_shows_the_page_in_a_frame(
    browser: Browser, gateway: Gateway, site: Site
) -> None:
    browser("open", "evil", f"http://127.0.0.1:{site.port}")
    browser("evaluate", "evil", f"""new Promise((done) => {{
        const frame = document.createElement("iframe");
        frame.onload = done;
        frame.src = "{gateway.origin}";
        document.body.append(frame);
    }})""")  # fmt: skip
    assert "chrome-error://chromewebdata/" in browser("frames", "evil")
    browser("close", "evil")
