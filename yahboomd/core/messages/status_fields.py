"""Every counter and fact of the status: name, group, kind, unit and meaning.

The groups of :class:`~yahboomd.core.messages.native.StatusSample` contain exactly the
fields listed here. Counters start at 0 with the daemon, only grow, and are in every status.
"""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import msgspec

GroupName: TypeAlias = Literal["board", "link", "command", "sources", "bus"]
"""A group of the status; ``sources`` has the counters of one command source."""

FieldKind: TypeAlias = Literal["counter", "gauge", "text"]
"""A counter counts, and only grows until the daemon ends; a gauge is any other number."""


class StatusField(msgspec.Struct, frozen=True):
    """One counter or fact of the status.

    Attributes:
        name: Its key in the group.
        unit: ``s``, ``ns``, ``V``, ``mm``, ``rad/s``, ``bytes``; empty for a plain number, a text.
        absent: When it is missing; empty if it is present from the first status on.
        per: The keys of a map, such as ``source``; empty for a single value.
    """

    group: GroupName
    kind: FieldKind
    name: str
    meaning: str
    unit: str = ""
    absent: str = ""
    per: str = ""


REFUSALS: dict[str, str] = {
    "no_velocity": "it holds none of the velocities",
    "not_finite": "it holds NaN, an infinity, or a number beyond what a double holds",
    "too_fast": "it is faster than any robot: over 100 m/s or 1,000 rad/s",
    "wrong_type": "a field has another type, or the stamp is no time",
    "malformed": "it is cut short, has bytes behind its end, or is no such encoding at all",
    "oversize": "payload and attachment have more than 4096 bytes; it is not read",
    "unknown_encoding": "it starts like neither JSON, MessagePack nor CDR",
    "unknown_source": "its source is not configured",
    "stale": "it is older than its source's commands are good for",
    "out_of_order": "a command with a later stamp came before it",
    "from_the_future": "its stamp is ahead of the clock by more than the timeout",
    "backlog": "it came in a burst after a silence",
    "after_pause": "it may have waited while yahboomd did not run",
    "lower_priority": "another source drives, with at least the same priority",
    "not_standing": "control passes down only once the wheels stand",
    "battery_empty": "the battery is empty (`board.battery_stop_v`), and no person drives",
}
"""Reasons to refuse a command, by the word under which they are counted."""

_ACCOUNT = {
    "received": "commands that arrived, lost and refused ones included",
    "accepted": "commands that took effect",
    "overrun": "commands that were lost unread because more came than yahboomd takes",
    "vy_ignored": "commands whose sideways velocity was ignored: this base cannot do it",
}

_LINK = {
    "attempts": "times that yahboomd set out to open the port and connect",
    "sessions": "connections with a recognised board that ended",
    "repeated_faults": "attempts that failed the same way as the one before, and were not logged",
    "readings": "readings of the encoders",
    "imu_readings": "samples of the board's inertial sensor",
    "bytes": "bytes that came from the board",
    "frames": "frames that came from the board",
    "lines": "lines of text that came from the board",
    "blank_bytes": "line ends behind frames, and empty lines",
    "discarded_bytes": "bytes that belonged to no whole frame or line",
    "broken_frames": "frames whose end never came",
    "overlong": "frames or lines that were longer than any true one, and were given up",
    "bad_bytes": "bytes that no board sends: damage of the line",
    "unrecognised": "whole frames and lines that mean nothing to yahboomd",
    "refusals": "requests that the board answered with a failure",
    "board_resets": "resets that the board reported itself",
    "velocities_sent": "frames with wheel speeds, repetitions included",
    "velocities_replaced": "wheel speeds that a newer one replaced before they were sent",
    "velocities_withheld": "wheel speeds that were not sent since the guard had stopped the wheels",
    "stops_sent": "frames with stops and cuts",
    "polls_sent": "questions for the encoders",
    "requests_sent": "other frames: questions for settings and the voltage, and set-up",
    "polls_late": "times that yahboomd was too late to poll the board, or to watch its stream",
    "polls_skipped": "polls that were left out because one waited already",
    "polls_unanswered": "questions for the counters without an answer",
    "answers_missed": "other questions that were not answered in time",
    "answers_late": "answers that came after that time",
    "settings_late": "answers with settings that came when the board was connected already",
    "battery_unanswered": (
        "questions for the voltage without an answer, however late; each makes the next one "
        "rarer, down to one in two minutes"
    ),
    "commands_lost": ("`fail,Command not found!` of the board; the speed is sent again at once"),
    "rearmed": "times that a stream of counts paused and was switched on again",
    "rearmed_unheard": (
        "times that the board was set up again because it may have reset itself unnoticed"
    ),
    "port_held": "frames that waited because the system still held bytes of an earlier one",
    "port_slow": "frames that left 50 ms and more later than their length explains",
}

_COMMAND = {
    "refused": "commands that were refused; each is also counted under its reason",
    **{reason: f"commands refused because {why}" for reason, why in REFUSALS.items()},
    "took_over": "times that a source took control",
    "timed_out": "times that the source in control fell silent in motion",
    "revoked": "times that accepted commands turned out to be a backlog, and were taken back",
    "limited": "control steps whose command was faster than the limit of an axis",
    "too_tight": (
        "control steps whose command was tighter than the car can steer: it drives its tightest "
        "curve at that speed, and does not move if it was to turn on the spot"
    ),
    "desaturated": "control steps in which all wheels were slowed since one was too fast",
    "beats_missed": "control steps that were left out because yahboomd was late",
    "pauses": "times that yahboomd did not run for 0.3 s or more",
    "guard_stops": "times that the guard stopped the wheels, since yahboomd did not run",
    "blind": "times that no counts came for too long, and the wheels were stopped",
    "disconnected": "times that a connected board was lost",
    "bus_lost": "times that the last client left while the wheels were commanded to turn",
    "stops_said": "stops that were sent before everything else",
    "cuts": "times that the motors were let go at once, for any reason",
    "slow_stops": "cuts after stops that were obeyed but took longer than 0.6 s",
    "noisy_cuts": (
        "cuts for what the line may have done; each with an event `line_noisy`, and the robot "
        "drives again"
    ),
    "noisy_doubts": "reports on a wheel that the line may have caused, and that were held back",
    "runaway_against": "wheels that turned against their command",
    "runaway_fast": "wheels that turned much faster than commanded",
    "turns_without_command": "wheels that turned without a command",
    "no_counts": "wheels whose encoder showed no motion although they were commanded to turn",
    "not_started": "wheels that did not begin to turn, and were let go until the next command",
    "off_speed": "wheels that turned at another speed than commanded",
    "stop_not_obeyed": "stops that the wheels did not obey",
    "rolled": "times that wheels which were let go at rest rolled, and were held again",
    "estops": "times that the e-stop was engaged, engaged already or not",
    "estops_unread": "of these, by something too long to be read",
    "release_refused": "releases of the e-stop that were refused, on either key",
    "estop_not_pressed": "samples on the e-stop's key that mean that it is not pressed (a "
    "`std_msgs/Bool` that is false)",
    "poses_refused": "samples that were to set the pose, and did not: another frame, or no pose",
    "estop_file_failures": "times that the e-stop's file could not be written or removed",
    "blackbox_saved": "black boxes that were saved",
    "blackbox_failures": "black boxes that could not be saved",
    "blackbox_left_out": "records that were too large for the black box",
    "recorder_failures": (
        "parts that only record, publish or show, and were switched off because they failed"
    ),
    "log_lines_lost": "lines of the log that were lost because nothing read them",
    "log_lines_broken": "lines of the log that could not be written as they were meant",
    "events": "events that were published",
    "events_suppressed": "events that were left out: more than five of one kind in a second",
    "odometry_readings": "readings that reached odometry",
    "odometry_estimates": "readings that became a pose and a speed",
    "odometry_repeated": (
        "lines that brought nothing new, and lines of a burst that left no room for a stamp; "
        "their counts are in the next"
    ),
    "odometry_held": "readings that waited until others agreed with them",
    "odometry_rejected": "of these, jumps that no reset and no gap announced",
    "odometry_resets": "resets of the board that odometry bridged",
    "odometry_gaps": "gaps in the readings that odometry bridged",
    "odometry_rebased": "jumps of the counts that lasted; the pose went on from there",
    "odometry_taken_back": "garbled readings that were believed, and taken back by the next",
    "odometry_unsure": (
        "readings whose moment is not known: late answers, and the ends of bursts; their speeds "
        "are low rather than high, with a large covariance, or left out"
    ),
    "gyro_silent": "times that the inertial sensor fell silent",
    "gyro_saturated": "times that the gyro was at its limit",
    "gyro_implausible": "times that the gyro was stuck, against the wheels, or had a new zero",
    "gyro_unchecked": "times that the gyro was not used because its sign was not checked",
    "wheels_slipped": (
        "seconds in which the turns of wheels and gyro differed by more than 0.1 rad and four "
        "standard deviations"
    ),
    "board_clock_changes": "times that another period of the board's counts was found, or none",
}

_BUS = {
    "published": "readings that were published",
    "stamps_held_back": "stamps that were moved by 1 ns to stay in order",
    "clock_steps": "times that this machine's clock was set by a second or more",
    "puts": "samples published, on all keys",
    "put_errors": "samples that could not be published",
    "samples_dropped": "samples lost, more than yahboomd takes; in a flood a lower bound",
    "samples_oversize": "samples refused for their size on keys that count none themselves",
    "floods": "times that samples began to be lost",
    "requests": "queries that reached their service",
    "requests_refused": "queries refused for their size, number or wildcards",
    "requests_failed": "queries that ended by an error",
    "answers_unsent": "answers that found no way: the client was gone, or its query too large",
    "tokens_ignored": "liveliness tokens beyond the 256 that are watched for a second daemon",
    "local_stops": "e-stops over the local socket",
    "local_refused": "connections to the local socket by users who may not use it",
    "local_dropped": "connections to the local socket that ended without a request",
}

_UNCONNECTED = "no board is connected"
_UNKNOWN = "no board is connected, or it has no settings; null if it did not answer"


def _counters(group: GroupName, meanings: dict[str, str]) -> tuple[StatusField, ...]:
    return tuple(
        StatusField(group, "counter", name, meaning, "bytes" if name.endswith("bytes") else "")
        for name, meaning in meanings.items()
    )


_fact = StatusField

FIELDS: tuple[StatusField, ...] = (
    _fact("board", "text", "port", "the port that it is connected to", absent=_UNCONNECTED),
    _fact("board", "text", "dialect", "how it is spoken to", absent=_UNCONNECTED),
    _fact("board", "text", "version", "its firmware", absent=_UNKNOWN),
    _fact("board", "gauge", "motor_type", "the motor type that it stores, 1 to 4", absent=_UNKNOWN),
    _fact("board", "gauge", "car_type", "the car type that it stores", absent=_UNKNOWN),
    _fact("board", "gauge", "deadzone", "PWM units added against friction", absent=_UNKNOWN),
    _fact("board", "gauge", "lines", "encoder lines of one turn of the motor", absent=_UNKNOWN),
    _fact("board", "gauge", "ratio", "gear ratio", absent=_UNKNOWN),
    _fact(
        *("board", "gauge", "wheel_diameter_mm", "wheel diameter as stored"),
        unit="mm",
        absent=_UNKNOWN,
    ),
    _fact("board", "gauge", "p", "P of its speed loop", absent=_UNKNOWN),
    _fact("board", "gauge", "i", "I of its speed loop", absent=_UNKNOWN),
    _fact("board", "gauge", "d", "D of its speed loop", absent=_UNKNOWN),
    _fact(
        *("board", "gauge", "volts", "the latest voltage of the motors' supply"),
        unit="V",
        absent="no board is connected, or no voltage came yet",
    ),
    _fact(
        *("board", "text", "battery", "good, low or empty, by the median of 30 s at rest"),
        absent="no limit is set (`board.battery_low_v`), or it did not rest for 30 s yet",
    ),
    _fact(
        *("board", "gauge", "volts_at_rest", "that median"),
        unit="V",
        absent="as `battery`",
    ),
    _fact(
        *("board", "text", "imu", "its inertial sensor"),
        absent="no board is connected, or no sample of one came yet",
    ),
    *_counters("link", _LINK),
    *_counters("command", _ACCOUNT | _COMMAND),
    _fact("command", "gauge", "estop_not_on_file", "1 while an engaged e-stop is not on file"),
    _fact("command", "gauge", "blackbox_recording", "1 while the black box is kept"),
    _fact(
        *("command", "gauge", "blackbox_saving"),
        "1 while black boxes can be saved; 0 if the last one could not be, or takes over 10 s",
    ),
    _fact(
        *("command", "text", "recorders_off"),
        "the recorders that failed and were switched off, with the reason; empty: none",
    ),
    _fact("command", "text", "blackbox_last", "the newest saved black box; empty: none was saved"),
    _fact(
        *("command", "gauge", "board_tick_ns"),
        "period in which the board renews its counts; 0: none fits, or the board is asked for them",
        unit="ns",
    ),
    _fact(
        *("command", "gauge", "gyro_bias_rad_s"),
        "what the gyro shows at rest, as learned; 0 without one",
        unit="rad/s",
    ),
    _fact(
        "command", "text", "pose_broken", "why the pose is off, until it is set; empty: it is not"
    ),
    _fact("command", "text", "last_refusal", "why the latest refused command was; empty: none was"),
    _fact(
        *("command", "gauge", "clock_offset_s", "how far the clock of each source is ahead"),
        unit="s",
        absent="no source has stamped a command in the last 10 s",
        per="source",
    ),
    _fact(
        *("command", "text", "clock_warnings", "the effect of a clock that is 0.1 s off"),
        absent="no source's clock is off",
        per="source",
    ),
    *_counters("sources", _ACCOUNT),
    _fact("sources", "counter", "refused", "commands that were refused", per="reason"),
    _fact("bus", "text", "zid", "Zenoh's id of the session that listens"),
    _fact("bus", "text", "routers", "addresses of the routers that it joined"),
    _fact("bus", "gauge", "neighbours", "Zenoh sessions that are connected to it"),
    *_counters("bus", _BUS),
    _fact("bus", "text", "local_socket", "path of the local socket; empty: there is none"),
)
"""Every counter and fact, by group."""


ZEROS: dict[GroupName, dict[str, int]] = {
    group: {
        field.name: 0
        for field in FIELDS
        if field.group == group and field.kind == "counter" and not field.per
    }
    for group in get_args(GroupName)
}
"""The counters of each group at the start, all zero."""
