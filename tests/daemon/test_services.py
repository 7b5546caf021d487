"""What is asked for on the service keys, without a bus."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from robot_bench import RobotBench

from yahboomd.bus import keys
from yahboomd.bus.services import Request, Response
from yahboomd.bus.subscriptions import Arrival
from yahboomd.daemon.services import Services
from yahboomd.messages import cdr
from yahboomd.simulation.virtual_time import on_virtual_time


class Bus:
    """Keeps what is declared."""

    def __init__(self) -> None:
        self.order: list[str] = []
        self.handlers: dict[str, Callable[[Request], Response]] = {}
        self.options: dict[str, dict[str, Any]] = {}
        self.estop_samples: Callable[[list[Arrival]], None] = lambda _: None

    def subscribe(self, key: str, handler: Callable[[list[Arrival]], None], **options: Any) -> None:
        assert key == keys.ESTOP
        assert options == {"urgent": True, "keep_oversize": True}
        self.order.append(key)
        self.estop_samples = handler

    def serve(self, key: str, handler: Callable[[Request], Response], **options: Any) -> None:
        self.order.append(key)
        self.handlers[key] = handler
        self.options[key] = options

    def ask(self, key: str, payload: bytes = b"", *, oversize: bool = False) -> Any:
        response = self.handlers[key](request(key, payload, oversize=oversize))
        assert response.encoding == "application/json;ServiceReply"
        return json.loads(response.payload)


def request(key: str, payload: bytes, *, oversize: bool = False) -> Request:
    return Request(
        key=key,
        selector=key,
        parameters="",
        payload=payload,
        encoding="",
        attachment=None,
        arrived_ns=0,
        oversize=oversize,
    )


def arrival(payload: bytes, *, oversize: bool = False) -> Arrival:
    return Arrival(
        key=keys.ESTOP,
        payload=payload,
        stamp_ns=None,
        arrived_ns=0,
        oversize=oversize,
    )


def served(bench: RobotBench, board: dict[str, Any] | None = None) -> Bus:
    bus = Bus()
    services = Services(
        bench.operator,
        encoding="json",
        config=lambda: {"zenoh": {"namespace": "bot1"}},
        board=lambda: board or {},
    )
    services.serve(bus)  # type: ignore[arg-type]
    return bus


@on_virtual_time
async def test_the_emergency_stop_is_there_first_and_goes_before_everything(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        bus = served(bench)
        assert bus.order[:2] == [keys.ESTOP, keys.ESTOP]
        urgent = {key for key, options in bus.options.items() if options["urgent"]}
        assert urgent == {keys.ESTOP}
        # Whoever asks for everything on the bus moves and releases nothing.
        by_wildcard = {key for key, options in bus.options.items() if options["wildcards"]}
        assert by_wildcard == {keys.CONFIG, keys.BOARD}


@pytest.mark.parametrize("payload", [b"", b"\xff", b'{"engaged": true}', b'{"engaged": 0}', b"{}"])
@pytest.mark.parametrize("way", ["sample", "query"])
@on_virtual_time
async def test_any_payload_engages(tmp_path: Path, payload: bytes, way: str) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        if way == "sample":
            bus.estop_samples([arrival(payload)])
        else:
            assert bus.ask(keys.ESTOP, payload)["success"]
        assert bench.controller.state()[0] == "estopped"


@on_virtual_time
async def test_a_payload_too_large_to_be_read_engages(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        bus.estop_samples([arrival(b'{"engaged": false}', oversize=True)])
        assert bench.controller.state()[0] == "estopped"
        assert bus.ask(keys.ESTOP, oversize=True)["success"]


@pytest.mark.parametrize("key", [keys.ESTOP, keys.ESTOP_RESET, keys.ODOMETRY_RESET])
@pytest.mark.parametrize("head", [cdr.HEADER_LE, b"\x00\x00\x00\x00"])
@on_virtual_time
async def test_what_asks_in_cdr_is_answered_in_cdr_whatever_becomes_of_it(
    tmp_path: Path, key: str, head: bytes
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        asked = [
            request(key, head),
            request(key, head + b"\x01"),
            request(key, head + bytes(100)),
            msgspec.structs.replace(request(key, b"", oversize=True), head=head + bytes(12)),
        ]
        for each in asked:
            answers = [
                bus.handlers[key](each),
                # How one is answered that is too large, has wildcards, comes with too many others
                # or fails in its handler.
                bus.options[key]["fallback"]("Why not.", each),
            ]
            for answer in answers:
                assert answer.encoding == "application/cdr;ServiceReply"
                assert cdr.is_cdr(answer.payload)
        assert answers[1].payload == cdr.service_response(False, "Why not.")


@pytest.mark.parametrize("way", ["sample", "query"])
@on_virtual_time
async def test_a_well_formed_false_neither_engages_nor_releases(tmp_path: Path, way: str) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        for state in ("standing", "estopped"):
            if way == "sample":
                bus.estop_samples([arrival(b'{"engaged": false}')])
            else:
                answer = bus.ask(keys.ESTOP, b'{"engaged": false}')
                assert not answer["success"]
                assert "estop/reset" in answer["message"]
            assert bench.controller.state()[0] == state
            bench.operator.engage_estop("a test")
        assert bench.controller.counters["release_refused"] == 2


@on_virtual_time
async def test_the_release_is_refused_with_its_reason_while_somebody_commands(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        bus.ask(keys.ESTOP)
        bench.command(0.3)
        answer = bus.ask(keys.ESTOP_RESET)
        assert not answer["success"]
        assert "cmd_vel" in answer["message"]
        bench.command(0.0)
        assert bus.ask(keys.ESTOP_RESET)["success"]


@on_virtual_time
async def test_a_pose_is_set_with_its_covariance_and_refused_with_its_reason(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        covariance = [0.04, 0, 0, 0, 0.09, 0, 0, 0, 0.01]
        wanted = {"x": 1, "y": -2, "theta": 7, "covariance": covariance}
        assert bus.ask(keys.ODOMETRY_SET_POSE, json.dumps(wanted).encode())["success"]
        count = len(bench.heard.estimates)
        await bench.until(lambda: len(bench.heard.estimates) > count + 2)
        estimate = bench.heard.estimates[-1]
        pose = estimate.pose
        assert (pose.x, pose.y, pose.theta) == pytest.approx((1, -2, 7))
        assert estimate.pose_covariance == pytest.approx(tuple(covariance), abs=1e-3)
        for bad in (
            b"",
            b"{}",
            b'{"x": 1, "y": 2, "theta": NaN}',
            b'{"x": 1, "y": 2, "theta": ""}',
        ):
            answer = bus.ask(keys.ODOMETRY_SET_POSE, bad)
            assert not answer["success"]
            assert "The pose stays as it is" in answer["message"]
        assert bus.ask(keys.ODOMETRY_RESET)["success"]
        count = len(bench.heard.estimates)
        await bench.until(lambda: len(bench.heard.estimates) > count + 2)
        pose = bench.heard.estimates[-1].pose
        assert (pose.x, pose.y, pose.theta) == pytest.approx((0, 0, 0))
        assert bench.heard.kinds.count("pose_set") == 2


@on_virtual_time
async def test_configuration_and_board_are_told(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        bus = served(bench)
        assert bus.ask(keys.CONFIG)["data"] == {"zenoh": {"namespace": "bot1"}}
        nothing = bus.ask(keys.BOARD)
        assert not nothing["success"]
        assert nothing["message"] == "No board is connected."
        bus = served(bench, {"dialect": "streamed", "version": "1.7.3"})
        assert bus.ask(keys.BOARD)["data"]["version"] == "1.7.3"


@on_virtual_time
async def test_an_answer_speaks_the_language_of_the_question(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        bus = served(bench)
        response = bus.handlers[keys.ESTOP](request(keys.ESTOP, b"\x80"))
        assert response.encoding == "application/msgpack;ServiceReply"
        assert msgspec.msgpack.decode(response.payload)["success"]
        fallback = bus.options[keys.ESTOP]["fallback"]("Too many at once.", request("", b"{}"))
        assert json.loads(fallback.payload) == {
            "success": False,
            "message": "Too many at once.",
            "data": {},
        }
