"""The rules of the tree that no lint knows: sizes, boards' names, the rows of the safety page."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterable
from pathlib import Path

import pytest

from yahboomd.cli.shell.shared_files import shared_files

ROOT = Path(__file__).resolve().parents[1]
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


MOST_CODE = {
    "blackbox": 1265,
    "cli": 5052,
    "client": 1908,
    "core": 17105,
    "moves": 2082,
    "ros2": 1313,
    "simulation": 3154,
    "tools": 12136,
    "web": 3363,
}
"""The lines of code of each door. They only shrink: a commit that raises one gives the reason, and
takes as much away soon."""


def code_lines(source: str) -> int:
    """The lines of code: none of blanks, comments and docstrings."""
    blank = {
        *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
        *(tokenize.ENCODING, tokenize.ENDMARKER),
    }
    code = {
        line
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type not in blank
        for line in range(token.start[0], token.end[0] + 1)
    }
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                code -= {*range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    return len(code)


@pytest.mark.parametrize("door", MOST_CODE)
def test_no_door_grows(door: str) -> None:
    files = (ROOT / "yahboomd" / door).rglob("*.py")
    assert sum(code_lines(path.read_text()) for path in files) <= MOST_CODE[door]


def naming(what: str) -> set[str]:
    files = (ROOT / "yahboomd").rglob("*.py")
    return {
        path.relative_to(ROOT / "yahboomd").as_posix() for path in files if what in path.read_text()
    }


def test_the_guard_alone_listens_for_local_stops_and_stops_what_its_owner_left() -> None:
    assert naming("local_socket.bound(") == {"tools/port/local_stops.py"}
    assert naming("import LocalStops, MadeSocket, Request") == {"tools/port/guard.py"}
    assert naming('"guard.py"') == {"tools/port/charge.py"}
    # The simulation's console, and the notices of the service manager.
    assert naming("socket.AF_UNIX") == {
        *("tools/port/charge.py", "tools/stop/local_socket.py", "tools/stop/stop_local.py"),
        *("core/daemon/process.py", "cli/simulate.py"),
        "simulation/port_link.py",
    }


def test_each_folder_is_a_door() -> None:
    assert {path.parent.name for path in (ROOT / "yahboomd").glob("*/__init__.py")} == {*MOST_CODE}


GUARDED = {
    "core/link/connected_board.py": ("core/daemon/control.py", "guard = guard or PortGuard()"),
    "tools/port/pulses.py": ("tools/setup/setup_wizard.py", "guard.watch_over(", "Pulses("),
    "tools/tune/stand.py": ("tools/tune/stand.py", "guard.watch_over(", "stand = cls("),
}
"""The only files that write motion, by `run`, `setup` and `tune`; where each shares its port with a
guard, before what writes is made. Every other command asks a daemon."""


def test_no_motion_is_written_without_a_guard() -> None:
    writes = re.compile(r"\bwriter\.velocity\(|\bdialect\.(speeds|outputs)\(")
    package = ROOT / "yahboomd"
    writing = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if "simulation" not in path.parts and writes.search(path.read_text())
    }
    assert writing == {*GUARDED}
    for where, *steps in GUARDED.values():
        text = (package / where).read_text()
        places = [text.find(step) for step in steps]
        assert -1 not in places
        assert places == sorted(places), where


def test_blanks_comments_and_docstrings_are_no_code() -> None:
    assert code_lines('"""Doc\nstring."""\n\n# Why.\nX = """a\nb"""  # c\n"""About X."""\n') == 2


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
}


def test_nothing_but_a_boards_own_folders_and_its_rows_name_it_or_its_commands() -> None:
    found = {
        str(path)
        for path in (source.relative_to(ROOT) for source in (ROOT / "yahboomd").rglob("*.py"))
        if not str(path).startswith(OWN_FOLDERS) and BOARD_WORDS.search((ROOT / path).read_text())
    }
    assert found == set(NAMED_ELSEWHERE)


def test_suites_that_a_target_leaves_out_are_there() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for named in ("WHOLE_ROBOTS", "OWN_TARGETS"):
        suites = re.search(rf"^{named} := (.+)", makefile, re.MULTILINE)
        assert suites
        assert [each for each in suites[1].split() if not (ROOT / "tests" / each).exists()] == []


SAFETY = "".join((ROOT / "docs" / name).read_text() for name in ("safety.md", "odometry.md"))
"""Faults, and those of the pose."""

TESTS = "\n".join(
    path.read_text()
    for folder in (ROOT / "tests", *ROOT.glob("extras/*/tests"))
    for path in sorted(folder.rglob("test_*.py"))
)
NAMES = set(re.findall(r"^(?:async )?def (test_\w+)", TESTS, re.MULTILINE))
NIGHTLY = set(
    re.findall(
        r"^@pytest\.mark\.nightly\n(?:[@ )\]].*\n)*(?:async )?def (test_\w+)", TESTS, re.MULTILINE
    )
)
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


@pytest.mark.parametrize(
    ("page", "least"), [("safety.md", 50), ("security.md", 20), ("odometry.md", 10)]
)
def test_every_test_that_a_page_on_safety_or_security_names_exists(page: str, least: int) -> None:
    named = set(re.findall(r"`(test_\w+)`", (ROOT / "docs" / page).read_text()))
    assert len(named) > least
    assert named - NAMES == set()


def test_every_fault_of_the_safety_page_says_what_happens_what_is_reported_and_what_shows_it() -> (
    None
):
    assert len(rows()) > 30
    for row in rows():
        assert len(row) == 4, row
        assert all(row), row
        assert re.fullmatch(r"`test_\w+`(, `test_\w+`)*", row[-1]), row
        assert not NIGHTLY.issuperset(row[-1].strip("`").split("`, `")), row[0]


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
