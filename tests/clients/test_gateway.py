"""The gateway lets its own page and programs in, and refuses pages of other origins.

Here a stand-in takes the place of zenohd and its plugins, and counts what reaches it; the tests
with a browser have the real ones.
"""

from __future__ import annotations

import json
import os
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from real_robot import Client, RealRobot, free_endpoint, wait_for
from web_gateway import EXAMPLE, Gateway, configuration

pytestmark = pytest.mark.realtime

FOREIGN = "http://evil.example"
PROGRAM = {"X-Yahboomd": "1"}
WEBSOCKET = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gateway]:
    made = Gateway(tmp_path_factory.mktemp("gateway"), free_endpoint())
    yield made
    made.close()


def request(gateway: Gateway, path: str, method: str, headers: dict[str, str]) -> int:
    """The status of one request."""
    arguments = ["--request", method, "--http1.1"]
    for name, value in headers.items():
        arguments += ["--header", f"{name}: {value}"]
    return gateway.curl(path, *arguments)


def reached(gateway: Gateway) -> list[str]:
    path = gateway.run_folder / "reached"
    return path.read_text().splitlines() if path.exists() else []


MOVE, RELEASE = "/rest/cmd_vel", "/rest/yahboomd/estop/reset"
START, BEAT = "/rest/yahboomd/moves/start", "/rest/yahboomd/moves/beat"
CROSS = {"Sec-Fetch-Site": "cross-site"}
SITE = {"Origin": FOREIGN, **CROSS}
REBOUND = {"Host": "evil.example", "Sec-Fetch-Site": "same-origin"}
"""A name of the attacker's that resolves to this machine is of one origin with his page."""

# Requests of a browser for a page of another site, and forgeries of programs.
REFUSED: dict[str, tuple[int, str, str, dict[str, str]]] = {
    "a script's GET": (403, "GET", "/rest/yahboomd/status", SITE),
    "a script's PUT": (403, "PUT", MOVE, SITE),
    "a script's PUT with the header of programs": (403, "PUT", MOVE, {**SITE, **PROGRAM}),
    "the same in an old browser": (403, "PUT", MOVE, {"Origin": FOREIGN, **PROGRAM}),
    "the question before it": (403, "OPTIONS", MOVE, SITE),
    "a form": (403, "POST", RELEASE, SITE),
    "a form in a sandbox": (403, "POST", RELEASE, {"Origin": "null"}),
    "an image": (403, "GET", RELEASE, CROSS),
    "an image in an old browser": (403, "GET", RELEASE, {}),
    "an image of another port": (403, "GET", RELEASE, {"Sec-Fetch-Site": "same-site", **PROGRAM}),
    "a link that a person opens": (403, "GET", RELEASE, {"Sec-Fetch-Site": "none"}),
    "a WebSocket": (403, "GET", "/zenoh", {**SITE, **WEBSOCKET}),
    "a WebSocket in an old browser": (403, "GET", "/zenoh", {"Origin": FOREIGN, **WEBSOCKET}),
    "a WebSocket in a sandbox": (403, "GET", "/zenoh", {"Origin": "null", **WEBSOCKET}),
    "one of another port": (403, "GET", "/zenoh", {"Origin": "http://127.0.0.1:1", **WEBSOCKET}),
    "no WebSocket": (426, "GET", "/zenoh", {}),
    "a rebound name": (421, "GET", "/", REBOUND),
    "a rebound name's WebSocket": (421, "GET", "/zenoh", {**REBOUND, **WEBSOCKET}),
    "a rebound name's script": (421, "PUT", MOVE, {**REBOUND, **PROGRAM}),
    "no name": (400, "PUT", MOVE, {"Host": "", **PROGRAM}),
    "a script's start of moves": (403, "POST", START, {**SITE, **PROGRAM}),
    "a form's start of moves": (403, "POST", START, {"Origin": "null"}),
    "a script's beat": (403, "PUT", BEAT, SITE),
    "the question before a beat": (403, "OPTIONS", BEAT, SITE),
    "a rebound name's beat": (421, "PUT", BEAT, {**REBOUND, **PROGRAM}),
    "an image that goes on with a pause": (403, "GET", "/rest/yahboomd/moves/resume", {}),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_other_pages_send_is_refused_reaches_no_plugin_and_is_logged(
    gateway: Gateway, name: str
) -> None:
    status, method, path, headers = REFUSED[name]
    before, lines = reached(gateway), len(gateway.refused())
    assert request(gateway, path, method, headers) == status
    assert reached(gateway) == before
    (line,) = wait_for(lambda: gateway.refused()[lines:], "a line in the log of refusals")
    assert f"refused {status}" in line
    assert f'Origin="{headers.get("Origin", "-")}"' in line


OWN = {
    "curl": ("/rest/yahboomd/status", "GET", PROGRAM, 200),
    "curl that commands": ("/rest/cmd_vel", "PUT", PROGRAM, 200),
    "curl that starts moves": (START, "POST", PROGRAM, 200),
    "curl's beat": (BEAT, "PUT", PROGRAM, 200),
    "a program's WebSocket": ("/zenoh", "GET", WEBSOCKET, 101),
    "the page": ("/nginx.conf", "GET", {"Sec-Fetch-Site": "none"}, 200),
}


@pytest.mark.parametrize("name", OWN)
def test_what_programs_send_gets_through(gateway: Gateway, name: str) -> None:
    path, method, headers, status = OWN[name]
    assert request(gateway, path, method, headers) == status


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_the_page_s_own_websocket_gets_through(gateway: Gateway, host: str) -> None:
    own = {
        "Host": f"{host}:{gateway.port}",
        "Origin": f"http://{host}:{gateway.port}",
        "Sec-Fetch-Site": "same-origin",
    }
    before = len(reached(gateway))
    assert request(gateway, "/zenoh", "GET", {**own, **WEBSOCKET}) == 101
    assert len(reached(gateway)) == before + 1


def test_the_longest_path_of_moves_gets_through_and_nothing_longer(
    gateway: Gateway, tmp_path: Path
) -> None:
    for length, status in ((65_000, 200), (66_000, 413)):
        (tmp_path / "moves").write_bytes(b" " * length)
        body = ("--data-binary", f"@{tmp_path / 'moves'}", "--header", "X-Yahboomd: 1")
        assert gateway.curl(START, *body) == status


def test_no_answer_allows_another_origin_to_read_it(gateway: Gateway) -> None:
    path = gateway.folder / "headers"
    gateway.curl("/rest/yahboomd/status", "--dump-header", str(path), "--header", "X-Yahboomd: 1")
    text = path.read_text().lower()
    assert " 200 " in text
    assert "access-control-allow" not in text


def test_the_ports_of_the_plugins_are_in_another_network(gateway: Gateway) -> None:
    ours = os.readlink("/proc/self/ns/net")
    # The folder's name is in the command of each socat that serves a plugin.
    networks = {
        name: os.readlink(f"/proc/{pid}/ns/net") for name, pid in gateway.children().items()
    }
    assert networks["nginx"] == ours
    assert networks["python3" if "python3" in networks else "python"] != ours
    # It listens on one port of this machine, on loopback.
    with socket.socket() as probe:
        probe.connect(("127.0.0.1", gateway.port))


def test_ended_it_leaves_no_process_and_no_socket(tmp_path: Path) -> None:
    made = Gateway(tmp_path, free_endpoint())
    folder = made.run_folder
    made.process.send_signal(signal.SIGTERM)
    assert made.process.wait(60) == 143
    wait_for(lambda: not made.children(), "its processes are gone")
    assert not folder.exists()


class Through:
    """A session with the gateway's configuration: what its plugins can do, this can."""

    def __init__(self, robot: RealRobot, *, drive: bool) -> None:
        config = zenoh.Config.from_json5(configuration(drive=drive))
        config.insert_json5("connect/endpoints", json.dumps([robot.endpoint]))
        config.insert_json5("plugins_loading/enabled", "false")
        self.session = zenoh.open(config)

    def ask(
        self, key: str, payload: bytes | None = None, *, within_s: float = 60.0
    ) -> dict[str, Any] | None:
        for reply in self.session.get(key, payload=payload, timeout=within_s):
            if reply.ok is not None:
                answer: dict[str, Any] = json.loads(bytes(reply.ok.payload))
                return answer
        return None

    def is_refused(self, key: str, payload: bytes | None = None) -> bool:
        """Whether the question does not come through: no answer comes."""
        return self.ask(key, payload, within_s=5.0) is None


class Moves:
    """What of moves reaches the robot's side of the gateway."""

    def __init__(self, robot: RealRobot) -> None:
        config = zenoh.Config.from_json5('{mode: "client"}')
        config.insert_json5("connect/endpoints", json.dumps([robot.endpoint]))
        self.came: set[str] = set()
        self.session = zenoh.open(config)
        self.session.declare_subscriber("yahboomd/moves/beat", self._saw)
        self.session.liveliness().declare_subscriber("yahboomd/moves/holder/*", self._saw)
        for name in VERBS:
            self.session.declare_queryable(f"yahboomd/moves/{name}", self._answer)

    def _saw(self, sample: zenoh.Sample) -> None:
        self.came.add(str(sample.key_expr).split("/")[2])

    def _answer(self, query: zenoh.Query) -> None:
        self.came.add(str(query.key_expr).split("/")[2])
        query.reply(query.key_expr, b'{"success": true}')


VERBS = ("start", "cancel", "pause", "resume")


def test_as_shipped_the_configuration_lets_clients_watch_and_stop_but_not_drive(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint)
    app.in_state("standing")
    before = app.latest("status")["command"]["sources"]
    heard, through = Moves(robot), Through(robot, drive=False)
    try:
        wait_for(lambda: "x" in (through.ask("yahboomd/pose") or {}), "the newest pose")
        for _ in range(20):
            for key in ("cmd_vel", "cmd_vel/teleop"):
                through.session.put(key, b'{"vx": 0.3}')
            through.session.put("yahboomd/moves/beat", b'{"id": "m1"}')
        through.session.liveliness().declare_token("yahboomd/moves/holder/page")
        for name in VERBS:
            assert through.is_refused(f"yahboomd/moves/{name}", b"{}")
        assert through.is_refused("yahboomd/config")
        assert through.is_refused("yahboomd/odometry/set_pose", b'{"x": 1, "y": 0, "theta": 0}')
        stopped = through.ask("yahboomd/estop")
        assert stopped
        assert stopped["success"]
        assert through.is_refused("yahboomd/estop/reset")
        status = app.in_state("estopped")
        # Not one of the commands came: the counters of the sources are as they were.
        assert status["command"]["sources"] == before
        assert robot.travelled_m() == 0.0
        assert heard.came == set()
    finally:
        heard.session.close()
        through.session.close()


@pytest.mark.nightly
def test_with_its_line_switched_on_the_configuration_lets_clients_drive(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint)
    app.in_state("standing")
    heard, through = Moves(robot), Through(robot, drive=True)
    try:

        def moves() -> bool:
            through.session.put("cmd_vel", b'{"vx": 0.3}')
            return robot.travelled_m() > 0.02

        wait_for(moves, "it drives")
        assert (through.ask("yahboomd/estop") or {})["success"]
        wait_for(lambda: (through.ask("yahboomd/estop/reset") or {}).get("success"), "the release")
        assert (through.ask("yahboomd/config") or {})["success"]
        progress = through.session.declare_subscriber(
            "yahboomd/moves", zenoh.handlers.RingChannel(1)
        )
        for name in VERBS:
            wait_for(lambda name=name: through.ask(f"yahboomd/moves/{name}", b"{}"), name)
        through.session.put("yahboomd/moves/beat", b'{"id": "m1"}')
        through.session.liveliness().declare_token("yahboomd/moves/holder/page")
        wait_for(lambda: heard.came == {*VERBS, "beat", "holder"}, "all of it")

        def hears() -> bool:
            heard.session.put("yahboomd/moves", b"{}")
            return progress.try_recv() is not None

        wait_for(hears, "the progress")
    finally:
        heard.session.close()
        through.session.close()


def test_the_page_of_clients_shows_the_deadman_of_the_web_page() -> None:
    root = EXAMPLE.parents[2]
    source = (root / "examples" / "clients" / "typescript" / "page.ts").read_text()
    deadman = source[source.index("// The deadman.") : source.index("/** Let go of")].strip()
    assert deadman in (root / "docs" / "clients.md").read_text()
