"""Settings are stored one by one, confirmed by reading back, with the wheels at rest."""

from __future__ import annotations

import pytest
from board_bench import LinkBench

from yahboomd.core.errors import BoardError, ConfigError
from yahboomd.core.link.storing import STORE_ATTEMPTS, Progress, Storing, StoringStep, store
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.settings import BoardSettings, SettingWrite
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.options import ImpairmentOptions
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.port import probing

P520 = PROFILES["520"].settings
P310 = PROFILES["310"].settings
GAINS = BoardSettings(pid=(1.0, 0.1, 0.4))


def flash_of(board: LinkBench) -> FlashContent:
    content: FlashContent = board.robot.board.flash  # type: ignore[attr-defined]
    return content


def settings_sent(board: LinkBench) -> list[bytes]:
    names = (b"$mtype", b"$deadzone", b"$mline", b"$mphase", b"$wdiameter", b"$MPID")
    return [frame for frame in board.frames if frame.startswith(names)]


async def stored(board: LinkBench, want: BoardSettings, **more: Progress) -> Storing:
    return await store(board.open, board.clock, want, **more)


@on_virtual_time
async def test_only_what_differs_is_written() -> None:
    board = LinkBench()
    storing = await stored(board, P520)
    assert settings_sent(board) == [b"$deadzone:1900#"]
    assert storing.complete
    assert flash_of(board).dead_zone == 1900
    assert storing.has["deadzone"] == 1900


@on_virtual_time
async def test_a_board_that_stores_the_profile_is_written_nothing() -> None:
    board = LinkBench(flash=FlashContent(dead_zone=1900))
    storing = await stored(board, P520)
    assert settings_sent(board) == []
    assert storing.steps == ()
    assert storing.complete


@on_virtual_time
async def test_gain_0_251_which_a_rosmaster_board_shows_as_0_250_is_written_once() -> None:
    board = LinkBench(dialect="rosmaster")
    want = BoardSettings(pid=(0.251, 0.06, 0.5))
    first = await stored(board, want)
    assert [step.outcome for step in first.steps] == ["stored"]
    assert first.has["pid"] == (0.250, 0.06, 0.5)
    again = await stored(board, want)
    assert again.steps == ()
    assert again.complete


@on_virtual_time
async def test_zeros_and_a_wrong_type_are_replaced() -> None:
    board = LinkBench(flash=FlashContent(motor_type=2, lines=0, ratio=0, wheel_diameter_mm=0.0))
    storing = await stored(board, P520)
    assert storing.complete
    assert [step.attempts for step in storing.steps] == [1] * 5
    flash = flash_of(board)
    assert (flash.motor_type, flash.lines, flash.ratio) == (1, 11, 30)
    assert flash.wheel_diameter_mm == 67.0


@on_virtual_time
async def test_one_value_at_a_time_each_after_the_answer_to_the_one_before() -> None:
    board = LinkBench(motor_type=2)
    await stored(board, P310)
    sent = [(at_ns, data) for at_ns, data in board.ports[-1].written if data.strip(b"\n")]
    for number, (at_ns, data) in enumerate(sent[:-1]):
        if data in settings_sent(board):
            next_ns, following = sent[number + 1]
            assert following == b"$read_flash#"
            assert next_ns - at_ns > 65_000_000


@on_virtual_time
async def test_the_motors_are_let_go_and_streams_off_before_the_first_value() -> None:
    board = LinkBench()
    await board.drive()
    storing = await stored(board, P520)
    assert storing.complete
    before = board.frames[: board.frames.index(b"$deadzone:1900#")]
    assert before[-3:] == [b"$pwm:0,0,0,0#", b"$upload:0,0,0#", b"$pwm:0,0,0,0#"]


@on_virtual_time
async def test_nothing_is_stored_while_a_wheel_turns() -> None:
    board = LinkBench()
    board.on_open = lambda _times: board.robot.set_faults(
        "left", FAULTS["turning"], now_ns=board.now_ns
    )
    with pytest.raises(BoardError, match=r"at rest only, and the wheels turn.*Nothing was stored"):
        await stored(board, P520)
    assert settings_sent(board) == []


@on_virtual_time
async def test_new_gains_restart_the_board_and_are_confirmed() -> None:
    board = LinkBench(initial_ticks=(900, 0, 0, 0))
    storing = await stored(board, GAINS)
    assert storing.complete
    assert storing.steps[0].answer == "restarted"
    assert storing.has["pid"] == (1.0, 0.1, 0.4)
    assert board.robot.board.totals == (0, 0, 0, 0)


@on_virtual_time
async def test_gains_come_after_all_that_does_not_restart_the_board() -> None:
    board = LinkBench()
    await stored(board, P520 | GAINS)
    assert [frame[:5] for frame in settings_sent(board)] == [b"$dead", b"$MPID"]


@pytest.mark.parametrize("want", [P520, GAINS])
@on_virtual_time
async def test_an_answer_that_is_lost_is_made_up_for_by_reading_back(want: BoardSettings) -> None:
    board = LinkBench()

    def mute(data: bytes) -> bytes:
        if data in (b"$deadzone:1900#", b"$MPID:1.000,0.100,0.400#"):
            board.robot.mute(board.now_ns, 0.9 if b"MPID" in data else 0.3)
        return data

    board.on_write = mute
    storing = await stored(board, want)
    assert storing.complete
    assert (storing.steps[0].answer, storing.steps[0].attempts) == ("", 1)


@on_virtual_time
async def test_firmware_that_confirms_no_dead_zone_is_read_back() -> None:
    board = LinkBench(firmware="1.6.5")
    storing = await stored(board, P520)
    assert storing.complete
    assert storing.steps[0].answer == ""


@on_virtual_time
async def test_a_digit_lost_on_the_way_is_found_by_reading_back_and_mended() -> None:
    board = LinkBench(flash=FlashContent(lines=13, dead_zone=1900))
    spoilt: list[bytes] = []

    def spoil(data: bytes) -> bytes:
        if data == b"$mline:11#" and not spoilt:
            spoilt.append(data)
            return b"$mline:1#"
        return data

    board.on_write = spoil
    storing = await stored(board, P520)
    assert storing.complete
    assert storing.steps[0].attempts == 2
    assert flash_of(board).lines == 11


@on_virtual_time
async def test_a_refusal_ends_it_and_is_reported_in_the_boards_words() -> None:
    board = LinkBench(flash=FlashContent(motor_type=2))
    board.on_write = lambda data: data.replace(b"$mtype:1#", b"$mtype:9#")
    storing = await stored(board, P520)
    assert not storing.complete
    assert [(step.outcome, step.answer) for step in storing.steps] == [
        ("refused", "fail,type error!")
    ]
    assert storing.steps[0].attempts == 1
    assert flash_of(board).dead_zone == 1600


@on_virtual_time
async def test_a_value_that_never_arrives_is_given_up_and_nothing_after_it_tried() -> None:
    board = LinkBench(flash=FlashContent(lines=13, motor_type=2))
    board.on_write = lambda data: None if data.startswith(b"$mtype") else data
    storing = await stored(board, P520)
    assert not storing.complete
    assert [(step.outcome, step.attempts) for step in storing.steps] == [("failed", STORE_ATTEMPTS)]
    assert flash_of(board).lines == 13


@pytest.mark.cases(2)
@pytest.mark.parametrize("seed", range(6))
@on_virtual_time
async def test_what_is_called_stored_is_stored_on_a_line_that_loses_bytes(seed: int) -> None:
    board = LinkBench(motor_type=2, seed=seed, impairments=ImpairmentOptions(loss=0.01))
    storing = await stored(board, P310)
    flash = flash_of(board)
    truly = {
        "mtype": flash.motor_type == 2,
        "deadzone": flash.dead_zone == 1600,
        "mline": flash.lines == 13,
        "mphase": flash.ratio == 20,
        "wdiameter": flash.wheel_diameter_mm == 48.0,
    }
    assert storing.steps
    for step in storing.steps:
        assert (step.outcome == "stored") == truly[step.write.reply_to]


async def believed_a_sunrise() -> LinkBench:
    """An X3, whose three cells are too much for a Sunrise: the alarm has latched."""
    board = LinkBench(
        dialect="rosmaster",
        drive="mecanum",
        battery_volts=11.4,
        rated_volts=11.4,
        start_up_s=10.6,
        flash=RosmasterStored(car_type=6),
    )
    await board.drive(0, for_s=3.0)
    return board


@on_virtual_time
async def test_the_way_back_works_on_a_board_whose_alarm_has_latched() -> None:
    board = await believed_a_sunrise()
    storing = await stored(board, PROFILES["x3"].settings)
    assert [(step.outcome, step.attempts) for step in storing.steps] == [("stored", 1)]
    assert storing.has["car_type"] == 1
    flash: RosmasterStored = board.robot.board.flash  # type: ignore[attr-defined]
    assert flash.car_type == 1
    # It counts again, by the limits of an X3.
    found = await probing.examine(board.open, board.clock, {})
    assert found.standing is True


@on_virtual_time
async def test_a_latched_board_says_why_it_does_not_count() -> None:
    board = await believed_a_sunrise()
    found = await probing.examine(board.open, board.clock, {})
    assert found.ticks is None
    assert "that is the battery of another car" in found.silence


@on_virtual_time
async def test_a_polled_board_is_sent_nothing() -> None:
    board = LinkBench(dialect="polled")
    with pytest.raises(BoardError, match="polled dialect stores no settings"):
        await stored(board, P520)


@on_virtual_time
async def test_a_value_that_must_never_be_stored_is_refused_here() -> None:
    board = LinkBench()
    with pytest.raises(ConfigError, match="encoder lines 0"):
        await stored(board, BoardSettings(lines=0))
    assert settings_sent(board) == []


@on_virtual_time
async def test_progress_is_reported_as_it_happens() -> None:
    class Listening(Progress):
        def __init__(self) -> None:
            self.steps: list[str] = []

        def begins(
            self, dialect: Dialect, writes: tuple[SettingWrite, ...], had: BoardSettings
        ) -> None:
            self.steps.append(f"{len(writes)} values, dead zone {had['deadzone']}")

        def stored(self, step: StoringStep, has: BoardSettings) -> None:
            self.steps.append(f"{step.write.reply_to} {step.outcome}, dead zone {has['deadzone']}")

    listening = Listening()
    await stored(LinkBench(), P520, progress=listening)
    assert listening.steps == ["1 values, dead zone 1600", "deadzone stored, dead zone 1900"]
