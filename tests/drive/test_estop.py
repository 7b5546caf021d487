from __future__ import annotations

from yahboomd.core.drive.estop import EmergencyStop, Latched


def test_engaging_latches_with_reason_and_author() -> None:
    stop = EmergencyStop()
    assert stop.engage("button", "yahboomd/estop", 5)
    assert stop.engaged
    assert stop.latched == Latched(reason="button", by="yahboomd/estop", since_ns=5)


def test_engaging_again_is_no_news_and_keeps_the_first_reason() -> None:
    stop = EmergencyStop()
    stop.engage("first", "a", 1)
    assert not stop.engage("second", "b", 2)
    assert stop.latched == Latched(reason="first", by="a", since_ns=1)


def test_it_is_not_released_while_anybody_commands_motion() -> None:
    stop = EmergencyStop()
    stop.engage("button", "a", 1)
    refused = stop.release(["cmd_vel"])
    assert not refused.released
    assert "cmd_vel" in refused.message
    assert stop.engaged


def test_it_is_released_without_motion_commands() -> None:
    stop = EmergencyStop()
    stop.engage("button", "a", 1)
    assert stop.release([]).released
    assert not stop.engaged


def test_releasing_what_is_not_engaged_succeeds_and_says_so() -> None:
    released = EmergencyStop().release(["cmd_vel"])
    assert released.released
    assert "not engaged" in released.message


def test_it_survives_a_restart() -> None:
    before = EmergencyStop()
    before.engage("button", "a", 1)
    after = EmergencyStop(before.latched)
    assert after.engaged
    assert after.latched == before.latched
