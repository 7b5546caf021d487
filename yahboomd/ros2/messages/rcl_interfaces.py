"""ROS 2's interfaces of every node, in CDR: parameter services with read-only values, and the log.

A request that cannot be read gets the answer to an empty one: a client waits for ever for
any other.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import TypeAlias, TypeVar

from yahboomd.core.messages import cdr
from yahboomd.ros2.messages import ros2_encoders, ros2_names

Value: TypeAlias = bool | int | float | str | tuple[bool | int | float | str, ...]
"""A parameter's value; the entries of a tuple have one type."""

NOT_SET = 0
_SCALARS: dict[type, int] = {bool: 1, int: 2, float: 3, str: 4}
_ARRAYS: dict[type, int] = {bool: 6, int: 7, float: 8, str: 9}
"""rcl_interfaces/msg/ParameterType; byte arrays (5) are not used."""

_PARAMETER_BYTES = 40
"""A rcl_interfaces/msg/Parameter has at least this many."""

LEVELS = {"info": 20, "warning": 30, "error": 40}
"""rcl_interfaces/msg/Log's levels, by the severity of an event."""


def log(stamp_ns: int, level: int, name: str, message: str, function: str) -> bytes:
    """A rcl_interfaces/msg/Log: a line of a node's log, without file and line.

    Args:
        level: One of :data:`LEVELS`.
        name: The logger's, which is the node's.
        function: Shown as its location.
    """
    out = bytearray(struct.pack("<4s2IB", cdr.HEADER_LE, *ros2_encoders.stamp(stamp_ns), level))
    for text in (name, message, "", function):
        cdr.put_text(out, text)
    cdr.put_count(out, 0)
    return bytes(out)


class ParameterServer:
    """Answers the parameter services of a node whose parameters do not change.

    Args:
        values: Each parameter by its name, whose parts are separated by dots.
        meanings: What each means and what it takes, by its name.
        refusal: The reason why no parameter can be set.
    """

    def __init__(
        self, values: Mapping[str, Value], meanings: Mapping[str, tuple[str, str]], refusal: str
    ) -> None:
        self._values = values
        self._meanings = meanings
        self._refusal = refusal
        self.services: dict[str, tuple[str, Callable[[bytes], bytes]]] = {
            "list_parameters": (ros2_names.LIST_PARAMETERS, self._list),
            "describe_parameters": (ros2_names.DESCRIBE_PARAMETERS, self._describe),
            "get_parameters": (ros2_names.GET_PARAMETERS, self._get),
            "get_parameter_types": (ros2_names.GET_PARAMETER_TYPES, self._types),
            "set_parameters": (ros2_names.SET_PARAMETERS, self._set),
            "set_parameters_atomically": (ros2_names.SET_ATOMICALLY, self._set_atomically),
        }
        """By name below the node's: the type, and what makes a response of a request."""

    def _list(self, request: bytes) -> bytes:
        asked = _read(request, lambda reader: (reader.texts(), reader.number("Q")))
        prefixes, depth = asked or ((), 0)
        names = [name for name in self._values if _is_listed(name, prefixes, depth)]
        above = sorted({name.rpartition(".")[0] for name in names if "." in name})
        out = _response()
        _put_texts(out, names)
        _put_texts(out, above)
        return bytes(out)

    def _describe(self, request: bytes) -> bytes:
        names = _read(request, _Reader.texts) or ()
        out = _response()
        cdr.put_count(out, len(names))
        for name in names:
            known = name in self._values
            meaning, takes = self._meanings.get(name, ("", ""))
            cdr.put_text(out, name)
            out.append(self._type(name))
            cdr.put_text(out, meaning)
            cdr.put_text(out, takes)
            out += bytes((known, False))  # read-only, not of changing type
            cdr.put_count(out, 0)
            cdr.put_count(out, 0)  # no ranges
        return bytes(out)

    def _get(self, request: bytes) -> bytes:
        names = _read(request, _Reader.texts) or ()
        out = _response()
        cdr.put_count(out, len(names))
        for name in names:
            _put_value(out, self._type(name), self._values.get(name))
        return bytes(out)

    def _types(self, request: bytes) -> bytes:
        names = _read(request, _Reader.texts) or ()
        out = _response()
        cdr.put_count(out, len(names))
        out += bytes(map(self._type, names))
        return bytes(out)

    def _set(self, request: bytes) -> bytes:
        names = _read(request, _Reader.parameters) or ()
        out = _response()
        cdr.put_count(out, len(names))
        for name in names:
            out.append(False)
            cdr.put_text(out, self._why_not(name))
        return bytes(out)

    def _set_atomically(self, request: bytes) -> bytes:
        names = _read(request, _Reader.parameters) or ()
        out = _response()
        out.append(not names)
        cdr.put_text(out, self._why_not(names[0]) if names else "")
        return bytes(out)

    def _type(self, name: str) -> int:
        value = self._values.get(name)
        if value is None:
            return NOT_SET
        if isinstance(value, tuple):
            return _ARRAYS[type(value[0])] if value else _ARRAYS[str]
        return _SCALARS[type(value)]

    def _why_not(self, name: str) -> str:
        return self._refusal if name in self._values else f"There is no parameter {name}."


def _is_listed(name: str, prefixes: tuple[str, ...], depth: int) -> bool:
    """Whether a list of parameters below ``prefixes`` has this one; a depth of 0 has no limit."""
    if not prefixes:
        return depth == 0 or name.count(".") < depth
    below = [name[len(prefix) + 1 :] for prefix in prefixes if name.startswith(f"{prefix}.")]
    return name in prefixes or any(depth == 0 or rest.count(".") < depth for rest in below)


def _response() -> bytearray:
    return bytearray(cdr.HEADER_LE)


def _put_texts(out: bytearray, texts: list[str]) -> None:
    cdr.put_count(out, len(texts))
    for text in texts:
        cdr.put_text(out, text)


def _put_value(out: bytearray, kind: int, value: Value | None) -> None:
    """Write a rcl_interfaces/msg/ParameterValue: each field in turn, all but one of them empty."""
    integer = value if kind == _SCALARS[int] else 0
    double = value if kind == _SCALARS[float] else 0.0
    out += bytes((kind, value is True))
    out += bytes(-(len(out) - 4) % 8)
    out += struct.pack("<qd", integer, double)
    cdr.put_text(out, value if isinstance(value, str) else "")
    cdr.put_count(out, 0)
    items = value if isinstance(value, tuple) else ()
    for each, code in ((bool, "?"), (int, "q"), (float, "d")):
        chosen = items if kind == _ARRAYS[each] else ()
        cdr.put_count(out, len(chosen))
        if chosen:
            out += bytes(-(len(out) - 4) % struct.calcsize(code))
            out += struct.pack(f"<{len(chosen)}{code}", *chosen)
    _put_texts(out, [str(item) for item in items] if kind == _ARRAYS[str] else [])


class _Malformed(ValueError):
    """A request ends early, or has another layout."""


Read = TypeVar("Read")


def _read(request: bytes, read: Callable[[_Reader], Read]) -> Read | None:
    try:
        return read(_Reader(request))
    except (_Malformed, UnicodeDecodeError):
        return None


class _Reader:
    """Reads values one after the other.

    Args:
        payload: CDR with its header, in either byte order.
    """

    def __init__(self, payload: bytes) -> None:
        if not cdr.is_cdr(payload):
            raise _Malformed
        self._order = "<" if payload[1] else ">"
        self._body = payload[4:]
        self._at = 0

    def number(self, code: str) -> int:
        """A number of a ``struct`` code."""
        size = struct.calcsize(f"={code}")
        self._at += -self._at % size
        (number,) = struct.unpack(self._order + code, self._take(size))
        return int(number)

    def text(self) -> str:
        return self._take(self.number("I")).rstrip(b"\0").decode()

    def texts(self) -> tuple[str, ...]:
        return tuple(self.text() for _ in range(self._count(4)))

    def parameters(self) -> tuple[str, ...]:
        """A sequence of rcl_interfaces/msg/Parameter, of which only the names matter."""
        names = list[str]()
        for _ in range(self._count(_PARAMETER_BYTES)):
            names.append(self.text())
            self._take(2)
            self.number("q")
            self.number("Q")
            self.text()
            for code in "BBqQ":
                for _ in range(self._count(struct.calcsize(f"={code}"))):
                    self.number(code)
            self.texts()
        return tuple(names)

    def _count(self, least: int) -> int:
        """The length of a sequence whose entries have at least ``least`` bytes."""
        count = self.number("I")
        if count * least > len(self._body) - self._at:
            raise _Malformed
        return count

    def _take(self, size: int) -> bytes:
        taken = self._body[self._at : self._at + size]
        if len(taken) != size:
            raise _Malformed
        self._at += size
        return taken
