"""The registry of the status is complete, unambiguous, and agrees with the source's counters."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

from yahboomd.core.drive import arbitration, faults
from yahboomd.core.messages import codecs
from yahboomd.core.messages.status_fields import FIELDS, REFUSALS, ZEROS

SOURCE = Path(__file__).parents[2] / "yahboomd"
CORE = SOURCE / "core"
ROOMS = ("bus", "daemon", "drive", "link", "odometry")
COUNTED = re.compile(r'(?:counters|found)\["(\w+)"\] [+-]?= ')


def counted() -> set[str]:
    """The names of counters that appear as such in the source."""
    return {
        name
        for room in ROOMS
        for path in (CORE / room).rglob("*.py")
        for name in COUNTED.findall(path.read_text())
    }


def test_no_name_is_registered_twice_in_a_group():
    names = [(field.group, field.name) for field in FIELDS]
    assert len(names) == len(set(names))


def test_every_field_has_a_meaning_in_one_phrase_and_a_known_unit():
    for field in FIELDS:
        assert field.meaning, field.name
        assert not field.meaning.endswith("."), field.name
        assert field.unit in {"", "bytes", "s", "ns", "V", "mm", "rad/s"}, field.name


def test_every_counter_starts_at_zero():
    names = {
        (field.group, field.name) for field in FIELDS if field.kind == "counter" and not field.per
    }
    assert names == {(group, name) for group, zeros in ZEROS.items() for name in zeros}
    assert {zero for zeros in ZEROS.values() for zero in zeros.values()} == {0}


def test_every_reason_of_a_refusal_is_registered():
    reasons = {*get_args(codecs.Reason), *get_args(arbitration.Reason)}
    assert reasons == REFUSALS.keys()
    assert reasons <= ZEROS["command"].keys()


def test_every_fault_of_a_wheel_has_its_counter():
    assert set(get_args(faults.FaultKind)) <= ZEROS["command"].keys()


def test_every_counter_of_the_source_is_registered():
    names = {field.name for field in FIELDS}
    # The local socket's counters carry its name in the status.
    local = {name.removeprefix("local_") for name in names if name.startswith("local_")}
    assert len(counted()) > 40
    assert counted() <= names | local


def test_every_registered_counter_is_a_word_of_the_source():
    source = "".join(
        path.read_text() for path in SOURCE.rglob("*.py") if path.name != "status_fields.py"
    )
    words = set(re.findall(r"\w+", source))
    # The gyro's counters are named after its problems.
    spelled = (re.sub("^(local|gyro)_", "", field.name) for field in FIELDS)
    assert {*spelled} <= words
