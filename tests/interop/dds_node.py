"""A node of a ROS 2 graph over DDS, without ROS: driven by JSON lines.

`dds_node.py DOMAIN [TOPIC ...]`: announces itself on `ros_discovery_info` as rmw_cyclonedds does
(the bridge routes only what belongs to a node), subscribes to the topics (none named: to all that a
robot base publishes; `-`: to none), and prints every message as one JSON line. DDS stays on the
loopback interface. It ends with its standard input:

    {"do":"drive","vx":0.1,"wz":0.0,"hz":20}    with "stamped":true: a TwistStamped
    {"do":"rest"}
    {"do":"graph"}
    {"do":"call","service":"/yahboomd/estop","data":true}    without "data": a Trigger
"""

import json
import os
import queue
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

LOOPBACK = """<CycloneDDS><Domain><General>
  <Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast>
</General><Discovery>
  <ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
  <Peers><Peer address="localhost"/></Peers>
</Discovery></Domain></CycloneDDS>"""
os.environ.setdefault("CYCLONEDDS_URI", LOOPBACK)  # before the library reads it

import dds_types as t  # noqa: E402
from cyclonedds.builtin import (  # noqa: E402
    BuiltinDataReader,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import (  # noqa: E402
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
)
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402

PLAIN_CDR = Policy.DataRepresentation(use_cdrv0_representation=True)
RELIABLE = Qos(
    PLAIN_CDR, Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10)
)
BEST_EFFORT = Qos(PLAIN_CDR, Policy.Reliability.BestEffort, Policy.History.KeepLast(10))
LATCHED = Qos(
    PLAIN_CDR,
    Policy.Reliability.Reliable(duration(milliseconds=100)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(10),
)
HEARD = {
    "/odom": (t.Odometry, RELIABLE),
    "/tf": (t.TFMessage, RELIABLE),
    "/tf_static": (t.TFMessage, LATCHED),
    "/joint_states": (t.JointState, BEST_EFFORT),
    "/battery_state": (t.BatteryState, BEST_EFFORT),
    "/diagnostics": (t.DiagnosticArray, RELIABLE),
}
STRANGE = dict.fromkeys(("/yahboomd/pose", "/yahboomd/status", "/odometry"), (t.Odometry, RELIABLE))
"""Topics that no robot base publishes as a ROS message; received only if they are named."""
PANEL = {"/estopped": (t.Bool, LATCHED)}
"""Received if it is named."""
SERVICES = {
    "/yahboomd/estop": (t.SetBoolRequest, t.SetBoolResponse),
    "/yahboomd/estop/reset": (t.TriggerRequest, t.TriggerResponse),
    "/yahboomd/odometry/reset": (t.TriggerRequest, t.TriggerResponse),
}
CALL_TIMEOUT_S = 30.0
ASK_AGAIN_S = 5.0
"""A question that is written before its reader knows the writer as well is lost, in ROS too: DDS
hands nobody what came before. On a busy machine that takes a while."""
POLL_S = 0.005


def say(**line: Any) -> None:
    print(json.dumps(line), flush=True)


@dataclass
class Call:
    """A question on its way."""

    service: str
    data: bool | None
    sequence_number: int
    deadline_s: float
    asks_s: float = 0.0


class Node:
    """One participant with one node: its readers, writers and service clients."""

    def __init__(self, domain: int, name: str, topics: Sequence[str]) -> None:
        self.name = name
        self.participant = DomainParticipant(domain, qos=Qos(Policy.Userdata(b"enclave=/;")))
        self.readers = {
            topic: self._reader("rt" + topic, kind, qos)
            for topic, (kind, qos) in (HEARD | STRANGE | PANEL).items()
            if topic in topics
        }
        self.cmd_vel: DataWriter | None = None
        self.clients: dict[str, tuple[DataWriter, DataReader]] = {}
        discovery = Topic(self.participant, "ros_discovery_info", t.ParticipantEntitiesInfo)
        self.announcer = DataWriter(
            self.participant,
            discovery,
            qos=Qos(
                PLAIN_CDR,
                Policy.Reliability.Reliable(duration(infinite=True)),
                Policy.Durability.TransientLocal,
                Policy.History.KeepLast(1),
            ),
        )
        self.announced = DataReader(
            self.participant,
            discovery,
            qos=Qos(
                PLAIN_CDR,
                Policy.Reliability.Reliable(duration(infinite=True)),
                Policy.Durability.TransientLocal,
                Policy.History.KeepAll,
                Policy.IgnoreLocal.Participant,
            ),
        )
        self.endpoints = {
            side: BuiltinDataReader(self.participant, kind)
            for side, kind in (
                ("publishers", BuiltinTopicDcpsPublication),
                ("subscribers", BuiltinTopicDcpsSubscription),
            )
        }
        self.sequence_number = 0
        self.calls: list[Call] = []
        self.announce()

    def _reader(self, topic: str, kind: type, qos: Qos) -> DataReader:
        return DataReader(self.participant, Topic(self.participant, topic, kind), qos=qos)

    def _writer(self, topic: str, kind: type, qos: Qos) -> DataWriter:
        return DataWriter(self.participant, Topic(self.participant, topic, kind), qos=qos)

    def announce(self) -> None:
        """Tell the graph which readers and writers are this node's."""
        readers = [*self.readers.values(), *(reply for _, reply in self.clients.values())]
        writers = [request for request, _ in self.clients.values()]
        if self.cmd_vel is not None:
            writers.append(self.cmd_vel)
        info = t.NodeEntitiesInfo(
            "/", self.name, [gid(r) for r in readers], [gid(w) for w in writers]
        )
        self.announcer.write(t.ParticipantEntitiesInfo(gid(self.participant), [info]))

    def drive(self, vx: float, vy: float, wz: float, *, stamped: bool) -> None:
        """Publish one command; the first one creates the publisher of its type."""
        if self.cmd_vel is None:
            kind = t.TwistStamped if stamped else t.Twist
            self.cmd_vel = self._writer("rt/cmd_vel", kind, RELIABLE)
            self.announce()
        twist = t.Twist(t.Vector3(vx, vy, 0.0), t.Vector3(0.0, 0.0, wz))
        if stamped:
            now_ns = time.time_ns()
            stamp = t.Time(now_ns // 1_000_000_000, now_ns % 1_000_000_000)
            self.cmd_vel.write(t.TwistStamped(t.Header(stamp, "base_link"), twist))
        else:
            self.cmd_vel.write(twist)

    def call(self, service: str, data: bool | None) -> None:
        """Call; `answers` returns the answer, or that none came."""
        if service not in self.clients:
            request, reply = SERVICES[service]
            self.clients[service] = (
                self._writer(f"rq{service}Request", request, RELIABLE),
                self._reader(f"rr{service}Reply", reply, RELIABLE),
            )
            self.announce()
        self.sequence_number += 1
        self.calls.append(
            Call(service, data, self.sequence_number, time.monotonic() + CALL_TIMEOUT_S)
        )

    def answers(self) -> Iterator[tuple[str, dict[str, Any] | None]]:
        """Service and reply of each call that ended; None without an answer in time."""
        for call in list(self.calls):
            request, reply = self.clients[call.service]
            client_guid = int.from_bytes(request.guid.bytes[8:], "big")
            # As rmw_cyclonedds judges whether a service is available: in both directions.
            matched = (
                request.get_publication_matched_status().current_count > 0
                and reply.get_subscription_matched_status().current_count > 0
            )
            if matched and time.monotonic() >= call.asks_s:
                kind = SERVICES[call.service][0]
                request.write(kind(client_guid, call.sequence_number, call.data or 0))
                call.asks_s = time.monotonic() + ASK_AGAIN_S
            for answer in taken(reply):
                mine = client_guid, call.sequence_number
                # A second answer is of no interest, as in ROS: a bridge whose routes outlived
                # their service asks it once for each of them.
                if call in self.calls and (answer.client_guid, answer.sequence_number) == mine:
                    self.calls.remove(call)
                    yield call.service, {"success": answer.success, "message": answer.message}
            if call in self.calls and time.monotonic() > call.deadline_s:
                self.calls.remove(call)
                yield call.service, None

    def graph(self) -> dict[str, Any]:
        """The offers of other participants now: nodes, and DDS topics with their types."""
        nodes = {
            (info.node_namespace, info.node_name)
            for sample in self.announced.read(100)
            for info in getattr(sample, "node_entities_info_seq", ())
        }
        mine = self.participant.guid
        alive = SampleState.Any | ViewState.Any | InstanceState.Alive
        sides = {
            side: {
                endpoint.topic_name: endpoint.type_name
                for endpoint in reader.read(500, condition=ReadCondition(reader, alive))
                if endpoint.participant_key != mine
            }
            for side, reader in self.endpoints.items()
        }
        return {"nodes": [{"namespace": n, "name": m} for n, m in sorted(nodes)], **sides}


def gid(entity: Any) -> t.Gid:
    return t.Gid(list(entity.guid.bytes))


def taken(reader: DataReader) -> list[Any]:
    """The received samples, without those that only report that a writer has gone."""
    return [sample for sample in reader.take(100) if isinstance(sample, t.IdlStruct)]


def orders(into: "queue.SimpleQueue[dict[str, Any] | None]") -> None:
    for line in sys.stdin:
        into.put(json.loads(line))
    into.put(None)


def main() -> None:
    node = Node(int(sys.argv[1]), "dds_peer", sys.argv[2:] or list(HEARD))
    inbox: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
    threading.Thread(target=orders, args=(inbox,), daemon=True).start()
    say(event="ready", node=node.name)
    wish: dict[str, Any] | None = None
    next_s = 0.0
    while True:
        for topic, reader in node.readers.items():
            for sample in taken(reader):
                say(event="message", topic=topic, message=asdict(sample))
        for service, reply in node.answers():
            if reply is None:
                say(event="no_reply", service=service, why="no answer in time")
            else:
                say(event="reply", service=service, reply=reply)
        if wish is not None and time.monotonic() >= next_s:
            next_s = time.monotonic() + 1.0 / wish.get("hz", 20)
            node.drive(
                wish.get("vx", 0.0),
                wish.get("vy", 0.0),
                wish.get("wz", 0.0),
                stamped=wish.get("stamped", False),
            )
        try:
            order = inbox.get(timeout=POLL_S)
        except queue.Empty:
            continue
        if order is None:
            return
        match order["do"]:
            case "drive":
                wish = order
            case "rest":
                wish = None
            case "graph":
                say(event="graph", graph=node.graph())
            case "call":
                node.call(order["service"], order.get("data"))


if __name__ == "__main__":
    main()
