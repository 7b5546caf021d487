"""Events on virtual time; samples: paced, numbered, and only for those who listen."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robot_bench import Heard

from yahboomd.core.daemon.publisher import EVENTS_A_SECOND, Events, Pace, Publisher
from yahboomd.core.daemon.stamps import WallStamps
from yahboomd.core.model import (
    Event,
    EventKind,
    ImuEstimate,
    ImuReading,
    ImuSensor,
    OdometryEstimate,
    Pose2d,
    Twist2d,
)
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.tools.schemas.event_kinds import KINDS


def event(kind: EventKind = "board_reset") -> Event:
    return Event(kind=kind, severity=KINDS[kind].severities[0], message=f"{kind} it is.")


class Gate:
    """The gate, and the samples that passed it."""

    def __init__(self) -> None:
        self.heard = Heard()
        self.counters: Counter[str] = Counter()
        self.events = Events(LoopClock(), self.heard, self.counters)


@on_virtual_time
async def test_a_flood_of_one_kind_keeps_no_other_kind_back() -> None:
    gate = Gate()
    for _ in range(100):
        gate.events.report(event("board_reset"))
    gate.events.report(event("disconnected"))
    assert gate.heard.kinds == ["board_reset"] * EVENTS_A_SECOND + ["disconnected"]
    assert gate.counters == {"events": 6, "events_suppressed": 95}


@on_virtual_time
async def test_after_a_second_a_kind_is_published_again() -> None:
    gate = Gate()
    for _ in range(EVENTS_A_SECOND + 1):
        gate.events.report(event())
    await asyncio.sleep(0.9)
    gate.events.report(event())
    assert len(gate.heard.events) == EVENTS_A_SECOND
    await asyncio.sleep(0.2)
    gate.events.report(event())
    assert len(gate.heard.events) == EVENTS_A_SECOND + 1


@on_virtual_time
async def test_an_event_is_logged_as_grave_as_it_is(caplog: pytest.LogCaptureFixture) -> None:
    gate = Gate()
    with caplog.at_level(logging.INFO):
        for kind in ("connected", "board_reset", "disconnected"):
            gate.events.report(event(kind))
    assert [record.levelname for record in caplog.records] == ["INFO", "WARNING", "ERROR"]
    assert caplog.records[0].getMessage() == "connected it is."
    assert gate.heard.changes == 3


ZERO = (0.0,) * 9
MS = 1_000_000


class Outlet:
    def __init__(self) -> None:
        self.has_subscribers = True
        self.payloads: list[dict[str, Any]] = []

    def put(self, payload: bytes) -> bool:
        self.payloads.append(msgspec.json.decode(payload))
        return True


@pytest.fixture
def outlets() -> dict[str, Outlet]:
    return {}


@pytest.fixture
async def publisher(outlets: dict[str, Outlet]) -> Publisher:
    return Publisher(
        lambda key: outlets.setdefault(key, Outlet()),
        encoding="json",
        stamps=WallStamps(LoopClock(), lambda _event: None),
        period_ns=20 * MS,
        frame_id="odom",
        child_frame_id="base_link",
        motor_names=("left", "right"),
    )


def estimate(stamp_ns: int) -> OdometryEstimate:
    return OdometryEstimate(
        stamp_ns=stamp_ns,
        pose=Pose2d(x=1.0, y=2.0, theta=3.0),
        twist=Twist2d(vx=0.1),
        pose_covariance=ZERO,
        twist_covariance=ZERO,
        motor_ticks=(10, 20),
        motor_position_rad=(0.1, 0.2),
        motor_speed_m_s=(0.3, 0.4),
    )


async def test_pose_and_twist_of_one_reading_share_stamp_and_number(
    publisher: Publisher, outlets: dict[str, Outlet]
) -> None:
    publisher.estimate(estimate(0), (0.3, 0.4))
    pose, twist, wheels = (
        outlets[key].payloads[0] for key in ("yahboomd/pose", "yahboomd/twist", "yahboomd/wheels")
    )
    assert pose["stamp_ns"] == twist["stamp_ns"] == wheels["stamp_ns"]
    assert pose["seq"] == twist["seq"] == wheels["seq"] == 1
    assert (pose["frame_id"], pose["child_frame_id"], twist["frame_id"]) == (
        "odom",
        "base_link",
        "base_link",
    )
    assert wheels["names"] == ["left", "right"]
    assert wheels["command_m_s"] == [0.3, 0.4]


async def test_more_readings_than_wanted_are_left_out(
    publisher: Publisher, outlets: dict[str, Outlet]
) -> None:
    for number in range(100):
        publisher.estimate(estimate(number * 10 * MS), (0.0, 0.0))
    assert len(outlets["yahboomd/pose"].payloads) == 50


async def test_nothing_is_encoded_without_a_subscriber(
    publisher: Publisher, outlets: dict[str, Outlet]
) -> None:
    outlets["yahboomd/pose"].has_subscribers = False
    publisher.estimate(estimate(0), (0.0, 0.0))
    assert outlets["yahboomd/pose"].payloads == []
    assert len(outlets["yahboomd/twist"].payloads) == 1


async def test_battery_and_events_go_out_as_they_happen(
    publisher: Publisher, outlets: dict[str, Outlet]
) -> None:
    publisher.battery(7.4)
    publisher.event(Event(kind="board_reset", severity="warning", message="It reset itself."))
    assert outlets["yahboomd/battery"].payloads[0]["volts"] == 7.4
    assert outlets["yahboomd/events"].payloads[0]["kind"] == "board_reset"


def imu(stamp_ns: int) -> ImuEstimate:
    sensor = ImuSensor(
        name="any",
        gyro_limit_rad_s=8.0,
        gyro_noise_rad_s=0.5,
        acceleration_limit_m_s2=20.0,
        acceleration_noise_m_s2=0.25,
    )
    reading = ImuReading(
        sensor=sensor,
        sent_ns=stamp_ns,
        gyro_rad_s=(0.0, 0.0, 0.5),
        acceleration_m_s2=(0.0, 0.0, 9.75),
    )
    return ImuEstimate(
        reading=reading,
        stamp_ns=stamp_ns,
        bias_rad_s=0.125,
        bias_variance=0.25,
        theta=1.5,
        theta_variance=0.0625,
    )


async def test_samples_of_the_sensor_are_numbered_and_stamped_in_order_beside_the_poses(
    publisher: Publisher, outlets: dict[str, Outlet]
) -> None:
    publisher.estimate(estimate(100 * MS), (0.0, 0.0))
    # Read before the counters, and later twice at the same moment.
    stamps = [publisher.imu(imu(at)) for at in (80 * MS, 120 * MS, 120 * MS)]
    first, second, third = outlets["yahboomd/imu"].payloads
    assert [each["seq"] for each in (first, second, third)] == [1, 2, 3]
    assert [each["stamp_ns"] for each in (first, second, third)] == stamps
    pose_ns = outlets["yahboomd/pose"].payloads[0]["stamp_ns"]
    assert pose_ns - stamps[0] == pytest.approx(20 * MS, abs=MS)
    assert stamps[2] - stamps[1] > 0
    assert (first["gyro_variance"], first["acceleration_variance"]) == (0.25, 0.0625)
    assert (first["theta"], first["gyro_bias_rad_s"]) == (1.5, 0.125)
    assert (first["magnetic_t"], first["frame_id"]) == (None, "imu_link")
    assert publisher.newest("yahboomd/imu").seq == 3


@settings(max_examples=30)
@given(st.lists(st.integers(min_value=1, max_value=40), min_size=50, max_size=200))
def test_the_pace_is_never_exceeded_in_the_long_run(steps: list[int]) -> None:
    pace = Pace(20 * MS)
    now_ns = passed = 0
    for step in steps:
        now_ns += step * MS
        passed += pace.due(now_ns)
    assert passed <= now_ns // (20 * MS) + 2


def test_readings_that_jitter_around_the_beat_all_pass() -> None:
    pace = Pace(20 * MS)
    jitter = (0, 3, -3, 2, -2)
    assert all(pace.due((n * 20 + jitter[n % 5]) * MS) for n in range(100))


async def test_the_newest_sample_is_known_without_any_subscriber(
    publisher: Publisher, outlets: dict[str, Outlet]
) -> None:
    assert publisher.newest("yahboomd/pose") is None
    publisher.estimate(estimate(0), (0.3, 0.4))
    published = outlets["yahboomd/pose"].payloads[-1]
    assert msgspec.json.decode(msgspec.json.encode(publisher.newest("yahboomd/pose"))) == published
    for outlet in outlets.values():
        outlet.has_subscribers = False
    publisher.estimate(estimate(20 * MS), (0.5, 0.6))
    publisher.battery(7.4)
    newest = {
        key: publisher.newest(f"yahboomd/{key}") for key in ("pose", "twist", "wheels", "battery")
    }
    assert newest["pose"].seq == newest["twist"].seq == newest["wheels"].seq == 2
    assert newest["wheels"].command_m_s == (0.5, 0.6)
    assert newest["battery"].volts == 7.4
    assert outlets["yahboomd/pose"].payloads == [published]
