"""The status, from every stage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from robot_bench import RobotBench
from status_check import assert_registered

from yahboomd.blackbox.box_keeper import BoxKeeper
from yahboomd.core.bus.presence import Neighbour
from yahboomd.core.config import Config
from yahboomd.core.daemon.recorders import Recorders
from yahboomd.core.daemon.status_sample import Status
from yahboomd.core.messages.status_fields import ZEROS
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time


class Bus:
    zid = "abc"
    neighbours = (
        Neighbour(zid="r1", kind="router", address="tcp/127.0.0.1:7447"),
        Neighbour(zid="c1", kind="client"),
    )

    def status_values(self) -> dict[str, int]:
        return {"puts": 3, "put_errors": 0}


OFF = Config.model_validate({"blackbox": {"enabled": False}})


def status(bench: RobotBench) -> Status:
    bus: Any = Bus()
    return Status(
        bench.clock,
        controller=bench.controller,
        intake=bench.intake,
        supervisor=bench.supervisor,
        bus=bus,
        box=BoxKeeper(OFF, bench.clock, {}),
        recorders=Recorders(),
        more_bus_facts=lambda: {"stamps_held_back": 1},
    )


@on_virtual_time
async def test_without_a_board_it_says_what_is_waited_for(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        sample = status(bench).sample()
        assert sample.state == "waiting"
        assert sample.driver is None
        assert sample.board == {}
        assert "No board yet" in sample.why


@on_virtual_time
async def test_every_counter_is_present_from_the_first_status_on(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        sample = msgspec.to_builtins(status(bench).sample())
        sample["bus"]["local_socket"] = ""
        assert_registered(sample, set())


@on_virtual_time
async def test_while_driving_it_names_the_driver_and_every_counter(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        sample = status(bench).sample()
        assert (sample.state, sample.driver) == ("driving", "cmd_vel")
        assert sample.board["port"] == "/dev/simulated"
        assert sample.board["version"] == "1.7.3"
        assert sample.board["lines"] == 11
        assert int(str(sample.link["readings"])) > 50
        assert sample.command["accepted"] == 20
        assert sample.bus == {
            **ZEROS["bus"],
            "zid": "abc",
            "routers": "tcp/127.0.0.1:7447",
            "neighbours": 2,
            "puts": 3,
            "put_errors": 0,
            "stamps_held_back": 1,
        }


class Jittering(LoopClock):
    """Its wall time is read a little later each time, and may be set."""

    ahead_ns = 0

    def wall_ns(self) -> int:
        self.ahead_ns += 37
        return super().wall_ns() + self.ahead_ns


@on_virtual_time
async def test_since_is_constant_while_the_state_lasts_and_follows_a_clock_that_is_set(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        bench.clock = clock = Jittering()
        await bench.ready()
        telling = status(bench)
        samples = []
        for _ in range(20):
            await bench.drive(0.1, 0.3)
            samples.append(telling.sample())
        assert len({each.since_ns for each in samples}) == 1
        assert len({each.driver_since_ns for each in samples}) == 1
        clock.ahead_ns += 7_200_000_000_000
        await bench.drive(0.1, 0.3)
        after = telling.sample()
        assert after.since_ns - samples[0].since_ns == pytest.approx(7.2e12, abs=1e4)


@on_virtual_time
async def test_the_wheels_are_known_by_counts_and_may_turn_where_these_ceased_in_motion(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        telling = status(bench)
        assert telling.sample().wheels is None
        await bench.ready()
        assert telling.sample().wheels == "at_rest"
        await bench.drive(1.0, 0.3)
        assert telling.sample().wheels == "turning"
        bench.robot.unplug(bench.clock.now_ns(), 2.0)
        await bench.until(lambda: bench.controller.state()[0] == "waiting")
        lost = telling.sample()
        assert not bench.standing
        assert lost.wheels == "unknown"
        assert lost.wheels_since_ns == lost.stamp_ns
        assert lost.why.startswith("The wheels may still turn: switch the motors' supply off. ")
        await bench.ready()
        await bench.until(lambda: telling.sample().wheels == "at_rest")
        # At rest a lost board alarms no one.
        bench.robot.unplug(bench.clock.now_ns(), 2.0)
        await bench.until(lambda: bench.controller.state()[0] == "waiting")
        assert telling.sample().wheels == "at_rest"
        assert "may still turn" not in telling.sample().why
