from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from real_robot import free_endpoint, wait_for

START = """
import os, sys, threading
from pathlib import Path
from yahboomd.cli.child_reader import read_in_child
from yahboomd.core.config import Config
from yahboomd.core.errors import ConfigError
"""


def run(script: str) -> str:
    """The output of a separate process, because this one has threads."""
    done = subprocess.run(
        [sys.executable, "-c", START + script],
        check=False,
        capture_output=True,
        text=True,
        timeout=60,
    )
    return done.stdout + done.stderr


def test_the_values_come_from_another_process_with_their_types() -> None:
    said = run(
        "given = Config.of({'chassis': {'preset': '4wd'}, 'zenoh': {'listen': ['tcp/[::1]:7']}})\n"
        "wait = read_in_child(lambda: (given, Path('/x'), os.getpid()), tuple[Config, Path, int])\n"
        "config, path, pid = wait()\n"
        "print(config == given, config.zenoh.listen, repr(path), pid != os.getpid())\n"
    )
    assert said == "True ('tcp/[::1]:7',) PosixPath('/x') True\n"


def test_this_process_goes_on_while_the_other_reads() -> None:
    said = run(
        "reading, writing = os.pipe()\n"
        "wait = read_in_child(lambda: os.read(reading, 9), bytes)\n"
        "os.write(writing, b'meanwhile')\n"
        "print(wait())\n"
    )
    assert said == "b'meanwhile'\n"


def test_a_mistake_is_raised_here_in_its_words() -> None:
    said = run(
        "def read(): raise ConfigError('The port is no port.', remedy='Write another \u2026.')\n"
        "try: read_in_child(read, int)()\n"
        "except ConfigError as error: print(error.exit_code, error)\n"
    )
    assert said == f"{os.EX_CONFIG} The port is no port. Write another \u2026.\n"


def test_a_bug_shows_its_traceback_and_the_process_does_not_start_without_configuration() -> None:
    said = run("read_in_child(lambda: 1 / 0, int)()")
    assert "ZeroDivisionError" in said
    assert f"The process that reads the configuration ended with {os.EX_SOFTWARE}." in said


def test_a_library_that_finds_no_memory_in_the_reader_is_a_limit_of_the_system() -> None:
    said = run(
        "def read(): raise ImportError('/x.so: failed to map segment from shared object')\n"
        "try: read_in_child(read, int)()\n"
        "except Exception as error: print(error.exit_code, error)\n"
    )
    assert said.startswith(f"{os.EX_OSERR} The system gives this process too little: no memory")


def test_a_reader_that_is_killed_is_not_taken_for_an_empty_configuration() -> None:
    assert "ended with -9." in run("read_in_child(lambda: os.kill(os.getpid(), 9), int)()")


def test_a_process_that_was_started_to_ignore_its_children_reads_as_well() -> None:
    said = run(
        "import signal\n"
        "signal.signal(signal.SIGCHLD, signal.SIG_IGN)\n"
        "print(read_in_child(lambda: 7, int)())\n"
    )
    assert said == "7\n"


def test_a_process_with_threads_reads_itself() -> None:
    said = run(
        "ended = threading.Event()\n"
        "threading.Thread(target=ended.wait).start()\n"
        "print(read_in_child(os.getpid, int)() == os.getpid())\n"
        "ended.set()\n"
    )
    assert said == "True\n"


def test_mistakes_in_a_configuration_that_is_a_pipe_are_named() -> None:
    command = [sys.executable, "-m", "yahboomd", "run", "--config", "/dev/stdin"]
    listen = f"zenoh.listen={free_endpoint()}"
    done = subprocess.run(
        [*command, "--set", listen],
        check=False,
        input="[board]\nlinse = 3\n",
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == os.EX_CONFIG
    assert '/dev/stdin:2: board.linse: unknown key; did you mean "lines"?' in done.stderr


def test_where_no_other_process_can_be_started_this_one_reads_itself() -> None:
    said = run(
        "import resource\n"
        "resource.setrlimit(resource.RLIMIT_NOFILE, (4, 4))\n"
        "print(read_in_child(os.getpid, int)() == os.getpid())\n"
    )
    assert said == "True\n"


def test_a_limit_of_the_system_is_a_sentence_and_a_status_of_its_own() -> None:
    for error in ("OSError(24, os.strerror(24))", "MemoryError()"):
        said = run(
            f"def read(): raise {error}\n"
            "try: read_in_child(read, int)()\n"
            "except Exception as error: print(error.exit_code, error)\n"
        )
        assert said.startswith(f"{os.EX_OSERR} The system gives this process too little: ")
        assert said.count("\n") == 1


def test_an_answer_that_is_not_waited_for_makes_no_noise() -> None:
    said = run(
        "going, gone = os.pipe()\n"
        "read_in_child(lambda: (os.close(gone), os.read(going, 1)), tuple[None, bytes])\n"
        "os._exit(0)\n"
    )
    assert said == ""


def test_a_reader_that_waits_for_a_pipe_ends_with_the_process_that_it_reads_for(
    tmp_path: Path,
) -> None:
    fifo = tmp_path / "config"
    os.mkfifo(fifo)
    command = [sys.executable, "-m", "yahboomd", "run", "--no-guard", "--config", str(fifo)]
    with subprocess.Popen(command) as parent:
        children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children")
        child = int(wait_for(children.read_text, "a process that reads"))
        parent.send_signal(signal.SIGKILL)
    try:
        wait_for(lambda: not runs(child), "the end of the reader")
    finally:
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)


def runs(pid: int) -> bool:
    """Whether a process is there and has not ended."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return False
    return stat.rpartition(")")[2].split()[0] not in "ZX"
