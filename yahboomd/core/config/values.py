"""The types of values in the configuration, and how a key is written in messages.

Each type states the values that it takes; the reference page and ``config.toml`` repeat these
words. pydantic checks the types, and is imported only to read values: `yahboomd stop` needs none.
"""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field
from functools import cache
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    Self,
    TypeAlias,
    TypeVar,
    dataclass_transform,
)

import msgspec

from yahboomd.core.names import (
    PROTOCOLS,
    camera_problem,
    endpoint_problem,
    is_ros_name,
    name_problem,
)

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, TypeAdapter
    from pydantic_core import CoreSchema

T = TypeVar("T")

Place: TypeAlias = tuple[str | int, ...]
"""The keys, and indices into lists, that lead to a value."""


def key(*, default: Any = MISSING, description: str, **bounds: Any) -> Any:  # noqa: ANN401
    """A key of a section.

    Args:
        default: Its value if it is not given; without a default it must be given.
        description: Its meaning.
        bounds: The values that it takes, as the arguments of pydantic's ``Field``.
    """
    about = {"description": description, **bounds}
    if not isinstance(default, dict):
        return field(default=default, metadata=about)
    shown = {"default": msgspec.to_builtins(default)}
    return field(default_factory=default.copy, metadata={**about, "json_schema_extra": shown})


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(key,))
class Section:
    """A table of the configuration: no unknown keys, no guessed types, no NaN, no changes."""

    __pydantic_config__: ClassVar[Mapping[str, object]] = {
        "extra": "forbid",
        "strict": True,
        "allow_inf_nan": False,
    }

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def of(cls, data: object) -> Self:
        """The section with these values, checked.

        Raises:
            ValidationError: pydantic's; it has every mistake.
        """
        return cls._checker().validate_python(data)

    def as_data(self) -> dict[str, Any]:
        """The values, as in a file: a key that is absent is left out."""
        data: dict[str, Any] = without_none(msgspec.to_builtins(self))
        return data

    @classmethod
    @cache
    def _checker(cls) -> TypeAdapter[Self]:
        from pydantic import TypeAdapter

        return TypeAdapter(cls)

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        schema = handler(source)
        # A file has tables; only their values are strict.
        handler.resolve_ref_schema(schema)["strict"] = False  # type: ignore[index]
        return schema

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        node = handler(schema)
        handler.resolve_ref_schema(node)["description"] = inspect.getdoc(cls)
        return node


def without_none(value: Any) -> Any:  # noqa: ANN401
    """Tables and lists as in a file: entries that are None are omitted."""
    if isinstance(value, dict):
        return {key: without_none(item) for key, item in value.items() if item is not None}
    return [without_none(item) for item in value] if isinstance(value, list | tuple) else value


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds of a value within a key.

    Attributes:
        core: Added to the schema by which pydantic checks.
        shown: Added to the JSON Schema.
    """

    core: Mapping[str, Any]
    shown: Mapping[str, Any] = field(default_factory=dict)

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return {**handler(source), **self.core}

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(schema), **self.shown}


@dataclass(frozen=True)
class Choice:
    """One of a few names or numbers.

    Attributes:
        names: The names that are always valid.
        registry: Its rows at the time of a check are valid names as well.
    """

    names: tuple[str | int, ...]
    registry: Mapping[str, object] = field(default_factory=dict)

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        from pydantic_core import core_schema

        # The type comes first: True equals 1.
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(schema), "enum": self._known}

    @property
    def _known(self) -> list[str | int]:
        return [*self.names, *self.registry]

    def _check(self, given: str | int) -> str | int:
        if given not in self._known:
            from pydantic_core import PydanticKnownError

            raise PydanticKnownError("literal_error", {"expected": str(self._known)})
        return given


@dataclass(frozen=True)
class Checked(Generic[T]):
    """A value that passes a check.

    Attributes:
        takes: The accepted values, as a noun; empty if the type shows them.
        problem: Returns the reason to refuse a text; None to accept it.
    """

    takes: str
    problem: Callable[[T], str | None]

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return handler(schema) | ({"$comment": self.takes} if self.takes else {})

    def _check(self, given: T) -> T:
        if problem := self.problem(given):
            from pydantic_core import PydanticCustomError

            raise PydanticCustomError("text", "{problem}", {"problem": problem})
        return given


@dataclass(frozen=True)
class Over:
    """A table whose missing entries are those of a default."""

    default: Section

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(self._fill, handler(source))

    def _fill(self, given: object) -> object:
        return {**self.default.as_data(), **given} if isinstance(given, Mapping) else given


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
Positive: TypeAlias = Annotated[float, Bounds({"gt": 0.0})]
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
