"""Laws for any bytes, target by target.

A target takes bytes and asserts; it raises if a law is broken. ``tests/fuzz`` runs each over its
corpus and over variations of it, ``make fuzz`` under a fuzzer that follows the code's branches.
"""

from __future__ import annotations

import atexit
import itertools
import math
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import msgspec

from yahboomd.core.config import Config, read
from yahboomd.core.errors import BoardError, ConfigError
from yahboomd.core.messages.cdr import HEADER_LE
from yahboomd.core.messages.codecs import (
    MAX_PAYLOAD_BYTES,
    Refusal,
    decode_command,
    decode_set_pose,
    encode,
    encoding_of,
    is_release_attempt,
)
from yahboomd.core.messages.native import INT64_MAX, MAX_LABEL, SetPoseRequest, VelocityCommand
from yahboomd.core.messages.set_pose import decode_pose
from yahboomd.core.model import FASTEST_M_S, FASTEST_RAD_S
from yahboomd.core.protocol.dialect import (
    Battery,
    Decoded,
    Deltas,
    Dialect,
    Setting,
    Speeds,
    Totals,
    VersionLine,
)
from yahboomd.core.protocol.four_channel.framing import (
    MAX_HELD_BYTES,
    RESYNC,
    Frame,
    LineFramer,
    TextLine,
)
from yahboomd.core.protocol.four_channel.stored import MAX_SPEED, units_per_m_s
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import BoardSettings, writes
from yahboomd.ros2.messages.rcl_interfaces import ParameterServer
from yahboomd.ros2.messages.ros2_names import parse_attachment

Target = Callable[[bytes], None]

REASONS = {
    *("no_velocity", "not_finite", "too_fast", "wrong_type"),
    *("malformed", "oversize", "unknown_encoding"),
}


def framer(data: bytes) -> None:
    """The output depends on the bytes alone, every byte is accounted for, little is kept."""
    whole = LineFramer()
    items = whole.feed(data)
    cut = LineFramer()
    pieces: list[Frame | TextLine] = []
    # The cuts depend on the input, so that a failure can be replayed.
    chance = Random(data)
    start = 0
    while start < len(data):
        end = start + chance.choice([1, 2, 3, 7, 64])
        pieces += cut.feed(data[start:end])
        assert cut.held_bytes <= MAX_HELD_BYTES
        start = end
    assert [_bare(item) for item in items] == [_bare(item) for item in pieces]
    assert whole.counters == cut.counters
    counters = whole.counters
    assert counters.bytes == len(data)
    sizes = sum(item.size for item in items)
    assert counters.bytes == (
        sizes + counters.blank_bytes + counters.discarded_bytes + whole.held_bytes
    )
    assert all(0 <= item.trailing < len(data) for item in items)
    # Whatever came before, two line ends later a frame is heard.
    after = whole.feed(b"\n$MAll:1,2,3,4#")
    assert isinstance(after[-1], Frame)
    assert after[-1].args == "1,2,3,4"


def _bare(item: Frame | TextLine) -> Frame | TextLine:
    return msgspec.structs.replace(item, trailing=0)


def streamed(data: bytes) -> None:
    """Nothing that the streamed dialect decodes is out of range."""
    _dialect(DIALECTS["streamed"], data)


def polled(data: bytes) -> None:
    """Nothing that the polled dialect decodes is out of range."""
    _dialect(DIALECTS["polled"], data)


def rosmaster(data: bytes) -> None:
    """The framer of frames with a checksum keeps the laws of the other; nothing is out of range."""
    dialect, chance = DIALECTS["rosmaster"], Random(data)
    whole, cut = dialect.framer(), dialect.framer()
    items, pieces, start = [*whole.feed(data)], [], 0
    while start < len(data):
        end = start + chance.choice([1, 2, 3, 7, 64])
        pieces += cut.feed(data[start:end])
        assert cut.held_bytes <= MAX_HELD_BYTES
        start = end
    meanings = [dialect.decode(item) for item in items]
    assert meanings == [dialect.decode(item) for item in pieces]
    assert whole.counters == cut.counters
    counters = whole.counters
    assert (
        counters.bytes
        == len(data)
        == (
            sum(item.size for item in items)
            + counters.blank_bytes
            + counters.discarded_bytes
            + whole.held_bytes
        )
    )
    for item, meaning in zip(items, meanings, strict=True):
        _in_range(meaning)
        dialect.recognises(item)
    numbers = tuple(int.from_bytes(data[n : n + 5], "little", signed=True) for n in (0, 4, 8))
    frame = dialect.speeds(numbers)
    assert (len(frame), sum(frame[2:-1]) & 0xFF) == (12, frame[-1])


def _dialect(dialect: Dialect, data: bytes) -> None:
    items = LineFramer().feed(data)
    decoded = [dialect.decode(item) for item in items]
    for item, meaning in zip(items, decoded, strict=True):
        _in_range(meaning)
        dialect.recognises(item)
    settings = BoardSettings()
    for meaning in decoded:
        if isinstance(meaning, Setting):
            settings[meaning.name] = meaning.value
    profile = PROFILES["520"]
    wrong = dialect.findings(settings, profile).unfit or dialect.name == "polled"
    try:
        units = units_per_m_s(settings, radius_m=0.0335, ticks_per_revolution=1320.0, scale=1.0)
    except BoardError:
        assert wrong
    else:
        assert math.isfinite(units)
        assert units > 0.0
    for write in writes(dialect.settings, settings, profile.settings):
        assert _is_command(write.frame, dialect)
    numbers = tuple(int.from_bytes(data[n : n + 5], "little", signed=True) for n in (0, 4, 8, 12))
    frame = dialect.speeds((numbers[0], numbers[1], numbers[2], numbers[3]))
    assert _is_command(frame, dialect)
    said = [int(number) for number in frame.rstrip(b"#").split(b":")[1].split(b",")]
    assert len(said) == 4
    for number, wanted in zip(said, numbers, strict=True):
        assert number == max(-MAX_SPEED, min(MAX_SPEED, wanted))


def _is_command(frame: bytes, dialect: Dialect) -> bool:
    inside = frame[1:-1]
    return (
        frame.startswith(b"$")
        and frame.endswith(b"#")
        and len(inside) <= 51
        and not set(inside) & set(b"$#\n\r")
        and RESYNC not in frame
    )


def _in_range(meaning: Decoded) -> None:
    if isinstance(meaning, Totals | Deltas):
        assert len(meaning.ticks) == 4
        assert all(-(2**31) <= ticks < 2**31 for ticks in meaning.ticks)
    elif isinstance(meaning, Speeds):
        assert all(math.isfinite(speed) for speed in meaning.mm_s)
    elif isinstance(meaning, Battery):
        assert math.isfinite(meaning.volts)
        assert meaning.volts >= 0.0
    elif isinstance(meaning, Setting):
        values = meaning.value if isinstance(meaning.value, tuple) else (meaning.value,)
        # A board whose supply went in mid-write shows nan.
        assert all(math.isnan(value) or abs(value) < 1e11 for value in values)
    elif isinstance(meaning, VersionLine):
        assert len(meaning.version) <= MAX_HELD_BYTES


def command(data: bytes) -> None:
    """A velocity command is finite, or refused for a known reason in words that stay short."""
    found = decode_command(data)
    if isinstance(found, Refusal):
        _is_refusal(found, data)
        return
    assert len(data) <= MAX_PAYLOAD_BYTES
    assert max(abs(found.vx), abs(found.vy)) <= FASTEST_M_S
    assert abs(found.wz) <= FASTEST_RAD_S
    assert found.stamp_ns is None or 0 < found.stamp_ns <= INT64_MAX
    assert found.source is None or len(found.source) <= MAX_LABEL
    assert found.encoding == encoding_of(data)
    plain = VelocityCommand(
        vx=found.vx, vy=found.vy, wz=found.wz, stamp_ns=found.stamp_ns, source=found.source
    )
    for encoding in ("json", "msgpack"):
        again = decode_command(encode(plain, encoding))
        assert not isinstance(again, Refusal)
        assert (again.vx, again.vy, again.wz) == (found.vx, found.vy, found.wz)
        assert (again.stamp_ns, again.source) == (found.stamp_ns, found.source)


def _is_refusal(refusal: Refusal, data: bytes) -> None:
    assert refusal.reason in REASONS
    assert 0 < len(refusal.detail) <= 200
    assert (refusal.reason == "oversize") == (len(data) > MAX_PAYLOAD_BYTES)


def set_pose(data: bytes) -> None:
    """A pose to start from is finite, or refused."""
    found: Refusal | SetPoseRequest | str = decode_set_pose(data)
    if isinstance(found, Refusal):
        _is_refusal(found, data)
        found = decode_pose(data, "odom")
    if isinstance(found, str):
        assert 0 < len(found) <= 300
        return
    covariance = found.covariance or ()
    assert len(covariance) in {0, 9}
    assert all(map(math.isfinite, (found.x, found.y, found.theta, *covariance)))
    assert all(variance >= 0.0 for variance in covariance[::4])


def estop(data: bytes) -> None:
    """Only a plain false does not engage the e-stop; everything else engages it."""
    for query in (False, True):
        if not is_release_attempt(data, query=query):
            continue
        assert len(data) <= MAX_PAYLOAD_BYTES
        if data[0] == 0:
            assert query
            assert data[4] == 0
        elif encoding_of(data) == "json":
            value = msgspec.json.decode(data)
            assert value["engaged"] is False
        else:
            assert msgspec.msgpack.decode(data)["engaged"] is False
    if parse_attachment(data) is not None:
        assert len(data) == 33


_FOLDER: list[Path] = []


def _file() -> Path:
    if not _FOLDER:
        _FOLDER.append(Path(tempfile.mkdtemp(prefix="yahboomd-fuzz-")))
        atexit.register(shutil.rmtree, _FOLDER[0], ignore_errors=True)
    return _FOLDER[0] / "config.toml"


def config(data: bytes) -> None:
    """A file is a configuration that can be used, or a list of mistakes; never anything else."""
    path = _file()
    path.write_bytes(data)
    _loads(path, {}, [])


def override(data: bytes) -> None:
    """The same for environment and ``--set``, line by line."""
    lines = data.decode("utf-8", "replace").replace("\0", "").split("\n")[:8]
    environ = {
        f"YAHBOOMD_{name}": value
        for name, _, value in (line.partition("=") for line in lines[1::2])
        if name
    }
    _loads(Path("/dev/null"), environ, lines[0::2])


def _loads(path: Path, environ: dict[str, str], overrides: list[str]) -> None:
    try:
        found = read(path, environ=environ, overrides=overrides).config
    except ConfigError as error:
        words = str(error)
        assert words.strip()
        assert all(char.isprintable() or char == "\n" for char in words)
        return
    assert isinstance(found, Config)
    finite = found.as_data()
    assert all(math.isfinite(number) for number in _numbers(finite))
    # The daemon's use of it at the start.
    motors = found.motors()
    assert len({motor.position for motor in motors}) == len(motors)
    kinematics = found.kinematics()
    factors = itertools.chain(*kinematics.inverse, *kinematics.forward)
    assert all(map(math.isfinite, factors))


def _numbers(value: Any) -> list[float]:
    if isinstance(value, dict):
        return [number for each in value.values() for number in _numbers(each)]
    if isinstance(value, list | tuple):
        return [number for each in value for number in _numbers(each)]
    return [value] if isinstance(value, int | float) else []


PARAMETERS = ParameterServer(
    {"a.b": 1, "a.c": ("x", "y")}, {"a.b": ("A number.", "a whole number")}, "It is read-only."
)


def parameters(data: bytes) -> None:
    """Any request has an answer, of a size that its own bounds."""
    for _, respond in PARAMETERS.services.values():
        response = respond(data)
        assert response.startswith(HEADER_LE)
        assert len(response) <= 200 + 20 * len(data)


TARGETS: dict[str, Target] = {
    "framer": framer,
    "streamed": streamed,
    "polled": polled,
    "rosmaster": rosmaster,
    "command": command,
    "set_pose": set_pose,
    "estop": estop,
    "parameters": parameters,
    "config": config,
    "override": override,
}
