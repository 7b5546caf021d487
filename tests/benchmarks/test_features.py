from __future__ import annotations

import re
from pathlib import Path

from benchmarks.features import FEATURES
from yahboomd.core.drive.kinematics import KINEMATICS
from yahboomd.core.protocol.registry import DIALECTS

ROOT = Path(__file__).resolve().parents[2]
OURS = {what: ours for what, _, ours in FEATURES}


def test_every_feature_has_a_word_for_both_and_is_asked_once() -> None:
    assert all(all(row) for row in FEATURES)
    assert len(OURS) == len(FEATURES)


def test_dialects_and_geometries_are_those_of_the_registries() -> None:
    assert all(name in OURS["dialects of the board"] for name in DIALECTS)
    assert OURS["kinematics"] == ", ".join(name.replace("_", " ") for name in KINEMATICS)


def test_times_are_those_of_configuration_and_unit() -> None:
    defaults = (ROOT / "config.toml").read_text()
    teleop = defaults.partition('[command.sources."cmd_vel/teleop"]')[2]
    timeouts = [re.search(r"^timeout_s = (\S+)", text, re.MULTILINE) for text in (defaults, teleop)]
    assert [each and each[1] for each in timeouts] == ["0.5", "0.3"]
    assert "0.5 s, teleop 0.3 s" in OURS["commands end"]
    unit = (ROOT / "systemd" / "yahboomd.service").read_text()
    assert "WatchdogSec=2\n" in unit
    assert "2 s" in OURS["watchdog"]
