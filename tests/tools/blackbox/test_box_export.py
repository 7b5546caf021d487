"""An exported box is a whole MCAP file with schemas, or there is none."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from made_boxes import WALL_NS, ring_of, saved_box
from mcap.reader import make_reader

from yahboomd.blackbox import records
from yahboomd.blackbox.box_file import read_box
from yahboomd.core.errors import Refused
from yahboomd.core.model import Event
from yahboomd.tools.blackbox.box_export import export

ESTOP = Event(kind="estop", severity="warning", message="Engaged.")
HAPPENED = (
    (9.0, records.Opened(port="/dev/ttyUSB0", byte_ns=86_805)),
    (8.0, records.Identified(dialect="streamed", settings={"p": 1.5})),
    (7.0, records.Received(data=b"$MAll:1,2,3,4#\r\n\xff")),
    (6.5, records.Armed()),
    (6.0, records.Written(data=b"$spd:0,0,0,0#")),
    (5.0, records.CommandRecord(source="cmd_vel", vx=0.5, vy=0.0, wz=0.0, refused="stale")),
    (4.0, records.DecisionRecord(state="estopped", driver="", why="Emergency stop.")),
    (3.0, records.Happened(event=ESTOP)),
    (2.0, records.Closed()),
)


def test_every_message_is_valid_by_its_schema_and_has_its_time(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    assert export(read_box(saved_box(*HAPPENED)), path) == 8
    with path.open("rb") as stream:
        reader = make_reader(stream)
        found = []
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            content = json.loads(message.data)
            jsonschema.validate(content, json.loads(schema.data))
            found.append((channel.topic, round((WALL_NS - message.log_time) * 1e-9, 3), content))
        (metadata,) = [each.metadata for each in reader.iter_metadata()]
    assert [topic.removeprefix("yahboomd/") for topic, _, _ in found] == [
        *("blackbox/link", "blackbox/link", "blackbox/received", "blackbox/written"),
        *("blackbox/commands", "blackbox/decisions", "events", "blackbox/link"),
    ]
    assert found[2][1:] == (
        7.0,
        {"hex": b"$MAll:1,2,3,4#\r\n\xff".hex(), "text": found[2][2]["text"]},
    )
    assert found[6][2]["kind"] == "estop"
    assert metadata["saved"] == "estop"
    assert json.loads(metadata["config"]) == {"zenoh": {"namespace": "bot1"}}
    assert [each.name for each in tmp_path.iterdir()] == ["x.mcap"]


def test_a_file_that_is_there_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_text("mine")
    with pytest.raises(Refused, match="there already"):
        export(read_box(saved_box(*HAPPENED)), path)
    assert path.read_text() == "mine"


@pytest.mark.parametrize("image", [ring_of(), ring_of((1.0, records.Armed()))])
def test_an_empty_box_is_refused_and_leaves_nothing(tmp_path: Path, image: bytes) -> None:
    with pytest.raises(Refused, match="empty"):
        export(read_box(image), tmp_path / "x.mcap")
    assert list(tmp_path.iterdir()) == []


def test_what_ends_it_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def ctrl_c(*_arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("yahboomd.tools.blackbox.box_export.os.rename", ctrl_c)
    with pytest.raises(KeyboardInterrupt):
        export(read_box(saved_box(*HAPPENED)), tmp_path / "x.mcap")
    assert list(tmp_path.iterdir()) == []
