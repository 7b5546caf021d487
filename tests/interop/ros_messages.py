"""Writes and reads messages by ROS 2's own typesupport. From each line of standard input a line:

["write", "rcl_interfaces/srv/ListParameters_Request", {"depth": 1}]     their bytes, in hex
["read", "rcl_interfaces/srv/ListParameters_Response", "0001..."]        their fields
["hash", "rcl_interfaces/srv/ListParameters"]                            the type's hash
"""

import importlib
import json
import os
import sys
from pathlib import Path
from typing import Any

# The wheels are no ROS installation: this names the folder that holds their resources.
os.environ["AMENT_PREFIX_PATH"] = sys.prefix

from rclpy.serialization import deserialize_message, serialize_message


def type_of(name: str) -> Any:
    package, kind, message = name.split("/")
    module = importlib.import_module(f"{package}.{kind}")
    service, _, part = message.partition("_")
    return getattr(getattr(module, service), part) if part else getattr(module, message)


def build(kind: Any, fields: dict[str, Any]) -> Any:
    types = kind.get_fields_and_field_types()
    return kind(**{name: converted(types[name], value) for name, value in fields.items()})


def converted(field_type: str, value: Any) -> Any:
    if isinstance(value, dict):
        package, entry = field_type.removeprefix("sequence<").removesuffix(">").split("/")
        return build(type_of(f"{package}/msg/{entry}"), value)
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [converted(field_type, each) for each in value]
    return value


def plain(value: Any) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value[0]
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(each) for each in value] if isinstance(value, (list, tuple)) else value


def done(order: list[Any]) -> Any:
    match order:
        case ["write", name, fields]:
            return serialize_message(build(type_of(name), fields)).hex()
        case ["read", name, payload]:
            return plain(deserialize_message(bytes.fromhex(payload), type_of(name)))
        case ["hash", name]:
            file = Path(sys.prefix, "share", f"{name}.json")
            hashes = json.loads(file.read_text())["type_hashes"]
            return next(each["hash_string"] for each in hashes if each["type_name"] == name)
    raise ValueError(order)


for line in sys.stdin:
    print(json.dumps(done(json.loads(line))), flush=True)
