from __future__ import annotations

import pytest
from command_fixtures import patience
from fake_daemon import fake_daemon
from fake_zenoh import fake_zenoh

from yahboomd.core import program

__all__ = ["fake_daemon", "fake_zenoh", "patience"]


@pytest.fixture(autouse=True)
def _is_on_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands in texts are named as where yahboomd is on the PATH, wherever the tests run."""
    monkeypatch.setattr(program, "name", lambda: "yahboomd")
