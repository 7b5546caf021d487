from __future__ import annotations

import daemon_samples as daemon
import pytest
from drawn_screen import lines as lines_of
from rich.console import RenderableType

from yahboomd.core.model import Twist2d
from yahboomd.tools.screens import drive_screen
from yahboomd.tools.screens.dashboard import View
from yahboomd.tools.screens.teleop import MOVES, Teleop

S = 1_000_000_000


def forms(
    view: View, command: Twist2d | None = None, **changes: object
) -> tuple[RenderableType, RenderableType]:
    arguments: dict[str, object] = {
        "robot": "bot1 at tcp/127.0.0.1:7448",
        "key": "cmd_vel/teleop",
        "heard": True,
        "why": "",
        "answer": ("", ""),
    }
    return drive_screen.screen(view, command, (0.3, 1.0), **{**arguments, **changes})


def drawn(view: View, command: Twist2d | None = None, **changes: object) -> str:
    return "\n".join(line.rstrip() for line in lines_of(forms(view, command, **changes)[0]))


def test_it_shows_command_state_reason_driver_and_pose() -> None:
    text = drawn(daemon.driving(0).view(0), Twist2d(vx=0.3))
    for words in (
        "bot1 at tcp/127.0.0.1:7448  on cmd_vel/teleop",
        "you    ↑ forward",
        "speeds 0.30 m/s, 1.00 rad/s",
        "● DRIVING cmd_vel drives.",
        "driver cmd_vel has control",
        "x 1.50 m  y -0.25 m  θ 28.6°   moving 0.30 m/s, -0.25 rad/s",
        "event  The board reset itself.",
    ):
        assert words in text


def test_every_key_that_moves_has_words() -> None:
    for key in MOVES:
        teleop = Teleop(linear_m_s=0.3, angular_rad_s=1.0)
        teleop.press(key, 0)
        motion = teleop.motion(0)
        assert motion is not None
        assert drive_screen.words(motion[0]) not in {"moving", "nothing commanded"}


def test_a_daemon_that_went_is_named() -> None:
    text = drawn(daemon.driving(0).view(5 * S), why="The connection is lost.")
    assert "no status from the daemon for 5 s. The connection is lost." in text
    assert "DRIVING" not in text
    assert "run `yahboomd stop`" in text


def test_a_key_without_a_listener_is_named_while_a_daemon_is_there() -> None:
    live, silent = daemon.driving(0).view(0), daemon.driving(0).view(5 * S)
    words = "The daemon accepts no commands on cmd_vel/mine"
    text = drawn(live, key="cmd_vel/mine", heard=False)
    assert words in text
    assert "--set 'command.sources.\"cmd_vel/mine\".priority=10'" in text
    assert "--set 'command.sources.joy.priority=10'" in drawn(live, key="joy", heard=False)
    assert words not in drawn(live, key="cmd_vel/mine", heard=True)
    assert words not in drawn(silent, key="cmd_vel/mine", heard=False)


@pytest.mark.parametrize("width", [80, 40, 20, 10])
def test_it_keeps_within_its_terminal(width: int) -> None:
    for form in forms(daemon.driving(0).view(0)):
        lines = lines_of(form, width, 24)
        assert len(lines) == 24
        assert max(map(len, lines)) <= width


def test_in_a_low_terminal_state_and_answer_stay_and_the_legend_goes() -> None:
    _, low = forms(daemon.driving(0).view(0), answer=("Released.", "green"))
    text = "\n".join(lines_of(low, 80, 10))
    assert "DRIVING" in text
    assert "Released." in text
    assert "emergency stop" not in text
