"""A router that publishes poses as a daemon does, or withholds them: for the deadman of clients."""

from __future__ import annotations

import json
import threading
from typing import Any

import daemon_samples
import zenoh
from real_robot import free_endpoint, wait_for

from yahboomd.core.messages.codecs import encode


class FakeRobot:
    """Stands still, whatever it is commanded; keeps the commands.

    Attributes:
        commands: All of them, in order.
        payload: The published pose; None is a pose, else these bytes; empty is silence.
    """

    def __init__(self) -> None:
        self.endpoint = free_endpoint()
        self.commands: list[dict[str, Any]] = []
        self.payload: bytes | None = None
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([self.endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self._session = zenoh.open(config)
        self._session.declare_subscriber("cmd_vel", self._on_command)
        status = encode(daemon_samples.status("standing", driver=None, why="At rest."), "json")
        self._session.declare_queryable(
            "yahboomd/status", lambda query: query.reply("yahboomd/status", status)
        )
        self._token = self._session.liveliness().declare_token("yahboomd/alive/fake")
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._publish)
        self._thread.start()

    def _on_command(self, sample: zenoh.Sample) -> None:
        self.commands.append(json.loads(sample.payload.to_bytes()))

    def _publish(self) -> None:
        pose = self._session.declare_publisher("yahboomd/pose")
        seq = 0
        while not self._ended.wait(0.02):
            seq += 1
            payload = self.payload
            if payload is None:
                payload = encode(daemon_samples.pose(0.0, 0.0, 0.0, seq=seq), "json")
            if payload:
                pose.put(payload)

    def drives(self) -> None:
        """Wait for a command for motion from now on."""
        begin = len(self.commands)
        wait_for(
            lambda: any(each["vx"] or each["wz"] for each in self.commands[begin:]), "it drives"
        )

    def stands(self) -> None:
        """Wait until the newest commands, for as long as a deadman may last, are all zero."""

        def resting() -> bool:
            newest = self.commands[-5:]
            return bool(newest) and not any(each["vx"] or each["wz"] for each in newest)

        wait_for(resting, "it sends zero")

    def close(self) -> None:
        """End it."""
        self._ended.set()
        self._thread.join()
        self._session.close()
