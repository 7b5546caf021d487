"""A session with a simulated board, both dialects, on virtual time."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable
from pathlib import Path

import pytest
from board_bench import Bench

from yahboomd.core.errors import BoardError, BoardSilent, PortLost
from yahboomd.core.link import latency_timer, session
from yahboomd.core.link.session import SessionOptions
from yahboomd.core.model import EncoderReading
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import connect_stop
from yahboomd.simulation.motors import MotorFaults
from yahboomd.simulation.options import ImpairmentOptions, SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

DIALECTS = ["streamed", "polled"]


def bench(there: str, **options: object) -> Bench:
    return Bench(
        SimulationOptions(dialect=there),  # type: ignore[arg-type]
        SessionOptions(**options),  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_the_dialect_is_found_out_and_counts_come(dialect: str) -> None:
    async with bench(dialect) as board:
        await board.connected()
        assert [each.dialect.name for each in board.recorder.identities] == [dialect]
        assert board.recorder.readings[0].after_gap
        await board.until(lambda: len(board.recorder.readings) > 20)
        assert not any(each.after_gap for each in board.recorder.readings[1:])


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_connecting_stops_first_and_writes_no_setting(dialect: str) -> None:
    async with bench(dialect) as board:
        await board.connected()
        assert board.port is not None
        frames = [frame for frame in board.port.frames if frame]
        stops = [stop for _, stop in connect_stop()]
        assert [frame for frame in frames if frame in stops][: len(stops)] == stops
        assert frames[:2] == stops[:2] == [b"$pwm:0,0,0,0#", b"$speed:0,0,0,0#"]
        frames = [frame for frame in frames if b"#" in frame]
        before = {frame.split(b":")[0].strip(b"$#") for frame in frames}
        allowed = {b"pwm", b"speed", b"read_flash", b"read", b"upload", b"read_vol"}
        assert before - ({b"mtype"} if dialect == "polled" else set()) <= allowed


@on_virtual_time
async def test_wheels_that_turn_after_a_crash_are_stopped_before_the_board_is_asked() -> None:
    board = bench("streamed")
    async with board:
        await board.connected()
        board.wheels.drive((300, 0, 300, 0))
        await board.until(lambda: min(board.rim_speeds) > 0.2)
        # The daemon is killed: no stop is sent, and the board drives on.
        assert board.port is not None
        board.port.close()
        assert min(board.rim_speeds) > 0.2
        again = Bench()
        again.robot = board.robot
        async with again:
            await again.connected()
            await again.until(lambda: max(map(abs, again.rim_speeds)) < 0.03)


@pytest.mark.parametrize(("wanted", "there"), [("polled", "streamed"), ("streamed", "polled")])
@on_virtual_time
async def test_the_other_dialect_than_the_configured_one_is_named(wanted: str, there: str) -> None:
    board = bench(there, dialect=wanted)
    with pytest.raises(
        BoardError, match=f'uses the {there} dialect.*dialect = "auto" or "{there}"'
    ):
        await board.session.run()
    assert board.port is not None
    assert board.port.closed


@on_virtual_time
async def test_a_port_on_which_nothing_answers_is_named_with_the_remedy() -> None:
    board = bench("streamed")
    board.robot.start(board.now_ns())
    board.robot.hang(board.now_ns())
    with pytest.raises(BoardSilent, match="no board answers here; received nothing"):
        await board.session.run()


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_the_end_of_a_session_brings_the_wheels_to_rest(dialect: str) -> None:
    async with bench(dialect) as board:
        await board.connected()
        board.wheels.drive((300, 0, 300, 0))
        await board.until(lambda: min(board.rim_speeds) > 0.2)
        await board.stop()
        assert max(map(abs, board.rim_speeds)) < 0.03
        assert board.session.report is not None
        assert board.session.report.stood is True
        assert board.port is not None
        assert board.port.closed


@pytest.mark.cases(2)
@pytest.mark.parametrize("how", ["raises", "is cancelled"])
@pytest.mark.parametrize("name", ["link-writer", "link-poller"])
@on_virtual_time
async def test_wheels_stop_when_a_task_dies(name: str, how: str) -> None:
    async with bench("streamed") as board:
        await board.connected()
        board.wheels.drive((300, 0, 300, 0))
        await board.until(lambda: min(board.rim_speeds) > 0.2)
        task = next(each for each in asyncio.all_tasks() if each.get_name() == name)
        if how == "is cancelled":
            task.cancel()
        else:
            line = board.wheels._line
            line.writer._pump = lambda: 1 / 0  # type: ignore[assignment, return-value, method-assign]
            board.wheels._poller._look = lambda: 1 / 0  # type: ignore[assignment, return-value, method-assign]
        with pytest.raises((RuntimeError, ZeroDivisionError)):
            await board.ended()
        assert max(map(abs, board.rim_speeds)) < 0.03


@on_virtual_time
async def test_an_encoder_that_is_dead_makes_the_stop_cut_the_motors() -> None:
    async with bench("streamed") as board:
        await board.connected()
        faults = MotorFaults(encoder_dead=True)
        board.robot.set_faults("left", faults, now_ns=board.now_ns())
        board.wheels.drive((150, 0, 150, 0))
        await board.until(lambda: board.rim_speeds[0] > 0.5)
        await board.stop()
        # The zero speed does not end a runaway; letting the motors go does.
        await asyncio.sleep(1.0)
        board.robot.advance(board.now_ns())
        assert abs(board.rim_speeds[0]) < 0.05


@on_virtual_time
async def test_the_port_that_goes_away_ends_the_session() -> None:
    board = bench("streamed")
    async with board:
        await board.connected()
        board.robot.unplug(board.now_ns())
        with pytest.raises(PortLost, match="/dev/simulated: the port went away"):
            await board.ended()


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_board_that_falls_silent_ends_the_session(dialect: str) -> None:
    board = bench(dialect)
    async with board:
        await board.connected()
        board.robot.hang(board.now_ns())
        with pytest.raises(BoardSilent, match="sent no counts"):
            await board.ended()


@on_virtual_time
async def test_a_latency_timer_is_named_once_for_each_connection(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(latency_timer, "SYSFS", tmp_path)
    (tmp_path / "simulated").mkdir()
    (tmp_path / "simulated" / "latency_timer").write_text("16\n")
    async with bench("streamed") as board:
        await board.connected()
        await asyncio.sleep(3.0)
        kinds = [event.kind for event in board.recorder.events]
        assert kinds == ["latency_timer"]


@on_virtual_time
async def test_another_reader_of_a_connected_board_is_named_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(session, "other_readers", lambda path: f"{path} is also open in cat.")
    async with bench("streamed") as board:
        await board.connected()
        await asyncio.sleep(3.0)
        (event,) = board.recorder.events
        assert (event.kind, event.severity) == ("port_shared", "warning")
        assert "cat" in event.message


class LateBoard(Bench):
    """Everything takes its time on the way; some lines of the board do not arrive."""

    def __init__(self, rtt_ms: int, without: bytes = b"") -> None:
        impairments = ImpairmentOptions(delay_s=rtt_ms / 2000)
        super().__init__(SimulationOptions(impairments=impairments))
        emit = self.robot.board.emit
        self.robot.board.emit = lambda data, now_ns: emit(  # type: ignore[method-assign]
            data.replace(without, b"") if without else data, now_ns
        )


@pytest.mark.cases(4)
@pytest.mark.parametrize("without", [b"", b"read_flash:OK!\r\n", b"wheel_diameter:67.000\r\n"])
@pytest.mark.parametrize("rtt_ms", [0, 20, 28, 80, 200, 260, 400, 500])
@on_virtual_time
async def test_late_answers_to_what_was_asked_twice_are_no_reset(
    rtt_ms: int, without: bytes
) -> None:
    board = LateBoard(rtt_ms, without)
    async with board:
        await asyncio.sleep(4.0)
        assert board.recorder.resets == []
        assert board.session.status_values().get("board_resets", 0) == 0
        # Without the diameter no wheel may turn; else the board is ready.
        assert bool(board.recorder.readings) == (b"diameter" not in without)


@pytest.mark.cases(2)
@pytest.mark.parametrize("rtt_ms", [0, 28, 500])
@on_virtual_time
async def test_a_reset_is_noticed_however_long_the_line_is(rtt_ms: int) -> None:
    async with LateBoard(rtt_ms) as board:
        await board.connected()
        await asyncio.sleep(2.0)
        board.robot.brown_out(board.now_ns())
        await board.until(lambda: board.recorder.resets, within_s=2.0)
        await asyncio.sleep(2.0)
        board.robot.reset(board.now_ns())
        await board.until(lambda: len(board.recorder.resets) == 2, within_s=2.0)


@on_virtual_time
async def test_a_reset_whose_notice_is_lost_is_armed_again_after_the_silence() -> None:
    async with bench("streamed") as board:
        await board.connected()
        board.robot.mute(board.now_ns(), 0.2)
        board.robot.reset(board.now_ns())
        count = len(board.recorder.readings)
        await board.until(lambda: len(board.recorder.readings) > count + 10)
        assert board.session.status_values()["rearmed"] >= 1


@on_virtual_time
async def test_polled_reaches_200_polls_a_second_with_a_speed_frame_in_every_control_step() -> None:
    async with bench("polled", poll_rate_hz=200.0) as board:
        await board.connected()
        start = len(board.recorder.readings)
        for step in range(100):
            board.wheels.drive((200 + step % 2, 0, 200, 0))
            await asyncio.sleep(0.02)
        polled = len(board.recorder.readings) - start
        # Every poll of the two seconds, but for the one under way at each end.
        assert polled >= 398


@pytest.mark.nightly
@on_virtual_time
async def test_a_polled_board_that_stands_is_asked_as_often_as_the_wire_allows() -> None:
    async with bench("polled", poll_rate_hz=520.0) as board:
        await board.connected()
        await asyncio.sleep(1.0)
        start = len(board.recorder.readings)
        await asyncio.sleep(1.0)
        # Question and answer take 1.93 ms, a little more than the period.
        assert len(board.recorder.readings) - start >= 510


def count_lines(board: Bench) -> Callable[[], int]:
    """Counts the lines of totals that the board emits from now on."""
    lines = 0
    emit = board.robot.board.emit

    def counting(data: bytes, now_ns: int) -> None:
        nonlocal lines
        lines += data.startswith(b"$MAll")
        emit(data, now_ns)

    board.robot.board.emit = counting
    return lambda: lines


@on_virtual_time
async def test_streamed_reads_every_frame_that_the_wire_carries() -> None:
    async with bench("streamed") as board:
        await board.connected()
        start = len(board.recorder.readings)
        emitted = count_lines(board)
        board.wheels.drive((200, 0, 200, 0))
        await asyncio.sleep(5.0)
        board.robot.advance(board.now_ns())
        read = len(board.recorder.readings) - start
        # The last line may be on the wire.
        assert emitted() - 1 <= read <= emitted() + 1
        assert read > 500


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_frames_keep_the_spacing_that_the_dialect_asks_for(dialect: str) -> None:
    async with bench(dialect, battery_period_s=0.0) as board:
        await board.connected()
        assert board.port is not None
        begin = len(board.port.written)
        for step in range(200):
            board.wheels.drive((100 + step, 0, 100, 0))
            await asyncio.sleep(0.003)
        gap_ns = board.recorder.identities[0].dialect.totals_spacing_ns
        frames = board.port.written[begin:]
        assert len(frames) > 20
        for (at_ns, data), (next_ns, _) in itertools.pairwise(frames):
            assert next_ns - at_ns >= len(data) * board.port.byte_ns + gap_ns - 1_000


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_reading_is_stamped_with_the_moment_its_last_byte_arrived(dialect: str) -> None:
    async with bench(dialect) as board:
        await board.connected()
        await board.until(lambda: len(board.recorder.readings) > 50)
        for reading in board.recorder.readings:
            assert reading.sent_ns <= reading.received_ns
            assert reading.received_ns - reading.sent_ns < 6_000_000


@on_virtual_time
async def test_a_polled_board_gets_the_type_of_the_configured_motors() -> None:
    async with bench("polled", profile=PROFILES["310"]) as board:
        await board.connected()
        assert board.port is not None
        await board.until(lambda: board.port is not None and b"$mtype:2#" in board.port.frames)
        assert b"$mtype:1#" not in board.port.frames


class Overlap:
    """Counts, at each reading, the questions and the answers that the line has seen."""

    def __init__(self, board: Bench) -> None:
        self._board = board
        self.asked_ahead: list[int] = []
        self.stamps: list[tuple[int | None, int]] = []
        self._hear, board.recorder.reading = board.recorder.reading, self.reading  # type: ignore[method-assign]

    def reading(self, reading: EncoderReading) -> None:
        assert self._board.port is not None
        self._hear(reading)
        asked = [at_ns for at_ns, data in self._board.port.written if data == b"$read#"]
        self.asked_ahead.append(sum(at_ns >= reading.received_ns for at_ns in asked))
        heard_ns = max(at_ns for at_ns in asked if at_ns < reading.received_ns)
        self.stamps.append((reading.requested_ns, heard_ns + 6 * self._board.port.byte_ns))


@on_virtual_time
async def test_the_next_question_is_out_before_the_counts_are_made_use_of() -> None:
    board = bench("polled", poll_rate_hz=1000.0)
    overlap = Overlap(board)
    async with board:
        await board.connected()
        await board.until(lambda: len(overlap.asked_ahead) > 100)
    # The schedule is faster than the wire: a question always waits for the answer before it.
    assert set(overlap.asked_ahead[5:100]) == {1}


@on_virtual_time
async def test_an_answer_keeps_its_own_question_when_the_next_one_is_out_already() -> None:
    board = bench("polled", poll_rate_hz=1000.0)
    overlap = Overlap(board)
    async with board:
        await board.connected()
        await board.until(lambda: len(overlap.stamps) > 100)
    for requested_ns, heard_ns in overlap.stamps[5:100]:
        assert requested_ns == heard_ns
