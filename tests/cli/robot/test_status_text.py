"""A status in words."""

from __future__ import annotations

import daemon_samples

from yahboomd.cli.robot.status_text import text


def test_it_says_state_reason_driver_and_board() -> None:
    assert text(daemon_samples.status(since_s=2.0)).splitlines() == [
        "state    driving for 2.0 s",
        "why      cmd_vel drives.",
        "driver   cmd_vel has control",
        "board    streamed 1.7.3 on /dev/ttyUSB0",
        "lost     nothing",
        "refused  no command",
    ]


def test_losses_and_refusals_are_named_and_counted() -> None:
    status = daemon_samples.status(
        link={"broken_frames": 2, "overlong": 1}, command={"stale": 4, "lower_priority": 1}
    )
    assert text(status).splitlines()[-2:] == ["lost     lost 3", "refused  stale 4 · outranked 1"]


def test_control_characters_of_others_do_not_reach_the_terminal() -> None:
    assert "\x1b" not in text(daemon_samples.status(driver="cmd\x1b[2Jvel", why="a\x1bb"))
