"""The installed service in a container; `make system-test` prepares it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from nspawn_machine import Machine
from service_bench import Bench, package_of_environment

FIGURES: list[tuple[str, float, float]] = []
"""Measurements: the fault, seconds to slowing down, seconds to standing."""

RATES: list[tuple[str, float]] = []
"""Measurements: a fault that lasts, lines in the journal per minute."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    ours = [item for item in items if item.path.is_relative_to(here)]
    for item in ours:
        if package_of_environment() is None:
            item.add_marker(
                pytest.mark.skip(reason="boots a container with systemd: make system-test runs it")
            )
        elif os.environ.get("YAHBOOMD_SYSTEM_SHORT") and "main_claim" not in item.keywords:
            item.add_marker(pytest.mark.skip(reason="not of the short form"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if FIGURES:
        terminalreporter.section("wheels under a fault, at 0.3 m/s")
        terminalreporter.line(f"{'fault':<28}{'slower after':>14}{'standing after':>16}")
    for fault, slower_s, standing_s in FIGURES:
        terminalreporter.line(f"{fault:<28}{slower_s:>12.2f} s{standing_s:>14.2f} s")
    if RATES:
        terminalreporter.section("journal under a fault that lasts")
    for fault, per_minute in RATES:
        terminalreporter.line(f"{fault:<48}{per_minute:>6.0f} lines/min")


@pytest.fixture(scope="session")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    prepared = package_of_environment()
    assert prepared is not None
    folder = tmp_path_factory.mktemp("machine")
    shared = folder / "shared"
    shared.mkdir()
    made = Machine(*prepared, shared=shared, log=folder / "console.log")
    try:
        made.run("apt-get", "install", "--yes", made.package)
        made.run("systemctl", "stop", "yahboomd.service")
        yield made
    finally:
        made.close()


@pytest.fixture
def bench(machine: Machine) -> Iterator[Bench]:
    made = Bench(machine)
    made.begin()
    yield made
    made.end()
    # Its journal is for people to read, whatever was sent to it.
    words = "\n".join(text for _, text in made.journal())
    assert "Traceback" not in words, words


@pytest.fixture
def figure() -> FigureTaker:
    return FigureTaker()


@pytest.fixture
def rate() -> Callable[[str, float], None]:
    """Writes a measured rate into the table."""
    return lambda fault, per_minute: RATES.append((fault, per_minute))


class FigureTaker:
    """Writes a measured stop into the table."""

    def __call__(self, fault: str, measured: tuple[float, float]) -> None:
        FIGURES.append((fault, *measured))
