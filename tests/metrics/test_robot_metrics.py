"""A status as metrics; the page of all robots."""

from __future__ import annotations

from typing import Any

import daemon_samples
import msgspec
import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from yahboomd.client.streams import read_sample
from yahboomd.core.messages.native import StatusSample
from yahboomd.core.messages.status_fields import FIELDS
from yahboomd.tools.metrics.exposition import Exposition
from yahboomd.tools.metrics.robot_metrics import (
    FRESH_NS,
    MAX_SERIES,
    PAGE_KEPT_NS,
    Page,
    RobotFacts,
    add_robot,
    metric_name,
)

Series = dict[tuple[str, tuple[tuple[str, str], ...]], float]


def series(*robots: RobotFacts) -> Series:
    """Every series as the official parser reads it, without the robot's label."""
    exposition = Exposition()
    for robot in robots:
        add_robot(exposition, robot)
    return {
        (sample.name, tuple((k, v) for k, v in sample.labels.items() if k != "robot")): sample.value
        for family in text_string_to_metric_families(exposition.text(openmetrics=True))
        for sample in family.samples
    }


def facts(status: StatusSample | None = None, **more: Any) -> RobotFacts:
    return RobotFacts(name="bot1", status=status or daemon_samples.status(), **more)


def filled() -> StatusSample:
    """A status that has every field, each with a number of its own."""
    groups: dict[str, dict[str, Any]] = {}
    for number, field in enumerate(FIELDS, start=1):
        value: Any = f"text {number}" if field.kind == "text" else number
        if field.per:
            value = {"backlog" if field.per == "reason" else "cmd_vel": value}
        groups.setdefault(field.group, {})[field.name] = value
    groups["command"]["sources"] = {"cmd_vel": groups.pop("sources")}
    status = daemon_samples.status()
    return msgspec.structs.replace(status, **groups)


def test_every_number_of_the_status_is_a_metric_with_its_value() -> None:
    found = series(facts(filled()))
    for number, field in enumerate(FIELDS, start=1):
        if field.kind == "text":
            continue
        name = metric_name(field) + ("_total" if field.kind == "counter" else "")
        matching = [value for (each, _), value in found.items() if each == name]
        factor = {"ns": 1e-9, "mm": 1e-3}.get(field.unit, 1)
        assert pytest.approx(number * factor) in matching, name
    assert found["yahboomd_unknown_status_fields", ()] == 0


def test_names_end_with_base_units() -> None:
    names = {field.name: metric_name(field) for field in FIELDS}
    assert names["board_tick_ns"] == "yahboomd_command_board_tick_seconds"
    assert names["wheel_diameter_mm"] == "yahboomd_board_wheel_diameter_meters"
    assert names["clock_offset_s"] == "yahboomd_command_clock_offset_seconds"
    assert names["volts"] == "yahboomd_board_volts"
    assert names["discarded_bytes"] == "yahboomd_link_discarded_bytes"
    named = [metric_name(field) for field in FIELDS if field.kind != "text"]
    assert len(set(named)) == len(named)


@pytest.mark.parametrize("version", ["first", "newer"])
def test_a_daemon_of_another_version_has_its_metrics(version: str) -> None:
    status = read_sample(daemon_samples.of_version(version)["yahboomd/status"], StatusSample)
    found = series(facts(status))
    assert found["yahboomd_up", ()] == 1
    states = [labels for (name, labels), on in found.items() if name == "yahboomd_state" and on]
    assert states == [(("state", "docked" if version == "newer" else "driving"),)]


def test_the_state_is_one_of_six_and_the_emergency_stop_has_its_own() -> None:
    found = series(facts(daemon_samples.status("estopped", driver=None)))
    states = {labels: value for (name, labels), value in found.items() if name == "yahboomd_state"}
    assert len(states) == 6
    assert [labels for labels, value in states.items() if value] == [(("state", "estopped"),)]
    assert found["yahboomd_estop_engaged", ()] == 1
    assert series(facts())["yahboomd_estop_engaged", ()] == 0


def test_a_source_has_its_account_and_every_reason_of_a_refusal() -> None:
    command = {
        "sources": {
            "cmd_vel": {"received": 9, "accepted": 7, "refused": {"stale": 2, "backlog": 0}}
        }
    }
    found = series(facts(daemon_samples.status(command=command, driver="cmd_vel/teleop")))
    source = ("source", "cmd_vel")
    assert found["yahboomd_source_received_total", (source,)] == 9
    assert found["yahboomd_source_refused_total", (source, ("reason", "stale"))] == 2
    assert found["yahboomd_source_refused_total", (source, ("reason", "backlog"))] == 0
    assert found["yahboomd_source_in_control", (source,)] == 0
    assert found["yahboomd_source_in_control", (("source", "cmd_vel/teleop"),)] == 1


def test_a_dead_daemon_leaves_no_number_that_looks_alive() -> None:
    dead = RobotFacts(
        name="bot1",
        status_age_s=12.5,
        twist=daemon_samples.twist(),
        wheels=daemon_samples.wheels(),
        events={("fault", "error"): 1},
    )
    assert series(dead) == {
        ("yahboomd_up", ()): 0,
        ("yahboomd_status_age_seconds", ()): 12.5,
        ("yahboomd_events_total", (("kind", "fault"), ("severity", "error"))): 1,
        ("yahboomd_unknown_status_fields", ()): 0,
        ("yahboomd_unreadable_samples_total", ()): 0,
    }


def test_speeds_are_those_of_the_newest_samples_and_old_ones_are_left_out() -> None:
    found = series(facts(twist=daemon_samples.twist(0.3, -0.25), wheels=daemon_samples.wheels()))
    assert found["yahboomd_twist_linear_meters_per_second", (("axis", "x"),)] == 0.3
    assert found["yahboomd_twist_angular_radians_per_second", (("axis", "z"),)] == -0.25
    assert found["yahboomd_wheel_speed_meters_per_second", (("wheel", "left"),)] == 0.29
    assert found["yahboomd_wheel_command_meters_per_second", (("wheel", "left"),)] == 0.3
    status = daemon_samples.status("waiting")
    late = msgspec.structs.replace(status, stamp_ns=status.stamp_ns + FRESH_NS)
    old = series(facts(late, twist=daemon_samples.twist(), wheels=daemon_samples.wheels()))
    assert not [name for name, _ in old if "per_second" in name]


def test_numbers_that_this_version_does_not_know_are_counted_and_left_out() -> None:
    found = series(facts(daemon_samples.status(link={"readings": 5, "warp": 9, "name": "x"})))
    assert found["yahboomd_unknown_status_fields", ()] == 1
    assert not [name for name, _ in found if "warp" in name]


def test_the_page_is_bounded_whatever_a_status_says() -> None:
    command = {
        "sources": {f"s{n}": {"refused": {f"r{m}": 1 for m in range(999)}} for n in range(999)}
    }
    status = daemon_samples.status(command=command, link={"readings": "many", "frames": {"a": 1}})
    wheels = daemon_samples.wheels((0.1,) * 999, (0.1,) * 999, tuple(f"w{n}" for n in range(999)))
    found = series(facts(status, wheels=wheels))
    assert len(found) < MAX_SERIES * (MAX_SERIES + 8)


def test_texts_are_left_out_but_for_the_board() -> None:
    exposition = Exposition()
    add_robot(exposition, facts(filled()))
    text = exposition.text(openmetrics=True)
    board = [field.name for field in FIELDS if field.group == "board" and field.kind == "text"]
    assert all(f'{name}="text ' in text for name in board)
    assert text.count('="text ') == len(board)


class Robots:
    """Two robots, and how often they were asked."""

    def __init__(self) -> None:
        self.asked = 0
        self.now_ns = 0

    def __call__(self) -> list[RobotFacts]:
        self.asked += 1
        return [RobotFacts(name="front", unreadable=self.asked), RobotFacts(name="rear")]


def test_a_flood_of_scrapes_makes_the_page_once_for_each_format() -> None:
    robots = Robots()
    page = Page(lambda: robots.now_ns, robots, version="1")
    pages = {page.text(openmetrics) for openmetrics in (True, False) for _ in range(1000)}
    assert len(pages) == 2
    assert robots.asked == 2


def test_the_page_follows_what_is_known() -> None:
    robots = Robots()
    page = Page(lambda: robots.now_ns, robots, version="1")
    before = page.text(openmetrics=True)
    robots.now_ns += PAGE_KEPT_NS
    assert page.text(openmetrics=True) != before


def test_it_has_every_robot_the_version_and_what_became_of_scrapers() -> None:
    robots = Robots()
    page = Page(lambda: 0, robots, version="1.2")
    page.connections = {"answered": 3, "bad_host": 0}
    samples = [
        (sample.name, tuple(sample.labels.values()), sample.value)
        for family in text_string_to_metric_families(page.text(openmetrics=True))
        for sample in family.samples
    ]
    assert ("yahboomd_up", ("front",), 0) in samples
    assert ("yahboomd_up", ("rear",), 0) in samples
    assert ("yahboomd_metrics_info", ("1.2",), 1) in samples
    assert ("yahboomd_metrics_connections_total", ("answered",), 3) in samples
