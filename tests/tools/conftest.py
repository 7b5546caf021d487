from __future__ import annotations

from command_fixtures import (
    _is_on_the_path,
    fake_daemon,
    on_robot,
    one_robot,
    patience,
    pytest_runtest_teardown,
    simulated_board,
    terminal,
    yahboomd,
)

__all__ = [
    "_is_on_the_path",
    "fake_daemon",
    "on_robot",
    "one_robot",
    "patience",
    "pytest_runtest_teardown",
    "simulated_board",
    "terminal",
    "yahboomd",
]
