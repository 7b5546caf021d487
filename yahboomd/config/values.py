"""What a value in the configuration may be, and the words for it.

Every constraint here carries its own words, so that a mistake, the reference page and the comments
in ``config.toml`` say the same thing.
"""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

import annotated_types
from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

Place: TypeAlias = tuple[str | int, ...]
"""Where a value stands: keys, and indices into lists."""

BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


class Section(BaseModel):
    """A table of the configuration: no unknown keys, no guessing of types, no NaN, no changes."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


@dataclass(frozen=True)
class Choice:
    """One of a few names, such as the rows of a registry, or of a few whole numbers.

    Attributes:
        names: What may stand there.
        refusals: Beginnings of what may not, each with the reason.
    """

    names: tuple[str | int, ...]
    refusals: tuple[tuple[str, str], ...] = ()

    def __get_pydantic_core_schema__(
        self, _source: object, _handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        choice = core_schema.literal_schema(list(self.names))
        if isinstance(self.names[0], str):
            return choice
        # True equals 1 for a literal; a sign is no switch.
        return core_schema.chain_schema([core_schema.int_schema(strict=True), choice])

    def reason(self, value: object) -> str:
        """Why exactly this value is refused, where there is more to say than what is expected."""
        if not isinstance(value, str):
            return ""
        return next((why for start, why in self.refusals if value.startswith(start)), "")


@dataclass(frozen=True)
class Checked:
    """Text that passes a test.

    Attributes:
        words: What is expected, to follow "expected".
        test: Whether a text is that.
    """

    words: str
    test: Callable[[str], bool]

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._pass, handler(source))

    def _pass(self, text: str) -> str:
        if not self.test(text):
            raise ValueError(self.words)
        return text


def _is_key(text: str) -> bool:
    # A key expression of Zenoh without wild cards. "@" opens verbatim chunks, which no subscriber
    # with wild cards would see.
    return all(text.split("/")) and not re.search(r"[*$?#@\s\x00-\x1f]", text)


def _is_source(text: str) -> bool:
    return _is_key(text) and text.split("/", maxsplit=1)[0] != "yahboomd"


def _is_frame(text: str) -> bool:
    return re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_/.-]*", text) is not None


def is_topic(text: str) -> bool:
    """Whether ROS 2 takes this for a relative name of a topic or a namespace."""
    return re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*", text) is not None


ENDPOINT = re.compile(r"(?P<protocol>[a-z_-]+)/(?P<address>[^?#\s]+)(\?[^#\s]*)?(#\S*)?")
HOST_AND_PORT = re.compile(r"(?P<host>\[[0-9A-Fa-f:.%a-z]+\]|[^:\[\]/]+):(?P<port>[0-9]{1,5})")
PROTOCOLS = ("tcp", "udp", "tls", "quic", "unixsock-stream")
"""What the Zenoh wheel has compiled in, and clients in other languages speak as well."""


def _is_endpoint(text: str) -> bool:
    parts = ENDPOINT.fullmatch(text)
    if parts is None or parts["protocol"] not in PROTOCOLS:
        return False
    if parts["protocol"] == "unixsock-stream":
        return True
    address = HOST_AND_PORT.fullmatch(parts["address"])
    return address is not None and int(address["port"]) <= 65535


Key: TypeAlias = Annotated[
    str,
    Checked(
        'a name such as "bot1" or "fleet/bot1", or "", '
        "with no slash at its ends and none of * $ ? # @ or blanks",
        lambda text: text == "" or _is_key(text),
    ),
]
SourceKey: TypeAlias = Annotated[
    str,
    Checked(
        'a key such as "cmd_vel" that is not below "yahboomd/", '
        "with no slash at its ends and none of * $ ? # @ or blanks",
        _is_source,
    ),
]
Endpoint: TypeAlias = Annotated[
    str,
    Checked(
        'an endpoint such as "tcp/127.0.0.1:7448" or "unixsock-stream//run/yahboomd/zenoh.sock" '
        f"(protocols: {', '.join(PROTOCOLS)})",
        _is_endpoint,
    ),
]
Frame: TypeAlias = Annotated[
    str,
    Checked('a frame such as "odom", of letters, digits, _ - . and inner slashes', _is_frame),
]
Joint: TypeAlias = Annotated[
    str,
    Checked('a joint such as "left_wheel_joint", of letters, digits, _ - . and /', _is_frame),
]
FramePrefix: TypeAlias = Annotated[
    str,
    Checked(
        'a prefix such as "bot1/", or "", of letters, digits, _ - . and slashes but none in front',
        lambda text: text == "" or _is_frame(text),
    ),
]
Topic: TypeAlias = Annotated[
    str,
    Checked(
        'a ROS topic without a slash in front, such as "odom" or "wheel/odom"',
        is_topic,
    ),
]
MotorName: TypeAlias = Annotated[
    str,
    Checked(
        'a name such as "front_left", of letters, digits and _',
        lambda text: re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", text) is not None,
    ),
]
AbsolutePath: TypeAlias = Annotated[
    str,
    Checked(
        'an absolute path, or ""',
        lambda text: text == "" or (text.startswith("/") and "\x00" not in text),
    ),
]
Positive: TypeAlias = Annotated[float, Field(gt=0.0)]


def expected(annotation: object, metadata: Iterable[Any] = ()) -> str:
    """The words for what a type with these constraints takes: "a number greater than 0".

    Args:
        annotation: A type as pydantic holds it in ``FieldInfo.annotation``.
        metadata: The constraints beside it, ``FieldInfo.metadata``.
    """
    annotation, metadata = unwrap(annotation, metadata)
    for mark in metadata:
        if isinstance(mark, Choice):
            return one_of(mark.names)
        if isinstance(mark, Checked):
            return mark.words
    origin = typing.get_origin(annotation)
    if origin is typing.Literal:
        return one_of(typing.get_args(annotation))
    if origin is tuple:
        return f"a list, each entry {expected(typing.get_args(annotation)[0])}"
    if origin is dict:
        return f"a table of names, each {expected(typing.get_args(annotation)[1])}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"a table {{ {', '.join(annotation.model_fields)} }}"
    return f"{_WORDS.get(annotation, 'a value')}{_bounds(metadata)}"


_WORDS: dict[object, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
}


def one_of(names: Iterable[Any]) -> str:
    """Names in quotes, numbers bare: ``"a", "b" or "c"``."""
    quoted = [f'"{name}"' if isinstance(name, str) else str(name) for name in names]
    return " or ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)


def unwrap(annotation: object, metadata: Iterable[Any] = ()) -> tuple[Any, list[Any]]:
    """Strip ``Annotated`` and ``| None`` off a type; the constraints found join the others."""
    marks = list(metadata)
    while True:
        origin = typing.get_origin(annotation)
        if origin is Annotated:
            annotation, *more = typing.get_args(annotation)
            for mark in more:
                marks.extend(getattr(mark, "metadata", None) or [mark])
        elif origin in {types.UnionType, typing.Union}:
            annotation = next(a for a in typing.get_args(annotation) if a is not types.NoneType)
        else:
            return annotation, marks


def _bounds(metadata: Iterable[Any]) -> str:
    low = high = ""
    for mark in metadata:
        match mark:
            case annotated_types.Gt(gt=bound):
                low = f"greater than {number(bound)}"
            case annotated_types.Ge(ge=bound):
                low = f"at least {number(bound)}"
            case annotated_types.Lt(lt=bound):
                high = f"less than {number(bound)}"
            case annotated_types.Le(le=bound):
                high = f"at most {number(bound)}"
            case _:
                pass
    if low.startswith("at least") and high.startswith("at most"):
        return f" from {low.removeprefix('at least ')} to {high.removeprefix('at most ')}"
    words = " and ".join(filter(None, (low, high)))
    return f" {words}" if words else ""


def number(value: object) -> str:
    """A bound without a needless ``.0``."""
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def dotted(place: Place) -> str:
    """A place as one writes it: ``command.sources."cmd_vel/teleop".priority``, ``left[0]``."""
    text = ""
    for part in place:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            bare = part if BARE_KEY.fullmatch(part) else toml_string(part)
            text += f".{bare}" if text else bare
    return text


def toml_string(text: str) -> str:
    """A basic string of TOML, every control character escaped."""
    escapes = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    body = "".join(
        escapes.get(char) or (f"\\u{ord(char):04x}" if ord(char) < 32 or ord(char) == 127 else char)
        for char in text
    )
    return f'"{body}"'
