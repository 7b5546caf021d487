"""A report in lines that a newcomer understands."""

from __future__ import annotations

import msgspec

from yahboomd.core.link.discovery import Candidate
from yahboomd.tools.probe.probe_report import Report, SettingRow
from yahboomd.tools.probe.probe_text import (
    NOT_READY,
    READY,
    listing,
    text,
    verdict,
)

FOUND = Report(
    port="/dev/yahboom_driver",
    device="/dev/ttyUSB0",
    dialect="streamed",
    firmware="1.7.3",
    volts=7.44,
    ticks=(1, -2, 3, 4),
    standing=True,
    reopen="kept",
    profile="310",
    settings=(
        SettingRow(name="motor type", command="mtype", have=1, want=2, differs=True),
        SettingRow(name="gear ratio", command="mphase", have=30, want=20.409, differs=True),
        SettingRow(name="wheel diameter", command="wdiameter", have=48.0, want=48, differs=False),
        SettingRow(name="gains", command="MPID", have=(0.8, 0.06, 0.5), want=None, differs=False),
    ),
)


def test_facts_stand_in_lines_of_their_own() -> None:
    lines = text(FOUND)
    assert lines[0] == "port        /dev/yahboom_driver -> /dev/ttyUSB0"
    assert "streamed dialect, firmware 1.7.3" in lines[1]
    assert lines[2] == "supply      7.4 V"
    assert lines[3] == "counters    M1 1   M2 -2   M3 3   M4 4"
    assert lines[4] == "wheels      standing"
    assert lines[5] == "reopening   the counters survive closing and opening the port"


def test_settings_stand_beside_the_profile() -> None:
    table = text(FOUND)[7:]
    assert table[0].split() == ["stored", "value", "board", "profile", "310"]
    assert table[1].split() == ["motor", "type", "1", "(520)", "2", "(310)", "differs"]
    assert "20 (truly 20.409)" in table[2]
    assert table[3].endswith("48 mm")
    assert table[4].endswith("0.8, 0.06, 0.5   left as it is")
    assert (
        len({line.index(word) for line, word in zip(table[1:3], ("2 (", "20 ("), strict=True)}) == 1
    )


def test_differences_alone_leave_the_board_ready() -> None:
    lines = verdict(FOUND)
    assert lines[0] == READY
    assert "2 values differ" in lines[1]
    assert "probe --write" in " ".join(lines)


def test_a_problem_comes_before_advice_and_denies_it() -> None:
    lines = verdict(msgspec.structs.replace(FOUND, problems=("Zero lines.",), advice=("Charge.",)))
    assert lines == [NOT_READY, "  - Zero lines.", "  - Charge."]


def test_ports_are_listed_with_the_name_that_stays() -> None:
    ports = [
        Candidate(path="/dev/ttyUSB0", description="USB", is_ch340=True, by_path="/dev/by/1"),
        Candidate(path="/dev/ttyUSB1", description="USB", is_ch340=True, by_path="/dev/by/2"),
        Candidate(path="/dev/ttyACM0", description="GPS", is_ch340=False, by_path=None),
    ]
    lines = listing(ports, "/dev/yahboom_driver", "/dev/ttyUSB1")
    assert lines[1].endswith("/dev/by/1")
    assert "CH340" in lines[1]
    assert lines[2].endswith("/dev/yahboom_driver")
    assert lines[3].split() == ["/dev/ttyACM0", "GPS"]
    assert listing([], "/dev/yahboom_driver", "") == [
        "No serial port is on USB, nor on the computer itself."
    ]
