"""Pages agree with the tree: links, files, commands, options, make targets, configuration keys."""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import pytest

from yahboomd.cli.shell import command_tree
from yahboomd.client.commanding import OTHER_SILENCE_S, SILENCE_S
from yahboomd.core.config import Config
from yahboomd.core.program import PACKAGES
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.first_words import FIRST_WORDS
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.boards import BOARDS

ROOT = Path(__file__).resolve().parents[1]
WRITTEN = [
    *(
        ROOT / name
        for name in (
            *("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "benchmarks/README.md"),
            *("SECURITY.md", "CODE_OF_CONDUCT.md"),
        )
    ),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").glob("clients/*.md")),
]
COMMANDS = {command.words: command for command in command_tree.whole().walk()}
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))

pages = pytest.mark.parametrize("page", WRITTEN, ids=lambda page: str(page.relative_to(ROOT)))


def prose(page: Path) -> str:
    return re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)


def code(page: Path) -> list[str]:
    """The commands that a page shows: code in the text, and lines of blocks without the output."""
    found = re.findall(r"`([^`]+)`", prose(page))
    for block in re.findall(r"```\w*\n(.*?)```", page.read_text(), re.DOTALL):
        lines = [line.strip() for line in block.splitlines()]
        typed = [line[2:] for line in lines if line.startswith("$ ")]
        found += typed or lines
    return found


@pages
def test_every_source_file_that_a_page_names_exists(page: Path) -> None:
    for name in re.findall(r"`((?:\w+/)+\w+\.(?:py|json5|toml|sh))`", prose(page)):
        roots = (ROOT, ROOT / "yahboomd", ROOT / "examples" / "clients", page.parent)
        assert any((root / name).exists() for root in roots), name


@pages
def test_every_command_and_option_that_a_page_shows_exists(page: Path) -> None:
    for line in code(page):
        assert not wrong_options(line, COMMANDS), line


def wrong_options(line: str, commands: Mapping[tuple[str, ...], command_tree.CommandNode]) -> str:
    """What is wrong in a shown command; that of a package of its own is left to its tests."""
    match = re.match(r"(?:sudo |\.venv/bin/)?yahboomd ([a-z][^|;&>#\n]*)", line)
    if match is None:
        return ""
    words = re.sub(r"'[^']*'|\"[^\"]*\"", "X", match[1]).split()
    if ("yahboomd", words[0]) not in commands:
        return "" if words[0] in PACKAGES else words[0]
    command = commands["yahboomd", words[0]]
    if len(words) > 1:
        command = commands.get(("yahboomd", *words[:2]), command)
    flags = {flag for option in command.options for flag in option.flags}
    used = {word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)}
    return " ".join(used - flags)


@pages
def test_every_make_target_that_a_page_names_exists(page: Path) -> None:
    for line in code(page):
        if match := re.match(r"make ((?:[a-z-]+ ?)+)", line):
            assert set(match[1].split()) <= TARGETS, line


def test_every_toml_example_is_a_configuration() -> None:
    count = 0
    for page in WRITTEN:
        for block in re.findall(r"```toml\n(.*?)```", page.read_text(), re.DOTALL):
            example = tomllib.loads(block)
            if "fleet" not in example:  # The list of a fleet: its package has the test.
                Config.model_validate(example)
                count += 1
    assert count > 5


ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text()
ANOTHER_BOARD = ARCHITECTURE.partition("\n## Another board\n")[2]


def test_the_page_lists_all_that_a_board_takes_and_every_board_has_it() -> None:
    listed = set(re.findall(r"`((?:\w+/)+[\w.-]*)`", ANOTHER_BOARD.partition("Adding one")[2]))
    taken = set()
    for name, dialect in DIALECTS.items():
        room = type(dialect).__module__.split(".")[3]
        places = {
            "core/protocol/BOARD/": ROOT / "yahboomd/core/protocol" / room,
            "simulation/BOARD/": ROOT / "yahboomd" / "simulation" / room,
            "tests/protocol/BOARD/captures/connect-DIALECT.txt": ROOT
            / f"tests/protocol/{room}/captures/connect-{name}.txt",
        }
        assert all(place.exists() for place in places.values()), name
        assert BOARDS[name].make.__module__.split(".")[2] == room
        assert name in FIRST_WORDS
        assert f"\n## `{name}`\n" in (ROOT / "docs" / "protocol.md").read_text()
        taken |= set(places)
    rows = {"core/protocol/registry.py", "core/protocol/first_words.py", "simulation/boards.py"}
    rows |= {"core/messages/status_fields.py", "core/protocol/profiles.py"}
    rows |= {"systemd/95-yahboomd.rules", "packaging/postinst"}
    tests = {"tests/plugins/fault_bench.py", "tests/plugins/binary_dialect.py"}
    assert listed == taken | rows | tests | {"docs/protocol.md"}


def test_the_page_names_every_part_of_a_dialect() -> None:
    named = set(re.findall(r"`(\w+)(?:\(\))?`", ANOTHER_BOARD))
    parts = {part for part in vars(Dialect) if not part.startswith("_")}
    assert parts - {"name", "title", "for_profile"} <= named


def test_a_client_expects_the_silence_that_the_daemon_allows() -> None:
    config, client = Config(), defaultdict(lambda: OTHER_SILENCE_S, SILENCE_S)
    assert {name: client[name] for name in config.command.sources} == {
        name: config.source_timeout_s(name) for name in config.command.sources
    }
