"""Every example reads the golden samples, field by field, and refuses other bytes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

pytestmark = [pytest.mark.realtime, pytest.mark.commands("decode")]

SCHEMAS = Path(__file__).resolve().parents[2] / "schemas"
MESSAGES = ("PoseSample", "StatusSample", "ServiceReply")
OPTIONAL = {"board", "link", "command", "bus", "driver_since_ns", "data"} | {
    "wheels",
    "wheels_since_ns",
    "reasons",
}
"""Fields that a program need not print."""


def golden(message: str) -> dict[str, Any]:
    sample: dict[str, Any] = json.loads(
        (SCHEMAS / "samples" / "json" / f"{message}.json").read_text()
    )
    return sample


def changed(name: str, /, **fields: Any) -> bytes:
    return json.dumps({**golden(name), **fields}).encode()


def without(message: str, field: str) -> bytes:
    return json.dumps({k: v for k, v in golden(message).items() if k != field}).encode()


WRONG = {
    "nothing": ("PoseSample", b""),
    "cut short": ("PoseSample", changed("PoseSample")[:-9]),
    "a list": ("PoseSample", b"[]"),
    "MessagePack": ("PoseSample", (SCHEMAS / "samples/msgpack/PoseSample.bin").read_bytes()),
    "another message": ("PoseSample", changed("ServiceReply")),
    "no x": ("PoseSample", without("PoseSample", "x")),
    "x is text": ("PoseSample", changed("PoseSample", x="1.25")),
    "x is null": ("PoseSample", changed("PoseSample", x=None)),
    "theta is NaN": ("PoseSample", changed("PoseSample", theta=float("nan"))),
    "seq is a fraction": ("PoseSample", changed("PoseSample", seq=4711.5)),
    "stamp_ns is text": ("PoseSample", changed("PoseSample", stamp_ns="1700000000123456789")),
    "eight covariances": ("PoseSample", changed("PoseSample", covariance=[0.0] * 8)),
    "state is a number": ("StatusSample", changed("StatusSample", state=7)),
    "no state": ("StatusSample", without("StatusSample", "state")),
    "why is a number": ("StatusSample", changed("StatusSample", why=7)),
    "driver is a number": ("StatusSample", changed("StatusSample", driver=7)),
    "success is a number": ("ServiceReply", changed("ServiceReply", success=1)),
    "no message": ("ServiceReply", without("ServiceReply", "message")),
}

ALSO_RIGHT = {
    "a field that is not known yet": ("PoseSample", changed("PoseSample", later={"a": [1]})),
    "a state that is not known yet": ("StatusSample", changed("StatusSample", state="docked")),
    "an integer where a number may be": ("PoseSample", changed("PoseSample", x=1, y=-2)),
    "the largest stamp": ("PoseSample", changed("PoseSample", stamp_ns=2**63 - 1)),
    "fields in another order": (
        "PoseSample",
        json.dumps(dict(reversed(golden("PoseSample").items()))).encode(),
    ),
    "no driver": ("StatusSample", changed("StatusSample", driver=None, driver_since_ns=None)),
    "no data": ("ServiceReply", without("ServiceReply", "data")),
    "quotes and other letters": (
        "ServiceReply",
        changed("ServiceReply", message='"é\\\n', data={"Ω": "\t"}),
    ),
}


def few(samples: dict[str, Any], *names: str) -> list[Any]:
    """All of them: others than these are nightly."""
    rest = pytest.mark.nightly
    return [pytest.param(name, marks=() if name in names else rest) for name in samples]


def assert_decoded(program: Any, message: str, payload: bytes) -> None:
    done = program.decode(message, payload)
    assert done.code == 0, done
    (line,) = done.out.splitlines()
    printed, sample = json.loads(line), json.loads(payload)
    for field in golden(message):
        if field in printed or field not in OPTIONAL:
            assert printed.get(field) == sample.get(field) or (
                field == "data" and not sample.get(field) and not printed[field]
            ), field


@pytest.mark.parametrize("message", MESSAGES)
def test_the_golden_sample_is_decoded(program: Any, message: str) -> None:
    payload = (SCHEMAS / "samples" / "json" / f"{message}.json").read_bytes()
    assert_decoded(program, message, payload)


@pytest.mark.parametrize("name", few(ALSO_RIGHT, "an integer where a number may be"))
def test_what_the_schema_allows_is_decoded(program: Any, name: str) -> None:
    assert_decoded(program, *ALSO_RIGHT[name])


@pytest.mark.parametrize("name", few(WRONG, "nothing", "cut short", "no x", "x is text"))
def test_what_is_wrong_is_refused_in_words(program: Any, name: str) -> None:
    message, payload = WRONG[name]
    done = program.decode(message, payload)
    assert (done.code, done.out) == (65, ""), done
    assert message in done.err
    assert len(done.err.splitlines()) <= 3, done.err


def test_the_schemas_judge_these_samples_as_this_suite_does() -> None:
    for samples, right in ((WRONG, False), (ALSO_RIGHT, True)):
        for name, (message, payload) in samples.items():
            schema = json.loads((SCHEMAS / f"{message}.json").read_text())
            try:
                value = json.loads(payload, parse_constant=str)
                jsonschema.validate(value, schema)
            except (ValueError, jsonschema.ValidationError):
                assert not right, name
            else:
                assert right, name
