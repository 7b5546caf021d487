"""A robot as ROS 2 sees it: a bridge, an rmw_zenoh graph and its nodes, on real sessions."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
import zenoh
from real_robot import PATIENCE_S, Client, RealRobot, wait_for
from ros_oracle import Oracle
from zenoh_fixtures import late_subscriber

from make.schema_files.cdr_samples import pose_message
from yahboomd.core.config import read
from yahboomd.core.messages import cdr
from yahboomd.ros2.messages import ros2_encoders, ros2_names
from yahboomd.ros2.ros2_plane import topics

pytestmark = pytest.mark.realtime

TYPES = {
    "odom": ros2_names.ODOMETRY,
    "tf": ros2_names.TF_MESSAGE,
    "joint_states": ros2_names.JOINT_STATE,
    "battery_state": ros2_names.BATTERY_STATE,
    "diagnostics": ros2_names.DIAGNOSTIC_ARRAY,
    "estopped": ros2_names.BOOL,
}
LASER = 'ros2.static_transforms=[{parent="base_link",child="laser",z=0.1}]'


def native_key(topic: str, ros_type: str) -> str:
    return f"0/{topic}/{ros2_names.dds_type(ros_type)}/{ros2_names.TYPE_HASHES[ros_type]}"


class Graph:
    """Everything that comes on the keys of ROS 2, as it came."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.samples: dict[str, list[zenoh.Sample]] = {}
        for topic, ros_type in TYPES.items():
            self.hear(topic)
            self.hear(native_key(topic, ros_type))

    def hear(self, key: str) -> None:
        self.session.declare_subscriber(key, self.samples.setdefault(key, []).append)

    def payloads(self, topic: str) -> list[bytes]:
        return [sample.payload.to_bytes() for sample in list(self.samples[topic])]

    def ask(self, key: str, payload: bytes, attachment: bytes | None = None) -> zenoh.Sample:
        carried = {"payload": payload, "attachment": attachment}
        for reply in self.session.get(key, **carried, timeout=PATIENCE_S):
            assert reply.ok is not None
            return reply.ok
        pytest.fail(f"{key} did not answer")


@pytest.fixture
def run(real_robot: Callable[..., RealRobot]) -> Callable[..., RealRobot]:
    """Starts a robot with settings such as ``ros2.rmw_zenoh=true``."""

    def start(*settings: str) -> RealRobot:
        return real_robot(run=[part for each in settings for part in ("--set", each)])

    return start


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealRobot]:
    """One for several tests, in both planes; each leaves it standing."""
    settings = ("ros2.rmw_zenoh=true", "ros2.frame_prefix=bot1/", LASER)
    made = RealRobot(
        tmp_path_factory.mktemp("robot"),
        run=[part for each in settings for part in ("--set", each)],
    )
    yield made
    made.close()


def answers(
    graph: Graph, oracle: Oracle, ros_type: str, way: tuple[Any, ...], success: bool
) -> zenoh.Sample | None:
    """The answer to a request; None if it succeeds where it should not, or the other way round."""
    answer = graph.ask(*way)
    reply = oracle.decode(f"{ros_type}_Response", answer.payload.to_bytes())
    assert reply["message"]
    return answer if reply["success"] is success else None


def stamp_ns(header: dict[str, Any]) -> int:
    return int(header["stamp"]["sec"]) * 1_000_000_000 + int(header["stamp"]["nanosec"])


def test_ros_reads_every_byte_and_the_same_readings_as_the_native_plane(
    robot: RealRobot, client: Callable[..., Client], oracle: Oracle
) -> None:
    app = client("client", robot.endpoint)
    graph = Graph(app.session)
    app.in_state("standing")
    app.drive_until(
        ros2_encoders.twist((0.25, 0.0, 0.0, 0.0, 0.0, 0.6)),
        lambda: app.latest("twist")["vx"] > 0.22 and len(graph.samples["odom"]) > 60,
        "it drives",
    )
    robot.settled_truth()
    wait_for(lambda: all(graph.samples[topic] for topic in TYPES), "every topic")
    for topic, ros_type in TYPES.items():
        for payload in graph.payloads(topic)[-20:]:
            # A message that ROS writes in the very bytes that it was read from.
            message = oracle.store.deserialize_cdr(payload, ros_type)
            assert bytes(oracle.store.serialize_cdr(message, ros_type)) == payload

    odometry = [oracle.decode(ros2_names.ODOMETRY, payload) for payload in graph.payloads("odom")]
    transforms = [
        oracle.decode(ros2_names.TF_MESSAGE, payload)["transforms"]
        for payload in graph.payloads("tf")
    ]
    stamps = [stamp_ns(transform["header"]) for (transform,) in transforms]
    assert stamps == sorted(set(stamps)), "tf2 takes a repeated transform for a mistake"
    poses = {pose["stamp_ns"]: pose for pose in app.samples["pose"]}
    same = [each for each in odometry if stamp_ns(each["header"]) in poses]
    assert len(same) > 20
    for each in same:
        native, there = poses[stamp_ns(each["header"])], each["pose"]["pose"]["position"]
        assert (there["x"], there["y"]) == (native["x"], native["y"])
        assert each["pose"]["covariance"][35] == native["covariance"][8]
        assert each["header"]["frame_id"] == "bot1/odom"
        assert each["child_frame_id"] == "bot1/base_link"
    assert any(each["twist"]["twist"]["linear"]["x"] > 0.2 for each in same)


def test_natively_the_same_bytes_go_out_with_an_attachment(
    robot: RealRobot, client: Callable[..., Client]
) -> None:
    graph = Graph(client("client", robot.endpoint).session)
    wait_for(lambda: len(graph.samples["odom"]) > 20, "odometry")
    for topic, ros_type in TYPES.items():
        key = native_key(topic, ros_type)
        wait_for(lambda key=key: graph.samples[key], topic)
        attached = [
            ros2_names.parse_attachment(sample.attachment.to_bytes())
            for sample in list(graph.samples[key])
            if sample.attachment is not None
        ]
        assert None not in attached
        first = attached[0].sequence
        numbers = [each.sequence for each in attached]
        assert numbers == list(range(first, first + len(numbers)))
        assert len({each.gid for each in attached}) == 1
    odom = native_key("odom", ros2_names.ODOMETRY)
    wait_for(
        lambda: len(set(graph.payloads("odom")) & set(graph.payloads(odom))) > 20, "the same bytes"
    )


def test_a_late_subscriber_gets_the_static_frames(
    robot: RealRobot, client: Callable[..., Client], oracle: Oracle
) -> None:
    app = client("client", robot.endpoint)
    app.in_state("standing")
    for key in ("tf_static", native_key("tf_static", ros2_names.TF_MESSAGE)):
        with late_subscriber(app.session, key, newest=1) as heard:
            wait_for(lambda heard=heard: heard, key)
        (laser,) = oracle.decode(ros2_names.TF_MESSAGE, heard[0].payload.to_bytes())["transforms"]
        frames = laser["header"]["frame_id"], laser["child_frame_id"]
        assert frames == ("bot1/base_link", "bot1/laser")
        assert laser["transform"]["translation"] == {"x": 0.0, "y": 0.0, "z": 0.1}
    # A subscriber that knows nothing of caches waits a second at most.
    plain: list[zenoh.Sample] = []
    app.session.declare_subscriber("tf_static", plain.append)
    wait_for(lambda: plain, "frames for a plain subscriber")


def test_what_ros_asks_is_answered_in_cdr(
    robot: RealRobot, client: Callable[..., Client], oracle: Oracle
) -> None:
    app = client("client", robot.endpoint)
    app.in_state("standing")
    graph = Graph(app.session)
    gid = bytes(range(16))
    asked = ros2_names.attachment(5, 1, gid)
    for key, ros_type, payload, success, state in (
        ("yahboomd/estop", ros2_names.SET_BOOL, ros2_encoders.boolean(True), True, "estopped"),
        ("yahboomd/estop", ros2_names.SET_BOOL, ros2_encoders.boolean(False), False, "estopped"),
        (
            "yahboomd/estop/reset",
            ros2_names.TRIGGER,
            ros2_encoders.trigger_request(),
            True,
            "standing",
        ),
        (
            "yahboomd/odometry/reset",
            ros2_names.TRIGGER,
            ros2_encoders.trigger_request(),
            True,
            "standing",
        ),
        # The least that the bridge leaves of a request: the header of its encoding.
        ("yahboomd/odometry/reset", ros2_names.TRIGGER, cdr.HEADER_LE, True, "standing"),
    ):
        for way in ((key, payload), (native_key(key, ros_type), payload, asked)):
            # A daemon that a starved board leaves without counts refuses for the moment.
            native = wait_for(partial(answers, graph, oracle, ros_type, way, success), str(way))
        assert native.attachment is not None
        returned = ros2_names.parse_attachment(native.attachment.to_bytes())
        assert (returned.sequence, returned.gid) == (5, gid)
        app.in_state(state)


@pytest.mark.nightly
def test_natively_the_estop_answers_to_the_names_of_other_bases(
    run: Callable[..., RealRobot], client: Callable[..., Client], oracle: Oracle
) -> None:
    robot = run("ros2.rmw_zenoh=true", "zenoh.namespace=bot1")
    app = client("client", robot.endpoint, "bot1/yahboomd")
    app.in_state("standing")
    graph = Graph(app.session)
    asked = ros2_names.attachment(5, 1, bytes(range(16)))
    for name, request, state in (
        # The zero byte of an empty request is the false of a SetBool, which is refused.
        ("e_stop_trigger", ros2_encoders.trigger_request(), "estopped"),
        ("e_stop_trigger", cdr.HEADER_LE, "estopped"),
        ("e_stop_reset", ros2_encoders.trigger_request(), "standing"),
        ("odometry_reset", ros2_encoders.trigger_request(), "standing"),
    ):
        answer = graph.ask(native_key(f"bot1/{name}", ros2_names.TRIGGER), request, asked)
        reply = oracle.decode(f"{ros2_names.TRIGGER}_Response", answer.payload.to_bytes())
        assert reply["success"] is True
        app.in_state(state)


def test_the_estop_is_a_topic_too_and_a_button_that_is_not_pressed_changes_nothing(
    robot: RealRobot, client: Callable[..., Client], oracle: Oracle
) -> None:
    app = client("client", robot.endpoint)
    app.in_state("standing")
    graph = Graph(app.session)
    refused = app.latest("status")["command"]["release_refused"]
    pressed, let_go = ros2_encoders.boolean(True), ros2_encoders.boolean(False)
    attached = ros2_names.attachment(1, 1, bytes(range(16)))

    def idle() -> int:
        return int(app.latest("status")["command"]["estop_not_pressed"])

    def said() -> list[bool]:
        return [
            oracle.decode(ros2_names.BOOL, payload)["data"]
            for payload in graph.payloads("estopped")
        ]

    def press(key: str, payload: bytes) -> None:
        app.session.put(key, payload, attachment=attached if key != "yahboomd/estop" else None)

    for key in ("yahboomd/estop", native_key("yahboomd/estop", ros2_names.BOOL)):
        wait_for(lambda: said()[-1:] == [False], "not engaged")
        before = idle()
        for _ in range(50):
            press(key, let_go)
        wait_for(lambda before=before: idle() == before + 50, "samples that ask for nothing")
        app.in_state("standing")
        # However often the bridge delivers it.
        for _ in range(32):
            press(key, pressed)
        app.in_state("estopped")
        wait_for(lambda: said()[-1:] == [True], "engaged")
        press(key, let_go)
        wait_for(lambda before=before: idle() == before + 51, "a button that was let go")
        assert app.latest("status")["state"] == "estopped"
        assert app.latest("status")["command"]["release_refused"] == refused
        reset = ("yahboomd/estop/reset", ros2_encoders.trigger_request())
        wait_for(partial(answers, graph, oracle, ros2_names.TRIGGER, reset, True), "released")
        app.in_state("standing")


def test_a_pose_in_the_frame_of_the_odometry_is_set_and_any_other_refused(
    robot: RealRobot, client: Callable[..., Client], oracle: Oracle
) -> None:
    app = client("client", robot.endpoint)
    graph = Graph(app.session)
    app.in_state("standing")
    turned = (0.0, 0.0, 0.6, 0.8)

    def orientation() -> Any:
        newest = oracle.decode(ros2_names.ODOMETRY, graph.payloads("odom")[-1])
        return newest["pose"]["pose"]["orientation"]

    keys = ("yahboomd/odometry/set_pose", native_key("yahboomd/odometry/set_pose", ros2_names.POSE))
    for count, key in enumerate(keys, start=1):
        for frame, x in (("bot1/odom", float(count)), ("map", 7.0)):
            payload = pose_message(1, frame, (x, 0.0, 0.0, *turned, *([0.0] * 36)))
            app.session.put(key, payload, attachment=ros2_names.attachment(1, 1, bytes(16)))
        wait_for(
            lambda count=count: app.latest("status")["command"]["poses_refused"] == count,
            "a refusal",
        )
        wait_for(lambda count=count: app.latest("pose")["x"] == count, "the pose")
        wait_for(
            lambda: orientation() == pytest.approx(dict(zip("xyzw", turned, strict=True))),
            "the same pose for ROS",
        )


@pytest.mark.nightly
def test_events_are_on_the_graphs_one_log_and_a_late_node_gets_them(
    run: Callable[..., RealRobot], client: Callable[..., Client], oracle: Oracle
) -> None:
    robot = run("ros2.rmw_zenoh=true", "zenoh.namespace=bot1")
    app = client("client", robot.endpoint, "bot1/yahboomd")
    app.in_state("standing")
    app.session.put(native_key("bot1/yahboomd/estop", ros2_names.BOOL), ros2_encoders.boolean(True))
    app.in_state("estopped")

    def stops(heard: list[zenoh.Sample]) -> list[dict[str, Any]]:
        lines = [oracle.decode(ros2_names.LOG, sample.payload.to_bytes()) for sample in list(heard)]
        return [line for line in lines if line["function"] == "estop"]

    for key in ("bot1/rosout", native_key("rosout", ros2_names.LOG)):
        with late_subscriber(app.session, key, newest=1000) as heard:
            (line,) = wait_for(lambda heard=heard: stops(heard), key)
        assert (line["level"], line["name"]) == (30, "yahboomd")
        assert line["msg"].startswith("Emergency stop engaged by a sample")


@pytest.mark.nightly
def test_the_node_answers_for_its_parameters(
    run: Callable[..., RealRobot], client: Callable[..., Client], oracle: Oracle
) -> None:
    robot = run("ros2.rmw_zenoh=true", "zenoh.namespace=bot1")
    app = client("client", robot.endpoint, "bot1/yahboomd")
    # Services are offered before anything is published: until then nothing answers.
    app.in_state("standing")
    graph = Graph(app.session)
    sequence = 0

    def ask(service: str, ros_type: str, payload: bytes) -> Any:
        nonlocal sequence
        sequence += 1
        gid = bytes(range(16))
        key = native_key(f"bot1/yahboomd/{service}", ros_type)
        answer = graph.ask(key, payload, ros2_names.attachment(sequence, 1, gid))
        returned = ros2_names.parse_attachment(answer.attachment.to_bytes())
        assert (returned.sequence, returned.gid) == (sequence, gid)
        return oracle.decode(f"{ros_type}_Response", answer.payload.to_bytes())

    def encode(ros_type: str, **request: Any) -> bytes:
        return oracle.encode(f"{ros_type}_Request", request)

    every = encode(ros2_names.LIST_PARAMETERS, prefixes=[], depth=0)
    names = ask("list_parameters", ros2_names.LIST_PARAMETERS, every)["result"]["names"]
    assert "zenoh.namespace" in names
    # All at once, as `ros2 param dump` asks.
    wanted = encode(ros2_names.GET_PARAMETERS, names=names)
    values = ask("get_parameters", ros2_names.GET_PARAMETERS, wanted)["values"]
    assert values[names.index("zenoh.namespace")]["string_value"] == "bot1"
    assert len(values) == len(names)
    # More than a command may have.
    wanted = encode(ros2_names.DESCRIBE_PARAMETERS, names=names * 2)
    assert len(wanted) > 4096
    described = ask("describe_parameters", ros2_names.DESCRIBE_PARAMETERS, wanted)["descriptors"]
    assert len(described) == 2 * len(names)
    assert all(each["description"] for each in described)
    # Other bytes than a request are answered as well.
    for payload in (b"", b"{}"):
        assert ask("get_parameters", ros2_names.GET_PARAMETERS, payload) == {"values": []}


@pytest.mark.nightly
def test_a_node_with_another_clock_drives_and_is_named_in_the_diagnostics(
    run: Callable[..., RealRobot], client: Callable[..., Client], oracle: Oracle
) -> None:
    robot = run()
    app = client("client", robot.endpoint)
    graph = Graph(app.session)
    app.in_state("standing")

    def warned() -> list[dict[str, Any]]:
        command = ros2_encoders.twist_stamped(
            time.time_ns() - 3_200_000_000, "", (0.2, 0, 0, 0, 0, 0)
        )
        app.session.put("cmd_vel", command)
        entries = [
            entry
            for payload in graph.payloads("diagnostics")[-1:]
            for entry in oracle.decode(ros2_names.DIAGNOSTIC_ARRAY, payload)["status"]
        ]
        return [each for each in entries if each["name"] == "yahboomd: commands" and each["level"]]

    # The least that a command took counts: the first ones may have taken longer.
    (entry,) = wait_for(
        lambda: (found := warned()) and "Its clock is 3.2" in found[0]["message"] and found,
        "a warning",
    )
    assert entry["level"] == 1
    assert entry["message"].startswith("cmd_vel: Its clock is 3.2")
    assert "behind" in entry["message"]
    robot.daemon.says("behind this machine's")

    def drives() -> Any:
        warned()
        status = app.latest("status")
        return status["state"] == "driving" and status

    status = wait_for(drives, "it drives")
    assert status["command"]["clock_offset_s"]["cmd_vel"] == pytest.approx(-3.2, abs=0.1)


def test_native_commands_drive_and_one_that_was_held_up_does_not(
    robot: RealRobot, client: Callable[..., Client]
) -> None:
    app = client("client", robot.endpoint)
    before = app.in_state("standing")["command"].get("accepted", 0)
    key = native_key("cmd_vel", ros2_names.TWIST)
    sequence = 0

    def say(stamp_ns: int) -> None:
        nonlocal sequence
        sequence += 1
        attached = ros2_names.attachment(sequence, stamp_ns, bytes(16))
        app.session.put(key, ros2_encoders.twist((0.2, 0, 0, 0, 0, 0)), attachment=attached)

    def driving() -> bool:
        say(time.time_ns())
        status = app.latest("status")
        return status["command"].get("accepted", 0) > before + 20 and status["driver"] == "cmd_vel"

    wait_for(driving, "commands to be obeyed")
    say(time.time_ns() - 5_000_000_000)
    wait_for(lambda: app.latest("status")["command"].get("out_of_order"), "a refusal")
    robot.settled_truth()


def test_names_follow_the_configuration() -> None:
    given = [
        "ros2.odom=false",
        "ros2.publish_tf=false",
        "ros2.joint_states_topic=wheels/joints",
        "ros2.frame_prefix=bot1_",
        "odometry.child_frame_id=base_footprint",
        'ros2.joint_names={left="left_drive"}',
        "zenoh.namespace=bot1",
        LASER,
    ]
    chosen = topics(read(None, environ={}, overrides=given).config)
    assert (chosen.odom, chosen.transform) == ("", False)
    assert chosen.joint_states == "wheels/joints"
    assert (chosen.frame_id, chosen.child_frame_id) == ("bot1_odom", "bot1_base_footprint")
    assert chosen.joints == ("left_drive", "right_wheel_joint")
    assert [(each.parent, each.child) for each in chosen.static] == [
        ("bot1_base_link", "bot1_laser")
    ]
    assert chosen.static[0].rotation == (0.0, 0.0, 0.0, 1.0)
    assert chosen.hardware_id == "bot1"


@pytest.mark.parametrize(
    ("given", "hardware_id"),
    [
        ([], socket.gethostname()),
        (["zenoh.namespace=bot1"], "bot1"),
        (["zenoh.namespace=bot1", "ros2.hardware_id=serial 7"], "serial 7"),
    ],
)
def test_a_robot_has_its_own_name_in_the_diagnostics(given: list[str], hardware_id: str) -> None:
    assert topics(read(None, environ={}, overrides=given).config).hardware_id == hardware_id
