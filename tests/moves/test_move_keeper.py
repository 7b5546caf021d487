"""Who may have moves driven, and every end of them."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import daemon_samples
import msgspec
import pytest
from move_bench import MoveBench

from make.schema_files.samples import NATIVE
from yahboomd.client.move_messages import SOURCE, Move, MoveRequest, MoveSample
from yahboomd.core.config import read
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import (
    ImuSample,
    ServiceReply,
    TwistSample,
    VelocityCommand,
    pose_sample,
)
from yahboomd.core.model import Twist2d
from yahboomd.moves.move_keeper import MoveKeeper
from yahboomd.simulation.virtual_time import on_virtual_time

STEP_NS = 20_000_000
EPOCH_NS = 1_700_000_000_000_000_000
STRAIGHT = MoveRequest(moves=(Move(kind="straight", distance_m=1.0),), by="a test", holder="me")


def config(*overrides: str) -> dict[str, Any]:
    return read(None, environ={}, overrides=list(overrides)).config.resolved().as_data()


class Kept:
    """A keeper with a daemon and a base that obeys at once."""

    def __init__(self) -> None:
        self.commands: list[Twist2d] = []
        self.stops = 0
        self.stopped_as = ""
        self.samples: list[MoveSample] = []
        self.now_ns = 1_000_000_000
        self.x = 0.0
        self.beats = True
        self.keeper = MoveKeeper(
            drive=self.commands.append,
            stop=self._stop,
            publish=self.samples.append,
            name=lambda: "id1",
        )
        self.keeper.learn(config())
        self.keeper.status(daemon_samples.status("standing", driver=None, why="At rest."), 0)
        self.pose()

    def _stop(self, label: str) -> None:
        self.stops += 1
        self.stopped_as = label

    def pose(self, **fields: Any) -> None:
        sample = daemon_samples.pose(self.x, 0.0, 0.0, seq=1)
        self.keeper.pose(msgspec.structs.replace(sample, **fields), self.now_ns)

    def start(self, request: MoveRequest = STRAIGHT) -> ServiceReply:
        return self.keeper.start(request, self.now_ns)

    def run(self, for_s: float) -> None:
        for _ in range(round(for_s * 1e9 / STEP_NS)):
            self.now_ns += STEP_NS
            if self.beats:
                self.keeper.beat("id1", self.now_ns)
            if self.samples and self.samples[-1].state != "ended" and self.commands:
                self.x += self.commands[-1].vx * STEP_NS / 1e9
            self.pose()

    @property
    def reason(self) -> str:
        return self.samples[-1].reason if self.samples else ""


@pytest.fixture
def kept() -> Kept:
    return Kept()


def driving(kept: Kept) -> Kept:
    assert kept.start().success
    kept.run(1.0)
    assert kept.commands[-1].vx > 0.1
    assert kept.stops == 0
    return kept


def test_a_move_is_driven_to_its_end(kept: Kept) -> None:
    reply = kept.start()
    assert reply.success
    assert reply.data["id"] == "id1"
    assert reply.data["seconds"] == pytest.approx(4.0, abs=0.1)
    kept.run(8.0)
    assert kept.x == pytest.approx(1.0, abs=0.002)
    end = kept.samples[-1]
    assert (end.state, end.reason, end.done, end.by) == ("ended", "reached", 1.0, "a test")
    assert kept.stops == 1
    assert [sample.state for sample in kept.samples].count("ended") == 1


# Refused.


@pytest.mark.parametrize(
    ("state", "driver", "words"),
    [
        ("estopped", None, "cannot drive. Pressed."),
        ("fault", None, "cannot drive. Pressed."),
        ("waiting", None, "cannot drive. Pressed."),
        ("driving", "cmd_vel/teleop", "cmd_vel/teleop drives the robot"),
        ("some later state", None, "cannot drive"),
    ],
)
def test_what_forbids_motion_refuses_moves(
    kept: Kept, state: str, driver: str | None, words: str
) -> None:
    kept.keeper.status(daemon_samples.status(state, driver=driver, why="Pressed."), kept.now_ns)
    reply = kept.start()
    assert not reply.success
    assert words in reply.message
    assert kept.commands == []


def test_a_second_client_is_refused_while_moves_are_driven(kept: Kept) -> None:
    driving(kept)
    reply = kept.start()
    assert not reply.success
    assert "Moves id1 of a test are being driven" in reply.message


def test_where_the_sources_were_replaced_the_answer_has_the_lines_to_paste(kept: Kept) -> None:
    sources = 'command.sources={"cmd_vel" = {priority = 10}}'
    kept.keeper.learn(config(sources))
    reply = kept.start()
    assert not reply.success
    lines = reply.message.partition("\n")[2]
    pasted = config(sources.replace("}}", '}, "cmd_vel/moves" = {priority = 5, timeout_s = 0.3}}'))
    assert lines == f'[command.sources."{SOURCE}"]\npriority = 5\ntimeout_s = 0.3\n'
    kept.keeper.learn(pasted)
    assert kept.start().success


def test_without_a_daemon_or_poses_moves_are_refused(kept: Kept) -> None:
    kept.now_ns += 600_000_000
    assert "No poses" in kept.start().message
    kept.keeper.lost()
    assert "No daemon" in kept.start().message


@pytest.mark.parametrize("config_", [{}, {"chassis": 3}, {"chassis": {}, "limits": {}}])
def test_a_configuration_of_another_version_refuses_moves(kept: Kept, config_: Any) -> None:
    kept.keeper.learn(config_)
    assert "another version" in kept.start().message


def test_what_the_base_cannot_do_is_refused_in_words(kept: Kept) -> None:
    reply = kept.start(MoveRequest(moves=(Move(kind="straight", left_m=1.0),)))
    assert "mecanum" in reply.message
    reply = kept.start(MoveRequest(moves=(Move(kind="straight", speed_m_s=math.nan),)))
    assert "not finite" in reply.message


# Ended.


def test_a_client_that_falls_silent_ends_its_moves_after_half_a_second(kept: Kept) -> None:
    driving(kept)
    kept.beats = False
    kept.run(0.5)
    assert kept.stops == 0
    kept.run(0.06)
    assert kept.reason == "client_silent"
    assert kept.stops == 1
    count = len(kept.commands)
    # It comes back: nothing begins again.
    kept.beats = True
    kept.run(1.0)
    assert len(kept.commands) == count


def test_the_beats_of_another_client_do_not_count(kept: Kept) -> None:
    driving(kept)
    kept.beats = False
    for _ in range(40):
        kept.keeper.beat("id2", kept.now_ns)
        kept.run(0.02)
    assert kept.reason == "client_silent"


def test_a_token_that_goes_ends_them_at_once(kept: Kept) -> None:
    driving(kept)
    kept.keeper.holder("other", present=True)
    kept.keeper.holder("me", present=True)
    kept.keeper.holder("other", present=False)
    assert kept.stops == 0
    kept.keeper.holder("me", present=False)
    assert kept.reason == "client_gone"
    assert kept.stopped_as == "moves of a test: client_gone"


@pytest.mark.parametrize(
    ("state", "driver", "reason"),
    [
        ("estopped", None, "estop"),
        ("fault", None, "fault"),
        ("waiting", None, "board_lost"),
        ("driving", "cmd_vel/teleop", "taken_over"),
        ("driving", "cmd_vel/web", "taken_over"),
    ],
)
def test_whatever_has_a_say_ends_them(
    kept: Kept, state: str, driver: str | None, reason: str
) -> None:
    driving(kept)
    kept.keeper.status(daemon_samples.status(state, driver=driver, why="Why."), kept.now_ns)
    assert kept.reason == reason
    assert kept.stops == 1
    kept.keeper.status(daemon_samples.status("standing", driver=None, why=""), kept.now_ns)
    count = len(kept.commands)
    kept.run(1.0)
    assert len(kept.commands) == count


def test_a_daemon_that_does_not_drive_for_them_ends_them(kept: Kept) -> None:
    driving(kept)
    status = daemon_samples.status("standing", driver=None, why="The battery is empty.")
    kept.keeper.status(status, kept.now_ns)
    assert kept.reason == "", "it may not have heard of them yet"
    kept.run(1.0)
    kept.keeper.status(status, kept.now_ns)
    assert kept.reason == "not_obeyed"
    assert "The battery is empty." in kept.samples[-1].message


@pytest.mark.parametrize("kind", ["pose_set", "odometry_bridged", "board_reset"])
def test_a_pose_that_was_set_or_bridged_ends_them(kept: Kept, kind: str) -> None:
    driving(kept)
    event = msgspec.structs.replace(daemon_samples.event("The pose was set."), kind=kind)
    kept.keeper.event(event)
    assert kept.reason == "pose_changed"
    assert "The pose was set." in kept.samples[-1].message


def test_other_events_do_not(kept: Kept) -> None:
    driving(kept)
    kept.keeper.event(msgspec.structs.replace(daemon_samples.event("Low."), kind="battery_low"))
    assert kept.reason == ""


def test_poses_that_stay_away_end_them_and_so_does_a_service_that_did_not_run(kept: Kept) -> None:
    driving(kept)
    kept.now_ns += 510_000_000
    kept.keeper.beat("id1", kept.now_ns)
    kept.keeper.check(kept.now_ns)
    assert kept.reason == "no_pose"

    other = driving(Kept())
    other.now_ns += 510_000_000
    other.keeper.beat("id1", other.now_ns)
    count = len(other.commands)
    other.pose()
    assert other.reason == "no_pose"
    assert len(other.commands) == count


def test_a_lost_daemon_ends_them(kept: Kept) -> None:
    driving(kept)
    kept.keeper.lost()
    assert kept.reason == "daemon_lost"


def test_wheels_that_turn_while_the_gyro_does_not_end_them(kept: Kept) -> None:
    driving(kept)
    twist = TwistSample(
        stamp_ns=0, seq=1, frame_id="base_link", vx=0.0, vy=0.0, wz=1.0, covariance=(0.0,) * 9
    )
    kept.keeper.twist(twist)
    gyro = NATIVE["ImuSample"]
    still = msgspec.structs.replace(gyro, gyro_rad_s=(0.0, 0.0, 0.01), gyro_bias_rad_s=0.01)
    assert isinstance(still, ImuSample)
    for step in range(50):
        kept.keeper.imu(still, kept.now_ns + step * STEP_NS)
    assert kept.reason == "slipping"


def test_a_place_that_becomes_uncertain_ends_them(kept: Kept) -> None:
    assert kept.start(msgspec.structs.replace(STRAIGHT, uncertain_m=0.1)).success
    kept.run(0.5)
    kept.now_ns += STEP_NS
    kept.pose(covariance=(0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert kept.reason == "uncertain"


def test_the_end_of_the_service_ends_them(kept: Kept) -> None:
    driving(kept)
    kept.keeper.end("service_ended", "Stopped.")
    assert kept.reason == "service_ended"
    assert kept.stops == 1
    kept.keeper.end("service_ended", "Stopped.")
    assert kept.stops == 1


# Chosen.


def choose(kept: Kept) -> Callable[..., ServiceReply]:
    return kept.keeper.choose


def test_cancel_ends_them_by_id_or_without_one(kept: Kept) -> None:
    driving(kept)
    assert not choose(kept)("cancel", "id7").success
    assert kept.reason == ""
    assert choose(kept)("cancel", "id1").success
    assert kept.reason == "cancelled"
    assert choose(kept)("cancel", None).message == "No moves are being driven."


def test_paused_moves_stand_still_need_their_client_and_go_on(kept: Kept) -> None:
    driving(kept)
    assert choose(kept)("pause", None).success
    assert kept.samples[-1].state == "paused"
    kept.run(2.0)
    assert kept.commands[-1].is_zero
    assert choose(kept)("resume", None).success
    kept.run(8.0)
    assert kept.reason == "reached"
    assert kept.x == pytest.approx(1.0, abs=0.003)

    held = driving(Kept())
    choose(held)("pause", None)
    held.beats = False
    held.run(0.6)
    assert held.reason == "client_silent"


def test_progress_is_published_while_they_are_driven(kept: Kept) -> None:
    driving(kept)
    kept.keeper.report()
    sample = kept.samples[-1]
    assert (sample.id, sample.kind, sample.index, sample.count) == ("id1", "straight", 0, 1)
    assert sample.left_m == pytest.approx(1.0 - kept.x, abs=0.01)
    assert 0.0 < sample.done < 0.5
    assert sample.left_s > 2.0
    kept.keeper.end("cancelled", "")
    count = len(kept.samples)
    kept.keeper.report()
    assert len(kept.samples) == count


# From outside.


def test_after_a_long_pause_the_daemon_has_time_to_drive_again(kept: Kept) -> None:
    driving(kept)
    choose(kept)("pause", None)
    kept.run(3.0)
    standing = daemon_samples.status("standing", driver=None, why="At rest.")
    kept.keeper.status(standing, kept.now_ns)
    choose(kept)("resume", None)
    kept.run(0.2)
    kept.keeper.status(standing, kept.now_ns)
    assert kept.reason == ""
    kept.run(2.0)
    kept.keeper.status(standing, kept.now_ns)
    assert kept.reason == "not_obeyed"


@pytest.mark.parametrize(
    "request_",
    [
        MoveRequest(moves=(Move(kind="straight", distance_m=1.0),), uncertain_m=math.nan),
        MoveRequest(moves=(Move(kind="straight", distance_m=1.0, speed_m_s=5e-324),)),
        MoveRequest(moves=(Move(kind="go_to", x=1.0, y=0.3, look_ahead_m=1e-300),)),
        MoveRequest(moves=(Move(kind="turn", angle_rad=1.0, jerk_rad_s3=5e-324),)),
        MoveRequest(moves=(Move(kind="arc", radius_m=5e-324, angle_rad=1.0),)),
        MoveRequest(moves=(Move(kind="go_to", x=math.inf, y=0.0),)),
        MoveRequest(moves=(Move(kind="follow", points=((0.0, 1.0), (math.nan, 2.0))),)),
    ],
    ids=repr,
)
def test_numbers_that_no_base_can_drive_are_refused(kept: Kept, request_: MoveRequest) -> None:
    assert not kept.start(request_).success
    kept.run(0.5)
    assert kept.commands == []


def test_of_two_clients_at_once_one_is_refused_and_neither_ends_the_other(kept: Kept) -> None:
    assert kept.start().success
    other = msgspec.structs.replace(STRAIGHT, by="another", holder="other")
    assert all(not kept.start(other).success for _ in range(100))
    kept.keeper.holder("other", present=False)
    kept.run(8.0)
    assert kept.reason == "reached"
    assert [sample.state for sample in kept.samples].count("ended") == 1
    assert kept.start(other).success


def test_no_order_of_choices_has_it_drive_after_its_end(kept: Kept) -> None:
    chance = Random(1)
    for _ in range(25):
        kept.x = 0.0
        kept.pose()
        assert kept.start().success
        kept.run(0.1)
        for verb in chance.choices(("pause", "resume"), k=chance.randrange(6)):
            choose(kept)(verb, chance.choice(("id1", "id2", None)))
        kept.run(chance.uniform(0.0, 0.4))
        choose(kept)("cancel", "id1")
        count = len(kept.commands)
        for verb in ("resume", "pause", "resume", "cancel"):
            assert not choose(kept)(verb, "id1").success
        kept.run(0.3)
        assert len(kept.commands) == count
        assert kept.reason == "cancelled"


# Every way to lose the client, judged by the wheels.


class Lossy(MoveBench):
    """A simulated robot and a keeper, both of which may lose what they depend on.

    Attributes:
        steps: Hours by which the wall clocks of the service and the daemon step.
        steps_s: When.
        way_m: The way ahead, before the turn.
    """

    steps = (0.0, 0.0)
    steps_s = math.inf
    way_m = 0.9

    async def lose(self, loss: str, after_s: float) -> float:
        """Drive, lose something, and return after how many seconds the wheels truly stand."""
        off_ns = 0

        def drive(twist: Twist2d) -> None:
            stamp_ns = self.clock.now_ns() + off_ns + EPOCH_NS
            command = VelocityCommand(vx=twist.vx, vy=twist.vy, wz=twist.wz, stamp_ns=stamp_ns)
            self.payload(encode(command, "json"), source=SOURCE)

        keeper = MoveKeeper(
            drive=drive,
            stop=lambda _: self.command(source=SOURCE),
            publish=lambda _: None,
            name=lambda: "id1",
        )
        keeper.learn(self.config.resolved().as_data())
        keeper.status(daemon_samples.status("standing", driver=None, why=""), 0)
        begun_ns, lost_ns = self.clock.now_ns(), 0
        moves = (Move(kind="straight", distance_m=self.way_m), Move(kind="turn", angle_rad=9.0))
        asked = False
        while True:
            now_ns = self.clock.now_ns()
            since_s = (now_ns - begun_ns) / 1e9
            if not off_ns and since_s >= self.steps_s:
                off_ns, daemons_ns = (round(hours * 3600e9) for hours in self.steps)
                self.clock._epoch_ns += daemons_ns
                self.steps_s = math.inf
            if not lost_ns and since_s >= after_s:
                lost_ns = now_ns
                assert not self.standing, "it was not in mid-move"
                if loss == "token":
                    keeper.holder("me", present=False)
                if loss == "cancel":
                    keeper.choose("cancel", None)
            lost = bool(lost_ns)
            if not (lost and loss == "client") and round(since_s / 0.02) % 5 == 0:
                keeper.beat("id1", now_ns)
            if not (lost and loss == "service"):
                estimate = self.heard.estimates[-1]
                sample = pose_sample(
                    estimate, stamp_ns=0, seq=1, frame_id="odom", child_frame_id="base_link"
                )
                keeper.pose(sample, now_ns)
                if not asked:
                    asked = keeper.start(
                        MoveRequest(moves=moves, holder="me", by=None), now_ns
                    ).success
                    assert asked
            if lost and self.standing:
                return (self.clock.now_ns() - lost_ns) / 1e9
            assert since_s < after_s + 3.0, "it drives on"
            await asyncio.sleep(0.02)


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("loss", "most_s"), [("client", 1.3), ("token", 0.8), ("cancel", 0.8), ("service", 1.1)]
)
@pytest.mark.parametrize("after_s", [1.0, 5.0])
@on_virtual_time
async def test_a_robot_stands_soon_after_its_client_is_lost(
    tmp_path: Path, loss: str, most_s: float, after_s: float
) -> None:
    """In the middle of a way, and of a turn."""
    async with Lossy(tmp_path) as bench:
        await bench.ready()
        await asyncio.sleep(0.3)
        assert await bench.lose(loss, after_s) < most_s


@pytest.mark.cases(2)
@pytest.mark.parametrize("hours", [-9.0, -0.00007, 0.0001, 9.0])
@pytest.mark.parametrize("whose", [(1, 0), (0, 1), (1, 1)])
@on_virtual_time
async def test_wall_clocks_that_step_in_mid_move_neither_end_it_nor_keep_it_alive(
    tmp_path: Path, whose: tuple[int, int], hours: float
) -> None:
    """By hours, and by a quarter of a second and 0.4 s: monotonic time alone judges beats."""
    async with Lossy(tmp_path) as bench:
        await bench.ready()
        await asyncio.sleep(0.3)
        bench.way_m = 3.0
        bench.steps, bench.steps_s = (whose[0] * hours, whose[1] * hours), 0.7
        # The client is there for 1.3 s more; at its loss the wheels still turn.
        assert await bench.lose("client", 2.0) < 1.3
