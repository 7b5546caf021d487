"""Fixtures of the tests of yahboomd itself, and those of its commands and of its page."""

from __future__ import annotations

import os

from command_fixtures import fake_daemon
from web_site import site

from tests.conftest import (
    no_ring_is_there,
    no_task_is_left_behind,
    patience,
    pytest_collection,
    pytest_collection_modifyitems,
    pytest_configure,
    pytest_pycollect_makeitem,
    real_robot,
    runtime_folder,
    tasks_end,
    virtual_time_run,
    zenoh_router,
)

__all__ = [
    "fake_daemon",
    "no_ring_is_there",
    "no_task_is_left_behind",
    "patience",
    "pytest_collection",
    "pytest_collection_modifyitems",
    "pytest_configure",
    "pytest_pycollect_makeitem",
    "real_robot",
    "runtime_folder",
    "site",
    "tasks_end",
    "virtual_time_run",
    "zenoh_router",
]

collect_ignore = [] if "YAHBOOMD_ANSIBLE" in os.environ else ["system"]
"""Robots in containers: only `make fleet-rollout` has them."""
