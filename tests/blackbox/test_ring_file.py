"""The file of a ring: made whole, locked while its daemon lives, found when it is left."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from yahboomd.blackbox.box_file import encode_header, read_box
from yahboomd.blackbox.records import Ended, Received, encode
from yahboomd.blackbox.ring_file import (
    LEFT_MOST,
    SEGMENTS,
    RingFile,
    is_live,
    left_rings,
    ring_folder,
    rings,
    set_aside,
    sweep_folders,
)


def note(file: RingFile, data: bytes = b"$MAll:1,2,3,4#\r\n") -> None:
    file.ring.write(*encode(Received(data=data)), 5)


def test_what_is_recorded_is_in_the_file_at_once(tmp_path, header):
    file = RingFile(tmp_path, header)
    note(file)
    (path,) = rings(tmp_path)
    found = read_box(path.read_bytes())
    assert [each.meaning for each in found.records] == [Received(data=b"$MAll:1,2,3,4#\r\n")]
    assert found.header == header
    assert len(file.segments()) == SEGMENTS * header.segment_bytes
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    file.close(keep=False)
    assert rings(tmp_path) == []
    # A record that comes late harms nothing.
    note(file)


def test_the_ring_of_a_running_daemon_is_left_alone_and_that_of_a_dead_one_is_found(
    tmp_path, header
):
    file = RingFile(tmp_path, header)
    note(file)
    (path,) = rings(tmp_path)
    assert is_live(path)
    with left_rings(tmp_path) as (left, _):
        assert left == []
    file.close(keep=True)
    assert not is_live(path)
    with left_rings(tmp_path) as (left, _):
        (ring,) = left
        assert ring.reasons == ("killed",)
        # Two daemons that start do not save it twice.
        with left_rings(tmp_path) as (others, _):
            assert others == []
        ring.remove()
    assert rings(tmp_path) == []
    assert not is_live(path)


def test_a_ring_that_was_not_saved_says_why_it_is_to_be(tmp_path, header):
    file = RingFile(tmp_path, header)
    file.ring.write(*encode(Ended(reasons=("crash", "estop"), error="RuntimeError: x")), 5)
    note(file)
    file.close(keep=True)
    with left_rings(tmp_path) as (left, _):
        assert left[0].reasons == ("crash", "estop")


def test_two_daemons_of_one_user_have_a_ring_each(tmp_path, header):
    one, other = RingFile(tmp_path, header), RingFile(tmp_path, header)
    note(one, b"one")
    note(other, b"other")
    found = {read_box(path.read_bytes()).records[0].meaning.data for path in rings(tmp_path)}
    assert found == {b"one", b"other"}
    one.close(keep=False)
    other.close(keep=False)


def test_a_daemon_that_fails_at_each_start_leaves_a_few_rings_the_first_among_them(
    tmp_path, header
):
    for number in range(10):
        file = RingFile(tmp_path, header)
        note(file, b"%d" % number)
        file.close(keep=True)
        path = next(each for each in rings(tmp_path) if each.stat().st_mtime > 1_000_000)
        os.utime(path, (number, number))
    with left_rings(tmp_path) as (left, _):
        kept = [read_box(ring.data).records[0].meaning.data for ring in left]
    assert kept == [b"0", b"7", b"8", b"9"]
    assert len(rings(tmp_path)) == LEFT_MOST


FULL = """
import os, sys
from pathlib import Path
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10000, 10000))
sys.path.insert(0, "tests/plugins")
from made_boxes import HEADER
from yahboomd.blackbox.ring_file import RingFile
try:
    RingFile(Path(sys.argv[1]), HEADER)
except OSError as error:
    print(error.errno)
"""


@pytest.mark.nightly
def test_a_lack_of_room_is_an_error_at_the_start_and_no_signal_later(tmp_path):
    """A store into a file without room would end the daemon by SIGBUS."""
    ran = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert int(ran.stdout) == errno.EFBIG, ran.stderr
    assert list(tmp_path.iterdir()) == []


def test_rings_are_in_memory_and_never_on_a_disk(tmp_path):
    in_memory = Path("/dev/shm/yahboomd-test")
    assert ring_folder(in_memory, 5) == in_memory
    # Each runtime folder has a place of its own.
    places = {ring_folder(Path("/proc/no/such"), 5), ring_folder(Path("/proc/no/other"), 5)}
    assert len(places) == 2
    assert {place.parent for place in places} == {Path("/dev/shm")}


def test_what_is_no_ring_is_left_alone(tmp_path, header):
    (tmp_path / "estop").write_text("{}")
    (tmp_path / "other.ring").write_text("")
    (tmp_path / "blackbox-link.ring").symlink_to(tmp_path / "estop")
    with left_rings(tmp_path) as (left, _):
        assert left == []
    assert (tmp_path / "estop").exists()


@pytest.mark.cases(2)
@pytest.mark.parametrize("cut", ["truncated", "emptied", "overwritten", "removed"])
def test_a_file_that_another_process_cuts_costs_records_only(tmp_path, header, cut):
    """A mapping of it would end the process (SIGBUS)."""
    file = RingFile(tmp_path, header)
    note(file, b"before")
    (path,) = rings(tmp_path)
    if cut == "truncated":
        os.truncate(path, 4096)
    elif cut == "emptied":
        path.write_bytes(b"")
    elif cut == "overwritten":
        path.write_bytes(b"x" * 100)
    else:
        path.unlink()
    for number in range(SEGMENTS * header.segment_bytes // 50):
        note(file, b"%50d" % number)
    # Later records are in the saved copy, once a new segment has begun.
    box = read_box(encode_header(header) + file.segments())
    assert box.records[-1].meaning == Received(data=b"%50d" % number)
    file.close(keep=False)


def strange_thing(folder: Path, kind: str) -> None:
    path = folder / "blackbox-00000000.ring"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "link":
        path.symlink_to(folder / "nothing")
    elif kind == "huge":
        path.write_bytes(b"")
        os.truncate(path, 8 << 30)
    else:
        os.mknod(path, stat.S_IFSOCK | 0o600)


@pytest.mark.cases(2)
@pytest.mark.parametrize("kind", ["pipe", "folder", "link", "huge", "socket"])
def test_what_only_has_the_name_of_a_ring_is_not_read(tmp_path, header, kind):
    strange_thing(tmp_path, kind)
    file = RingFile(tmp_path, header)
    file.close(keep=True)
    with left_rings(tmp_path) as (left, strange):
        assert len(left) == 1
        assert [path.name for path in strange] == ["blackbox-00000000.ring"]
    set_aside(strange[0])
    assert len(rings(tmp_path)) == 1
    assert not is_live(strange[0])


def test_folders_of_other_daemons_are_removed_when_they_are_a_day_old(header):
    user, now_ns, day_s = os.getuid(), time.time_ns(), 86_400
    own, empty, old, new = (
        Path(f"/dev/shm/yahboomd-{user}-test{os.getpid()}{letter}") for letter in "abcd"
    )
    try:
        for folder in (own, empty, old, new):
            folder.mkdir()
        for folder in (own, old, new):
            RingFile(folder, header).close(keep=True)
        for path in (*own.iterdir(), *old.iterdir(), own, empty, old):
            os.utime(path, (now_ns / 1e9 - 2 * day_s,) * 2)
        sweep_folders(own, user, now_ns)
        assert [each.exists() for each in (own, empty, old, new)] == [True, False, False, True]
        for folder in (own, new):
            with left_rings(folder) as (left, _):
                left[0].remove()
        # Without a ring the folder goes, too.
        assert not own.exists()
        assert not new.exists()
    finally:
        for folder in (own, empty, old, new):
            shutil.rmtree(folder, ignore_errors=True)
