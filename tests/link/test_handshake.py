"""Identifying a board, whatever it sends."""

from __future__ import annotations

import asyncio

import pytest
from board_bench import Bench, LinkBench

from yahboomd.core.errors import BoardSilent
from yahboomd.core.link import handshake
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import Line
from yahboomd.core.link.port import byte_time_ns
from yahboomd.core.link.session import SessionOptions
from yahboomd.core.link.start_notices import Notice
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.options import ImpairmentOptions, SimulationOptions
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time


class Script:
    """A port whose far side answers from a script, line after line."""

    name = "/dev/script"
    byte_ns = byte_time_ns(115200)

    def queued(self) -> int:
        return 0

    def __init__(self, *answers: bytes) -> None:
        self.answers = list(answers)
        self.line = Line(self, LoopClock())  # type: ignore[arg-type]
        self.asked = 0

    def write(self, data: bytes) -> None:
        self.asked += 1
        if self.answers:
            answer = self.answers.pop(0)
            asyncio.get_running_loop().call_later(0.02, self.line._receive, answer)


async def identified(script: Script, wanted: str = "auto") -> Dialect:
    return await handshake.identify(script.line, wanted, stop_first=False)


FLASH = (
    b"read_flash:OK!\r\nMotor_Version:1.7.3\r\nMotor_type:1\r\nDead_Zone:1600\r\n"
    b"Pulse_Line:%d\r\nPulse_Phase:30\r\nwheel_diameter:67.000\r\n"
    b"P:0.800\t I:0.060\t D:0.500\t \r\n"
)


async def settings_from(*answers: bytes) -> object:
    script, streamed = Script(*answers), DIALECTS["streamed"]
    script.line.dialect = streamed
    task = asyncio.create_task(script.line.writer.run())
    try:
        return await handshake.read_settings(script.line, streamed, PROFILES["520"].settings)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@pytest.mark.parametrize(
    ("answers", "name"),
    [
        ((b"read_flash:OK!\r\n",), "streamed"),
        ((b"", b"$data:1,2,3,4#"), "polled"),
        ((b"$MAll:1,2,3,4#\r\n",), "streamed"),
        ((b"", b"", b"read_flash:OK!\r\n"), "streamed"),
    ],
)
@on_virtual_time
async def test_what_answers_tells_the_dialect(answers: tuple[bytes, ...], name: str) -> None:
    assert (await identified(Script(*answers))).name == name


@on_virtual_time
async def test_another_device_is_no_board_and_is_asked_no_more_than_needed() -> None:
    script = Script(*[b"$GPGGA,123519,4807.038,N*47\r\n"] * 6)
    with pytest.raises(BoardSilent, match="lines that no board sends"):
        await identified(script)
    assert script.asked == 3 * len(DIALECTS)


@on_virtual_time
async def test_settings_as_expected_are_believed_at_once() -> None:
    settings = await settings_from(FLASH % 11)
    assert settings is not None
    assert settings["lines"] == 11  # type: ignore[index]


@on_virtual_time
async def test_on_a_clean_line_the_board_is_asked_once_and_no_command_is_lost() -> None:
    async with Bench() as board:
        await board.connected()
        assert board.port is not None
        assert sum(b"$read_flash#" in data for _, data in board.port.written) == 1
        assert board.session.status_values().get("commands_lost", 0) == 0


@on_virtual_time
async def test_a_lost_digit_is_not_believed() -> None:
    settings = await settings_from(FLASH % 1, FLASH % 11)
    assert settings["lines"] == 11  # type: ignore[index]


@on_virtual_time
async def test_another_setting_than_expected_is_believed_when_said_twice() -> None:
    settings = await settings_from(FLASH % 13, FLASH % 13)
    assert settings["lines"] == 13  # type: ignore[index]


@on_virtual_time
async def test_a_board_that_never_tells_everything_is_not_moved() -> None:
    with pytest.raises(BoardSilent, match="does not send its settings"):
        await settings_from(*[b"read_flash:OK!\r\nMotor_type:1\r\n"] * 20)


@on_virtual_time
async def test_a_clone_is_told_from_a_bad_cable() -> None:
    with pytest.raises(
        BoardSilent, match="'mtype\\+OK': it speaks a dialect that yahboomd does not"
    ):
        await identified(Script(b"mtype+OK"))
    # Its counts may look like those of a board that is known.
    with pytest.raises(BoardSilent, match="dialect that yahboomd does not know"):
        await settings_from(b"pwm+OK$MAll:1,2,3,4#")


@on_virtual_time
async def test_another_reader_of_the_port_is_named_before_the_board_is_blamed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(handshake, "other_readers", lambda path: f"{path} is also open in cat")
    with pytest.raises(BoardSilent, match="/dev/script is also open in cat"):
        await identified(Script())
    with pytest.raises(BoardSilent, match="/dev/script is also open in cat"):
        await settings_from()


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", range(5))
@on_virtual_time
async def test_a_noisy_line_never_leads_to_wrong_settings(seed: int) -> None:
    simulation = SimulationOptions(
        seed=seed,
        flash=FlashContent(lines=13, ratio=20),
        impairments=ImpairmentOptions(loss=0.01, corruption=0.002),
    )
    async with Bench(simulation, SessionOptions()) as board:
        await board.connected()
        settings = board.recorder.identities[0].settings
        assert settings is not None
        assert (settings["lines"], settings["ratio"]) == (13, 20)


@on_virtual_time
async def test_a_version_alone_is_unclear_so_long_as_it_may_answer_a_question() -> None:
    board = LinkBench()
    line = Line(await board.open(), board.clock)
    notices: list[Notice] = []
    line.on_said = lambda _said, notice: notices.append(notice)
    alone = b"Motor_Version:1.7.3\r\n"
    async with line.attended():
        talk = await Conversation.begin(line)
        line._receive(alone)
        # Its earlier answer is enough: it is asked only the second time.
        await talk.read_settings(PROFILES["520"].settings)
        await asyncio.sleep(5.0)
        line._receive(alone)
        await talk.read_settings(PROFILES["520"].settings)
        line._receive(alone)
    assert [each for each in notices if each != "none"] == ["unclear", "start", "unclear"]
