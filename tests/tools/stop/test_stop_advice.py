"""Advice if no daemon was reached; test_stop.py has it on real processes."""

from __future__ import annotations

from zenoh_fixtures import free_endpoint

from yahboomd.core.config import Config
from yahboomd.core.errors import NoDaemon, PortMissing
from yahboomd.tools.stop.stop_advice import StopOptions, no_answer, not_found, not_released, silent
from yahboomd.tools.stop.stop_local import LocalDaemon, LocalStops

GONE = 4_194_305
"""No process has such an id: the kernel's largest is one less."""


def test_a_daemon_that_does_not_answer_is_named_with_what_ends_it() -> None:
    error = silent(
        LocalDaemon("/run/a", GONE, silent=True),
        StopOptions(port="/dev/a", again="yahboomd stop --port /dev/a"),
    )
    assert error.message == f"yahboomd (pid {GONE}) does not answer."
    assert f"kill -9 {GONE}; yahboomd stop --port /dev/a" in error.remedy


def test_where_nothing_listens_the_error_stays() -> None:
    error = NoDaemon("No daemon answers.", remedy="Start it.")
    assert no_answer(error, StopOptions(), (free_endpoint(),)) is error


def test_a_release_by_port_names_the_daemon_on_that_port_and_no_other() -> None:
    robots = [
        LocalDaemon(f"/run/{name}", GONE, ports=(f"/dev/{name}",), listen=(f"tcp/{name}:1",))
        for name in ("a", "b")
    ]
    error = NoDaemon("No daemon answers.", remedy="Start it.")
    found = not_released(error, StopOptions(port="/dev/b"), robots, (free_endpoint(),))
    assert "`yahboomd stop --release --connect tcp/b:1`" in found.remedy
    assert "tcp/a:1" not in found.remedy


def test_a_missing_port_and_a_missing_daemon_are_one_error_with_its_exit_code() -> None:
    local = LocalStops()
    local.others.append(LocalDaemon("/run/c", 3, namespace="bot1"))
    missing = PortMissing("/dev/a is not there.", remedy="Plug it in.")
    error = not_found(missing, Config(), ("tcp/x:1",), local)
    assert type(error) is PortMissing
    assert error.message == "No daemon answers at tcp/x:1, and /dev/a is not there."
    assert "yahboomd stop --namespace bot1" in error.remedy
