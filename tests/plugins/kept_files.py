"""Everything that yahboomd keeps on a disk, written in steps, and read as its own readers read it.

As a program it writes all of it below a folder, and marks each step for the record of its calls.
"""

from __future__ import annotations

import json
import os
import sys
import tomllib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from cut_disk import MARK
from made_boxes import saved_box
from made_calibrations import calibration

from yahboomd.blackbox.box_file import read_box
from yahboomd.blackbox.records import Written
from yahboomd.blackbox.saved_boxes import save_box, saved_boxes
from yahboomd.core.config.calibration_file import read_calibration
from yahboomd.core.daemon.estop.latch_file import LatchFile
from yahboomd.tools.calibrate.calibration_writing import undo_calibration, write_calibration
from yahboomd.tools.record.cut_files import Cut, parts, read_from_front
from yahboomd.tools.record.mcap_files import METADATA, ROS, Channel, McapFiles
from yahboomd.tools.setup.robot_file import write_robot
from yahboomd.tools.tune.saved import SavedSettings, finish, read_saved, remove, save
from yahboomd.web.session_files import PREFIX as SESSION
from yahboomd.web.session_files import StoredSession, end_stored, keep, replace, stored_sessions

ROBOT = '[serial]\nport = "/dev/ttyUSB{}"\n'
SETTINGS = SavedSettings(made="then", port="", dialect="streamed", settings={"deadzone": 1600})
"""The board's own, before a tuning."""


class Kept(NamedTuple):
    """Files of one kind.

    Attributes:
        steps: Each changes them, and has done so once it returns.
        read: What a reader has of them, as JSON would; it raises nothing.
        fits: Whether this may be found, by what was there before the step of the cut and after it.
    """

    steps: tuple[Callable[[Path], object], ...]
    read: Callable[[Path], Any]
    fits: Callable[[Any, Any, Any], bool] = lambda found, before, after: found in (before, after)


def _calibrated(folder: Path) -> list[float | None]:
    """The multiplier of the newest one, and of the one before it; None for one that is absent."""
    return [
        read_calibration(path).chassis.wheel_separation_multiplier if path.exists() else None
        for path in (folder / "calibration.toml", folder / "calibration.previous.toml")
    ]


def _one_calibration_is_used(found: Any, before: Any, after: Any) -> bool:
    return found[:1] in (before[:1], after[:1])


def _text(name: str) -> Callable[[Path], Any]:
    def read(folder: Path) -> Any:
        with suppress(FileNotFoundError):
            return tomllib.loads((folder / name).read_text())
        return None

    return read


def _session(name: str) -> StoredSession:
    return StoredSession(role="driver", name=name, key="0" * 64, made_s=0)


def _let_in(folder: Path) -> None:
    keep(folder, f"{SESSION}3f9a2c", msgspec.json.encode(_session("Android phone")))


def _sessions(folder: Path) -> list[str]:
    return [stored.name for _, stored, _ in stored_sessions(folder)]


def _tuned(folder: Path) -> Any:
    found = read_saved(folder / "before-tune.json")
    return found and [found.settings, found.finished]


def _boxes(folder: Path) -> list[int]:
    boxes = [read_box(box.path.read_bytes()) for box in saved_boxes(folder)]
    assert not any(box.damaged or box.cut for box in boxes)
    return [len(box.records) for box in boxes]


def _save_box(folder: Path, count: int) -> None:
    box = saved_box(*((1.0 + n, Written(data=os.urandom(200))) for n in range(count)))
    save_box(folder, box, reason="estop", wall_ns=count)


_FILES: list[McapFiles] = []


def _record(folder: Path) -> None:
    """Forty seconds of a topic, and the sync that `yahboomd record` makes now and then."""
    if not _FILES:
        _FILES.append(McapFiles(folder, ROS, split_bytes=60_000, is_bag=True))
    begin = _FILES[0].messages
    for number in range(begin, begin + 2000):
        # A content that shrinks little.
        data = number.to_bytes(4, "big") + os.urandom(40)
        channel = Channel("/odom", "cdr", "nav_msgs/msg/Odometry", "ros2msg", "float64 x")
        _FILES[0].write(channel, data, logged_ns=number + 1, published_ns=1, sequence=number)
    _FILES[0].sync()


def _recorded(folder: Path) -> int:
    """The messages from the front, which are all until there are no more."""
    found: list[int] = []
    for part in parts(folder, ROS):
        with suppress(Cut):
            found += (message.sequence for _, _, message in read_from_front(part))
    assert found == list(range(len(found)))
    with suppress(FileNotFoundError):
        text = (folder / METADATA).read_text()
        assert text.startswith("rosbag2_bagfile_information:")
        assert text.rstrip("\n").rpartition("\n")[2].startswith("      message_count: ")
    return len(found)


KEPT = {
    "the calibration": Kept(
        (
            lambda folder: write_calibration(folder / "calibration.toml", calibration(1.05)),
            lambda folder: write_calibration(folder / "calibration.toml", calibration(1.07)),
            lambda folder: write_calibration(folder / "calibration.toml", calibration(1.09)),
            lambda folder: undo_calibration(folder / "calibration.toml"),
        ),
        _calibrated,
        _one_calibration_is_used,
    ),
    "an engaged emergency stop, in a file on a disk": Kept(
        (
            lambda folder: LatchFile(folder / "estop").engage("a person"),
            lambda folder: LatchFile(folder / "estop").engage("another"),
        ),
        lambda folder: LatchFile(folder / "estop").load() is not None,
    ),
    "the configuration that `setup` writes": Kept(
        tuple(
            lambda folder, n=n: write_robot(
                folder / "robot.toml", ROBOT.format(n), overwrite=bool(n)
            )
            for n in range(3)
        ),
        _text("robot.toml"),
    ),
    "the board's own values during a tuning": Kept(
        (
            lambda folder: save(folder / "before-tune.json", SETTINGS),
            lambda folder: finish(folder / "before-tune.json", SETTINGS),
            lambda folder: remove(folder / "before-tune.json"),
        ),
        _tuned,
    ),
    "the session of a phone": Kept(
        (
            _let_in,
            lambda folder: replace(folder, "3f9a2c", _session("Anne")),
            lambda folder: end_stored(folder, "3f9a2c"),
        ),
        _sessions,
    ),
    "black boxes": Kept(
        tuple(lambda folder, n=n: _save_box(folder, n) for n in (5, 20, 50)),
        _boxes,
    ),
    "a recording": Kept(
        (_record, _record, _record, lambda _: _FILES[0].end()),
        _recorded,
        lambda found, before, after: before <= found <= after,
    ),
}


def write_all(root: Path) -> None:
    """Write all of it, and what readers have after each step beside the folder."""
    values: dict[str, list[Any]] = {}
    for name, kept in KEPT.items():
        folder = root / str(len(values))
        folder.mkdir(parents=True, mode=0o700)
        values[name] = [kept.read(folder)]
        for step in kept.steps:
            step(folder)
            values[name].append(kept.read(folder))
            with suppress(FileNotFoundError):
                os.open(f"{MARK}-{len(values) - 1}", os.O_RDONLY)
    root.with_name("values.json").write_text(json.dumps(values))


if __name__ == "__main__":
    write_all(Path(sys.argv[1]))
