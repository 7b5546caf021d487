"""The official JSON Schema and the official parser of AsyncAPI accept ``schemas/asyncapi.json``.

Both are installed once, into a cache outside the tree.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from installations import needs, npm_packages, run

SCHEMAS = Path(__file__).resolve().parents[2] / "schemas"
DOCUMENT = json.loads((SCHEMAS / "asyncapi.json").read_text())
PACKAGES = ("@asyncapi/parser@3.6.3", "@asyncapi/specs@6.11.1")

PARSE = """\
import { Parser, fromFile } from "@asyncapi/parser";
const { document, diagnostics } = await fromFile(new Parser(), process.argv[2]).parse();
// 0 is an error, 1 a warning; less than that is advice.
const troubles = diagnostics.filter((each) => each.severity < 2);
console.log(JSON.stringify({
  troubles: troubles.map((each) => `${each.path.join("/")}: ${each.message}`),
  operations: document?.operations().all().map((each) => each.id()) ?? [],
  kinds: document?.messages().all().flatMap(
    (each) => each.payload()?.properties()?.kind?.enum() ?? []) ?? [],
}));
"""

# One process installs and runs it.
pytestmark = [
    pytest.mark.realtime,
    pytest.mark.timeout(600),
    pytest.mark.xdist_group("asyncapi"),
]


@pytest.fixture(scope="session")
def packages() -> Path:
    return npm_packages("asyncapi", PACKAGES)


@pytest.fixture(scope="session")
def official(packages: Path) -> Any:
    name = f"{DOCUMENT['asyncapi']}.json"
    path = packages / "node_modules" / "@asyncapi" / "specs" / "schemas" / name
    return jsonschema.Draft7Validator(json.loads(path.read_text()))


@pytest.fixture
def parse(packages: Path) -> Callable[[Path], dict[str, Any]]:
    program = packages / "parse.mjs"
    program.write_text(PARSE)

    def parsed(path: Path) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(run(needs("node"), program, path, cwd=packages))
        return found

    return parsed


def test_the_official_schema_accepts_the_document_and_refuses_a_broken_one(official: Any) -> None:
    official.validate(DOCUMENT)
    broken = json.loads(json.dumps(DOCUMENT))
    broken["operations"]["publish_pose"]["action"] = "publish"
    with pytest.raises(jsonschema.ValidationError):
        official.validate(broken)


def test_the_official_parser_finds_every_operation_and_no_trouble(
    parse: Callable[[Path], dict[str, Any]],
) -> None:
    found = parse(SCHEMAS / "asyncapi.json")
    assert found["troubles"] == []
    assert sorted(found["operations"]) == sorted(DOCUMENT["operations"])
    # The schemas of events are other files: their references were followed.
    assert {"clock_stepped", "paused", "no_counts"} <= set(found["kinds"])


def test_the_official_parser_names_an_operation_on_a_channel_that_is_not_there(
    parse: Callable[[Path], dict[str, Any]], tmp_path: Path
) -> None:
    broken = json.loads(json.dumps(DOCUMENT).replace('"./', f'"{SCHEMAS}/'))
    broken["operations"]["publish_pose"]["channel"]["$ref"] = "#/channels/nowhere"
    path = tmp_path / "asyncapi.json"
    path.write_text(json.dumps(broken))
    assert any("publish_pose" in trouble for trouble in parse(path)["troubles"])
