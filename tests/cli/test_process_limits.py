"""The limits of a process, on processes whose limits are set."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Iterator

import pytest

from yahboomd.cli.process_limits import ADDRESSES, THREADS, WANTED, make_room


@pytest.fixture(autouse=True)
def limits() -> Iterator[int]:
    """The hard limit; restores the soft one after the test."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    yield hard
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def soft() -> int:
    return resource.getrlimit(resource.RLIMIT_NOFILE)[0]


def test_the_limit_is_raised_as_far_as_it_may_be(limits: int) -> None:
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, limits))
    make_room()
    assert soft() == (WANTED if limits == resource.RLIM_INFINITY else min(WANTED, limits))


def test_too_few_descriptors_are_refused_with_what_raises_the_limit() -> None:
    script = (
        "import resource\n"
        "from yahboomd.cli.process_limits import make_room\n"
        "resource.setrlimit(resource.RLIMIT_NOFILE, (63, 63))\n"
        "try: make_room()\n"
        "except Exception as error: print(error.exit_code, error)\n"
    )
    said = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    ).stdout
    assert said.startswith(f"{os.EX_OSERR} This process may open 63 files; the daemon needs 64")
    assert "`ulimit -n 64`" in said


def refused(limit: str, command: list[str]) -> tuple[int, str]:
    """The status and words of a command in a process with this limit of a shell."""
    done = subprocess.run(
        ["sh", "-c", f'ulimit {limit} && exec "$0" -m yahboomd "$@"', sys.executable, *command],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stdout == ""
    return done.returncode, done.stderr


@pytest.mark.cases(1)
@pytest.mark.realtime
@pytest.mark.parametrize(
    ("megabytes", "command"),
    [(60, ["run"]), (90, ["run"]), (1535, ["run"]), (200, ["web", "--listen", "127.0.0.1:0"])],
)
def test_too_little_address_space_is_refused_in_a_sentence_before_zenoh_panics(
    megabytes: int, command: list[str]
) -> None:
    status, words = refused(f"-v {megabytes * 1024}", command)
    assert (status, words.count("\n")) == (os.EX_OSERR, 1)
    if megabytes > 60:
        # Else an import needed too much of it already.
        assert words.startswith(f"yahboomd: This process may use {megabytes} MB of address space; ")
        assert f"needs {ADDRESSES >> 20} MB" in words
    assert "`ulimit -" in words


def test_too_few_threads_for_this_user_are_refused_with_how_many_there_are() -> None:
    script = (
        "import os, resource\n"
        "from yahboomd.cli.process_limits import THREADS, check_limits\n"
        # Root's threads are not limited, and this user has no other.
        "os.getuid() or os.setuid(61234)\n"
        "hard = resource.getrlimit(resource.RLIMIT_NPROC)[1]\n"
        "resource.setrlimit(resource.RLIMIT_NPROC, (hard, hard))\n"
        "check_limits(who='the daemon')\n"
        "resource.setrlimit(resource.RLIMIT_NPROC, (THREADS, hard))\n"
        "try: check_limits(who='the daemon')\n"
        "except Exception as error: print(error.exit_code, error)\n"
    )
    said = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    ).stdout
    assert said.startswith(f"{os.EX_OSERR} The programs of this user may have {THREADS} threads")
    assert f"the daemon needs {THREADS} more. `ulimit -u` raises" in said
