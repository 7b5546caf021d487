"""The files in ``schemas/`` describe today's messages."""

from __future__ import annotations

import json
import math
from pathlib import Path

import jsonschema
import msgspec
import pytest
from jsonschema import Draft202012Validator

from make.schema_files import cdr_samples, generate, samples
from make.schema_files.samples import MESSAGES
from yahboomd.tools.schemas.message_schema import schema

SCHEMAS = Path(__file__).parents[2] / "schemas"


def test_the_committed_schemas_are_up_to_date(capsys):
    assert generate.main(["--check", str(SCHEMAS)]) == 0, capsys.readouterr().out


def test_generation_is_deterministic():
    assert generate.generated() == generate.generated()


@pytest.mark.parametrize("name", MESSAGES)
def test_every_schema_is_valid_described_and_accepts_its_samples(name):
    files = generate.generated()
    described = json.loads(files[f"{name}.json"])
    Draft202012Validator.check_schema(described)
    assert described["title"] == name
    assert described["description"]
    validator = Draft202012Validator(described)
    validator.validate(json.loads(files[f"samples/json/{name}.json"]))
    validator.validate(msgspec.msgpack.decode(files[f"samples/msgpack/{name}.bin"]))


@pytest.mark.parametrize(
    ("name", "instance"),
    [
        ("VelocityCommand", {}),
        ("VelocityCommand", {"source": "me"}),
        ("VelocityCommand", {"vx": "1"}),
        ("RosVelocityCommand", {"linear": {}, "angular": {}}),
        ("RosVelocityCommand", {"linear": {"z": 1}}),
        ("PoseSample", {"x": 1.0}),
        ("SetPoseRequest", {"x": 0, "y": 0, "theta": 0, "covariance": [1, 2]}),
        ("ServiceReply", {"success": 1, "message": ""}),
    ],
)
def test_schemas_refuse_what_the_daemon_refuses(name, instance):
    with pytest.raises(jsonschema.ValidationError):
        Draft202012Validator(schema(MESSAGES[name])).validate(instance)


def parts(node):
    """Every schema within a schema."""
    if isinstance(node, list):
        for item in node:
            yield from parts(item)
    elif isinstance(node, dict):
        yield node
        for item in node.values():
            yield from parts(item)


@pytest.mark.parametrize("name", MESSAGES)
def test_schemas_keep_to_forms_that_generators_of_types_understand(name):
    for part in parts(schema(MESSAGES[name])):
        assert "prefixItems" not in part
        assert part.get("items") is not False
        assert part.get("maximum", 0) <= 2**53
        assert part.get("type") != "integer" or part["format"] == "int64"
        assert not {"anyOf", "oneOf", "allOf"} & part.keys() or {"type": "null"} in part["anyOf"]


def test_a_covariance_has_nine_numbers_in_its_schema():
    covariance = schema(MESSAGES["PoseSample"])["properties"]["covariance"]
    assert (covariance["minItems"], covariance["maxItems"]) == (9, 9)
    assert covariance["items"] == {"type": "number"}


@pytest.mark.parametrize("name", MESSAGES)
def test_schemas_let_messages_grow(name):
    grown = {**msgspec.to_builtins(samples.NATIVE[name]), "a_later_field": 1}
    Draft202012Validator(schema(MESSAGES[name])).validate(json.loads(json.dumps(grown)))


def test_decoded_values_of_cdr_samples_are_those_of_the_bytes(oracle):
    files = generate.generated()

    def named(value):
        if isinstance(value, dict):
            return {key: named(item) for key, item in value.items()}
        if isinstance(value, list):
            return [named(item) for item in value]
        return "NaN" if isinstance(value, float) and math.isnan(value) else value

    for name in cdr_samples.CDR:
        described = json.loads(files[f"samples/cdr/{name}.json"])
        decoded = oracle.decode(described["type"], files[f"samples/cdr/{name}.bin"])
        assert named(decoded) == described["values"], name


def test_check_lists_every_difference_and_writes_nothing(tmp_path, capsys):
    assert generate.main([str(tmp_path)]) == 0
    (tmp_path / "PoseSample.json").write_bytes(b"{}")
    (tmp_path / "samples/cdr/Twist.bin").unlink()
    (tmp_path / "Old.json").write_bytes(b"{}")
    capsys.readouterr()
    assert generate.main(["--check", str(tmp_path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[:3] == [
        "not generated: Old.json",
        "differs: PoseSample.json",
        "missing: samples/cdr/Twist.bin",
    ]
    assert not (tmp_path / "samples/cdr/Twist.bin").exists()


def test_check_of_a_folder_that_is_not_there_lists_everything(tmp_path, capsys):
    assert generate.main(["--check", str(tmp_path / "none")]) == 1
    assert capsys.readouterr().out.count("missing: ") == len(generate.generated())


def test_the_readme_names_every_message_and_type():
    readme = generate.generated()["README.md"].decode()
    assert all(f"[`{name}`]({name}.json)" in readme for name in MESSAGES)
    assert all(f"`{sample.ros_type}`" in readme for sample in cdr_samples.CDR.values())
