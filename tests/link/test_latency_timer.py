"""A chip that holds received bytes back, as sysfs shows it."""

from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.core.link import latency_timer
from yahboomd.core.link.latency_timer import describe, latency_ms


@pytest.fixture
def sysfs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(latency_timer, "SYSFS", tmp_path / "sys")
    return tmp_path / "sys"


def chip(sysfs: Path, name: str, timer: str | None) -> None:
    (sysfs / name).mkdir(parents=True)
    if timer is not None:
        (sysfs / name / "latency_timer").write_text(timer)


def test_the_timer_of_an_ftdi_chip_is_named_with_the_line_that_sets_it(
    sysfs: Path, tmp_path: Path
) -> None:
    chip(sysfs, "ttyUSB3", "16\n")
    link = tmp_path / "yahboom_driver"
    link.symlink_to("/dev/ttyUSB3")
    words = describe(str(link))
    assert words is not None
    assert f"{link}: its USB-serial chip keeps what it has received for up to 16 ms" in words
    assert words.splitlines()[1:] == [
        'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'
    ]


def test_a_timer_that_is_set_already_is_not_mentioned(sysfs: Path) -> None:
    chip(sysfs, "ttyUSB0", "1\n")
    assert latency_ms("/dev/ttyUSB0") == 1
    assert describe("/dev/ttyUSB0") is None


@pytest.mark.parametrize("timer", [None, "", "soon\n"])
def test_a_chip_without_one_as_the_ch340_is_not_mentioned(sysfs: Path, timer: str | None) -> None:
    chip(sysfs, "ttyUSB0", timer)
    assert latency_ms("/dev/ttyUSB0") is None
    assert describe("/dev/ttyUSB0") is None


def test_what_is_not_on_usb_has_none(sysfs: Path) -> None:
    assert describe("/dev/ttyTHS1") is None
