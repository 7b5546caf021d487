from __future__ import annotations

from typing import Any

import pytest

from yahboomd.client.streams import read_sample
from yahboomd.core.messages.native import ServiceReply
from yahboomd_fleet.fleet_stop import STAND_WITHIN_S, FleetStop

BOTS = ("farm/north/bot1", "farm/north/bot2", "farm/south/bot3")
ONE, TWO, THREE = BOTS


def reply(*, stands: bool | None = True, speed: float | None = 0.0) -> ServiceReply:
    data: dict[str, Any] = {"sent": True, "stands": stands, "fastest_m_s": speed}
    return ServiceReply(success=True, message="Engaged.", data=data)


NOT_SENT = ServiceReply(success=False, message="The port takes no output.\x1b[31m")


@pytest.fixture
def stop() -> FleetStop:
    return FleetStop(BOTS)


def test_it_is_over_when_every_known_robot_acknowledged_and_stands(stop: FleetStop) -> None:
    assert stop.missing == list(BOTS)
    for at, robot in enumerate(BOTS):
        assert not stop.is_over(float(at))
        assert not stop.all_stand
        stop.answered(robot, reply(), at / 10)
    assert stop.is_over(0.2)
    assert stop.all_stand
    assert stop.report() == ["3 of 3 robots acknowledged, the last after 0.20 s; 3 stand."]


def test_a_robot_that_could_not_send_the_stop_has_not_acknowledged(stop: FleetStop) -> None:
    stop.answered(ONE, NOT_SENT, 0.1)
    assert ONE in stop.missing
    assert f"{ONE}: it answered and was not stopped. The port takes no output. [31m" in (
        stop.report()
    )
    stop.answered(ONE, reply(), 0.6)
    assert ONE not in stop.missing
    assert not any(line.startswith(ONE) for line in stop.report())


def test_a_standing_robot_whose_counts_came_after_its_answer_stands(stop: FleetStop) -> None:
    for robot in BOTS:
        stop.answered(robot, reply(stands=None, speed=None), 0.1)
    assert stop.turning(0.2) == list(BOTS)
    assert not stop.is_over(0.2)
    for seq in (1, 2):
        for robot in BOTS:
            stop.measured(robot, seq, (0.0, 0.0))
    assert stop.is_over(0.3)
    assert stop.all_stand


def test_who_did_not_answer_and_who_is_not_reachable_are_named_apart(stop: FleetStop) -> None:
    stop.answered(ONE, reply(), 0.1)
    stop.seen(TWO, present=True)
    assert stop.report() == [
        "1 of 3 robots acknowledged, the last after 0.10 s; 1 stand.",
        f"{TWO}: did not answer, although its daemon is there.",
        f"{THREE}: is not reachable.",
    ]
    assert stop.progress() == f"1 of 3 robots acknowledged. Missing: {TWO}, {THREE}."
    assert not stop.all_stand


def test_wheels_have_three_seconds_to_come_to_rest_and_are_reported_then(stop: FleetStop) -> None:
    for robot in (TWO, THREE):
        stop.answered(robot, reply(), 0.1)
    stop.answered(ONE, reply(stands=False, speed=0.4), 0.1)
    assert stop.turning(0.2) == [ONE]
    assert not stop.is_over(0.2)
    stop.measured(ONE, 7, (0.3, -0.2))
    assert stop.is_over(0.1 + STAND_WITHIN_S)
    assert not stop.all_stand
    assert stop.report()[1:] == [
        f"{ONE}: stopped; its wheels still turned at 0.30 m/s by its latest counts."
    ]


def test_wheels_stand_after_two_readings_in_a_row(stop: FleetStop) -> None:
    for robot in (TWO, THREE):
        stop.answered(robot, reply(), 0.1)
    # Before the acknowledgement readings prove nothing.
    for seq in (1, 2, 3):
        stop.measured(ONE, seq, (0.0, 0.0))
    stop.answered(ONE, reply(stands=False, speed=0.4), 0.1)
    for seq, speed in ((4, 0.0), (4, 0.0), (5, -0.2), (6, 0.01)):
        stop.measured(ONE, seq, (0.0, speed))
        assert stop.turning(0.2) == [ONE], seq
    stop.measured(ONE, 7, (0.0, 0.0))
    assert stop.all_stand
    # The time is that of its first acknowledgement.
    assert stop.report() == ["3 of 3 robots acknowledged, the last after 0.10 s; 3 stand."]


def test_counts_are_waited_for_as_long_and_without_them_nothing_is_claimed(
    stop: FleetStop,
) -> None:
    for robot in BOTS:
        stop.answered(robot, reply(stands=None, speed=None), 0.1)
    assert stop.is_over(0.1 + STAND_WITHIN_S)
    assert not stop.all_stand
    assert f"{ONE}: stopped; no counts show whether its wheels stand." in stop.report()


def test_a_robot_that_left_and_came_again_has_to_acknowledge_again(stop: FleetStop) -> None:
    stop.answered(ONE, reply(), 0.1)
    # Its token is seen after its answer: it has not left.
    assert not stop.seen(ONE, present=True)
    assert ONE not in stop.missing
    assert not stop.seen(ONE, present=False)
    assert ONE in stop.missing
    assert not stop.all_stand
    assert f"{ONE}: left during the stop: whether it stands is unknown." in stop.report()
    assert stop.seen(ONE, present=True)
    assert ONE in stop.missing
    stop.answered(ONE, reply(), 0.9)
    assert ONE not in stop.missing
    assert not stop.seen(ONE, present=True)
    assert ONE not in stop.missing


@pytest.mark.parametrize(
    "payload",
    [
        b'{"success": true, "message": "Engaged."}',
        b'{"success": true, "message": "Engaged.", "data": {"stands": "surely", "mood": [1]}}',
    ],
    ids=["of a daemon that knows less", "of one that knows other things"],
)
def test_an_answer_of_another_version_acknowledges_and_claims_nothing(payload: bytes) -> None:
    stop, answer = FleetStop([ONE]), read_sample(payload, ServiceReply)
    assert answer is not None
    stop.answered(ONE, answer, 0.1)
    assert stop.missing == []
    assert not stop.all_stand
    assert stop.report()[1:] == [f"{ONE}: stopped; no counts show whether its wheels stand."]


def test_a_stop_that_is_asked_for_once_more_has_every_robot_acknowledge_anew(
    stop: FleetStop,
) -> None:
    for robot in BOTS:
        stop.answered(robot, reply(), 0.1)
    assert stop.all_stand
    stop.again()
    assert stop.missing == list(BOTS)
    assert not stop.all_stand
    stop.answered(ONE, reply(), 0.2)
    assert stop.missing == [TWO, THREE]
