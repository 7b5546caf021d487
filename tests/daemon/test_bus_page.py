"""The daemon's keys and services, and docs/bus.md, which lists them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args

from yahboomd.cli.call import SERVICES
from yahboomd.client import move_messages
from yahboomd.core.bus import keys
from yahboomd.core.daemon.publisher import PUBLISHED
from yahboomd.core.daemon.requests import Services
from yahboomd.core.messages.codecs import Reason
from yahboomd.core.messages.status_fields import FIELDS
from yahboomd.ros2.ros2_topics import ROS_TOPICS
from yahboomd.tools.schemas.event_kinds import KINDS

PAGE = (Path(__file__).parents[2] / "docs" / "bus.md").read_text(encoding="utf-8")
MOVES = (
    *(move_messages.START, move_messages.CANCEL),
    *(move_messages.PAUSE, move_messages.RESUME),
)
CALLED = [*(f"yahboomd/{name}" for name in SERVICES), *MOVES]
OUT = PUBLISHED | {move_messages.MOVES: move_messages.MoveSample}
IN = {
    **dict.fromkeys((keys.CMD_VEL, keys.CMD_VEL_TELEOP, keys.CMD_VEL_WEB), "VelocityCommand"),
    move_messages.SOURCE: "VelocityCommand",
    move_messages.BEAT: "MoveBeat",
    keys.ESTOP: "EstopRequest",
    keys.ODOMETRY_SET_POSE: "SetPoseRequest",
}


def section(title: str) -> str:
    return PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]


def rows(title: str) -> list[list[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in section(title).splitlines()
        if line.startswith("| `")
    ]


def words(text: str) -> list[str]:
    return re.findall(r"`([\w/]+)`", text)


def test_every_key_has_its_direction_and_its_message() -> None:
    page: dict[str, tuple[str, str]] = {}
    for row in rows("Keys"):
        for key in words(row[0]):
            page[key] = row[1], row[2]
    assert page.keys() == {*OUT, *IN, *CALLED, *ROS_TOPICS, keys.ALIVE}
    declared = {
        value for name, value in vars(keys).items() if name.isupper() and isinstance(value, str)
    }
    assert declared <= page.keys()
    for key, published in OUT.items():
        assert page[key][0].startswith("out")
        assert words(page[key][1])[0] == published.__name__
    for key, received in IN.items():
        assert page[key][0].startswith("in")
        assert words(page[key][1])[0] == received
    assert all("service" in page[key][0] for key in CALLED)
    assert {page[key][0] for key in ROS_TOPICS} == {"out, in CDR"}
    assert page[keys.ALIVE][0] == "liveliness token"


def test_every_service_has_a_row() -> None:
    assert [words(row[0])[0] for row in rows("Services")] == CALLED


def test_every_service_of_the_command_is_offered_the_estop_first() -> None:
    services: Any = Services(
        None,  # type: ignore[arg-type]
        encoding="json",
        config=dict,
        board=dict,
        newest=lambda _key: None,
        save_box=None,  # type: ignore[arg-type]
    )
    # The one whose answer waits for the disk is served apart.
    offered = [*services.actions, keys.BLACKBOX_SAVE]
    assert offered == [f"yahboomd/{name}" for name in SERVICES]
    assert offered[0] == keys.ESTOP


def test_the_newest_of_every_sample_but_events_can_be_asked_for() -> None:
    assert {*keys.SAMPLES, keys.EVENTS} == PUBLISHED.keys()


def test_the_page_has_the_qos_that_test_service_sees() -> None:
    page = {
        words(row[0])[0]: [words(row[1])[0], words(row[2])[0]] for row in rows("Quality of service")
    }
    assert page["published"] == ["data_high", "drop"]
    assert page["answers"] == ["data", "block"]


def test_the_page_has_every_reason_for_which_a_payload_is_refused() -> None:
    assert {words(row[0])[0] for row in rows("Velocity commands")} >= set(get_args(Reason))


def test_the_page_names_only_counters_and_kinds_that_are_registered() -> None:
    text = " ".join(PAGE.split())
    found = re.findall(r"((?:`\w+`(?: \([^)]*\))?(?:, | and )?)+) under `(command|bus|link)`", text)
    assert len(found) > 5
    registered = {(field.group, field.name) for field in FIELDS}
    for names, group in found:
        for name in words(re.sub(r"\([^)]*\)", "", names)):
            assert (group, name) in registered, name
    kinds = re.findall(r"event `(\w+)`", text)
    assert len(kinds) > 2
    assert set(kinds) <= KINDS.keys()
