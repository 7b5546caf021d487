"""The application: drives on request, subscribes to everything, and calls services."""

from __future__ import annotations

import json
import threading
import time
from collections import Counter, deque
from random import Random

import msgspec
import zenoh

from benchmarks.soak.children import session
from benchmarks.soak.poses import PoseWatch
from yahboomd.core.messages.native import (
    EventSample,
    PoseSample,
    ServiceReply,
    StatusSample,
    TwistSample,
)

PERIOD_S = 0.05
FORWARD_M_S = 0.5
BACKWARD_M_S = -0.35
TURN_RAD_S = 2.0

KEEP_SAMPLES = 4000
"""Poses and twists that are kept for checks: about twenty seconds of them."""


class Application:
    """A client of the daemon.

    Attributes:
        poses: Watches the published poses.
        commands: The number of sent commands.
        last_ns: When the latest was sent.
        events: The number of received events of each kind.

    Args:
        endpoint: The daemon's endpoint.
        random: Decides the way.
    """

    def __init__(self, endpoint: str, random: Random) -> None:
        self.poses = PoseWatch()
        self.commands = 0
        self.last_ns = 0
        self.events: Counter[str] = Counter()
        self._recent: deque[tuple[int, EventSample]] = deque(maxlen=2000)
        self._random = random
        self._lock = threading.Lock()
        self._wish: tuple[float, float] | None = (0.0, 0.0)
        self._wandering = False
        self._poses: deque[tuple[int, PoseSample]] = deque(maxlen=KEEP_SAMPLES)
        self._twists: deque[tuple[int, TwistSample]] = deque(maxlen=KEEP_SAMPLES)
        self._status: tuple[int, StatusSample] | None = None
        self._ending = threading.Event()
        self.session = session(endpoint)
        decode_pose = msgspec.json.Decoder(PoseSample).decode
        decode_twist = msgspec.json.Decoder(TwistSample).decode
        decode_status = msgspec.json.Decoder(StatusSample).decode
        decode_event = msgspec.json.Decoder(EventSample).decode

        def pose(sample: zenoh.Sample) -> None:
            found = decode_pose(sample.payload.to_bytes())
            self.poses.see(found, time.time_ns())
            self._poses.append((time.monotonic_ns(), found))

        def twist(sample: zenoh.Sample) -> None:
            found = decode_twist(sample.payload.to_bytes())
            self._twists.append((time.monotonic_ns(), found))

        def status(sample: zenoh.Sample) -> None:
            self._status = (time.monotonic_ns(), decode_status(sample.payload.to_bytes()))

        def event(sample: zenoh.Sample) -> None:
            found = decode_event(sample.payload.to_bytes())
            self.events[found.kind] += 1
            self._recent.append((time.monotonic_ns(), found))

        self._subscribers = [
            self.session.declare_subscriber("yahboomd/pose", pose),
            self.session.declare_subscriber("yahboomd/twist", twist),
            self.session.declare_subscriber("yahboomd/status", status),
            self.session.declare_subscriber("yahboomd/events", event),
        ]
        self._driver = threading.Thread(target=self._drive, daemon=True)
        self._driver.start()

    def steady(self, vx: float, wz: float = 0.0) -> None:
        """Command one velocity from now on."""
        with self._lock:
            self._wandering = False
            self._wish = (vx, wz)

    def wander(self) -> None:
        """Command velocities that change smoothly, at random."""
        with self._lock:
            self._wandering = True
            self._wish = self._wish or (0.0, 0.0)

    def silent(self) -> int:
        """Command nothing more; returns when the last command was sent."""
        with self._lock:
            self._wandering = False
            self._wish = None
            return self.last_ns

    def now(self, vx: float) -> int:
        """Command a velocity from now on, the first time at once; returns when that was sent."""
        with self._lock:
            self._wandering = False
            self._wish = (vx, 0.0)
            return self._send()

    def _send(self) -> int:
        assert self._wish is not None
        payload = json.dumps({"vx": self._wish[0], "wz": self._wish[1]})
        self.last_ns = time.monotonic_ns()
        self.session.put("cmd_vel", payload)
        self.commands += 1
        return self.last_ns

    def _drive(self) -> None:
        random = self._random
        goal, until = (0.0, 0.0), 0.0
        due = time.monotonic()
        while not self._ending.is_set():
            with self._lock:
                if self._wish is not None:
                    if self._wandering:
                        if time.monotonic() > until:
                            goal = (
                                random.uniform(BACKWARD_M_S, FORWARD_M_S),
                                random.uniform(-TURN_RAD_S, TURN_RAD_S),
                            )
                            until = time.monotonic() + random.uniform(0.4, 2.0)
                        vx, wz = self._wish
                        self._wish = (vx + 0.25 * (goal[0] - vx), wz + 0.25 * (goal[1] - wz))
                    self._send()
            due = max(due + PERIOD_S, time.monotonic() - PERIOD_S)
            self._ending.wait(max(0.0, due - time.monotonic()))

    @property
    def status(self) -> StatusSample | None:
        """The latest status, unless it is stale."""
        found = self._status
        fresh = found is not None and time.monotonic_ns() - found[0] < 1_500_000_000
        return found[1] if fresh and found is not None else None

    def pose_since(self, t_ns: int) -> PoseSample | None:
        """The latest pose, if it was sampled after a moment."""
        if not self._poses:
            return None
        _, pose = self._poses[-1]
        return pose if pose.stamp_ns >= t_ns + time.time_ns() - time.monotonic_ns() else None

    def poses_since(self, t_ns: int) -> list[PoseSample]:
        """Poses that came after a moment."""
        return [pose for at_ns, pose in list(self._poses) if at_ns >= t_ns]

    def twists_since(self, t_ns: int) -> list[TwistSample]:
        """Twists that came after a moment."""
        return [twist for at_ns, twist in list(self._twists) if at_ns >= t_ns]

    def events_since(self, t_ns: int, *kinds: str) -> list[EventSample]:
        """Events of some kinds that came after a moment."""
        return [
            event for at_ns, event in list(self._recent) if at_ns >= t_ns and event.kind in kinds
        ]

    def ask(self, key: str) -> ServiceReply | None:
        """Call a service; None without an answer."""
        for reply in self.session.get(key, timeout=3.0):
            if reply.ok is not None:
                return msgspec.json.decode(reply.ok.payload.to_bytes(), type=ServiceReply)
        return None

    def close(self) -> None:
        """End it."""
        self._ending.set()
        self._driver.join()
        self.session.close()
