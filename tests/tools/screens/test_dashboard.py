from __future__ import annotations

import daemon_samples as daemon
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.bus import keys
from yahboomd.core.messages.codecs import encode
from yahboomd.tools.screens.dashboard import Dashboard, View

S = 1_000_000_000


def accept(dashboard: Dashboard, key: str, sample: object, now_ns: int) -> None:
    dashboard.accept(key, encode(sample, "json"), now_ns)


@pytest.mark.parametrize("encoding", ["json", "msgpack"])
def test_each_sample_shows_whatever_its_encoding(encoding: str) -> None:
    dashboard = Dashboard()
    for key, payload in daemon.all_samples(encoding).items():
        dashboard.accept(key, payload, 0)
    view = dashboard.view(0)
    assert view.phase == "live"
    assert view.status == daemon.status()
    assert view.pose == daemon.pose()
    assert view.twist == daemon.twist()
    assert view.wheel_rows == (("left", 1000, 0.29, 0.3), ("right", 2000, 0.31, 0.3))
    assert view.volts == 7.4
    assert [event.message for event in view.events] == ["The board reset itself."]
    assert view.unreadable == 0


def test_a_daemon_that_falls_silent_is_noticed_and_its_return_too() -> None:
    dashboard = daemon.driving(0)
    assert dashboard.view(2 * S).phase == "live"
    silent = dashboard.view(2 * S + 1)
    assert silent.phase == "silent"
    assert silent.silent_s == pytest.approx(2.0)
    assert silent.status == daemon.status()
    accept(dashboard, keys.STATUS, daemon.status(), 3 * S)
    assert dashboard.view(3 * S).phase == "live"


def test_a_lost_connection_is_silence_at_once() -> None:
    assert daemon.driving(0).view(1, connected=False).phase == "silent"


def test_poses_that_stay_away_make_the_rest_old() -> None:
    dashboard = daemon.driving(0)
    assert not dashboard.view(S).late
    accept(dashboard, keys.STATUS, daemon.status(), 2 * S)
    view = dashboard.view(2 * S)
    assert view.phase == "live"
    assert view.late


def test_durations_go_on_between_two_statuses() -> None:
    dashboard = Dashboard()
    accept(dashboard, keys.STATUS, daemon.status(since_s=2.0), 10 * S)
    assert dashboard.view(10 * S).state_s == pytest.approx(2.0)
    assert dashboard.view(11 * S).state_s == pytest.approx(3.0)


def test_rates_follow_from_the_daemons_own_counters() -> None:
    dashboard = Dashboard()
    for half in range(4):
        sample = daemon.status(link={"readings": 50 * half}, command={"received": 10 * half})
        accept(dashboard, keys.STATUS, sample, half * S // 2)
        accept(dashboard, keys.POSE, daemon.pose(seq=25 * half), half * S // 2)
    view = dashboard.view(2 * S)
    assert view.readings_per_s == pytest.approx(100.0)
    assert view.commands_per_s == pytest.approx(20.0)
    # Most poses never arrived here.
    assert view.poses_per_s == pytest.approx(50.0)


def test_counters_of_the_past_are_shown_and_only_new_ones_are_news() -> None:
    dashboard = Dashboard()
    old = daemon.status(
        link={"readings": 1, "broken_frames": 3, "polls_unanswered": 2},
        command={"stale": 4},
    )
    accept(dashboard, keys.STATUS, old, 0)
    view = dashboard.view(0)
    assert {each.name: each.total for each in view.link} == {"lost": 3, "missed polls": 2}
    assert {each.name: each.total for each in view.refusals} == {"stale": 4}
    assert not any(each.rising for each in (*view.link, *view.refusals))
    new = daemon.status(
        link={"readings": 1, "broken_frames": 3, "polls_unanswered": 2, "unrecognised": 1},
        command={"stale": 5},
    )
    accept(dashboard, keys.STATUS, new, S)
    view = dashboard.view(S)
    assert {each.name for each in view.link if each.rising} == {"lost"}
    assert {each.name: each.total for each in view.refusals if each.rising} == {"stale": 5}
    assert not any(each.rising for each in dashboard.view(30 * S).link)


def test_a_robot_moves_while_a_wheel_turns_or_is_to_turn() -> None:
    dashboard = daemon.driving(0)
    assert dashboard.view(0).moving
    accept(dashboard, keys.WHEELS, daemon.wheels((0.0, 0.0), (0.0, 0.2)), 0)
    assert dashboard.view(0).moving
    accept(dashboard, keys.WHEELS, daemon.wheels((0.0, 0.0), (0.0, 0.0)), 0)
    assert not dashboard.view(0).moving


SHOWN = sorted(set(daemon.all_samples()) - {keys.IMU})


@given(st.sampled_from(SHOWN), st.binary())
def test_what_cannot_be_read_is_counted_and_changes_nothing(key: str, payload: bytes) -> None:
    dashboard = daemon.driving(0)
    before = dashboard.view(0)
    dashboard.accept(key, payload, 0)
    after = dashboard.view(0)
    assert after.unreadable == 1
    assert (after.status, after.pose, after.twist, after.wheels) == (
        before.status,
        before.pose,
        before.twist,
        before.wheels,
    )


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_numbers_that_cannot_be_drawn_are_not_taken(number: float) -> None:
    dashboard = daemon.driving(0)
    for key, sample in {
        keys.POSE: daemon.pose(x=number),
        keys.TWIST: daemon.twist(vx=number),
        keys.WHEELS: daemon.wheels((number, 0.0)),
    }.items():
        dashboard.accept(key, encode(sample, "msgpack"), 0)
    view = dashboard.view(0)
    assert view.unreadable == 3
    assert (view.pose, view.twist) == (daemon.pose(), daemon.twist())
    assert view.wheels == daemon.wheels()


def test_old_wheels_do_not_move() -> None:
    wheels = daemon.wheels((0.5, 0.5), (0.5, 0.5))
    assert View(phase="live", wheels=wheels).moving
    assert not View(phase="live", wheels=wheels, late=True).moving
