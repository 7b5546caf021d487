"""The types of values in the configuration, and how a key is written in messages.

Each type states the values that it takes; the reference page and ``config.toml`` repeat these
words.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Generic, TypeAlias, TypeVar

from annotated_types import GroupedMetadata
from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError, PydanticKnownError

from yahboomd.core.names import (
    PROTOCOLS,
    camera_problem,
    endpoint_problem,
    is_ros_name,
    name_problem,
)

T = TypeVar("T")

Place: TypeAlias = tuple[str | int, ...]
"""The keys, and indices into lists, that lead to a value."""


class Section(BaseModel):
    """A table of the configuration: no unknown keys, no guessed types, no NaN, no changes."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    def as_data(self) -> dict[str, Any]:
        """The values, as in a file: a key that is absent is left out."""
        return self.model_dump(mode="json", exclude_none=True)


@dataclass(frozen=True)
class Choice(GroupedMetadata):
    """One of a few names or numbers.

    Attributes:
        names: The names that are always valid.
        registry: Its rows at the time of a check are valid names as well.
    """

    names: tuple[str | int, ...]
    registry: Mapping[str, object] = field(default_factory=dict)

    def __iter__(self) -> Iterator[object]:
        # The type comes first: True equals 1.
        yield AfterValidator(self._check)
        yield Field(json_schema_extra=lambda node: node.update(enum=self._known))

    @property
    def _known(self) -> list[Any]:
        return [*self.names, *self.registry]

    def _check(self, given: str | int) -> str | int:
        if given not in self._known:
            raise PydanticKnownError("literal_error", {"expected": str(self._known)})
        return given


@dataclass(frozen=True)
class Checked(GroupedMetadata, Generic[T]):
    """A value that passes a check.

    Attributes:
        takes: The accepted values, as a noun; empty if the type shows them.
        problem: Returns the reason to refuse a text; None to accept it.
    """

    takes: str
    problem: Callable[[T], str | None]

    def __iter__(self) -> Iterator[object]:
        yield AfterValidator(self._check)
        if self.takes:
            yield Field(json_schema_extra={"$comment": self.takes})

    def _check(self, given: T) -> T:
        if problem := self.problem(given):
            raise PydanticCustomError("text", "{problem}", {"problem": problem})
        return given


def _like(pattern: str, takes: str) -> Checked[str]:
    found = re.compile(pattern).fullmatch
    return Checked(takes, lambda text: None if found(text) else f"expected {takes}")


def _source_problem(text: str) -> str | None:
    own = text.split("/", maxsplit=1)[0] == "yahboomd"
    return "keys below yahboomd/ are yahboomd's own" if own else name_problem(text)


Key: TypeAlias = Annotated[
    str,
    Checked(
        'a name such as "bot1" or "fleet/bot1", or "", '
        "with no slash at its ends and none of * $ ? # @ or blanks",
        lambda text: name_problem(text) if text else None,
    ),
]
SourceKey: TypeAlias = Annotated[
    str,
    Checked(
        'a key such as "cmd_vel" that is not below "yahboomd/", '
        "with no slash at its ends and none of * $ ? # @ or blanks",
        _source_problem,
    ),
]
Endpoint: TypeAlias = Annotated[
    str,
    Checked(
        'an endpoint such as "tcp/127.0.0.1:7448" or "unixsock-stream//run/yahboomd/zenoh.sock" '
        f"(protocols: {', '.join(PROTOCOLS)})",
        endpoint_problem,
    ),
]
Camera: TypeAlias = Annotated[
    str, Checked('an address such as "http://127.0.0.1:8080/stream", or ""', camera_problem)
]
RelayLine: TypeAlias = Annotated[
    str, _like(r"(/dev/[\w./-]+:\d+)?", 'a line to toggle, such as "/dev/gpiochip0:17", or ""')
]
_FRAME = r"[A-Za-z0-9_][A-Za-z0-9_/.-]*"
Frame: TypeAlias = Annotated[
    str, _like(_FRAME, 'a frame such as "odom", of letters, digits, _ - . and inner slashes')
]
Joint: TypeAlias = Annotated[
    str, _like(_FRAME, 'a joint such as "left_wheel_joint", of letters, digits, _ - . and /')
]
FramePrefix: TypeAlias = Annotated[
    str,
    _like(
        f"({_FRAME})?",
        'a prefix such as "bot1/", or "", of letters, digits, _ - . and slashes but none in front',
    ),
]
_TOPIC = 'a ROS topic without a slash in front, such as "odom" or "wheel/odom"'
Topic: TypeAlias = Annotated[
    str, Checked(_TOPIC, lambda text: None if is_ros_name(text) else f"expected {_TOPIC}")
]
MotorName: TypeAlias = Annotated[
    str, _like(r"[A-Za-z][A-Za-z0-9_]*", 'a name such as "front_left", of letters, digits and _')
]
AbsolutePath: TypeAlias = Annotated[str, _like(r"(?s)(/[^\0]*)?", 'an absolute path, or ""')]
AnyPath: TypeAlias = Annotated[
    str, Checked("", lambda text: "a path has no byte 0" if "\0" in text else None)
]
Positive: TypeAlias = Annotated[float, Field(gt=0.0)]
Sign: TypeAlias = Annotated[int, Choice((1, -1))]


def dotted(place: Place) -> str:
    """A place as a person writes it: ``command.sources."cmd_vel/teleop".priority``, ``left[0]``."""
    text = ""
    for part in place:
        text += f"[{part}]" if isinstance(part, int) else f"{'.' if text else ''}{_name(part)}"
    return text


def _name(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else inline(key)


def inline(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            # TOML's basic strings are JSON's, except for one character.
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case dict():
            pairs = [f"{_name(str(key))} = {inline(item)}" for key, item in value.items()]
            return f"{{ {', '.join(pairs)} }}" if pairs else "{}"
        case list() | tuple():
            return f"[{', '.join(map(inline, value))}]"
        case _:
            return str(value)


def number(value: float) -> str:
    """A number without a needless ``.0``."""
    return f"{value:.12g}"
