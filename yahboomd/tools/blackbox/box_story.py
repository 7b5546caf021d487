"""Tells a black box in plain words: why the robot stopped, and the events before."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from datetime import UTC, datetime
from operator import itemgetter
from typing import NamedTuple

from yahboomd.blackbox import records
from yahboomd.blackbox.box_file import Box, settings_of
from yahboomd.blackbox.records import Record
from yahboomd.core.model import NS_PER_S, EventKind
from yahboomd.core.program import plain
from yahboomd.core.protocol.registry import DIALECTS

SILENT_NS = 300_000_000
"""A board sends, or is asked to send, twenty times in this time."""

REASONS = {
    "estop": "an emergency stop",
    "runaway": "a wheel that ran away",
    "fault": "a fault",
    "disconnected": "the loss of the board",
    "crash": "a fault of yahboomd itself",
    "killed": "the daemon was killed",
    "asked": "somebody asked for it",
}


MOVES_SOURCE, MOVES_LABEL = "cmd_vel/moves (", "moves of "
"""How the end of moves is recorded: as ``cmd_vel/moves (moves of NAME: REASON)``."""

MOVE_ENDS = {
    "reached": "their goal was reached",
    "cancelled": "a client cancelled them",
    "client_silent": "the client that asked fell silent",
    "client_gone": "the client that asked left",
    "taken_over": "another source drove",
    "estop": "the emergency stop was engaged",
    "fault": "the daemon refused motion",
    "board_lost": "the board was lost",
    "daemon_lost": "the daemon was lost",
    "no_pose": "no pose came",
    "pose_changed": "the pose was set or bridged",
    "blocked": "the base was commanded and hardly moved",
    "slipping": "the wheels turned the base, and the gyro did not see it turn",
    "exchanged": "the wheels turned the base one way and the gyro the other: exchanged plugs",
    "uncertain": "the place was too uncertain",
    "not_obeyed": "the daemon did not drive for them",
    "short": "small commands did not move the base to its goal",
    "service_ended": "`yahboomd moves` was stopped",
}


class StoryLine(NamedTuple):
    """A line of the story.

    Attributes:
        what: The kind: ``event``, ``state``, ``command``, ``board``, ``sent``, ``daemon``.
    """

    at_ns: int
    what: str
    words: str


class Story(NamedTuple):
    """A box in words.

    Attributes:
        end_ns: When the box was saved, or its record ended; monotonic nanoseconds.
        end: The name of that moment: ``the save`` or ``the end``.
        why: Why the robot stopped last.
    """

    end_ns: int
    end: str
    why: str
    lines: list[StoryLine]


def story(box: Box) -> Story:
    """Tell a box in words."""
    saved = box.header.saved
    newest_ns = box.records[-1].at_ns if box.records else box.header.started_ns
    end_ns, end = (saved.at_ns, "the save") if saved and saved.at_ns else (newest_ns, "the end")
    lines = sorted(
        [*_said(box.records), *_commands(box.records), *_silences(box.records, end_ns)],
        key=lambda line: line.at_ns,
    )
    return Story(end_ns, end, _why(box.records, end_ns, end), lines)


def before(at_ns: int, end_ns: int, end: str) -> str:
    """``12.41 s before the save``."""
    return f"{(end_ns - at_ns) / NS_PER_S:.2f} s before {end}"


def wall_clock(box: Box) -> Callable[[int], int]:
    """A function from moments of a box to Unix nanoseconds, by the last clock reading before."""
    started = box.header.started_ns, box.header.started_wall_ns
    readings = [
        (record.at_ns, record.meaning.wall_ns)
        for record in box.records
        if isinstance(record.meaning, records.WallClock)
    ]

    def wall_clock_ns(at_ns: int) -> int:
        before = bisect_right(readings, at_ns, key=itemgetter(0))
        mono_ns, wall_ns = readings[before - 1] if before else started
        return wall_ns + at_ns - mono_ns

    return wall_clock_ns


def utc(wall_ns: int) -> str:
    """``2026-11-22 17:35:30.25 UTC``."""
    moment = datetime.fromtimestamp(wall_ns / NS_PER_S, UTC)
    return f"{moment:%Y-%m-%d %H:%M:%S}.{moment.microsecond // 10_000:02} UTC"


def summary(box: Box) -> str:
    """Whose record this is, from when to when, and why it was saved."""
    header = box.header
    first_ns = box.records[0].at_ns if box.records else header.started_ns
    last_ns = box.records[-1].at_ns if box.records else header.started_ns
    name = plain(str(settings_of(header, "zenoh").get("namespace", "")))
    port = plain(str(settings_of(header, "serial").get("port", "")))
    robot = (name and f", robot {name}") + (port and f", board on {port}")
    reasons = header.saved.reasons if header.saved else ("it is not saved yet",)
    why = ", then ".join(REASONS.get(reason, reason) for reason in reasons)
    wall_clock_ns = wall_clock(box)
    from_to = f"{utc(wall_clock_ns(first_ns))} to {utc(wall_clock_ns(last_ns))}"
    words = [
        f"yahboomd {header.version}{robot}, process {header.pid}",
        f"{from_to}: {(last_ns - first_ns) / NS_PER_S:.1f} s, {len(box.records)} records",
        f"saved for: {why}" if header.saved else "the ring of a daemon, not saved yet",
    ]
    if box.cut:
        words.append("the file was cut off: its end is missing")
    if box.damaged:
        words.append(f"damaged in {box.damaged} of its segments: a part is missing")
    return "\n".join(words)


def last_stop(every: list[Record]) -> Record | None:
    """The last decision that stopped the robot; None if it drives at the end, or never drove."""
    stops, driving = _stops(every)
    return stops[-1] if stops and not driving else None


def _stops(every: list[Record]) -> tuple[list[Record], bool]:
    """Each decision that stopped the robot, and whether it drives at the end."""
    driving, stops = False, list[Record]()
    for record in every:
        if isinstance(record.meaning, records.DecisionRecord):
            drives = record.meaning.state == "driving"
            if driving and not drives:
                stops.append(record)
            driving = drives
    return stops, driving


def _why(every: list[Record], end_ns: int, end: str) -> str:
    """Why the robot stands or crawls, and why it stopped unasked before that."""
    stops, driving = _stops(every)
    newest = next((each for each in reversed(every) if _words(each)), None)
    last = "" if newest is None else _words(newest)
    if not stops and not driving:
        return "It did not drive in the time that is recorded." + (last and f" Its state: {last}")

    def placed(record: Record) -> str:
        moment = before(record.at_ns, end_ns, end)
        return f"{moment}: {' '.join([_words(record), *_reported(every, record)])}"

    if driving:
        plainly = last.endswith(" drives.") and last.count(" ") == 1
        found = ["It drives to the end of the record." if plainly else f"It drives: {last}"]
    else:
        stop = stops.pop()
        found = [f"It stopped {placed(stop)}", *_moves_end(every, stop)]
        stops = stops if _ordered(stop) else []
        held = newest is not None and _is_held(newest) and ORDERLY_END not in last
        if held and not (_words(stop) in last or last in _words(stop)):
            found.append(f"Later: {last}")
    if unasked := [each for each in stops if not _ordered(each)]:
        found.append(f"Before that it stopped {placed(unasked[-1])}")
    return " ".join(found)


ORDERLY_END = "The connection to the board is being ended"

_ORDERED = ("commands zero and keeps control", "ended with a zero command", ORDERLY_END)
"""Words in the reasons of stops that a command, or the end of the daemon, asked for."""

_CAUSES: tuple[EventKind, ...] = (
    *("board_reset", "reset_loop", "board_unfit", "unguarded", "disconnected"),
    *("paused", "line_noisy", "runaway_against", "runaway_fast", "turns_without_command"),
    *("no_counts", "stop_not_obeyed"),
)
"""Events that explain a stop which shows otherwise only as a symptom, such as missing counts."""

_REPORTED_NS = (NS_PER_S // 2, 3 * NS_PER_S)
"""The time before and after a stop; a board reports a reset only once it has started again."""


def _words(record: Record) -> str:
    meaning = record.meaning
    return plain(meaning.why) if isinstance(meaning, records.DecisionRecord) else ""


def _is_held(record: Record) -> bool:
    """Whether something other than its commands keeps the robot from driving."""
    meaning = record.meaning
    held = ("waiting", "fault", "estopped")
    return isinstance(meaning, records.DecisionRecord) and meaning.state in held


def _ordered(stop: Record) -> bool:
    return any(each in _words(stop) for each in _ORDERED)


def _reported(every: list[Record], stop: Record) -> list[str]:
    """At most two events near a stop that explain it and are not in its own reason."""
    if _ordered(stop):
        return []
    earliest_ns, latest_ns = stop.at_ns - _REPORTED_NS[0], stop.at_ns + _REPORTED_NS[1]
    said = [
        plain(record.meaning.event.message)
        for record in every
        if isinstance(record.meaning, records.Happened)
        and record.meaning.event.kind in _CAUSES
        and earliest_ns <= record.at_ns <= latest_ns
    ]
    return [each for each in dict.fromkeys(said) if each not in _words(stop)][:2]


def _moves_end(every: list[Record], stop: Record) -> list[str]:
    """Why moves ended, and whose, where their end is the stop."""
    for at_ns, meaning in reversed(every):
        if at_ns > stop.at_ns or not isinstance(meaning, records.CommandRecord):
            continue
        _, found, label = meaning.source.partition(f"{MOVES_SOURCE}{MOVES_LABEL}")
        if not found or stop.at_ns - at_ns > NS_PER_S:
            return []
        name, _, reason = plain(label.removesuffix(")")).rpartition(": ")
        return [f"These were the moves of {name}: {MOVE_ENDS.get(reason, reason)} ({reason})."]
    return []


def _said(every: list[Record]) -> list[StoryLine]:
    """The lines for events, decisions, connections, and stops that were sent."""
    lines = []
    dialect, sent, decision = "", "", None
    for at_ns, meaning in every:
        match meaning:
            case records.Happened():
                lines.append(StoryLine(at_ns, "event", plain(meaning.event.message)))
            case records.DecisionRecord():
                # Each segment of a ring repeats the latest decision.
                if meaning != decision:
                    lines.append(
                        StoryLine(at_ns, "state", f"{meaning.state}: {plain(meaning.why)}")
                    )
                decision = meaning
                sent = "" if meaning.state == "driving" else sent
            case records.Opened():
                lines.append(StoryLine(at_ns, "board", f"{plain(meaning.port)} was opened."))
                dialect = sent = ""
            case records.Identified() | records.Anchor():
                dialect = meaning.dialect or dialect
                if isinstance(meaning, records.Identified):
                    lines.append(StoryLine(at_ns, "board", f"It is a {_title(dialect)} board."))
            case records.Closed():
                lines.append(StoryLine(at_ns, "board", "The port was closed."))
            case records.Written():
                kind = _frame(meaning.data, dialect)
                if kind and kind != sent:
                    lines.append(StoryLine(at_ns, "sent", f"Sent to the board: {kind}."))
                sent = kind or sent
            case records.PoseSet():
                pose = meaning.pose
                words = f"The pose was set: x {pose.x:g}, y {pose.y:g}, theta {pose.theta:g}."
                lines.append(StoryLine(at_ns, "event", words))
            case records.Lost():
                words = f"{meaning.count} more {meaning.what} came in a second and are left out."
                lines.append(StoryLine(at_ns, "command", words))
            case records.Ended():
                words = f"yahboomd ended by a fault of its own: {plain(meaning.error)}"
                words = words if meaning.error else "yahboomd ended."
                lines.append(StoryLine(at_ns, "daemon", words))
            case _:
                pass
    return lines


def _title(dialect: str) -> str:
    known = DIALECTS.get(dialect)
    return f"{known.title} ({dialect})" if known is not None else dialect


def _frame(data: bytes, dialect: str) -> str:
    """Whether a frame to the board is a cut or a brake; empty for other frames."""
    known = DIALECTS.get(dialect)
    if known is None:
        return ""
    if known.cut and known.cut in data:
        return "motors off"
    return "brake" if known.brake in data else ""


class _Run(NamedTuple):
    """Consecutive commands of one source."""

    first_ns: int
    last_ns: int
    times: int
    command: records.CommandRecord


def _commands(every: list[Record]) -> list[StoryLine]:
    """A line for each run of similar commands; a silence of the source ends a run."""
    runs: list[_Run] = []
    open_runs: dict[str, _Run] = {}
    for at_ns, meaning in every:
        if not isinstance(meaning, records.CommandRecord):
            continue
        run = open_runs.get(meaning.source)
        if run is not None and _alike(run.command, meaning) and at_ns - run.last_ns < NS_PER_S:
            open_runs[meaning.source] = run._replace(last_ns=at_ns, times=run.times + 1)
            continue
        if run is not None:
            runs.append(run)
        open_runs[meaning.source] = _Run(at_ns, at_ns, 1, meaning)
    return [
        StoryLine(run.first_ns, "command", _run_words(run)) for run in [*runs, *open_runs.values()]
    ]


def _alike(one: records.CommandRecord, other: records.CommandRecord) -> bool:
    if one.refused != other.refused:
        return False
    moved = (one.vx, one.vy, one.wz), (other.vx, other.vy, other.wz)
    # A joystick's values differ a little each time.
    return any(moved[0]) == any(moved[1])


def _run_words(run: _Run) -> str:
    command = run.command
    speed = f"{command.vx:.2f} m/s, {command.wz:.2f} rad/s"
    if command.vy:
        speed = f"{command.vx:.2f} m/s, {command.vy:.2f} m/s to the left, {command.wz:.2f} rad/s"
    many = f"{run.times} commands for {(run.last_ns - run.first_ns) / NS_PER_S:.2f} s, the first "
    words = f"{plain(command.source)}: {many if run.times > 1 else ''}{speed}"
    return f"{words}: refused ({command.refused})." if command.refused else f"{words}."


def _silences(every: list[Record], end_ns: int) -> list[StoryLine]:
    """A line for each time in which an open port received nothing."""
    lines = []
    last_ns: int | None = None
    for at_ns, meaning in [*every, Record(end_ns, records.Closed())]:
        if not isinstance(meaning, records.Received | records.Closed | records.Opened):
            continue
        if last_ns is not None and at_ns - last_ns > SILENT_NS:
            silent_s = (at_ns - last_ns) / NS_PER_S
            lines.append(
                StoryLine(last_ns, "board", f"The board sent nothing for {silent_s:.2f} s.")
            )
        last_ns = at_ns if isinstance(meaning, records.Received) else None
    return lines
