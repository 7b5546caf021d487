"""Whether a daemon obeys, read from its statuses."""

from __future__ import annotations

from typing import Any

import daemon_samples
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.messages.native import StatusSample
from yahboomd.core.messages.status_fields import REFUSALS
from yahboomd.tools.robot.obedience import Obedience


def status(
    state: str = "driving",
    *,
    accepted: int = 0,
    vy_ignored: int = 0,
    limited: int = 0,
    too_tight: int = 0,
    driver: str | None = "cmd_vel",
    why: str = "Why.",
    **refused: int,
) -> StatusSample:
    account = {"accepted": accepted, "vy_ignored": vy_ignored, "refused": refused}
    command: dict[str, Any] = {
        "limited": limited,
        "too_tight": too_tight,
        "sources": {"cmd_vel": account, "other": {}},
    }
    return daemon_samples.status(state, driver=driver, why=why, command=command)


def test_in_a_state_of_a_later_version_nothing_may_drive() -> None:
    words = Obedience("cmd_vel", status("docked")).trouble_before()
    assert "'docked'" in words
    assert words.endswith("Why.")
    assert Obedience("cmd_vel", status()).trouble(status("docked", accepted=9)) == words


def judged(*statuses: StatusSample) -> list[str]:
    """The findings at each status after the first, and after all of them."""
    obedience = Obedience("cmd_vel", statuses[0])
    return [*map(obedience.trouble, statuses[1:]), obedience.trouble_after()]


def test_accepted_commands_are_obeyed() -> None:
    assert judged(status(), status(accepted=10), status(accepted=20)) == ["", "", ""]


@pytest.mark.parametrize("state", ["estopped", "fault", "waiting"])
def test_a_state_without_motion_is_reported_in_the_daemons_words(state: str) -> None:
    stands = status(state, accepted=5, why="Because.")
    assert judged(status(), stands)[0] == "Because."
    assert Obedience("cmd_vel", stands).trouble_before() == "Because."
    assert Obedience("cmd_vel", status()).trouble_before() == ""


def test_a_source_that_is_not_configured_is_named_with_those_that_are() -> None:
    words = Obedience("nav", status()).trouble_before()
    assert "nav" in words
    assert "cmd_vel, other" in words


def test_another_source_in_control_is_named_at_once() -> None:
    taken = status(accepted=3, driver="other", lower_priority=7)
    words = judged(status(accepted=3), taken)[0]
    assert words == "other has control of the robot; cmd_vel does not take it over."


def test_a_refusal_is_reported_with_its_reason() -> None:
    found = judged(status(), status(stale=5), status(stale=9))
    assert found[0] == ""
    assert found[1] == f"The daemon refuses the commands on cmd_vel: {REFUSALS['stale']}."
    # If it was too short for a second status, the end reports it.
    assert judged(status(), status(stale=1))[-1] == found[1]


def test_commands_that_never_arrive_are_reported_at_the_end() -> None:
    found = judged(status(), status(), status())
    assert found[:2] == ["", ""]
    assert "No command arrived" in found[2]


def test_a_command_that_was_limited_is_obeyed_with_a_warning() -> None:
    obedience = Obedience("cmd_vel", status())
    assert obedience.trouble(status(accepted=4, limited=4)) == ""
    assert obedience.trouble_after() == ""
    assert len(obedience.warnings) == 1


facts = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.text(max_size=3),
    lambda each: st.dictionaries(
        st.sampled_from(
            ["sources", "cmd_vel", "accepted", "refused", "stale", "limited", "too_tight"]
        ),
        each,
    ),
)


@given(st.lists(st.dictionaries(st.just("sources"), facts), min_size=1, max_size=4))
def test_whatever_a_status_holds_it_is_judged(commands: list[dict[str, Any]]) -> None:
    judged(*(daemon_samples.status(command=each) for each in commands))
