"""``yahboomd replay``: computes the poses of a black box again."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from yahboomd import __version__
from yahboomd.core.errors import ConfigError, YahboomdError

if TYPE_CHECKING:
    from yahboomd.blackbox.box_file import Box
    from yahboomd.tools.replay.replayed_poses import Compared, Estimated, PoseReplay

MCAP = b"\x89MCAP0"

COLUMNS = (
    *("wall_ns", "stamp_ns", "x", "y", "theta", "vx", "vy", "wz"),
    *("variance_x", "variance_y", "variance_theta"),
)
"""The columns of a table of poses: Unix and monotonic nanoseconds, metres, radians, seconds."""

DESCRIPTION = """\
Compute the poses of a black box again: its bytes become poses by the same code as in the daemon,
and are compared with the daemon's poses.
"""

EPILOG = """\
examples:
  yahboomd replay 12.blackbox --odometry
  yahboomd replay 12.blackbox --odometry --output poses.csv

exit status:
  0    the same poses as the daemon's, within 1e-9
  1    other poses or events than the daemon's
  65   no black box, or no pose can be computed from it
  66   the file cannot be read
  78   the output cannot be written
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("file", metavar="FILE", type=Path, help="a black box")
    parser.add_argument("--odometry", action="store_true", required=True, help="compute the poses")
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        help="write every pose: .csv, or .jsonl for a JSON object a line",
    )
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")


class Unplayable(YahboomdError):
    """No pose can be computed from a file."""

    exit_code = os.EX_DATAERR


class Unreadable(YahboomdError):
    """The file cannot be read."""

    exit_code = os.EX_NOINPUT


def run(args: argparse.Namespace) -> int:
    """Compute the poses, and compare them."""
    if args.output is not None and args.output.suffix not in {".csv", ".jsonl"}:
        raise ConfigError(
            f"--output {args.output}: its name has to end in .csv, or in .jsonl for a JSON object "
            "a line."
        )
    return _compute(_read(args.file), args)


def _read(path: Path) -> Box:
    from yahboomd.blackbox.box_file import NotABox, read_box
    from yahboomd.tools.blackbox.box_places import box_bytes

    try:
        with path.open("rb") as file:
            is_mcap = file.read(len(MCAP)) == MCAP
        data = b"" if is_mcap else box_bytes(path)
    except OSError as error:
        raise Unreadable(f"{path} cannot be read: {error.strerror}.") from error
    except NotABox as error:
        raise Unplayable(f"{path}: {error.message}") from error
    if is_mcap:
        raise Unplayable(
            f"{path} is an MCAP file, which has not all that a replay needs.",
            remedy="Name the black box itself: `yahboomd blackbox` shows which there are.",
        )
    try:
        box = read_box(data)
    except NotABox as error:
        raise Unplayable(f"{path}: {error.message}", remedy=error.remedy) from error
    if box.cut:
        print(f"{path} was cut off: its end is missing.", file=sys.stderr)
    if box.damaged:
        print(f"{path} is damaged: the part after the damage is missing.", file=sys.stderr)
    return box


def _compute(box: Box, args: argparse.Namespace) -> int:
    from yahboomd.core.odometry.snapshot import NotAState
    from yahboomd.tools.replay.replayed_poses import PoseReplay

    replay = PoseReplay(box.header)
    try:
        replay.run(box.records, damaged=box.damaged > 0)
    except NotAState as error:
        raise Unplayable(
            f"{args.file}: its odometry is that of yahboomd {box.header.version}, and this is "
            f"{__version__}.",
            remedy="Compute it with that version.",
        ) from error
    if not replay.estimates:
        raise Unplayable(
            f"{args.file}: no pose can be computed from it: no counts came after a state of the "
            "odometry.",
            remedy="`yahboomd blackbox explain` shows what happened instead.",
        )
    if args.output is not None:
        _write(args.output, replay.estimates)
    facts = _facts(box, replay)
    print(json.dumps(facts) if args.json else _words(facts, replay))
    return 0 if replay.compared.same else 1


def _write(path: Path, estimates: list[Estimated]) -> None:
    import msgspec

    lines: list[str] = []
    if path.suffix == ".csv":
        lines.append(",".join(COLUMNS))
        for wall_ns, each in estimates:
            pose, twist, spread = each.pose, each.twist, each.pose_covariance
            values = (
                *(wall_ns, each.stamp_ns, pose.x, pose.y, pose.theta),
                *(twist.vx, twist.vy, twist.wz, spread[0], spread[4], spread[8]),
            )
            lines.append(",".join(map(repr, values)))
    else:
        for wall_ns, each in estimates:
            line = {"wall_ns": wall_ns, **msgspec.to_builtins(each)}
            lines.append(msgspec.json.encode(line).decode())
    try:
        path.write_text("\n".join(lines) + "\n", encoding="ascii")
    except OSError as error:
        raise ConfigError(f"{path} cannot be written: {error.strerror}.") from error


def _facts(box: Box, replay: PoseReplay) -> dict[str, Any]:
    import msgspec

    first, last = replay.estimates[0], replay.estimates[-1]
    compared = replay.compared
    return {
        "estimates": len(replay.estimates),
        "seconds": round((last.estimate.stamp_ns - first.estimate.stamp_ns) * 1e-9, 3),
        "first": msgspec.to_builtins(first.estimate.pose),
        "last": msgspec.to_builtins(last.estimate.pose),
        "events": msgspec.to_builtins(replay.events),
        "same": compared.same,
        "compared": msgspec.to_builtins(compared),
        "version": box.header.version,
        "machine": box.header.machine,
    }


def _words(facts: dict[str, Any], replay: PoseReplay) -> str:
    first, last = replay.estimates[0].estimate.pose, replay.estimates[-1].estimate.pose
    lines = [
        f"{facts['estimates']} poses in {facts['seconds']:.1f} s",
        f"  from x {first.x:.4f} m, y {first.y:.4f} m, heading {first.theta:.4f} rad",
        f"  to   x {last.x:.4f} m, y {last.y:.4f} m, heading {last.theta:.4f} rad",
    ]
    lines += [f"  {event.severity}: {event.message}" for event in replay.events]
    lines += _verdict(replay.compared, facts["machine"])
    return "\n".join(lines)


def _verdict(compared: Compared, machine: str) -> list[str]:
    """Compare the poses with the daemon's, in sentences."""
    if not compared.moments:
        lines = ["There is nothing to compare with: the recording has no pose of the daemon's."]
    elif compared.identical == compared.moments:
        lines = [f"The same as the daemon's to the last bit ({compared.moments} compared)."]
    else:
        lines = [
            (
                f"The same as the daemon's to the last bit in {compared.identical} of "
                f"{compared.moments}; at most {compared.largest:.2g} m or rad apart."
            )
        ]
        if machine != platform.machine():
            lines.append(f"It was recorded on another kind of machine ({machine}).")
    lines += [
        f"The daemon published, and this did not: {each.message}" for each in compared.missing
    ]
    if compared.unmatched:
        lines.append(f"{compared.unmatched} readings of the daemon are not in its bytes.")
    if compared.restarts:
        lines.append(
            f"After missing records it went on from the daemon's next state "
            f"({compared.restarts} times)."
        )
    return lines
