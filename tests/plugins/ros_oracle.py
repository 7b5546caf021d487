"""Rosbags as the oracle of ROS 2's types: bytes, values and type hashes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore


class Oracle:
    """Builds, serialises and reads ROS 2 messages, and hashes their types."""

    def __init__(self) -> None:
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self._add_services()

    def _add_services(self) -> None:
        base = Nodetype.BASE
        fields = self.store.fielddefs
        # A .msg `char` is a uint8 to the type hash; rosbags hashes it as a char.
        constants, info = fields["service_msgs/msg/ServiceEventInfo"]
        gid = (Nodetype.ARRAY, ((base, ("uint8", 0)), 16))
        fields["service_msgs/msg/ServiceEventInfo"] = (
            constants,
            [(field, gid if field == "client_gid" else kind) for field, kind in info],
        )
        empty = [("structure_needs_at_least_one_member", (base, ("uint8", 0)))]
        flag = [("data", (base, ("bool", 0)))]
        reply = [("success", (base, ("bool", 0))), ("message", (base, ("string", 0)))]
        self._add_service("std_srvs/srv/Trigger", empty, reply)
        self._add_service("std_srvs/srv/SetBool", flag, reply)
        self._add_parameter_services()

    def _add_parameter_services(self) -> None:
        base, name, sequence = Nodetype.BASE, Nodetype.NAME, Nodetype.SEQUENCE

        def several(message: str) -> Any:
            return (sequence, ((name, f"rcl_interfaces/msg/{message}"), 0))

        texts = (sequence, ((base, ("string", 0)), 0))
        result = (name, "rcl_interfaces/msg/SetParametersResult")
        listed = (name, "rcl_interfaces/msg/ListParametersResult")
        for service, request, response in (
            (
                "ListParameters",
                [("prefixes", texts), ("depth", (base, ("uint64", 0)))],
                ("result", listed),
            ),
            (
                "DescribeParameters",
                [("names", texts)],
                ("descriptors", several("ParameterDescriptor")),
            ),
            ("GetParameters", [("names", texts)], ("values", several("ParameterValue"))),
            (
                "GetParameterTypes",
                [("names", texts)],
                ("types", (sequence, ((base, ("uint8", 0)), 0))),
            ),
            (
                "SetParameters",
                [("parameters", several("Parameter"))],
                ("results", several("SetParametersResult")),
            ),
            ("SetParametersAtomically", [("parameters", several("Parameter"))], ("result", result)),
        ):
            self._add_service(f"rcl_interfaces/srv/{service}", request, [response])

    def _add_service(self, full: str, request: list[Any], response: list[Any]) -> None:
        name, sequence = Nodetype.NAME, Nodetype.SEQUENCE
        event = [
            ("info", (name, "service_msgs/msg/ServiceEventInfo")),
            ("request", (sequence, ((name, f"{full}_Request"), 1))),
            ("response", (sequence, ((name, f"{full}_Response"), 1))),
        ]
        parts = [
            ("request_message", (name, f"{full}_Request")),
            ("response_message", (name, f"{full}_Response")),
            ("event_message", (name, f"{full}_Event")),
        ]
        self.store.register(
            {
                f"{full}_Request": ([], request),
                f"{full}_Response": ([], response),
                f"{full}_Event": ([], event),
                full: ([], parts),
            }
        )

    def build(self, typename: str, value: Any) -> Any:
        """A rosbags message from nested dicts; a missing field is refused."""
        fields = self.store.fielddefs[typename][1]
        assert {field for field, _ in fields} == set(value), typename
        return self.store.types[typename](
            **{field: self._convert(kind, value[field]) for field, kind in fields}
        )

    def _convert(self, kind: Any, value: Any) -> Any:
        node, detail = kind
        if node == Nodetype.NAME:
            return self.build(detail, value)
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            inner = detail[0]
            if inner[0] == Nodetype.NAME:
                return [self.build(inner[1], item) for item in value]
            if inner[1][0] == "string":
                return list(value)
            return np.array(value, dtype=np.dtype(inner[1][0]))
        return value

    def encode(self, typename: str, value: Any, *, little_endian: bool = True) -> bytes:
        """The CDR bytes of nested dicts."""
        message = self.build(typename, value)
        return bytes(self.store.serialize_cdr(message, typename, little_endian=little_endian))

    def decode(self, typename: str, payload: bytes) -> Any:
        """CDR bytes as nested dicts and lists."""
        return self._plain(self.store.deserialize_cdr(payload, typename))

    def _plain(self, value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value.tolist()
        if isinstance(value, list):
            return [self._plain(item) for item in value]
        if hasattr(value, "__msgtype__"):
            fields = self.store.fielddefs[value.__msgtype__][1]
            return {field: self._plain(getattr(value, field)) for field, _ in fields}
        return value

    def type_hash(self, typename: str) -> str:
        """The RIHS01 hash of a message or a service."""
        return self.store.hash_rihs01(typename)


def _header(stamp_ns: int, frame_id: str) -> dict[str, Any]:
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}


def _xyz(numbers: Any) -> dict[str, float]:
    return dict(zip("xyz", numbers, strict=True))


def _twist(numbers: Any) -> dict[str, Any]:
    return {"linear": _xyz(numbers[:3]), "angular": _xyz(numbers[3:])}


def _quaternion(numbers: Any) -> dict[str, float]:
    return dict(zip("xyzw", numbers, strict=True))


@pytest.fixture(scope="session")
def ros() -> SimpleNamespace:
    """Builders of the parts of ROS messages, as nested dicts."""
    return SimpleNamespace(header=_header, xyz=_xyz, twist=_twist, quaternion=_quaternion)


@pytest.fixture(scope="session")
def oracle() -> Oracle:
    return Oracle()
