"""extras/fleet/ansible, as far as it can be read without Ansible; `make fleet-rollout` runs it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

ROLES = Path(__file__).resolve().parents[1] / "ansible"
FILES = sorted(ROLES.rglob("*.yml"))
KEYWORDS = {
    *("name", "when", "vars", "register", "until", "retries", "delay", "diff", "check_mode"),
    *("changed_when", "failed_when", "ignore_errors", "ignore_unreachable", "loop", "loop_control"),
}


def steps(entries: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Each task, those of blocks too."""
    for entry in entries:
        if "block" in entry:
            yield from steps([*entry["block"], *entry["rescue"]])
        elif "hosts" in entry:
            yield from steps(entry.get("tasks", []))
        else:
            yield entry


def read(path: Path) -> Any:
    return YAML(typ="safe").load(path.read_text())


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROLES)))
def test_each_task_has_a_name_and_one_module_which_ansible_core_brings(path: Path) -> None:
    if path.parent.name == "defaults":
        assert isinstance(read(path), dict)
        return
    for step in steps(read(path)):
        modules = set(step) - KEYWORDS
        assert "name" in step, step
        assert len(modules) == 1, step
        assert modules.pop().startswith("ansible.builtin."), step


def test_every_robot_play_ends_after_the_first_bad_wave() -> None:
    plays = {play["hosts"]: play for play in read(ROLES / "rollout.yml") if "roles" in play}
    assert set(plays) == {"routers", "robots"}
    for play in plays.values():
        assert play["serial"]
        assert play["max_fail_percentage"] == 0
        assert (ROLES / "roles" / play["roles"][0] / "tasks/main.yml").exists()


def test_no_task_that_copies_a_key_shows_its_difference() -> None:
    copied = [
        (step["ansible.builtin.copy"]["src"], step.get("diff"))
        for path in FILES
        if path.parent.name == "tasks"
        for step in steps(read(path))
        if "ansible.builtin.copy" in step
    ]
    files = {source: diff for source, diff in copied if not source.endswith("yahboomd_suffix }}")}
    # There and back, on robots and routers.
    assert len(files) == 4
    assert set(files.values()) == {False}
