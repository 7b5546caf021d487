"""Pages agree with the tree: links, files, commands, options, make targets, configuration keys."""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import msgspec
import pytest

from yahboomd.cli.shell import command_tree
from yahboomd.client.async_robot import OLD_S
from yahboomd.client.commanding import OTHER_SILENCE_S, SILENCE_S
from yahboomd.core.bus import keys
from yahboomd.core.bus.inbox import MAX_BYTES
from yahboomd.core.clock import PAUSE_NS, seconds
from yahboomd.core.config import Config
from yahboomd.core.drive.stop_watch import STAND_WITHIN_NS
from yahboomd.core.model import FASTEST_M_S, FASTEST_RAD_S
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.first_words import FIRST_WORDS
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.boards import BOARDS
from yahboomd.tools.fleet.fleet_plan import FleetPlan, plan_problem
from yahboomd.tools.port.run_guard import BEATS_WITHIN_S
from yahboomd.web.beats import LAPSE_NS

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


def anchors(page: Path) -> set[str]:
    """The fragments of a page's headings, as GitHub makes them."""
    found = set()
    for heading in re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE):
        text = re.sub(r"\[(.*?)\]\(.*?\)", r"\1", heading).strip().lower()
        found.add(re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", text)))
    return found


@pages
def test_every_link_of_a_page_leads_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if "://" in link:
            continue
        path, _, fragment = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        assert not fragment or target.suffix != ".md" or fragment in anchors(target), link


@pages
def test_every_source_file_that_a_page_names_exists(page: Path) -> None:
    for name in re.findall(r"`((?:\w+/)+\w+\.(?:py|json5|toml|sh))`", prose(page)):
        roots = (ROOT, ROOT / "yahboomd", ROOT / "examples" / "clients", page.parent)
        assert any((root / name).exists() for root in roots), name


@pages
def test_every_command_and_option_that_a_page_shows_exists(page: Path) -> None:
    for line in code(page):
        match = re.match(r"(?:sudo |\.venv/bin/)?yahboomd ([a-z][^|;&>#\n]*)", line)
        if match is None:
            continue
        words = re.sub(r"'[^']*'|\"[^\"]*\"", "X", match[1]).split()
        assert ("yahboomd", words[0]) in COMMANDS, line
        command = COMMANDS["yahboomd", words[0]]
        if len(words) > 1:
            command = COMMANDS.get(("yahboomd", *words[:2]), command)
        flags = {flag for option in command.options for flag in option.flags}
        used = {word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        assert used <= flags, line


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
            if "fleet" in example:
                assert plan_problem(msgspec.convert(example, FleetPlan)) == ""
            else:
                Config.of(example)
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


class Figure(NamedTuple):
    """A number of the code that pages repeat.

    Attributes:
        value: The code's own.
        phrases: How sentences repeat it; ``N`` stands for the number.
        copies: The fewest that the pages have, so that the phrases keep finding them.
    """

    value: float
    phrases: str
    copies: int


FIGURES = {
    "command.timeout_s": Figure(
        Config().command.timeout_s,
        r"(?:lapses? after|stops the robot (?:after|within)|slows down after) N s(?! when)"
        r"|(?:lapse after a|when the) timeout (?:is over )?\(N s, (?:or|tele)"
        r"|timeout_s` in the daemon's configuration: N s|less than N s \(the daemon's `timeout_s`"
        r"|(?:timeout of its commands instead|the timeout of yahboomd), N s",
        19,
    ),
    "command.sources.cmd_vel/teleop.timeout_s": Figure(
        Config().source_timeout_s(keys.CMD_VEL_TELEOP),
        r"(?:`cmd_vel/teleop` and `cmd_vel/web`|teleop and the page) N s|after N s when driven by",
        3,
    ),
    "command.sources.cmd_vel/web.timeout_s": Figure(
        Config().source_timeout_s(keys.CMD_VEL_WEB),
        r"for `cmd_vel/web`, N s|its commands' timeout is over \(N s\)",
        2,
    ),
    "the page's beats": Figure(
        seconds(LAPSE_NS),
        r"beat is older than N s|delay is above N s|falls silent: after N s|silent for N s, its net"
        r"|page is closed, else after N s|nothing that waited N s",
        6,
    ),
    "a client's old samples": Figure(
        OLD_S, r"newest pose (?:is older|arrived more) than N s|arrived more than N s ago", 3
    ),
    "event paused": Figure(
        seconds(PAUSE_NS), r"did not run for N s or more|starved for N s (?:or|and) more", 4
    ),
    "a stop's deadline": Figure(
        seconds(STAND_WITHIN_NS),
        r"do not within N s|still turn after N s|longer than N s|after N s the motors are cut",
        4,
    ),
    "the guard's and the unit's watchdog": Figure(
        BEATS_WITHIN_S, r"hangs for N s|not fed for N s|beats end for N s", 3
    ),
    "the largest payload": Figure(
        MAX_BYTES, r"(?:more than|at most) N bytes(?=, its attach|; it is not)", 3
    ),
    "the fastest velocity": Figure(FASTEST_M_S, r"(?:over|above) N m/s(?= or 1,000 rad)", 3),
    "the fastest turn": Figure(FASTEST_RAD_S, r"(?<=00 m/s or )N rad/s", 3),
}
REPEATING = [*WRITTEN, *sorted((ROOT / "yahboomd" / "cli").glob("*.py"))]


def repeated() -> str:
    """The text of all pages and of the commands' help, without the marks of comments."""
    text = " ".join(page.read_text() for page in REPEATING)
    return re.sub(r"(?:\s|#|//)+", " ", text).replace("half a second", "0.5 s")


@pytest.mark.parametrize("name", FIGURES)
def test_a_number_that_pages_repeat_is_the_codes(name: str) -> None:
    figure = FIGURES[name]
    phrases = f"(?:{figure.phrases})".replace("N ", r"([\d.,]*\d) ")
    found = [
        float(next(filter(None, match.groups())).replace(",", ""))
        for match in re.finditer(phrases, repeated())
    ]
    assert found == [figure.value] * len(found)
    assert len(found) >= figure.copies


def test_every_copy_of_the_commands_timeout_is_compared_with_it() -> None:
    phrases = FIGURES["command.timeout_s"].phrases.replace("N ", r"[\d.,]*\d ")
    rest = re.sub(phrases, "", repeated())
    value = f"{Config().command.timeout_s:g}"
    near = r"(?:lapse|timeout_s|without (?:one|a command)|stops (?:sending|the robot))"
    assert re.findall(rf"{near}[^.|]{{0,40}}\b{value} s\b|\b{value} s without.{{20}}", rest) == []


def test_a_client_expects_the_silence_that_the_daemon_allows() -> None:
    config, client = Config(), defaultdict(lambda: OTHER_SILENCE_S, SILENCE_S)
    assert {name: client[name] for name in config.command.sources} == {
        name: config.source_timeout_s(name) for name in config.command.sources
    }


def test_the_units_watchdog_is_the_guards() -> None:
    for unit in ("yahboomd.service", "yahboomd@.service"):
        assert f"\nWatchdogSec={BEATS_WITHIN_S:g}\n" in (ROOT / "systemd" / unit).read_text()
