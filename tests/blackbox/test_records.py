"""Records are the same after they were written."""

from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.blackbox import records
from yahboomd.blackbox.records import decode, encode
from yahboomd.core.model import Event, Pose2d

ALL = [
    records.Opened(port="/dev/ttyUSB0", byte_ns=86_805),
    records.Received(data=b"$MAll:1,2,3,4#\r\n"),
    records.Written(data=b"$spd:0,0,0,0#"),
    records.Identified(dialect="streamed", settings={"version": "1.7.3", "pid": [0.8, 0.06, 0.5]}),
    records.Identified(dialect="polled", settings=None),
    records.Closed(),
    records.ReadingRecord(received_ns=7),
    records.ReadingRecord(received_ns=7, requested_ns=5, earliest_ns=3, after_reset=True),
    records.ReadingRecord(received_ns=7, after_gap=True, unbroken=True),
    records.Renewal(period_ns=10_000_000, each_line=True, age_ns=3),
    records.Renewal(period_ns=None, each_line=False, age_ns=0),
    records.Armed(),
    records.Posed(stamp_ns=7, pose=Pose2d(x=0.1, y=-2.0, theta=7.0)),
    records.PoseSet(pose=Pose2d(x=0.1, y=-0.2, theta=7.5)),
    records.PoseSet(pose=Pose2d(), covariance=(0.1, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.3)),
    records.SteerRecord(curvature_per_m=0.1 + 0.2),
    records.Anchor(port="/dev/ttyUSB0", byte_ns=86_805, dialect="", state=b"\x80"),
    records.CommandRecord(source="cmd_vel", vx=0.5, vy=-0.25, wz=2.0),
    records.CommandRecord(source="front/cmd_vel", vx=0.0, vy=0.0, wz=0.0, refused="stale"),
    records.DecisionRecord(state="idle", driver="", why="No command for 0.5 s."),
    records.Happened(event=Event(kind="estop", severity="warning", message="", data={"n": 1.5})),
    records.WallClock(wall_ns=1_700_000_000_000_000_000),
    records.Lost(what="commands", count=1000),
    records.Ended(reasons=("crash",), error="RuntimeError: the task control ended by itself"),
]


@pytest.mark.parametrize("meaning", ALL, ids=lambda each: type(each).__name__)
def test_a_record_is_read_as_it_was_written(meaning: records.Meaning) -> None:
    kind, payload = encode(meaning)
    assert decode(kind, payload) == meaning
    assert 0 < kind < 256
    assert kind not in (records.BASE, records.REPEATED)


def test_every_kind_of_record_is_tried_here() -> None:
    assert {type(each) for each in ALL} == set(records.Meaning.__args__)


def test_numbers_of_a_command_have_seven_digits() -> None:
    kind, payload = encode(records.CommandRecord(source="cmd_vel", vx=0.123456789, vy=0.0, wz=0.0))
    found = decode(kind, payload)
    assert isinstance(found, records.CommandRecord)
    assert found.vx == pytest.approx(0.123456789, rel=1e-7)


@given(kind=st.integers(0, 255), payload=st.binary(max_size=60))
def test_no_bytes_whatever_raise(kind: int, payload: bytes) -> None:
    found = decode(kind, payload)
    assert found is None or isinstance(found, msgspec.Struct)


@pytest.mark.parametrize("number", [3.5e38, -1e39, 1e308, math.inf, math.nan])
def test_a_number_beyond_single_precision_is_recorded_all_the_same(number: float) -> None:
    kind, payload = encode(
        records.CommandRecord(source="cmd_vel", vx=number, vy=0.0, wz=-number, refused="x")
    )
    found = decode(kind, payload)
    assert isinstance(found, records.CommandRecord)
    assert not math.isfinite(found.vx)
    assert not math.isfinite(found.wz)
    assert found.refused == "x"
