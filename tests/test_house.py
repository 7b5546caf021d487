"""The rules of the tree: floors, names, words, sizes, and code that only tests call."""

from __future__ import annotations

import ast
import functools
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import pytest
from dead_code import without_callers

from yahboomd.cli.shell.shared_files import shared_files

ROOT = Path(__file__).resolve().parents[1]
SOURCES = [
    path.relative_to(ROOT / "yahboomd")
    for path in sorted((ROOT / "yahboomd").rglob("*.py"))
    if path.stem not in {"__init__", "__main__"}
]
CORE = {path.parts[1] for path in SOURCES if path.parts[0] == "core" and len(path.parts) > 2}
ROOMS = CORE | {"blackbox", "cli", "client", "moves", "ros2", "simulation", "tools", "web"}


READING_PATH = re.findall(
    r"^\| `(core/[\w/]+\.py)` \| ",
    (ROOT / "docs/architecture.md").read_text().partition("\n## The doors\n")[0],
    re.MULTILINE,
)
READ_IN_A_DAY = 6500


def lines_of(paths: Iterable[Path]) -> int:
    return sum(len(path.read_text().splitlines()) for path in paths)


def test_the_path_for_a_reader_is_there_and_can_be_read_in_a_day() -> None:
    assert 18 <= len(READING_PATH) <= 26
    assert lines_of(ROOT / "yahboomd" / name for name in READING_PATH) <= READ_IN_A_DAY


MOST_LINES_OF_THE_CORE = 26093
"""It only shrinks. A commit that raises it gives the reason, and takes as much away soon."""


def test_the_core_does_not_grow() -> None:
    assert lines_of((ROOT / "yahboomd/core").rglob("*.py")) <= MOST_LINES_OF_THE_CORE


@functools.cache
def texts_of_tests() -> dict[str, list[str]]:
    """The texts of all tests, by the name of their file."""
    found: dict[str, list[str]] = defaultdict(list)
    for path in (ROOT / "tests").rglob("test_*.py"):
        found[path.name].append(path.read_text())
    return found


@pytest.mark.parametrize("source", SOURCES, ids=str)
def test_every_source_file_has_tests_of_its_own_name(source: Path) -> None:
    texts = texts_of_tests()[f"test_{source.name}"]
    assert any(re.search(r"^(async )?def test_", text, re.MULTILINE) for text in texts)


def test_every_test_of_a_room_belongs_to_a_source_file() -> None:
    names = {source.name for source in SOURCES}
    strays = [
        path
        for room in ROOMS
        for path in (ROOT / "tests" / room).rglob("test_*.py")
        if path.name.removeprefix("test_") not in names
    ]
    assert strays == []


CONSTRUCTIONS = {
    "a condition (if, when, unless)": r"where (it|they|no|one|none|an?|the|there|that|this|these"
    r"|nothing|nobody|each|several|only|not|some|any|all)",
    "a noun (the queued frame)": r"what (is|was|are|were|has|had|have|came|comes?|waits?|can"
    r"|cannot|could|does|did|do|stands?|goes|went|must|may|will|would|happens|happened|belongs"
    r"|follows)",
    "a measure (the number, or its name)": r"so (long|many|often|old|much|far|few|soon|late|short"
    r"|large|fast|slow)",
    "report, return, log, print": r"(say|says|said|saying)",
}
"""Turns that make a reader translate, by the plain words for them."""

MOST_IN_1000_WORDS = 0.5


def prose() -> str:
    """The docstrings and comments of the source."""
    found = []
    for path in sorted((ROOT / "yahboomd").rglob("*.py")):
        text = path.read_text()
        documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
        nodes = (node for node in ast.walk(ast.parse(text)) if isinstance(node, documented))
        found += [ast.get_docstring(node) or "" for node in nodes]
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        found += [token.string for token in tokens if token.type == tokenize.COMMENT]
    return "\n".join(found)


def test_docstrings_and_comments_hold_few_turns_that_a_reader_has_to_translate() -> None:
    text = prose()
    words = len(re.findall(r"\b[\w']+\b", text))
    per_1000 = {
        plain: 1000.0 * len(re.findall(rf"\b{turn}\b", text, re.IGNORECASE)) / words
        for plain, turn in CONSTRUCTIONS.items()
    }
    assert {plain: rate for plain, rate in per_1000.items() if rate > MOST_IN_1000_WORDS} == {}


SHARED = {
    "options.py": "the options of a room's constructors",
    "fleet.py": "the command for many robots, and the benchmark of many robots",
}
"""Names of files that mean the same thing in several rooms."""


OWN_FOLDERS = tuple(
    f"yahboomd/{room}/{board}/"
    for room in ("core/protocol", "simulation")
    for board in ("four_channel", "rosmaster")
)
BOARD_WORDS = re.compile(
    r"\b(streamed|polled|four_channel|rosmaster)\b"
    r"|\$(spd|speed|pwm|mtype|upload|read|MAll|MTEP|MSPD|data|Battery)\b"
)
NAMED_ELSEWHERE = {
    "yahboomd/core/protocol/registry.py": "the row of each dialect",
    "yahboomd/core/protocol/first_words.py": "the stop before anything can be imported",
    "yahboomd/simulation/boards.py": "the row of each simulated board",
    "yahboomd/simulation/options.py": "the board that is simulated where none is named",
    "yahboomd/tools/schemas/samples.py": "a golden sample is one of a real board",
}


def test_nothing_but_a_boards_own_folders_and_its_rows_name_it_or_its_commands() -> None:
    found = {
        str(path)
        for path in (source.relative_to(ROOT) for source in (ROOT / "yahboomd").rglob("*.py"))
        if not str(path).startswith(OWN_FOLDERS) and BOARD_WORDS.search((ROOT / path).read_text())
    }
    assert found == set(NAMED_ELSEWHERE)


def test_no_two_files_of_one_name_mean_different_things() -> None:
    """A test beside the room's own, with real processes, may have its name."""
    whole = ("tests/whole", "tests/faults", "tests/system")
    names = [
        path.name
        for folder in ("yahboomd", "benchmarks", "make", "tests")
        for path in (ROOT / folder).rglob("*.py")
        if not str(path.relative_to(ROOT)).startswith(whole)
    ]
    alike = {name.removeprefix("test_") for name in names if names.count(name) > 1}
    assert alike <= {*SHARED, "__init__.py", "__main__.py", "conftest.py"}


def test_no_two_classes_have_one_name() -> None:
    names = [
        node.name
        for text in read("yahboomd").values()
        for node in ast.parse(text).body
        if isinstance(node, ast.ClassDef)
    ]
    assert {name for name in names if names.count(name) > 1} == set()


def test_every_package_says_what_is_inside() -> None:
    packages = [
        *(ROOT / "yahboomd").rglob("__init__.py"),
        *(ROOT / "benchmarks").rglob("__init__.py"),
    ]
    assert len(packages) > len(ROOMS)
    for package in packages:
        docstring = ast.get_docstring(ast.parse(package.read_text())) or ""
        assert len(docstring.split()) > 5, package


CALLED_BY_OTHERS = {
    "_action_max_length": "argparse",
    "_fields_": "ctypes",
    "__pydantic_config__": "pydantic",
    "connection_made": "asyncio",
    "data_received": "asyncio",
    "connection_lost": "asyncio",
    "modify": "selectors",
    "tell": "mcap",
    "capture_signals": "uvicorn",
    "handle_ping": "uvicorn",
    "handle_pong": "uvicorn",
    "handle_cont": "uvicorn",
    "handle_websocket_upgrade": "uvicorn",
    "on_response_complete": "uvicorn",
    "send_400_response": "uvicorn",
}
"""Names that a library calls or reads, and no caller of ours."""


def read(folder: str) -> dict[Path, str]:
    return {path: path.read_text() for path in sorted((ROOT / folder).rglob("*.py"))}


def test_suites_that_a_target_leaves_out_are_there() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for named in ("WHOLE_ROBOTS", "OWN_TARGETS"):
        suites = re.search(rf"^{named} := (.+)", makefile, re.MULTILINE)
        assert suites
        assert [each for each in suites[1].split() if not (ROOT / "tests" / each).exists()] == []


def test_no_code_is_there_for_tests_alone() -> None:
    """But in the simulator, with which tests measure."""
    callers = [
        text for folder in ("examples", "benchmarks", "make") for text in read(folder).values()
    ]
    found = without_callers(read("yahboomd"), callers, CALLED_BY_OTHERS)
    assert [str(each) for each in found if "yahboomd/simulation/" not in each.where] == []


def test_code_that_only_dead_code_calls_is_dead_and_what_is_exported_is_not() -> None:
    source = """
__all__ = ["Robot", "start"]
LIMIT = 3
class Robot:
    def drive(self): self._speed = _clip(1)
    def _lost(self): self._lost()
def start(): _used()
def _used(): return Robot
def _clip(speed): return speed
def helper(): return other() + LIMIT
def other(): return helper()
def retired(): return past()
def past(): return 1
"""
    dead = without_callers({Path("robot.py"): source}, [], ["_speed"])
    assert {each.name for each in dead} == {"_lost", "past", "retired"}
    assert without_callers({Path("robot.py"): source}, ["Robot()._lost(retired)"], ["_speed"]) == []


SAFETY = (ROOT / "docs" / "safety.md").read_text()
TESTS = {
    name
    for path in (ROOT / "tests").rglob("test_*.py")
    for name in re.findall(r"^(?:async )?def (test_\w+)", path.read_text(), re.MULTILINE)
}
FAULTS = [
    *("command silence", "a source that dies", "e-stop", "lost bus", "SIGTERM, SIGINT, SIGHUP"),
    *("cancelled task", "SIGKILL, abort, out of memory", "hung event loop", "not obeyed"),
    *("backlog", "hand-over", "gentle deceleration"),
    *("unplugged and back", "another device node", "EIO, ENODEV, a hang-up", "silent", "hangs"),
    *("babbles", "takes no output", "20 % of the bytes", "half frames", "resets in motion"),
    *("brown-out", "three resets in 10 s", "missing", "went on counting", "near to zero"),
    *("flood", "against its command", "counts stay away", "stalled", "without command"),
    *("motor unplugged", "another kind", "settings that would run away"),
]


def rows() -> list[list[str]]:
    """The rows of the tables of evidence, in cells."""
    found: list[list[str]] = []
    shows = False
    for line in SAFETY.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            shows = False
        elif cells[-1] == "shown by":
            shows = True
        elif shows and not line.startswith("|---"):
            found.append(cells)
    return found


@pytest.mark.parametrize(("page", "least"), [("safety.md", 50), ("security.md", 20)])
def test_every_test_that_a_page_on_safety_or_security_names_exists(page: str, least: int) -> None:
    named = set(re.findall(r"`(test_\w+)`", (ROOT / "docs" / page).read_text()))
    assert len(named) > least
    assert named - TESTS == set()


def test_every_fault_of_the_safety_page_says_what_happens_what_is_reported_and_what_shows_it() -> (
    None
):
    assert len(rows()) > 30
    for row in rows():
        assert len(row) == 4, row
        assert all(row), row
        assert re.fullmatch(r"`test_\w+`(, `test_\w+`)*", row[-1]), row


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_that_is_known_is_on_the_safety_page(fault: str) -> None:
    assert any(fault in cell for row in rows() for cell in row[:2]), fault


def test_no_test_of_a_fault_is_missing_from_the_safety_page() -> None:
    """A fault that has a test and no row would be one that no reader learns of."""
    missing = [
        path.name
        for path in (ROOT / "tests" / "faults").glob("test_*.py")
        if not set(re.findall(r"def (test_\w+)", path.read_text()))
        & set(re.findall(r"`(test_\w+)`", SAFETY))
    ]
    assert missing == []


def test_man_pages_and_completions_are_what_the_options_make_of_them() -> None:
    share = ROOT / "share"
    there = {str(path.relative_to(share)) for path in share.rglob("*") if path.is_file()}
    texts = shared_files()
    assert there == set(texts), "run `make schemas`"
    stale = [name for name, text in texts.items() if (share / name).read_text() != text]
    assert stale == [], "run `make schemas`"
