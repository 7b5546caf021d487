"""The native plane as another program sees it: keys, encodings, schemas, services."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest
import zenoh
from event_check import assert_registered
from real_robot import Client, RealRobot, wait_for

from yahboomd.cli.call import SERVICES
from yahboomd.core.daemon.publisher import PUBLISHED

pytestmark = pytest.mark.realtime

SCHEMAS = Path(__file__).resolve().parents[2] / "schemas"
KEYS = {f"bot1/{key}": message.__name__ for key, message in PUBLISHED.items()}
REQUESTS = {"odometry/set_pose": {"x": 1.0, "y": -2.0, "theta": 0.5}}
DECODE: dict[str, Callable[[bytes], Any]] = {
    "json": json.loads,
    "msgpack": msgspec.msgpack.decode,
}
ENCODE: dict[str, Callable[[Any], bytes]] = {
    "json": msgspec.json.encode,
    "msgpack": msgspec.msgpack.encode,
}


class Application:
    """Speaks Zenoh and one encoding, and keeps every sample with its encoding's name."""

    def __init__(self, endpoint: str, encoding: str) -> None:
        self.client = Client("client", endpoint, prefix="elsewhere")
        self.session = self.client.session
        self.encoding = encoding
        self.samples: list[zenoh.Sample] = []
        self.session.declare_subscriber("bot1/yahboomd/**", self.samples.append)

    def of(self, key: str) -> list[dict[str, Any]]:
        payloads = [bytes(each.payload) for each in self.samples if str(each.key_expr) == key]
        return [DECODE[self.encoding](payload) for payload in payloads]

    def state(self, wanted: str) -> None:
        key = "bot1/yahboomd/status"
        wait_for(lambda: self.of(key) and self.of(key)[-1]["state"] == wanted, wanted)

    def drives(self, payload: bytes) -> None:
        """Command until it drives, or did: a busy machine drops commands that waited."""

        def found() -> bool:
            self.session.put("bot1/cmd_vel", payload)
            time.sleep(0.04)
            return any(each["state"] == "driving" for each in self.of("bot1/yahboomd/status"))

        wait_for(found, "driving")

    def account(self) -> dict[str, Any]:
        """How the commands fared, as of the newest status."""
        status = self.of("bot1/yahboomd/status")[-1]
        account: dict[str, Any] = status["command"]["sources"]["cmd_vel"]
        return account

    def ask(self, key: str, request: dict[str, Any] | None) -> tuple[str, dict[str, Any]]:
        payload = None if request is None else ENCODE[self.encoding](request)
        for reply in self.session.get(f"bot1/{key}", payload=payload, timeout=60.0):
            assert reply.ok is not None
            answer = DECODE[self.encoding](bytes(reply.ok.payload))
            return str(reply.ok.encoding), answer
        pytest.fail(f"{key} did not answer")


@pytest.fixture(params=["msgpack", pytest.param("json", marks=pytest.mark.nightly)])
def application(
    request: pytest.FixtureRequest, real_robot: Callable[..., RealRobot]
) -> Iterator[Application]:
    sets = ("zenoh.namespace=bot1", f"zenoh.encoding={request.param}")
    robot = real_robot(run=[word for each in sets for word in ("--set", each)])
    application = Application(robot.endpoint, request.param)
    application.state("standing")
    yield application
    application.client.close()


def is_valid(message: object, name: str) -> None:
    schema = json.loads((SCHEMAS / f"{name}.json").read_text())
    # Tuples and lists are one to a schema.
    jsonschema.Draft202012Validator(schema).validate(json.loads(json.dumps(message)))


def test_every_sample_and_answer_is_what_its_key_its_encoding_and_its_schema_promise(
    application: Application,
) -> None:
    services_answer(application)
    application.state("standing")
    drive = ENCODE[application.encoding]({"vx": 0.2, "wz": 0.4, "a_later_field": [1, {"b": None}]})
    application.drives(drive)
    application.session.put("bot1/cmd_vel", b"garbage")
    wait_for(
        lambda: application.account()["refused"]["unknown_encoding"] == 1, "the garbage is refused"
    )
    application.state("standing")
    application.ask("yahboomd/odometry/reset", None)
    # This board has no inertial sensor.
    keys = set(KEYS) - {"bot1/yahboomd/imu"}
    wait_for(lambda: keys == {str(s.key_expr) for s in application.samples}, "every key")
    for sample in list(application.samples):
        name = KEYS[str(sample.key_expr)]
        assert str(sample.encoding) == f"application/{application.encoding};{name}"
        message = DECODE[application.encoding](bytes(sample.payload))
        is_valid(message, name)
        if name == "EventSample":
            assert_registered(message)

    def heard() -> tuple[list[Any], dict[int, int], list[Any]]:
        poses, twists = (application.of(f"bot1/yahboomd/{name}") for name in ("pose", "twist"))
        stamps = {each["seq"]: each["stamp_ns"] for each in poses}
        return poses, stamps, [each for each in twists if each["seq"] in stamps]

    # Every key may have been heard after less than a second.
    wait_for(lambda: len(heard()[2]) > 20, "more poses and their twists")
    poses, stamps, shared = heard()
    assert all(each["stamp_ns"] == stamps[each["seq"]] for each in shared)
    assert max(each["x"] for each in poses) > 0.02
    assert application.account()["accepted"] >= 1


def services_answer(application: Application) -> None:
    """Every service answers in the encoding of the daemon, and of the request."""
    for name in SERVICES:
        encoding, answer = application.ask(f"yahboomd/{name}", REQUESTS.get(name))
        assert encoding == f"application/{application.encoding};ServiceReply"
        is_valid(answer, "ServiceReply")
        # A busy machine may write the black box later than it is answered.
        assert answer["success"] or "The disk took longer" in answer["message"], answer
        assert answer["message"]
    other = "msgpack" if application.encoding == "json" else "json"
    payload = ENCODE[other]({"x": 1.0, "y": 2.0})
    get = application.session.get("bot1/yahboomd/odometry/set_pose", payload=payload, timeout=60.0)
    (reply,) = [each.ok for each in get if each.ok is not None]
    assert str(reply.encoding) == f"application/{other};ServiceReply"
    assert not DECODE[other](bytes(reply.payload))["success"]
