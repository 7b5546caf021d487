"""A recorder writes some things, and leaves others out."""

from __future__ import annotations

import pytest

from yahboomd.blackbox import records
from yahboomd.blackbox.box_file import read_box
from yahboomd.blackbox.recorder import COMMANDS_A_SECOND, Recorder
from yahboomd.core.model import EncoderReading, Event, Twist2d

SECOND_NS = 1_000_000_000


class Rig:
    """A recorder on a clock that a test sets."""

    def __init__(self, memory, segments=4):
        self.buffer, ring = memory(segments)
        self.now_ns = 10 * SECOND_NS
        self.recorder = Recorder(ring, lambda: self.now_ns, lambda: self.now_ns + 7)
        self.recorder.odometer_state = lambda: b"state"

    @property
    def records(self):
        return read_box(bytes(self.buffer)).records

    def of(self, kind):
        return [each.meaning for each in self.records if isinstance(each.meaning, kind)]


@pytest.fixture
def rig(memory):
    return Rig(memory)


def connect(recorder):
    recorder.opened("/dev/ttyUSB0", 86_805)
    recorder.identified("streamed", {"version": "1.7.3"})


def test_every_segment_has_an_anchor_with_what_belongs_to_it(rig):
    connect(rig.recorder)
    rig.recorder.decision("driving", "cmd_vel", "cmd_vel drives.")
    for number in range(2000):
        rig.now_ns += 10_000_000
        rig.recorder.received(b"$MAll:%d,2,3,4#\r\n" % number, rig.now_ns)
        if rig.recorder.due:
            rig.recorder.settled()
    kinds = [type(each.meaning).__name__ for each in rig.records]
    anchors = rig.of(records.Anchor)
    assert len(anchors) in (3, 4)
    assert set(anchors) == {
        records.Anchor(port="/dev/ttyUSB0", byte_ns=86_805, dialect="streamed", state=b"state")
    }
    # The ring has gone round: who drives is known all the same.
    assert kinds.index("Anchor") < 5
    assert rig.of(records.DecisionRecord)[0].driver == "cmd_vel"
    assert rig.of(records.WallClock)[0].wall_ns - 7 in [each.at_ns for each in rig.records]


def test_an_anchor_waits_until_a_board_is_connected(rig):
    rig.recorder.record(records.Armed())
    assert not rig.recorder.due
    rig.recorder.opened("/dev/ttyUSB0", 86_805)
    (anchor,) = rig.of(records.Anchor)
    assert (anchor.port, anchor.dialect) == ("/dev/ttyUSB0", "")
    rig.recorder.identified("polled", None)
    rig.recorder.closed()
    assert not rig.recorder.due
    kinds = [type(each.meaning).__name__ for each in rig.records]
    assert kinds[-4:] == ["Anchor", "Opened", "Identified", "Closed"]


def test_what_the_bytes_of_a_reading_do_not_show_is_recorded(rig):
    asked = EncoderReading(
        ticks=(1, 2, 3, 4), received_ns=9, sent_ns=8, requested_ns=5, earliest_ns=4, after_gap=True
    )
    rig.recorder.noted(asked)
    assert rig.of(records.ReadingRecord) == [
        records.ReadingRecord(received_ns=9, requested_ns=5, earliest_ns=4, after_gap=True)
    ]


def test_a_flood_of_commands_is_counted_and_leaves_the_rest_in_the_ring(rig):
    rig.recorder.decision("driving", "cmd_vel", "cmd_vel drives.")
    for second in range(5):
        rig.now_ns = (20 + second) * SECOND_NS
        for _ in range(10_000):
            rig.recorder.command("cmd_vel", Twist2d(vx=0.5), "backlog")
    assert len(rig.of(records.CommandRecord)) <= 5 * COMMANDS_A_SECOND
    assert rig.of(records.Lost)[-1] == records.Lost(
        what="commands", count=10_000 - COMMANDS_A_SECOND
    )


def test_a_decision_is_recorded_when_it_changes(rig):
    for why in ("No command yet.", "No command yet.", "The emergency stop is engaged."):
        rig.recorder.decision("standing", "", why)
    assert [each.why for each in rig.of(records.DecisionRecord)] == [
        "No command yet.",
        "The emergency stop is engaged.",
    ]


def test_events_poses_and_steering_are_recorded_as_they_are(rig):
    event = Event(kind="clock_stepped", severity="info", message="by 2 s", data={"by_s": 2.0})
    rig.recorder.event(event)
    rig.recorder.steered(0.75, rig.now_ns - 5)
    rig.recorder.renewal(None, each_line=False, age_ns=0)
    assert rig.of(records.Happened) == [records.Happened(event=event)]
    # Moments by the wall clock change with it.
    assert rig.of(records.WallClock)
    (steered,) = [each for each in rig.records if isinstance(each.meaning, records.SteerRecord)]
    assert (steered.at_ns, steered.meaning.curvature_per_m) == (rig.now_ns - 5, 0.75)
