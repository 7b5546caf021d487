"""The rules that compare keys with each other.

A rule reads a configuration whose single values are valid, and yields contradictions. A finding
names every key that was compared: it is dropped if one of them already has a mistake.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from yahboomd.core.config.hardware import CUSTOM, PRESETS, Chassis, given_motors
from yahboomd.core.config.models import Config
from yahboomd.core.config.values import Place, dotted, number
from yahboomd.core.drive.kinematics import unit_geometry
from yahboomd.core.names import is_local, is_ros_name
from yahboomd.core.protocol.profiles import NO_ENCODER_TYPE
from yahboomd.core.protocol.registry import DIALECTS

BITS_PER_BYTE = 10
"""8N1: a start bit, eight of data, a stop bit."""

FIXED_TOPICS = {
    "tf": "the transforms",
    "tf_static": "the transforms",
    "estopped": "the state of the emergency stop",
    "rosout": "the log",
}
"""Topics of ROS 2 whose names cannot be chosen."""


@dataclass(frozen=True)
class Finding:
    """A contradiction, or with ``is_warning`` a setting that works but may surprise.

    Attributes:
        place: The key to change.
        words: The contradiction, and what to write instead.
        beside: The other keys that were compared.
        is_warning: Whether the configuration can still be used.
    """

    place: Place
    words: str
    beside: tuple[Place, ...] = ()
    is_warning: bool = False


Rule = Callable[[Config], Iterator[Finding]]

_PRESET: Place = ("chassis", "preset")
_KINEMATICS: Place = ("chassis", "kinematics")
_MOTORS: Place = ("chassis", "motors")
_BASE: Place = ("chassis", "wheel_base_m")
_PROFILE: Place = ("board", "profile")

LONG_RAMP_S = 2.0
"""A robot whose program died should not drive on for longer."""

LEAST_POLL_HZ = 5
"""With rarer counts it shows too late, or never, whether wheels stand or turn."""


def presets(config: Config) -> Iterator[Finding]:
    """A preset fixes kinematics, wheels and positions; other keys of its motors may be changed."""
    preset = config.chassis.preset
    if not preset:
        return
    kinematics, usual = PRESETS[preset]
    if config.chassis.kinematics not in {Chassis().kinematics, kinematics}:
        words = f'contradicts preset "{preset}", which is {kinematics}; leave out one'
        yield Finding(_KINEMATICS, words, (_PRESET,))
    for wheel, entries in given_motors(config.chassis).items():
        if wheel not in usual:
            words = f'preset "{preset}" has the wheels {", ".join(usual)}'
            for side, motors in usual.items():
                # The name is that of a motor in a list, not of a wheel.
                for position in (each.position for each in motors if each.name == wheel):
                    words += f": write motors.{side} = [{{ position = {position}, \u2026 }}]"
            yield Finding((*_MOTORS, wheel), words, (_PRESET,))
            continue
        positions = [entry.position for entry in usual[wheel]]
        for index, entry in enumerate(entries):
            place = (*_MOTORS, wheel, index, "position")
            if entry.position not in positions:
                places = " and ".join(f"M{position}" for position in positions)
                words = (
                    f'preset "{preset}" has {places} there; for motors at other '
                    f'places, replace preset by kinematics = "{kinematics}" and name all motors'
                )
                yield Finding(place, words, (_PRESET,))
            elif entry.position in (other.position for other in entries[:index]):
                yield Finding(place, f"position {entry.position} is named twice", (_PRESET,))


def wheels(config: Config) -> Iterator[Finding]:
    """Every wheel of the geometry has motors, and no other wheel has any."""
    name = config.kinematics_name()
    geometry, entries = unit_geometry(name), config.motor_entries()
    known = geometry.wheels
    beside = (_KINEMATICS, _PRESET)
    base = f"a {name} base has the wheels {', '.join(known)}"
    presets = [preset for preset, (kinematics, _) in PRESETS.items() if kinematics == name]
    by_preset = f', or set chassis.preset = "{presets[0]}"' if presets else ""
    if config.chassis.motors == Chassis().motors and set(known).isdisjoint(entries):
        # The default motors are no choice: one mistake for all wheels is enough.
        words = f"missing; {base}: name their motors{by_preset}"
        yield Finding(_MOTORS, words, beside)
        return
    for wheel in known:
        motors = entries.get(wheel)
        if motors is None:
            words = f"missing; {base}: name the motors of each{by_preset}"
            if presets:
                words += " and name only those that differ"
            yield Finding((*_MOTORS, wheel), words, (_MOTORS, *beside))
        elif len(motors) > 1 and not geometry.sides:
            words = f"expected one motor, got {len(motors)}; several on a side are skid_steer"
            yield Finding((*_MOTORS, wheel), words, beside)
    factors = config.chassis.wheel_radius_multiplier.items()
    calibrated = [wheel for wheel, factor in factors if factor != 1.0]
    for table, names in (("motors", list(entries)), ("wheel_radius_multiplier", calibrated)):
        for wheel in names:
            if wheel not in known:
                yield Finding(("chassis", table, wheel), f"unknown wheel; {base}", beside)


def motors(config: Config) -> Iterator[Finding]:
    """No two motors share a position or a name."""
    names = config.motor_names()
    places = {
        (*_MOTORS, wheel, index): (entry.position, names[wheel][index])
        for wheel, entries in config.motor_entries().items()
        for index, entry in enumerate(entries)
    }
    for part, what in enumerate(("position", "name")):
        taken: dict[int | str, Place] = {}
        for place, values in places.items():
            first = taken.setdefault(values[part], place)
            if first != place:
                words = f"{what} {values[part]} is taken by {dotted(first)}"
                yield Finding((*place, what), words, ((*first, what), _PRESET))
    all_names = [name for group in names.values() for name in group]
    for motor in config.ros2.joint_names:
        if motor not in all_names:
            words = f"no motor of that name; there are {', '.join(all_names)}"
            yield Finding(("ros2", "joint_names", motor), words, (_MOTORS, _PRESET))


def geometry(config: Config) -> Iterator[Finding]:
    """The distance between the axles is given for bases that need it, and only there."""
    name = config.kinematics_name()
    unit = unit_geometry(name)
    beside = (_KINEMATICS, _PRESET)
    if unit.base_m and config.chassis.wheel_base_m is None:
        words = f"missing; a base of kind {name} needs the distance between its axles in metres"
        yield Finding(_BASE, words, beside)
    if not unit.base_m and config.chassis.wheel_base_m is not None:
        words = f"belongs to a mecanum or ackermann base, and this one is {name}; leave it out"
        yield Finding(_BASE, words, beside)
    if not unit.least_radius_m and config.chassis.steering_max_rad is not None:
        words = f"belongs to an ackermann base, and this one is {name}; leave it out"
        yield Finding(("chassis", "steering_max_rad"), words, beside)
    if not unit.holonomic and config.chassis.sideways_multiplier != 1.0:
        words = f"belongs to a mecanum base, and this one is {name}; leave it out"
        yield Finding(("chassis", "sideways_multiplier"), words, beside)


def profile(config: Config) -> Iterator[Finding]:
    """A profile has an encoder; `custom` is complete, and its keys belong to no other profile."""
    board, chassis = config.board, config.chassis
    if board.motor_type == NO_ENCODER_TYPE:
        words = "expected 1, 2 or 3, got 4: motors without encoder give no odometry"
        yield Finding(("board", "motor_type"), words)
    if board.profile != CUSTOM:
        for key in ("motor_type", "deadzone", "lines", "ratio", "wheel_diameter_mm"):
            if getattr(board, key) is not None:
                words = f'belongs to profile "custom", and the profile is "{board.profile}"'
                yield Finding(("board", key), words, (_PROFILE,))
        return
    needed = (
        ("ratio", "ticks_per_revolution", board.ratio or chassis.ticks_per_revolution),
        ("wheel_diameter_mm", "wheel_radius_m", board.wheel_diameter_mm or chassis.wheel_radius_m),
    )
    for key, instead, value in needed:
        if value is None:
            words = f'missing; profile "custom" needs it, or chassis.{instead}'
            yield Finding(("board", key), words, (_PROFILE, ("chassis", instead)))
    if board.ratio is None and chassis.ticks_per_revolution is not None:
        least = 4 * (board.lines or 11)
        if chassis.ticks_per_revolution < least:
            place = ("chassis", "ticks_per_revolution")
            words = f"expected at least {least} (one turn of the motor, lines x 4)"
            yield Finding(place, words, (_PROFILE, ("board", "lines"), ("board", "ratio")))


def speeds(config: Config) -> Iterator[Finding]:
    """The limits fit the board, the odometry and the detection of stalls."""
    velocity = config.limits.linear.velocity
    place: Place = ("limits", "linear", "velocity")
    chosen = config.serial.dialect
    taken = min(each.fastest_m_s for each in DIALECTS.values() if chosen in {"auto", each.name})
    if velocity is not None and velocity > taken:
        words = f"{number(velocity)} m/s is more than the board takes ({taken:g} m/s)"
        yield Finding(place, words, (("serial", "dialect"),), is_warning=True)
    fastest: Place = ("odometry", "max_wheel_speed_m_s")
    if velocity is not None and velocity >= config.odometry.max_wheel_speed_m_s:
        words = f"expected more than limits.linear.velocity ({number(velocity)}), got "
        words += (
            f"{number(config.odometry.max_wheel_speed_m_s)}; raise it too: --set "
            f"odometry.max_wheel_speed_m_s={math.floor(velocity) + 1}, or lower the velocity"
        )
        yield Finding(fastest, words, (place,))
    least: Place = ("faults", "min_speed_m_s")
    if velocity is not None and velocity < config.faults.min_speed_m_s:
        words = (
            f"above limits.linear.velocity ({number(velocity)}): a stall in motion is noticed late"
        )
        yield Finding(least, words, (place,), is_warning=True)


def ramps(config: Config) -> Iterator[Finding]:
    """The ramp after silence is short; a longer one gives a warning."""
    beside: Place = ("command", "on_timeout")
    for axis, unit in (("linear", "m"), ("angular", "rad")):
        limits = getattr(config.limits, axis)
        fastest, slows = limits.velocity, limits.deceleration
        if config.command.on_timeout == "halt" or not (fastest and slows):
            continue
        ramp_s = fastest / slows
        if ramp_s > LONG_RAMP_S:
            words = (
                f"after silence it takes {ramp_s:.1f} s and {fastest * ramp_s / 2:.1f} {unit} to "
            )
            words += f'stand; {dotted(beside)} = "halt" stops at once'
            yield Finding(("limits", axis, "deceleration"), words, (beside,), is_warning=True)


def timeouts(config: Config) -> Iterator[Finding]:
    """A command lasts two control periods at least, and is sent again before it ends."""
    command = config.command
    rate: Place = ("command", "rate_hz")
    resend: Place = ("command", "resend_s")
    shortest = 2.0 / command.rate_hz
    given: dict[Place, float] = {("command", "timeout_s"): command.timeout_s}
    for name, source in command.sources.items():
        if source.timeout_s is not None:
            given[("command", "sources", name, "timeout_s")] = source.timeout_s
    for place, timeout_s in given.items():
        if timeout_s < shortest:
            words = f"expected at least two control periods ({number(shortest)} s at rate_hz = "
            yield Finding(place, f"{words}{number(command.rate_hz)}), got {timeout_s}", (rate,))
    place = min(given, key=given.__getitem__)
    if command.resend_s >= given[place]:
        words = f"expected less than {dotted(place)} ({given[place]}), got {command.resend_s}"
        yield Finding(resend, words, (place,))
    if not command.sources:
        words = "there is none, so no program can drive"
        yield Finding(("command", "sources"), words, is_warning=True)


def rates(config: Config) -> Iterator[Finding]:
    """The serial line carries the polls, and no more samples are published than come."""
    poll_hz, publish_hz = config.odometry.poll_rate_hz, config.odometry.publish_rate_hz
    poll: Place = ("odometry", "poll_rate_hz")
    publish: Place = ("odometry", "publish_rate_hz")
    baud: Place = ("serial", "baudrate")
    dialect: Place = ("serial", "dialect")
    chosen = config.serial.dialect
    poll_bytes = max(each.poll_bytes for each in DIALECTS.values() if chosen in {"auto", each.name})
    most = config.serial.baudrate / BITS_PER_BYTE / poll_bytes if poll_bytes else math.inf
    if poll_hz > most:
        words = f"expected at most {most:.0f}, the most for {config.serial.baudrate} baud, got "
        yield Finding(poll, f"{words}{number(poll_hz)}", (baud, dialect), chosen == "auto")
    if poll_bytes and poll_hz < LEAST_POLL_HZ:
        words = f"expected at least {LEAST_POLL_HZ}: fewer counts show motion too late, got "
        yield Finding(poll, f"{words}{number(poll_hz)}", (dialect,), chosen == "auto")
    period_ns = DIALECTS[chosen].sample_period_ns if chosen in DIALECTS else None
    if period_ns is not None:
        if publish_hz > (samples := 1e9 / period_ns):
            words = f"expected at most {samples:g}, the samples of a {chosen} board, got "
            yield Finding(publish, f"{words}{number(publish_hz)}", (dialect,))
    elif publish_hz > poll_hz:
        words = f"expected at most poll_rate_hz ({number(poll_hz)}), got {number(publish_hz)}"
        yield Finding(publish, words, (poll, dialect))


def battery(config: Config) -> Iterator[Finding]:
    """A battery is low before it is empty, and its voltage is requested."""
    board, low = config.board, config.board.low_v()
    stop: Place = ("board", "battery_stop_v")
    beside: Place = ("board", "battery_low_v")
    if board.battery_stop_v is not None and low is not None and board.battery_stop_v >= low:
        words = f"expected less than battery_low_v ({number(low)}), got "
        yield Finding(stop, f"{words}{number(board.battery_stop_v)}", (beside,))
    for place, limit in ((beside, board.battery_low_v), (stop, board.battery_stop_v)):
        if limit and board.battery_period_s == 0.0:
            words = "a board that has to be asked is not, and its battery is never judged"
            yield Finding(place, words, (("board", "battery_period_s"),), is_warning=True)


def bus(config: Config) -> Iterator[Finding]:
    """The bus can be reached; a warning reports that other machines can reach it."""
    zenoh = config.zenoh
    mode: Place = ("zenoh", "mode")
    listen: Place = ("zenoh", "listen")
    connect: Place = ("zenoh", "connect")
    if zenoh.config and not os.path.isfile(zenoh.config):
        yield Finding(("zenoh", "config"), "there is no such file")
    if zenoh.mode == "client":
        if not zenoh.connect:
            words = "expected an endpoint: a client needs a router to connect to"
            yield Finding(connect, words, (mode,))
        if zenoh.listen not in ((), type(zenoh)().listen):
            words = 'contradicts mode = "client": a client does not listen; leave it out, or []'
            yield Finding(listen, words, (mode,))
        return
    if not (zenoh.listen or zenoh.connect or zenoh.config):
        words = "expected an endpoint: no program reaches a bus that neither listens nor connects"
        yield Finding(listen, words, (connect, ("zenoh", "config")))
    for endpoint in zenoh.listen:
        if endpoint in zenoh.connect:
            yield Finding(connect, f"{endpoint} is in zenoh.listen as well", (listen,))
        if not zenoh.config and not is_local(endpoint):
            words = f"{endpoint} is open to the network: every program that reaches it can drive"
            yield Finding(listen, words, is_warning=True)


def names(config: Config) -> Iterator[Finding]:
    """Every topic, source and frame has its own name."""
    ros2 = config.ros2
    if config.odometry.frame_id == config.odometry.child_frame_id:
        words = f'"{config.odometry.frame_id}" is the frame of the pose as well'
        yield Finding(("odometry", "child_frame_id"), words, (("odometry", "frame_id"),))
    topics: dict[str, Place] = {}
    keys = ("odom_topic", "joint_states_topic", "imu_topic", "battery_state_topic")
    for key in (*keys, "diagnostics_topic"):
        place: Place = ("ros2", key)
        topic: str = getattr(ros2, key)
        first = topics.setdefault(topic, place)
        if first != place:
            yield Finding(place, f'"{topic}" is {dotted(first)} as well', (first,))
        if contents := FIXED_TOPICS.get(topic):
            yield Finding(place, f'"{topic}" carries {contents}')
        if topic.partition("/")[0] == "yahboomd":
            yield Finding(place, f'"{topic}": below "yahboomd/" are native samples and services')
    for source in config.command.sources:
        if ros2.bridge and (source in topics or source in FIXED_TOPICS):
            words = "a topic that yahboomd itself publishes; choose another key"
            place = ("command", "sources", source)
            yield Finding(place, words, (topics.get(source, place),))


def ros(config: Config) -> Iterator[Finding]:
    """Names in a ROS 2 graph are valid there, and every frame has one parent."""
    ros2 = config.ros2
    if ros2.rmw_zenoh and config.zenoh.namespace and not is_ros_name(config.zenoh.namespace):
        words = "expected a name of ROS 2, of letters, digits and _, because of ros2.rmw_zenoh"
        yield Finding(("zenoh", "namespace"), words, (("ros2", "rmw_zenoh"),))
    for index, source in enumerate(ros2.stamped_commands):
        if source not in config.command.sources:
            words = f"no source of commands; there are {', '.join(config.command.sources)}"
            yield Finding(("ros2", "stamped_commands", index), words, (("command", "sources"),))
    parents: dict[str, Place] = {config.odometry.child_frame_id: ("odometry", "child_frame_id")}
    for index, transform in enumerate(ros2.static_transforms):
        place: Place = ("ros2", "static_transforms", index, "child")
        if transform.child == transform.parent:
            yield Finding(place, f'"{transform.child}" is its own parent')
            continue
        first = parents.setdefault(transform.child, place)
        if first != place:
            words = f'"{transform.child}" has a parent already, by {dotted(first)}'
            yield Finding(place, words, (first,))


RULES: tuple[Rule, ...] = (
    presets,
    wheels,
    motors,
    geometry,
    profile,
    speeds,
    ramps,
    timeouts,
    rates,
    battery,
    bus,
    names,
    ros,
)


def findings(config: Config) -> list[Finding]:
    return [finding for rule in RULES for finding in rule(config)]
