"""Our bytes and our type hashes beside those of ROS 2's own typesupport."""

import json
import subprocess

import pytest
from ros_peers import HERE, built

from make.schema_files.cdr_samples import CDR
from yahboomd.core.config import read
from yahboomd.core.messages.native import SetPoseRequest
from yahboomd.core.messages.set_pose import decode_pose
from yahboomd.ros2.messages import ros2_names
from yahboomd.ros2.messages.rcl_interfaces import log
from yahboomd.ros2.ros2_parameters import parameter_server

DISTROS = ("jazzy", "kilted")
PARAMETER = {"name": "command.timeout_s", "value": {"type": 3, "double_value": 9.0}}
LISTS = {"string_array_value": ["a", "bc"], "integer_array_value": [1, 2], "byte_array_value": []}


@pytest.fixture(scope="module", params=DISTROS)
def ask(request):
    """Has ROS 2 write and read messages."""
    python = str(built(f"ros-{request.param}"))
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([python, str(HERE / "ros_messages.py")], **pipes) as process:

        def ask(*order):
            process.stdin.write(f"{json.dumps(order)}\n")
            process.stdin.flush()
            line = process.stdout.readline()
            assert line, "it ended; its words are above"
            return json.loads(line)

        yield ask


def test_ros_asks_for_parameters_and_reads_every_answer(ask):
    config = read(None, environ={}).config
    services = parameter_server(config).services
    names = ["command.timeout_s", "zenoh.listen", "serial.dtr", "no.such"]
    wanted = {
        "list_parameters": {"prefixes": ["command"], "depth": 1},
        "get_parameters": {"names": names},
        "get_parameter_types": {"names": names},
        "describe_parameters": {"names": names},
        "set_parameters": {"parameters": [PARAMETER, {"name": "no.such", "value": LISTS}]},
        "set_parameters_atomically": {"parameters": [PARAMETER]},
    }
    read_by_ros = []
    for service, fields in wanted.items():
        ros_type, respond = services[service]
        response = respond(bytes.fromhex(ask("write", f"{ros_type}_Request", fields)))
        read_by_ros.append(ask("read", f"{ros_type}_Response", response.hex()))
    listed, values, kinds, described, refused, at_once = read_by_ros
    assert "command.timeout_s" in listed["result"]["names"]
    assert values["values"][0]["double_value"] == 0.5
    assert values["values"][1]["string_array_value"] == ["tcp/127.0.0.1:7448"]
    assert values["values"][2]["bool_value"] is True
    assert kinds["types"] == [3, 9, 1, 0]
    assert [each["read_only"] for each in described["descriptors"]] == [True, True, True, False]
    assert "silence" in described["descriptors"][0]["description"]
    assert [each["successful"] for each in refused["results"]] == [False, False]
    assert refused["results"][1]["reason"] == "There is no parameter no.such."
    assert "read-only" in at_once["result"]["reason"]


def test_ros_reads_a_line_of_the_log(ask):
    payload = log(1_700_000_000_123_456_789, 30, "yahboomd", "The board is back: é.", "connected")
    line = ask("read", ros2_names.LOG, payload.hex())
    assert line["stamp"] == {"sec": 1_700_000_000, "nanosec": 123_456_789}
    assert (line["level"], line["name"], line["function"]) == (30, "yahboomd", "connected")
    assert line["msg"] == "The board is back: é."


def test_a_pose_that_ros_writes_is_read(ask):
    values = CDR["PoseWithCovarianceStamped"].values
    wanted = decode_pose(bytes.fromhex(ask("write", ros2_names.POSE, values)), "odom")
    assert wanted == decode_pose(CDR["PoseWithCovarianceStamped"].payload, "odom")
    assert isinstance(wanted, SetPoseRequest)


def test_type_hashes_are_those_of_the_distribution(ask):
    # tf2_msgs is no wheel.
    types = [name for name in ros2_names.TYPE_HASHES if not name.startswith("tf2_msgs/")]
    assert {name: ask("hash", name) for name in types} == {
        name: ros2_names.TYPE_HASHES[name] for name in types
    }
