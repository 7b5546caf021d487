"""The whole state of an odometer as bytes, and back.

Law: a restored odometer continues bit by bit like the one that was saved.

The state is walked attribute by attribute, and written as MessagePack: numbers exactly, objects by
the names of their classes. Restoring creates only classes of this room and of the nouns that it
keeps, and runs none of their code, so that a state from a stranger's file is safe to restore. The
state includes values that a constructor computes from the robot's geometry: restore it into an
odometer that was made with the same arguments.
"""

from __future__ import annotations

import sys
from collections import deque
from typing import Any, TypeAlias

import msgspec

from yahboomd.core.odometry.odometer import Odometer

_CLASSES: dict[str, type] = {
    each.__name__: each
    for name, room in tuple(sys.modules.items())
    if name in {"yahboomd.core.counts", "yahboomd.core.model"}
    or name.startswith("yahboomd.core.odometry.")
    for each in vars(room).values()
    if isinstance(each, type) and each.__module__ == name
}
"""The classes of all files that an odometer imports."""

_PLAIN = (bool, int, float, str, type(None))

Written: TypeAlias = Any
"""Plain values as they are; else a list of a mark and its content."""


class NotAState(ValueError):
    """The bytes are not a state of such an odometer."""


def save(odometer: Odometer) -> bytes:
    return msgspec.msgpack.encode(_attributes(odometer))


def restore(odometer: Odometer, state: bytes) -> None:
    """Restore a saved state into a fresh odometer.

    Args:
        odometer: Made with the arguments of the one that was saved.
        state: The result of :func:`save`.

    Raises:
        NotAState: The bytes are no state, or one of another version.
    """
    try:
        written = msgspec.msgpack.decode(state)
        # The clock of a board that reports unasked is made with arguments.
        period_ns, each_line, age_ns = _value(None, written["_renewal"])
        odometer.set_sample_period(period_ns, each_line=each_line, age_ns=age_ns)
        _fill(odometer, written)
    except (msgspec.DecodeError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise NotAState(f"not the state of such an odometer: {error!r}") from error


def _attributes(thing: object) -> dict[str, Written]:
    # All have slots. Looking at an object's dict makes Python 3.11 and 3.12 create it, and slows
    # every access from then on: the daemon took a tenth more of its CPU.
    names = next(each.__slots__ for each in type(thing).__mro__ if each.__name__ in _CLASSES)  # type: ignore[attr-defined]
    return {name: _written(getattr(thing, name)) for name in names if hasattr(thing, name)}


def _written(value: object) -> Written:
    if type(value) in _PLAIN:
        return value
    if isinstance(value, msgspec.Struct):
        names = value.__struct_fields__
        return ["S", type(value).__name__, [_written(getattr(value, name)) for name in names]]
    if isinstance(value, tuple):
        name = type(value).__name__ if type(value) is not tuple else ""
        return ["T", name, [_written(each) for each in value]]
    if isinstance(value, list):
        return ["L", [_written(each) for each in value]]
    if isinstance(value, deque):
        return ["D", [_written(each) for each in value], value.maxlen]
    if isinstance(value, dict):
        return ["M", [[key, _written(each)] for key, each in value.items()]]
    if isinstance(value, complex):
        return ["C", value.real, value.imag]
    if type(value).__name__ not in _CLASSES:
        raise TypeError(f"the state of an odometer has a {type(value).__name__}")
    return ["O", type(value).__name__, _attributes(value)]


def _fill(thing: object, written: dict[str, Written]) -> None:
    """Set an object's attributes; those that are objects keep their identity."""
    for name, value in written.items():
        setattr(thing, name, _value(getattr(thing, name, None), value))


def _value(present: Any, written: Written) -> Any:  # noqa: ANN401 - any attribute
    """The value that was written, in the present object if others may refer to it."""
    if not isinstance(written, list):
        return written
    mark, *rest = written
    if mark == "L":
        items = [_value(None, each) for each in rest[0]]
        if isinstance(present, list):
            present[:] = items
            return present
        return items
    if mark == "D":
        return deque((_value(None, each) for each in rest[0]), maxlen=rest[1])
    if mark == "M":
        found = {key: _value(None, each) for key, each in rest[0]}
        if isinstance(present, dict):
            present.clear()
            present.update(found)
            return present
        return found
    if mark == "T":
        items = [_value(None, each) for each in rest[1]]
        return _CLASSES[rest[0]](*items) if rest[0] else tuple(items)
    if mark == "S":
        kind = _CLASSES[rest[0]]
        values = [_value(None, each) for each in rest[1]]
        return kind(**dict(zip(kind.__struct_fields__, values, strict=True)))  # type: ignore[attr-defined]
    if mark == "C":
        return complex(*rest)
    if mark == "O":
        kind = _CLASSES[rest[0]]
        thing = present if type(present) is kind else object.__new__(kind)
        _fill(thing, rest[1])
        return thing
    raise NotAState(f"an unknown mark, {mark!r}")
