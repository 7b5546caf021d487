"""From bytes on a command key to the arbiter; clocks that are off; poses that arrive as samples."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from robot_bench import RobotBench

from make.schema_files.cdr_samples import pose_message
from yahboomd.core.bus import keys
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.daemon.commands import ClockWatch, CommandIntake, PoseIntake
from yahboomd.core.drive.arbiter import Arbiter
from yahboomd.core.drive.arbitration import AllowedSource
from yahboomd.core.messages.status_fields import REFUSALS
from yahboomd.core.model import Event
from yahboomd.simulation.virtual_time import on_virtual_time

MS = 1_000_000
NONE_REFUSED = dict.fromkeys(REFUSALS, 0)


class Hand:
    """A clock that stands."""

    now = 1_000_000_000

    def now_ns(self) -> int:
        return self.now

    def wall_ns(self) -> int:
        return self.now + 1_700_000_000_000_000_000

    def alarm(self, callback: object) -> object:
        raise NotImplementedError


class Scene:
    def __init__(self, *, holonomic: bool = False) -> None:
        self.clock = Hand()
        self.steps = 0
        self.arbiter = Arbiter([AllowedSource(name="cmd_vel", priority=10)])
        self.intake = CommandIntake(
            self.arbiter,
            self.clock,  # type: ignore[arg-type]
            holonomic=holonomic,
            notice_pause=lambda: None,
            step=self.step,
        )
        self.take = self.intake.handler("cmd_vel")

    def step(self) -> None:
        self.steps += 1

    def arrival(self, payload: bytes, **more: object) -> Arrival:
        return Arrival(
            key="cmd_vel",
            payload=payload,
            stamp_ns=None,
            arrived_ns=self.clock.now,
            **more,  # type: ignore[arg-type]
        )


def test_a_batch_is_offered_whole_before_one_step() -> None:
    scene = Scene()
    scene.take([scene.arrival(b'{"vx": 0.1}'), scene.arrival(b'{"vx": 0.2}')])
    assert scene.steps == 1
    assert scene.arbiter.current(scene.clock.now).twist.vx == 0.2
    assert scene.intake.status_values()["received"] == 2


def test_a_command_is_no_younger_for_a_process_that_is_held_up_between_two_clocks() -> None:
    class HeldUp(Hand):
        def now_ns(self) -> int:
            seen, self.now = self.now, self.now + 400 * MS
            return seen

        def wall_ns(self) -> int:
            seen, self.now = super().wall_ns(), self.now + 400 * MS
            return seen

    clock = HeldUp()
    arbiter = Arbiter(
        [AllowedSource(name="cmd_vel", priority=10, timeout_s=0.3)], stamps="absolute"
    )
    intake = CommandIntake(
        arbiter,
        clock,  # type: ignore[arg-type]
        holonomic=False,
        notice_pause=lambda: None,
        step=lambda: None,
    )
    sent_ns = Hand.wall_ns(clock) - 200 * MS
    command = b'{"vx": 0.5, "stamp_ns": %d}' % sent_ns
    intake.handler("cmd_vel")(
        [Arrival(key="cmd_vel", payload=command, stamp_ns=None, arrived_ns=clock.now)]
    )
    assert intake.counters["refused"] == 1
    assert "stale" in intake.last_refusal


def test_what_was_overrun_is_counted() -> None:
    scene = Scene()
    scene.take([scene.arrival(b'{"vx": 0.1}', dropped=3)])
    facts = scene.intake.status_values()
    assert facts["received"] == 4
    assert facts["overrun"] == 3


def test_commands_that_were_lost_unread_count_as_motion() -> None:
    scene = Scene()
    scene.take([scene.arrival(b'{"vx": 0.0}')])
    assert scene.arbiter.moving_sources(scene.clock.now) == ()
    scene.take([scene.arrival(b'{"vx": 0.0}', dropped=1)])
    assert scene.arbiter.moving_sources(scene.clock.now) == ("cmd_vel",)


@pytest.mark.parametrize(
    ("payload", "oversize"), [(b"{", False), (b'{"vx": "0.3"}', False), (b"", True)]
)
def test_commands_that_cannot_be_read_count_as_motion(payload: bytes, oversize: bool) -> None:
    scene = Scene()
    scene.take([scene.arrival(payload, oversize=oversize)])
    assert scene.arbiter.moving_sources(scene.clock.now) == ("cmd_vel",)


def test_two_hundred_old_commands_at_once_move_nothing() -> None:
    scene = Scene()
    scene.take([scene.arrival(b'{"vx": 0.5}') for _ in range(64)])
    scene.take([scene.arrival(b'{"vx": 0.5}', dropped=72) for _ in range(64)])
    assert scene.arbiter.current(scene.clock.now).twist.is_zero
    assert scene.intake.status_values()["backlog"] > 0


def test_an_oversize_payload_is_refused_and_named() -> None:
    scene = Scene()
    scene.take([scene.arrival(b"", oversize=True)])
    assert scene.intake.status_values()["oversize"] == 1
    assert scene.intake.last_refusal.startswith("cmd_vel: oversize")


@pytest.mark.parametrize(("holonomic", "vy"), [(True, 0.2), (False, 0.0)])
def test_a_sideways_wish_counts_only_where_the_base_can(holonomic: bool, vy: float) -> None:
    scene = Scene(holonomic=holonomic)
    scene.take([scene.arrival(b'{"vx": 0.1, "vy": 0.2}')])
    assert scene.arbiter.current(scene.clock.now).twist.vy == vy
    assert scene.intake.status_values().get("vy_ignored", 0) == (0 if holonomic else 1)


def test_the_label_in_a_payload_is_no_authority() -> None:
    scene = Scene()
    scene.take([scene.arrival(json.dumps({"vx": 0.1, "source": "cmd_vel/teleop"}).encode())])
    assert scene.arbiter.current(scene.clock.now).driver == "cmd_vel"


def test_a_refusal_of_the_arbiter_is_put_into_words() -> None:
    scene = Scene()
    stamp_ns = scene.clock.wall_ns()
    scene.take([scene.arrival(json.dumps({"vx": 0.1, "stamp_ns": stamp_ns}).encode())])
    scene.clock.now += 900 * MS
    scene.take([scene.arrival(json.dumps({"vx": 0.2, "stamp_ns": stamp_ns + 1}).encode())])
    assert "stale" in scene.intake.last_refusal
    assert scene.intake.status_values()["stale"] == 1


def test_every_source_has_its_own_account() -> None:
    scene = Scene()
    teleop = scene.intake.handler("cmd_vel/teleop")
    scene.take([scene.arrival(b'{"vx": 0.1, "vy": 0.2}'), scene.arrival(b"garbage", dropped=2)])
    teleop([scene.arrival(b'{"vx": 0.1}'), scene.arrival(b'{"vx": NaN}')])
    facts = scene.intake.status_values()
    assert facts["sources"] == {
        "cmd_vel": {
            "received": 4,
            "accepted": 1,
            "overrun": 2,
            "vy_ignored": 1,
            "refused": NONE_REFUSED | {"unknown_encoding": 1},
        },
        # No source of that name may drive in this scene.
        "cmd_vel/teleop": {
            "received": 2,
            "accepted": 0,
            "overrun": 0,
            "vy_ignored": 0,
            "refused": NONE_REFUSED | {"unknown_source": 1, "not_finite": 1},
        },
    }
    # In all, every one that came is either accepted, refused or lost.
    assert facts["received"] == facts["accepted"] + facts["refused"] + facts["overrun"]


S = 1_000_000_000


class ClockScene:
    """Warnings as they are set, and the events about them."""

    def __init__(self) -> None:
        self.warnings: dict[str, str] = {}
        self.events: list[Event] = []
        self._watch = ClockWatch(lambda _now_ns: self.warnings, self.events.append)

    def look(self, at_s: int, **warnings: str) -> None:
        self.warnings = warnings
        self._watch.report(at_s * S)


def test_a_clock_that_is_off_is_reported_once_while_it_is() -> None:
    scene = ClockScene()
    for second in range(600):
        scene.look(second, cmd_vel=f"Its clock is {second} s behind.")
    (event,) = scene.events
    assert (event.kind, event.severity) == ("clock_offset", "warning")
    assert event.message == "cmd_vel: Its clock is 0 s behind."
    assert event.data == {"source": "cmd_vel"}


def test_it_is_news_again_after_it_was_right_for_a_minute() -> None:
    scene = ClockScene()
    scene.look(0, cmd_vel="off")
    scene.look(30)
    scene.look(50, cmd_vel="off")
    assert len(scene.events) == 1
    scene.look(120, cmd_vel="off")
    assert len(scene.events) == 2


def test_each_source_has_a_clock_of_its_own() -> None:
    scene = ClockScene()
    scene.look(0, cmd_vel="off")
    scene.look(1, cmd_vel="off", joystick="off")
    assert [event.message for event in scene.events] == ["cmd_vel: off", "joystick: off"]


HALF_TURN = (0.0, 0.0, 1.0, 0.0)
COVARIANCE = [0.0] * 36
COVARIANCE[0], COVARIANCE[35] = 0.25, 0.5


def arrival(payload: bytes) -> Arrival:
    return Arrival(key=keys.ODOMETRY_SET_POSE, payload=payload, stamp_ns=None, arrived_ns=0)


def pose(frame_id: str) -> Arrival:
    return arrival(pose_message(1, frame_id, (1.0, -2.0, 0.0, *HALF_TURN, *COVARIANCE)))


@on_virtual_time
async def test_odometry_goes_on_from_a_ros_pose_in_its_frame(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        intake = PoseIntake(bench.operator, "bot1/odom")
        # However often the bridge delivers it.
        intake.accept([pose("bot1/odom")] * 32)
        count = len(bench.heard.estimates)
        await bench.until(lambda: len(bench.heard.estimates) > count + 2)
        estimate = bench.heard.estimates[-1]
        where = estimate.pose
        assert (where.x, where.y, where.theta) == pytest.approx((1.0, -2.0, 3.14159265), abs=1e-6)
        assert estimate.pose_covariance[0] == pytest.approx(0.25, abs=1e-3)
        assert estimate.pose_covariance[8] == pytest.approx(0.5, abs=1e-3)
        assert bench.controller.counters["poses_refused"] == 0


@on_virtual_time
async def test_a_native_sample_sets_the_pose_as_well(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        sample = b'{"x": 3.0, "y": 4.0, "theta": 0.5}'
        PoseIntake(bench.operator, "odom").accept([arrival(sample)])
        count = len(bench.heard.estimates)
        await bench.until(lambda: len(bench.heard.estimates) > count + 2)
        where = bench.heard.estimates[-1].pose
        assert (where.x, where.y, where.theta) == pytest.approx((3.0, 4.0, 0.5))


@on_virtual_time
async def test_a_pose_in_another_frame_is_refused_counted_and_reported(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        before = bench.heard.estimates[-1].pose
        refused = [pose("map"), pose(""), arrival(b"\0\1\0\0odom"), arrival(b"{}"), arrival(b"")]
        PoseIntake(bench.operator, "odom").accept(refused)
        count = len(bench.heard.estimates)
        await bench.until(lambda: len(bench.heard.estimates) > count + 2)
        assert bench.heard.estimates[-1].pose == before
        assert bench.controller.counters["poses_refused"] == 5
        events = [event for event in bench.heard.events if event.kind == "pose_refused"]
        assert 'its frame is "map", and a pose in "odom" is expected' in events[0].message
        assert "pose_set" not in bench.heard.kinds
