"""The stop socket of a tool, in one process with it."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path
from typing import Any

import pytest

from yahboomd.core.errors import Refused
from yahboomd.tools.port.guarded import LeftTurning
from yahboomd.tools.port.stop_socket import stop_socket, tools_folder

pytestmark = pytest.mark.realtime


async def stopped(folder: Path, error: BaseException | None = None) -> tuple[dict[str, Any], bool]:
    """The first answer to a stop of a tool that ends so; whether it came only after the end."""
    ending = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ending.set)
    try:
        async with stop_socket("tune", "/dev/a", {"RUNTIME_DIRECTORY": str(folder)}):
            reader, writer = await asyncio.open_unix_connection(folder / "stop-tune.sock")
            writer.write(b"stop by yahboomd stop\n")
            await ending.wait()
            answer = asyncio.ensure_future(reader.readline())
            await asyncio.sleep(0)
            waited = not answer.done()
            if error is not None:
                raise error
    except LeftTurning:
        pass
    finally:
        asyncio.get_running_loop().remove_signal_handler(signal.SIGTERM)
    line = json.loads(await answer)
    writer.close()
    return line, waited


async def test_a_stop_ends_the_tool_by_sigterm_and_is_answered_once_it_has_ended(
    tmp_path: Path,
) -> None:
    answer, waited = await stopped(tmp_path / "run")
    assert waited
    assert answer["engaged"] is answer["sent"] is True
    assert answer["message"].startswith("`yahboomd tune` is ended by `yahboomd stop` (")
    assert not (tmp_path / "run/stop-tune.sock").exists()


async def test_a_tool_that_left_wheels_turning_does_not_say_that_it_sent_a_stop(
    tmp_path: Path,
) -> None:
    answer, _ = await stopped(tmp_path / "run", LeftTurning())
    assert answer["sent"] is False


async def test_without_a_socket_no_wheel_is_turned(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("")
    with pytest.raises(Refused, match="no wheel is turned"):
        async with stop_socket("setup", "/dev/a", {"RUNTIME_DIRECTORY": str(tmp_path / "run")}):
            raise AssertionError


def test_roots_tools_have_a_folder_beside_the_services_which_that_user_owns() -> None:
    assert tools_folder({}, user_id=0) == Path("/run/yahboomd-root")
    assert tools_folder({"XDG_RUNTIME_DIR": "/x"}, user_id=1000) == Path("/x/yahboomd")
    assert tools_folder({"RUNTIME_DIRECTORY": "/run/a"}, user_id=0) == Path("/run/a")
