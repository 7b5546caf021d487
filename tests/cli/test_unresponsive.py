"""Words about a process that does not answer."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from yahboomd.tools.stop.unresponsive import (
    listener,
    process_state,
    restarting,
    true_names,
    unresponsive,
)


def test_the_state_is_found_behind_a_name_with_brackets(tmp_path: Path) -> None:
    (tmp_path / "12").mkdir()
    (tmp_path / "12" / "stat").write_text("12 (a) R (b)) D 1 2 3")
    assert process_state(12, proc=str(tmp_path)) == "D"
    assert process_state(13, proc=str(tmp_path)) == ""
    assert process_state(os.getpid()) == "R"


def test_what_ends_a_frozen_process_is_no_sigterm() -> None:
    message, remedy = unresponsive("yahboomd (pid 12)", 12, "T", "yahboomd stop --port /dev/x")
    assert message.startswith("yahboomd (pid 12) is frozen (stopped by a signal, state T)")
    assert "kill -9 12; yahboomd stop --port /dev/x\n" in remedy
    assert "kill -CONT 12; yahboomd stop --port /dev/x" in remedy


def test_a_program_of_python_is_named_yahboomd_where_it_is_one(tmp_path: Path) -> None:
    for pid, words in (
        (1, ("/x/bin/python", "-m", "yahboomd", "run")),
        (2, ("/x/bin/python3", "/x/bin/yahboomd", "run")),
        (3, ("python3", "yahboomd.log")),
        (5, ("/x/bin/python", "/x/bin/yahboomd", "tune", "--yes")),
        (6, ("/x/bin/python", "-I", "-S", "/x/yahboomd/tools/port/guard.py", "{}")),
    ):
        (tmp_path / str(pid)).mkdir()
        (tmp_path / str(pid) / "cmdline").write_text("\0".join(words) + "\0")
    text = (
        "held by python (pid 1), python3.11 (pid 2), python3 (pid 3), python (pid 4), cat (pid 1), "
        "yahboomd (pid 5), python (pid 6)"
    )
    assert true_names(text, proc=str(tmp_path)) == (
        "held by yahboomd (pid 1), yahboomd (pid 2), python3 (pid 3), python (pid 4), cat (pid 1), "
        "yahboomd tune (pid 5), yahboomd's guard (pid 6)"
    )


def test_the_process_that_listens_where_a_daemon_is_expected_is_found() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert listener((f"tcp/127.0.0.1:{port}",)) == os.getpid()
        assert listener((f"tcp/10.0.0.1:{port}", f"tcp/localhost:{port}")) == os.getpid()
        assert listener((f"tcp/10.0.0.1:{port}", "unixsock-stream//run/x")) is None
    assert listener((f"tcp/127.0.0.1:{port}",)) is None


@pytest.mark.parametrize(
    ("group", "words"),
    [
        (
            "/system.slice/system-yahboomd.slice/yahboomd@left.service",
            "`sudo systemctl restart yahboomd@left`.",
        ),
        ("/system.slice/yahboomd.service", "`sudo systemctl restart yahboomd`."),
        (
            "/user.slice/user-1000.slice/user@1000.service/app.slice/a.scope",
            "press Ctrl-C in its terminal",
        ),
        (None, "press Ctrl-C in its terminal"),
    ],
)
def test_a_daemon_in_a_terminal_is_not_restarted_by_systemctl(
    tmp_path: Path, group: str | None, words: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        (tmp_path / str(os.getpid())).mkdir()
        if group is not None:
            (tmp_path / str(os.getpid()) / "cgroup").write_text(f"0::{group}\n")
        assert words in restarting((endpoint,), proc=str(tmp_path))
    assert "if it is the service, else Ctrl-C" in restarting((endpoint,), proc=str(tmp_path))
