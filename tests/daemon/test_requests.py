"""The services without a bus; the e-stop and its release, as people ask for them."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import msgspec
import pytest
from robot_bench import RobotBench

from yahboomd import __version__
from yahboomd.core.bus import keys
from yahboomd.core.bus.presence import Neighbour
from yahboomd.core.bus.services import TOO_MANY, BusQuery, Response
from yahboomd.core.daemon.estop import latch
from yahboomd.core.daemon.estop.latch_file import LatchFile
from yahboomd.core.daemon.requests import Services
from yahboomd.core.messages import cdr
from yahboomd.core.messages.native import BatterySample, ServiceReply
from yahboomd.ros2.messages import ros2_encoders
from yahboomd.simulation.motors import MotorFaults
from yahboomd.simulation.virtual_time import on_virtual_time


@on_virtual_time
async def test_engaging_says_what_was_done_and_once_more_that_it_was_done_already(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        assert bench.operator.engage_estop("a test") == "Emergency stop engaged by a test."
        assert "already" in bench.operator.engage_estop("another")
        await bench.until(lambda: "estop" in bench.heard.kinds)
        await asyncio.sleep(1.0)
        assert bench.heard.kinds.count("estop") == 1


@on_virtual_time
async def test_the_next_frame_on_the_wire_is_the_stop_within_the_spacing(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        await asyncio.sleep(0.03)
        assert bench.port is not None
        written = len(bench.port.written)
        engaged_ns = bench.clock.now_ns()
        bench.operator.engage_estop("a test")
        await bench.until(lambda: bench.port is not None and len(bench.port.written) > written)
        assert bench.port.frames[written] == b"$spd:0,0,0,0#"
        assert bench.port.written[written][0] - engaged_ns < 13_000_000


@on_virtual_time
async def test_engaging_again_says_the_stop_again(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bench.operator.engage_estop("a test")
        await asyncio.sleep(1.0)
        said = bench.controller.counters["stops_said"]
        bench.operator.engage_estop("a test")
        assert bench.controller.counters["stops_said"] == said + 1


@on_virtual_time
async def test_a_refused_release_is_counted_and_reported(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        words = bench.operator.refuse_release("A sample")
        assert "yahboomd/estop/reset" in words
        assert bench.controller.counters["release_refused"] == 1
        assert "estop_release_refused" in bench.heard.kinds
        bench.operator.refuse_release("A sample", times=1_000)
        assert bench.controller.counters["release_refused"] == 1_001
        assert bench.heard.kinds.count("estop_release_refused") == 2


@on_virtual_time
async def test_a_fault_is_cleared_only_while_no_source_commands_motion(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        faults = MotorFaults(encoder_dead=True)
        bench.robot.set_faults("left", faults, now_ns=bench.clock.now_ns())
        await bench.drive(1.0, 0.3)
        cleared, words = bench.operator.release_estop()
        assert not cleared
        assert "cmd_vel commands motion" in words
        await asyncio.sleep(1.0)
        cleared, words = bench.operator.release_estop()
        assert cleared
        # What happened, and not again what to do about it.
        assert words.startswith("Cleared the fault: left")
        assert words.count(". ") == 0
        assert bench.operator.release_estop() == (True, "Nothing to release: no e-stop, no fault.")


@on_virtual_time
async def test_one_release_opens_the_latch_and_clears_the_fault(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        faults = MotorFaults(encoder_dead=True)
        bench.robot.set_faults("left", faults, now_ns=bench.clock.now_ns())
        await bench.drive(1.0, 0.3)
        bench.operator.engage_estop("a test")
        await asyncio.sleep(1.0)
        released, words = bench.operator.release_estop()
        assert released
        assert "Cleared the fault" in words
        assert bench.controller.state()[0] == "standing"


@pytest.mark.cases(1)
@pytest.mark.parametrize("copies", [2, 32])
@on_virtual_time
async def test_no_copy_of_a_release_releases_what_was_engaged_after_it(
    tmp_path: Path, copies: int
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bench.operator.engage_estop("a test")
        assert bench.operator.release_estop()[0]
        bench.operator.engage_estop("another")
        for _ in range(copies - 1):
            released, why = bench.operator.release_estop()
            assert not released
            assert "copy of that request" in why
            await asyncio.sleep(0.01)
        assert bench.controller.counters["release_refused"] == copies - 1
        await asyncio.sleep(1.0)
        assert bench.operator.release_estop()[0]


@on_virtual_time
async def test_copies_of_a_release_are_answered_as_done(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bench.operator.engage_estop("a test")
        assert all(bench.operator.release_estop()[0] for _ in range(32))
        assert bench.heard.kinds.count("estop_released") == 1


@pytest.mark.parametrize("hangs", [False, True])
async def test_an_acknowledgement_says_when_the_stop_would_not_survive_a_restart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hangs: bool
) -> None:
    let_go = threading.Event()
    if hangs:
        monkeypatch.setattr(LatchFile, "engage", lambda *_: let_go.wait(60.0))
        monkeypatch.setattr(latch, "SETTLE_S", 0.01)
    bench = RobotBench(tmp_path)
    words = bench.operator.engage_estop("a test")
    # The wheels do not wait for the disk.
    assert bench.controller.state()[0] == "estopped"
    message = (await bench.operator.acknowledged(words)).message
    assert message.startswith("Emergency stop engaged by a test.")
    assert ("would not survive a restart" in message) is hangs
    assert ("not on file" in bench.controller.state()[1][0].text) is hangs
    assert bench.controller.status_values()["estop_not_on_file"] == int(hangs)
    let_go.set()
    monkeypatch.setattr(latch, "SETTLE_S", 60.0)
    assert bench.latch.settle()
    bench.controller.close()


class Bus:
    """Keeps the declared keys."""

    neighbours: tuple[Neighbour, ...] = ()

    def __init__(self, settle: Callable[[], bool]) -> None:
        self.order: list[str] = []
        self.handlers: dict[
            str, Callable[[BusQuery], Response | Coroutine[Any, Any, Response]]
        ] = {}
        self.settle = settle
        self.options: dict[str, dict[str, Any]] = {}
        self.alarms = set[str]()
        self.raised: Callable[[int, int], None] = lambda count, unread: None
        self.ignored: Callable[[int], None] = lambda count: None
        self.idle: Callable[[int], None] = lambda count: None
        self.harmless: Callable[[bytes], bool] = lambda payload: False
        self.asks_nothing: Callable[[bytes], bool] = lambda payload: False

    def alarm(
        self,
        key: str,
        raised: Callable[[int, int], None],
        ignored: Callable[[int], None],
        *,
        harmless: Callable[[bytes], bool],
        idle: Callable[[int], None],
        asks_nothing: Callable[[bytes], bool],
    ) -> None:
        assert key.endswith(keys.ESTOP)
        self.order.append(key)
        self.alarms.add(key)
        self.raised, self.ignored, self.harmless = raised, ignored, harmless
        self.idle, self.asks_nothing = idle, asks_nothing

    def estop_sample(self, payload: bytes, key: str = keys.ESTOP) -> None:
        assert key in self.alarms
        if self.asks_nothing(payload):
            self.idle(1)
        elif self.harmless(payload):
            self.ignored(1)
        else:
            self.raised(1, 0)

    def serve(self, key: str, handler: Callable[[BusQuery], Response], **options: Any) -> None:
        self.order.append(key)
        self.handlers[key] = handler
        self.options[key] = options

    async def answer(self, asked: BusQuery) -> Response:
        """The answer; that of an e-stop comes when it was sent and its latch is on file."""
        response = self.handlers[asked.key](asked)
        if isinstance(response, Response):
            return response
        # Each time it waits for half a second, which a busy disk may need several times.
        assert any(self.settle() for _ in range(40))
        return await response

    async def ask(self, key: str, payload: bytes = b"", *, oversize: bool = False) -> Any:
        recognise = self.options[key].get("harmless")
        harmless = recognise is None or (recognise(payload) and not oversize)
        asked = request(key, payload, oversize=oversize, harmless=harmless)
        response = await self.answer(asked)
        assert response.encoding == "application/json;ServiceReply"
        return json.loads(response.payload)


def request(
    key: str, payload: bytes, *, oversize: bool = False, harmless: bool = False
) -> BusQuery:
    return BusQuery(
        key=key,
        selector=key,
        payload=payload,
        encoding="",
        attachment=None,
        arrived_ns=0,
        oversize=oversize,
        harmless=harmless,
    )


async def saved() -> ServiceReply:
    return ServiceReply(success=True, message="Saved.", data={"path": "/a/box"})


def served(
    bench: RobotBench, board: dict[str, Any] | None = None, groups: tuple[str, ...] = ()
) -> Bus:
    bus = Bus(bench.latch.settle)
    services = Services(
        bench.operator,
        encoding="json",
        config=lambda: {"zenoh": {"namespace": "bot1"}},
        board=lambda: board or {},
        newest={keys.BATTERY: BatterySample(stamp_ns=1, volts=7.4)}.get,
        save_box=saved,
    )
    services.serve(bus, groups)  # type: ignore[arg-type]
    return bus


@on_virtual_time
async def test_the_emergency_stop_is_there_first_and_goes_before_everything(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        bus = served(bench)
        assert bus.order[:2] == [keys.ESTOP, keys.ESTOP]
        alarms = {key for key, options in bus.options.items() if options.get("harmless")}
        assert alarms == {keys.ESTOP}
        # Asked for by its key, it answers beside that of another daemon, not instead of it.
        assert {
            key for key, options in bus.options.items() if not options.get("complete", True)
        } == alarms
        # A query for everything on the bus moves and releases nothing.
        by_wildcard = {key for key, options in bus.options.items() if options.get("wildcards")}
        assert by_wildcard == {keys.CONFIG, keys.BOARD, *keys.SAMPLES}


@on_virtual_time
async def test_the_newest_sample_is_answered_as_it_is_published(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        bus = served(bench)
        response = await bus.answer(request(keys.BATTERY, b""))
        assert response.encoding == "application/json;BatterySample"
        assert json.loads(response.payload) == {"stamp_ns": 1, "volts": 7.4}
        before_the_first = await bus.ask(keys.POSE)
        assert not before_the_first["success"]
        assert before_the_first["message"] == "There was no sample on yahboomd/pose yet."


@pytest.mark.cases(3)
@pytest.mark.parametrize("payload", [b"", b"\xff", b'{"engaged": true}', b'{"engaged": 0}', b"{}"])
@pytest.mark.parametrize("way", ["sample", "query"])
@on_virtual_time
async def test_any_payload_engages(tmp_path: Path, payload: bytes, way: str) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        if way == "sample":
            bus.estop_sample(payload)
        else:
            assert (await bus.ask(keys.ESTOP, payload))["success"]
        await bench.until(lambda: bench.controller.state()[0] == "estopped")


@on_virtual_time
async def test_who_engaged_the_estop_is_named_as_the_query_says(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        answer = await served(bench).ask(keys.ESTOP, b'{"by": "the red button"}')
        engaged = "engaged by the red button"
        assert answer["message"].startswith(f"Emergency stop {engaged}.")
        assert engaged in bench.controller.state()[1][0].text


@on_virtual_time
async def test_a_payload_too_large_to_be_read_engages(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        assert (await bus.ask(keys.ESTOP, b'{"engaged": false}', oversize=True))["success"]
        assert bench.controller.state()[0] == "estopped"
        bus.raised(3, 2)
        assert bench.controller.counters["estops"] == 4
        assert bench.controller.counters["estops_unread"] == 3
        (words,) = [event.message for event in bench.heard.events if event.kind == "estop"]
        assert "too long to be read" in words


@pytest.mark.cases(2)
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
                await bus.answer(each),
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
                bus.estop_sample(b'{"engaged": false}')
            else:
                answer = await bus.ask(keys.ESTOP, b'{"engaged": false}')
                assert not answer["success"]
                assert "estop/reset" in answer["message"]
            assert bench.controller.state()[0] == state
            bench.operator.engage_estop("a test")
            await asyncio.sleep(0.05)
        assert bench.controller.counters["release_refused"] == 2


@on_virtual_time
async def test_the_release_is_refused_with_its_reason_while_somebody_commands(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        await bus.ask(keys.ESTOP)
        bench.command(0.3)
        answer = await bus.ask(keys.ESTOP_RESET)
        assert not answer["success"]
        assert "cmd_vel" in answer["message"]
        bench.command(0.0)
        assert not (await bus.ask(keys.ESTOP_RESET))["success"]
        await asyncio.sleep(1.0)
        assert (await bus.ask(keys.ESTOP_RESET))["success"]


@on_virtual_time
async def test_a_pose_is_set_with_its_covariance_and_refused_with_its_reason(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        covariance = [0.04, 0, 0, 0, 0.09, 0, 0, 0, 0.01]
        wanted = {"x": 1, "y": -2, "theta": 7, "covariance": covariance}
        assert (await bus.ask(keys.ODOMETRY_SET_POSE, json.dumps(wanted).encode()))["success"]
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
            answer = await bus.ask(keys.ODOMETRY_SET_POSE, bad)
            assert not answer["success"]
            assert "The pose stays as it is" in answer["message"]
        assert (await bus.ask(keys.ODOMETRY_RESET))["success"]
        count = len(bench.heard.estimates)
        await bench.until(lambda: len(bench.heard.estimates) > count + 2)
        pose = bench.heard.estimates[-1].pose
        assert (pose.x, pose.y, pose.theta) == pytest.approx((0, 0, 0))
        assert bench.heard.kinds.count("pose_set") == 2


@on_virtual_time
async def test_configuration_and_board_are_answered(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        bus = served(bench)
        assert (await bus.ask(keys.CONFIG))["data"] == {
            "version": __version__,
            "zenoh": {"namespace": "bot1"},
        }
        assert (await bus.ask(keys.BLACKBOX_SAVE))["data"] == {"path": "/a/box"}
        nothing = await bus.ask(keys.BOARD)
        assert not nothing["success"]
        assert nothing["message"] == "No board is connected."
        bus = served(bench, {"dialect": "streamed", "version": "1.7.3"})
        assert (await bus.ask(keys.BOARD))["data"]["version"] == "1.7.3"


@on_virtual_time
async def test_an_answer_speaks_the_language_of_the_question(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        bus = served(bench)
        response = await bus.answer(request(keys.ESTOP, b"\x80"))
        assert response.encoding == "application/msgpack;ServiceReply"
        message = msgspec.msgpack.decode(response.payload)["message"]
        assert message.startswith("Emergency stop engaged by a query on yahboomd/estop.")
        fallback = bus.options[keys.ESTOP]["fallback"]("Too many at once.", request("", b"{}"))
        assert json.loads(fallback.payload) == {
            "success": False,
            "message": "Too many at once.",
            "data": {},
        }


@on_virtual_time
async def test_an_alarm_among_too_many_is_answered_with_what_becomes_of_it(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        bus = served(bench)

        def words(key: str, *, harmless: bool) -> str:
            asked = request(key, b"{}", harmless=harmless)
            answer = json.loads(bus.options[key]["fallback"](TOO_MANY, asked).payload)
            assert not answer["success"]
            return str(answer["message"])

        assert "engaged all the same" in words(keys.ESTOP, harmless=False)
        assert words(keys.ESTOP, harmless=True) == TOO_MANY
        assert words(keys.BOARD, harmless=True) == TOO_MANY


@on_virtual_time
async def test_an_estop_that_is_offered_elsewhere_too_is_an_alarm_there(tmp_path: Path) -> None:
    """As the native ROS 2 plane offers it; its clients ask only services that are complete."""
    native = "/0/estop/std_srvs::srv::dds_::SetBool_/RIHS01_1"
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench)
        services = Services(
            bench.operator,
            encoding="json",
            config=dict,
            board=dict,
            newest=lambda _: None,
            save_box=saved,
        )
        services.offer(
            bus,  # type: ignore[arg-type]
            keys.ESTOP,
            services.actions[keys.ESTOP],
            lambda request, reply: Response(payload=reply.message.encode()),
            at=native,
        )
        options = bus.options[native]
        assert options["complete"]
        assert options["harmless"](ros2_encoders.boolean(False))
        assert not options["harmless"](ros2_encoders.boolean(True))
        assert not bus.harmless(ros2_encoders.boolean(False))
        await bus.answer(msgspec.structs.replace(request(native, b""), harmless=False))
        assert bench.controller.state()[0] == "estopped"


@pytest.mark.parametrize("way", ["sample", "query"])
@on_virtual_time
async def test_the_estop_of_a_group_stops_its_robots_and_neither_releases_nor_names_one(
    tmp_path: Path, way: str
) -> None:
    """Every robot of the group answers, not the nearest one."""
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bus = served(bench, groups=("farm/north", "farm"))
        for key in ("/farm/north/yahboomd/estop", "/farm/yahboomd/estop"):
            assert not bus.options[key]["complete"]
            assert not bus.options[key].get("wildcards")
            assert bus.options[key]["harmless"](b'{"engaged": false}')
            if way == "sample":
                bus.estop_sample(b"{}", key)
            else:
                answer = await bus.ask(key, b'{"by": "the red button"}')
                assert answer["success"]
            await bench.until(lambda: bench.controller.state()[0] == "estopped")
            assert bench.operator.release_estop()[0]
            await asyncio.sleep(2.0)
        assert "/farm/yahboomd/estop/reset" not in bus.options


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("addresses", "words"),
    [
        ((), "yahboomd/estop."),
        (("tcp/10.0.0.7:40112",), "yahboomd/estop, from tcp/10.0.0.7:40112."),
        (("tcp/a:1", ""), "yahboomd/estop, from one of tcp/a:1, 2b."),
        (tuple(map(str, range(5))), "yahboomd/estop, from one of 5 clients."),
    ],
)
@on_virtual_time
async def test_an_emergency_stop_without_a_name_names_the_clients_that_may_have_sent_it(
    tmp_path: Path, addresses: tuple[str, ...], words: str
) -> None:
    async with RobotBench(tmp_path) as bench:
        bus = served(bench)
        bus.neighbours = tuple(
            Neighbour(zid=f"{number + 1}b", kind="client", address=address)
            for number, address in enumerate(addresses)
        )
        answer = await bus.ask(keys.ESTOP)
        assert answer["message"].startswith(f"Emergency stop engaged by a query on {words}")
