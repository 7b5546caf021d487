"""The AsyncAPI document is the bus: of the table of keys, and in agreement with the page."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from jsonschema import Draft202012Validator

from yahboomd.core.bus import keys
from yahboomd.core.messages.codecs import Reason
from yahboomd.core.messages.status_fields import FIELDS
from yahboomd.ros2.ros2_topics import ROS_TOPICS
from yahboomd.tools.schemas import asyncapi, move_samples
from yahboomd.tools.schemas.event_kinds import EVENTS, KINDS
from yahboomd.tools.schemas.key_table import INPUTS, OFFERS, OUTPUTS
from yahboomd.tools.schemas.samples import MESSAGES

ROOT = Path(__file__).parents[2]
SCHEMAS = ROOT / "schemas"
PAGE = (ROOT / "docs" / "bus.md").read_text(encoding="utf-8")
DOCUMENT = asyncapi.document()
QOS = "Quality of service"
CHANNELS, OPERATIONS = DOCUMENT["channels"], DOCUMENT["operations"]


def references(node: Any) -> Iterator[str]:
    if isinstance(node, dict):
        if "$ref" in node:
            yield node["$ref"]
        for value in node.values():
            yield from references(value)
    elif isinstance(node, list):
        for value in node:
            yield from references(value)


def address(operation: dict[str, Any]) -> str:
    found: str = CHANNELS[operation["channel"]["$ref"].rpartition("/")[2]]["address"]
    return found


def of(prefix: str) -> dict[str, dict[str, Any]]:
    """The operations of one verb, by the key that they are on."""
    return {
        address(operation): operation
        for name, operation in OPERATIONS.items()
        if name.startswith(f"{prefix}_")
    }


def carried(operation: dict[str, Any]) -> list[str]:
    return [each["$ref"].rpartition("/")[2] for each in operation["messages"]]


def test_the_committed_document_is_current() -> None:
    assert asyncapi.main([str(SCHEMAS), "--check"]) == 0


def test_check_names_a_document_that_differs_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert asyncapi.main([str(tmp_path), "--check"]) == 1
    assert not list(tmp_path.iterdir())
    assert asyncapi.main([str(tmp_path)]) == 0
    assert asyncapi.main([str(tmp_path), "--check"]) == 0
    assert capsys.readouterr().out.count("differs: ") == 1


def test_every_reference_leads_somewhere() -> None:
    found = set(references(DOCUMENT))
    assert len(found) > 60
    for reference in found:
        if reference.startswith("./"):
            assert (SCHEMAS / reference).is_file(), reference
            continue
        node: Any = DOCUMENT
        for part in reference.removeprefix("#/").split("/"):
            node = node[part]


def test_every_key_has_its_operations_in_its_direction() -> None:
    assert of("publish").keys() == OUTPUTS.keys() | move_samples.OUTPUTS.keys()
    assert of("get").keys() == set(keys.SAMPLES) | move_samples.OUTPUTS.keys()
    assert of("take").keys() == INPUTS.keys() | move_samples.INPUTS.keys()
    assert of("call").keys() == OFFERS.keys() | move_samples.OFFERS.keys()
    assert of("ros2").keys() == ROS_TOPICS.keys()
    assert of("declare").keys() == {keys.ALIVE}
    for name, operation in OPERATIONS.items():
        sends = name.startswith(("publish_", "ros2_", "declare_"))
        assert operation["action"] == ("send" if sends else "receive")
        assert ("reply" in operation) == name.startswith(("get_", "call_"))


def test_every_native_message_and_event_is_described_with_a_valid_example() -> None:
    messages = DOCUMENT["components"]["messages"]
    for name in (*MESSAGES, *EVENTS):
        payload = messages[name]["payload"]["$ref"]
        (example,) = messages[name]["examples"]
        schema = json.loads((SCHEMAS / payload).read_text())
        Draft202012Validator(schema).validate(json.loads(json.dumps(example["payload"])))
        assert messages[name]["summary"]


def test_every_kind_of_event_and_every_field_of_the_status_is_in_the_document() -> None:
    messages = DOCUMENT["components"]["messages"]
    for kind, info in KINDS.items():
        assert f"| `{kind}` | " in messages[info.message.__name__]["description"]
    assert len(messages["StatusSample"]["x-status-fields"]) == len(FIELDS)


def test_what_is_published_has_its_qos() -> None:
    for key, operation in {**of("publish"), **of("ros2")}.items():
        qos = operation["x-zenoh"]
        assert (qos["priority"], qos["congestionControl"]) == ("data_high", "drop"), key
        assert all(";" in encoding for encoding in qos["encodings"])


# The page, docs/bus.md.


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


def test_the_page_has_the_keys_of_the_document_with_direction_and_message() -> None:
    page: dict[str, tuple[str, str]] = {}
    for row in rows("Keys"):
        for key in words(row[0]):
            page[key] = row[1], row[2]
    assert page.keys() == {each["address"] for each in CHANNELS.values() if each["address"]}
    for key, operation in of("publish").items():
        direction, message = page[key]
        assert direction.startswith("out")
        assert words(message)[0] == carried(operation)[0]
    for key, operation in of("take").items():
        direction, message = page[key]
        assert direction.startswith("in")
        assert words(message)[0] == carried(operation)[0]
    for key in of("call"):
        assert "service" in page[key][0]
    for key in of("ros2"):
        assert page[key][0] == "out, in CDR"
    assert page[keys.ALIVE][0] == "liveliness token"


def test_the_page_has_the_services_of_the_document() -> None:
    page = {words(row[0])[0]: row[1] for row in rows("Services")}
    assert list(page) == list(of("call"))
    for key, operation in of("call").items():
        assert (page[key] == "none") == (carried(operation)[0] == asyncapi.QUERY)


def test_the_page_has_the_qos_of_the_document() -> None:
    page = {words(row[0])[0]: (words(row[1])[0], words(row[2])[0]) for row in rows(QOS)}
    for operation in (of("publish") | of("ros2")).values():
        qos = operation["x-zenoh"]
        assert page["published"] == (qos["priority"], qos["congestionControl"])
    for operation in [*of("get").values(), *of("call").values()]:
        qos = operation["x-zenoh"]["reply"]
        assert page["answers"] == (qos["priority"], qos["congestionControl"])


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
