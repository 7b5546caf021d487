"""Diagnoses, with advice."""

from __future__ import annotations

import getpass
import grp
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.errors import BoardSilent, LinkError, PortBusy, PortDenied, PortMissing
from yahboomd.core.link.discovery import Candidate
from yahboomd.core.link.line import ReceivedSample
from yahboomd.core.protocol.dialect import FramerCounters
from yahboomd.core.protocol.registry import unknown_dialect
from yahboomd.tools.stop.diagnosis import busy, hints, what_was_heard

NOWHERE = Path("/nonexistent/sysfs")


def heard(data: bytes) -> ReceivedSample:
    return ReceivedSample(start=data, counters=FramerCounters(bytes=len(data)))


def test_a_missing_port_names_those_that_are_there() -> None:
    gps = Candidate(path="/dev/ttyACM0", description="GPS", is_ch340=False, by_path=None)
    found = hints(PortMissing("gone."), "/dev/ttyUSB0", found=[gps], sysfs=NOWHERE)
    assert found == ("Serial ports that are there: /dev/ttyACM0.",)


def test_a_missing_port_on_a_machine_without_any_points_to_the_cable() -> None:
    (found,) = hints(PortMissing("gone."), "/dev/ttyUSB0", sysfs=NOWHERE)
    assert "cable" in found
    assert "dmesg" in found


def test_a_dangling_link_names_where_it_points(tmp_path: Path) -> None:
    link = tmp_path / "board"
    link.symlink_to("/dev/nowhere")
    found = hints(PortMissing("gone."), str(link), sysfs=NOWHERE)
    assert found[0] == f"{link} is a link to /dev/nowhere, which is not there."


def test_a_device_without_a_tty_is_the_likeliest_reason(tmp_path: Path) -> None:
    folder = tmp_path / "1-2"
    folder.mkdir()
    (folder / "idVendor").write_text("1a86\n")
    (folder / "idProduct").write_text("7523\n")
    found = hints(PortMissing("gone."), "/dev/ttyUSB0", sysfs=tmp_path)
    assert "ch341" in found[0]
    assert hints(PortMissing(f"gone. {found[0]}"), "", sysfs=tmp_path) == ()


def test_a_denied_port_names_the_group_to_join(tmp_path: Path) -> None:
    port = tmp_path / "port"
    port.touch()
    foreign = next((each for each in grp.getgrall() if _is_foreign(each)), None)
    if foreign is None or os.geteuid() != 0:
        pytest.skip("only root can give a file to a group that it is not in")
    os.chown(port, -1, foreign.gr_gid)
    port.chmod(0o660)
    (found,) = hints(PortDenied("no."), str(port))
    assert f"sudo usermod -aG {foreign.gr_name} {getpass.getuser()}" in found


def _is_foreign(group: grp.struct_group) -> bool:
    gids = {os.getegid(), *os.getgroups()}
    return group.gr_gid not in gids and getpass.getuser() not in group.gr_mem


def test_a_denied_port_of_ones_own_group_asks_for_another_reason(tmp_path: Path) -> None:
    port = tmp_path / "port"
    port.touch()
    port.chmod(0o660)
    (found,) = hints(PortDenied("no."), str(port))
    assert "something else forbids it" in found
    port.chmod(0o600)
    (found,) = hints(PortDenied("no."), str(port))
    assert "udev rule" in found


def test_known_holders_come_with_their_remedy() -> None:
    assert "apt remove brltty" in busy(("brltty (pid 5)",))[0]
    assert "ModemManager" in busy(("ModemManager (pid 5)",))[0]
    assert "yahboomd stop" in busy(("yahboomd (pid 5)",))[0]
    assert len(busy(("brltty (pid 5)", "brltty (pid 6)", "yahboomd (pid 7)"))) == 2
    assert busy(("minicom (pid 5)",)) == ()
    assert "fuser" in busy(())[0]
    assert "fuser" in hints(PortBusy("held."), "/nonexistent")[0]


def test_silence_points_to_power_and_reset() -> None:
    words = what_was_heard(heard(b""))
    assert "No byte came" in words
    assert "RTS" in words


def test_text_of_another_device_is_quoted() -> None:
    words = what_was_heard(heard(b"$GPGGA,123519,4807.038,N\r\n$GPGGA,123520"))
    assert "another device" in words
    assert "$GPGGA,123519" in words


def test_noise_points_to_the_baud_rate() -> None:
    words = what_was_heard(heard(bytes(range(128, 256))))
    assert "another baud rate than the board's 115200," in words


def test_other_errors_have_no_hint_but_the_list_of_ports() -> None:
    assert "--list" in hints(LinkError("odd."), "/dev/null")[0]
    assert hints(BoardSilent("silent."), "/dev/x") == ()


def test_a_clone_is_no_bad_cable_and_another_reader_no_silent_board() -> None:
    words = what_was_heard(heard(b"\x00$pwm+OK\r\nmtype+OK"), "read by cat.")
    assert "'pwm+OK': it speaks a dialect that yahboomd does not know" in words
    assert what_was_heard(heard(b""), "/dev/x is also open in cat (pid 5).").endswith("(pid 5).")
    assert not unknown_dialect(b"Set mtype:OK!\r\nOK+B9600")


@given(st.binary(max_size=600))
def test_whatever_was_heard_is_said_in_printable_words(data: bytes) -> None:
    assert what_was_heard(heard(data)).isprintable()
