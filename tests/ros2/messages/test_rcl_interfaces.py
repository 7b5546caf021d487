"""Parameter services and the log, byte for byte against rosbags."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.messages import cdr
from yahboomd.ros2.messages import ros2_names
from yahboomd.ros2.messages.rcl_interfaces import LEVELS, ParameterServer, log

VALUES = {
    "serial.port": "/dev/ttyUSB0",
    "serial.dtr": True,
    "serial.rts": False,
    "serial.baudrate": 115200,
    "odometry.poll_rate_hz": 50.0,
    "limits.linear.velocity": -0.25,
    "zenoh.listen": ("tcp/127.0.0.1:7448", "é"),
    "zenoh.connect": (),
    "board.curve": (9.6, 12.6),
    "board.counts": (1, -(2**40), 3),
    "board.flags": (True, False, True),
}
MEANINGS = {name: (f"About {name}.", f"as {name}") for name in VALUES}
REFUSAL = "It is read-only."
TYPES = dict(zip(VALUES, (4, 1, 1, 2, 3, 3, 9, 9, 8, 7, 6), strict=True))


@pytest.fixture
def server() -> ParameterServer:
    return ParameterServer(VALUES, MEANINGS, REFUSAL)


@pytest.fixture
def ask(server, oracle):
    """Asks a service as a node does; the answer is in the very bytes that a node would write."""

    def asked(service, *, little_endian=True, **request):
        ros_type, respond = server.services[service]
        payload = oracle.encode(f"{ros_type}_Request", request, little_endian=little_endian)
        response = respond(payload)
        message = oracle.store.deserialize_cdr(response, f"{ros_type}_Response")
        written = bytes(oracle.store.serialize_cdr(message, f"{ros_type}_Response"))
        assert written == response
        return oracle.decode(f"{ros_type}_Response", response)

    return asked


def parameter(name, **value):
    nothing = {
        "type": 0,
        "bool_value": False,
        "integer_value": 0,
        "double_value": 0.0,
        "string_value": "",
        **{f"{kind}_array_value": [] for kind in ("byte", "bool", "integer", "double", "string")},
    }
    return {"name": name, "value": {**nothing, **value}}


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize(
    ("prefixes", "depth", "names"),
    [
        ([], 0, list(VALUES)),
        ([], 1, []),
        ([], 2, [name for name in VALUES if name.count(".") == 1]),
        (["serial"], 0, [name for name in VALUES if name.startswith("serial.")]),
        (["limits"], 1, []),
        (["limits"], 2, ["limits.linear.velocity"]),
        (["limits.linear", "zenoh.listen"], 1, ["limits.linear.velocity", "zenoh.listen"]),
        (["seri"], 0, []),
    ],
)
def test_parameters_are_listed_below_prefixes_to_a_depth(
    ask, prefixes, depth, names, little_endian
):
    listed = ask("list_parameters", prefixes=prefixes, depth=depth, little_endian=little_endian)
    assert listed["result"]["names"] == names
    above = {name.rpartition(".")[0] for name in names}
    assert listed["result"]["prefixes"] == sorted(above)


def test_every_value_comes_in_the_field_of_its_type(ask):
    names = [*VALUES, "no.such"]
    got = ask("get_parameters", names=names)["values"]
    fields = {1: "bool", 2: "integer", 3: "double", 4: "string", 6: "bool_array"}
    fields |= {7: "integer_array", 8: "double_array", 9: "string_array"}
    for name, value in zip(names, got, strict=True):
        if name not in VALUES:
            assert value == parameter("")["value"]
            continue
        expected, kind = VALUES[name], TYPES[name]
        given = list(expected) if isinstance(expected, tuple) else expected
        wanted = parameter("", type=kind, **{f"{fields[kind]}_value": given})
        assert value == wanted["value"]
    assert ask("get_parameter_types", names=names) == {"types": [*TYPES.values(), 0]}


def test_a_description_says_what_it_is_and_that_it_is_read_only(ask):
    known, unknown = ask("describe_parameters", names=["serial.baudrate", "no.such"])["descriptors"]
    assert known == {
        "name": "serial.baudrate",
        "type": 2,
        "description": "About serial.baudrate.",
        "additional_constraints": "as serial.baudrate",
        "read_only": True,
        "dynamic_typing": False,
        "floating_point_range": [],
        "integer_range": [],
    }
    assert (unknown["name"], unknown["type"], unknown["read_only"]) == ("no.such", 0, False)


@pytest.mark.parametrize("little_endian", [True, False])
def test_nothing_is_set_and_each_refusal_has_its_reason(ask, little_endian):
    wanted = [
        parameter("serial.dtr", type=1, bool_value=False),
        parameter("no.such", type=9, string_array_value=["a", "bc"]),
        parameter("board.counts", type=7, integer_array_value=[1, 2]),
        parameter("board.flags", type=5, byte_array_value=[1, 2, 3]),
        parameter("board.curve", type=8, double_array_value=[0.5], bool_array_value=[True]),
    ]
    refused = ask("set_parameters", parameters=wanted, little_endian=little_endian)["results"]
    unknown = "There is no parameter no.such."
    assert [each["successful"] for each in refused] == [False] * 5
    assert [each["reason"] for each in refused] == [REFUSAL, unknown, *([REFUSAL] * 3)]
    once = ask("set_parameters_atomically", parameters=wanted)["result"]
    assert once == {"successful": False, "reason": REFUSAL}
    assert ask("set_parameters_atomically", parameters=[])["result"]["successful"]


@given(
    noise=st.binary(max_size=120),
    order=st.sampled_from([b"", b"\0\0\0\0", b"\0\1\0\0"]),
    cut=st.integers(0, 60),
)
def test_whatever_is_asked_is_answered_well_formed(oracle, noise, order, cut):
    server = ParameterServer(VALUES, MEANINGS, REFUSAL)
    wanted = {"parameters": [parameter("serial.dtr", string_array_value=["x"])]}
    for ros_type, respond in server.services.values():
        for request in (
            order + noise,
            oracle.encode(f"{ros2_names.SET_PARAMETERS}_Request", wanted)[:cut],
        ):
            response = respond(request)
            oracle.decode(f"{ros_type}_Response", response)


@pytest.mark.parametrize("count", [2**32 - 1, 1000])
def test_a_count_beyond_the_request_takes_no_memory(server, oracle, count):
    request = cdr.HEADER_LE + count.to_bytes(4, "little") + bytes(900)
    for service in ("get_parameters", "set_parameters"):
        ros_type, respond = server.services[service]
        ((_, answers),) = oracle.decode(f"{ros_type}_Response", respond(request)).items()
        assert answers == []


def test_a_line_of_the_log_is_read_as_it_was_written(oracle):
    stamp_ns = 1_700_000_000_123_456_789
    for severity, level in (("info", 20), ("warning", 30), ("error", 40)):
        payload = log(stamp_ns, LEVELS[severity], "yahboomd", "The board is back: é.", "connected")
        line = {
            "stamp": {"sec": 1_700_000_000, "nanosec": 123_456_789},
            "level": level,
            "name": "yahboomd",
            "msg": "The board is back: é.",
            "file": "",
            "function": "connected",
            "line": 0,
        }
        assert oracle.decode(ros2_names.LOG, payload) == line
        assert oracle.encode(ros2_names.LOG, line) == payload
