"""Frames that wait to be sent: three lanes, and one rule for their order.

- **stop** overtakes everything, and discards the velocity that it contradicts;
- **velocity** is a slot: the newest wins, and it is repeated until replaced, because the board may
  drop one and its caller would not know;
- **configuration** is first in, first out, each waiting for its answer.

The request for counters of a board that has to be asked is a slot beside them. So that a flood of
velocities cannot starve the poll, nor the poll the configuration, only a stop goes twice in a
row while another waits.

A question that waits for its answer holds back other questions, and a velocity only as long as the
board's mailbox needs: the robot may have to brake meanwhile.
"""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Callable

import msgspec

from yahboomd.core.protocol.dialect import Decoded


class FrameLane(enum.StrEnum):
    """The lane of a frame."""

    STOP = "stop"
    VELOCITY = "velocity"
    POLL = "poll"
    CONFIGURATION = "configuration"


Answers = Callable[[Decoded], bool]
"""Whether a decoded item is the (last part of the) answer to a request."""


class Question(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A frame of the configuration lane and the answer that it waits for.

    Attributes:
        frame: The bytes to send.
        answered: Decides whether something received completes the answer.
        timeout_ns: The longest wait for it, from the end of the frame.
        done: Called once, with whether the answer came.
    """

    frame: bytes
    answered: Answers
    timeout_ns: int
    done: Callable[[bool], None]


class Outgoing(msgspec.Struct, frozen=True, kw_only=True):
    """The frame to send now."""

    lane: FrameLane
    frame: bytes
    request: Question | None = None


class Outbox:
    """The lanes. It writes nothing and asks no clock: the writer does.

    Attributes:
        resend_ns: The period at which the current velocity is repeated.
    """

    def __init__(self, *, resend_ns: int) -> None:
        self.resend_ns = resend_ns
        self._stops: deque[bytes] = deque()
        self._velocity: bytes | None = None
        self._velocity_due_ns: int | None = None
        self._poll: bytes | None = None
        self._requests: deque[Question] = deque()
        self._last: FrameLane | None = None
        self.replaced = 0

    def stop(self, frames: tuple[bytes, ...]) -> None:
        """Queue a stop before everything else; the velocity is discarded."""
        self._stops.clear()
        self._stops.extend(frames)
        self._velocity = None
        self._velocity_due_ns = None

    def velocity(self, frame: bytes) -> bool:
        """Replace the velocity; the same one again does not change its due time.

        Returns:
            Whether it is another one.
        """
        if frame == self._velocity:
            return False
        if self._velocity_due_ns == 0:
            self.replaced += 1
        self._velocity = frame
        self._velocity_due_ns = 0
        return True

    def velocity_lost(self) -> None:
        """The board lost a command: send the current velocity again at once."""
        if self._velocity is not None:
            self._velocity_due_ns = 0

    def quiet(self) -> None:
        """Send no velocity any more (the motors are released)."""
        self._velocity = None
        self._velocity_due_ns = None

    def poll(self, frame: bytes) -> bool:
        """Ask for the counters; ``False`` if the previous request still waits."""
        if self._poll is not None:
            return False
        self._poll = frame
        return True

    def request(self, request: Question) -> None:
        self._requests.append(request)

    def withdraw(self, request: Question) -> None:
        if request in self._requests:
            self._requests.remove(request)

    @property
    def stopping(self) -> bool:
        return bool(self._stops)

    @property
    def questions(self) -> bool:
        return self._poll is not None or bool(self._requests)

    def waits(self, until_ns: int) -> bool:
        """Whether a frame is due up to that moment, once every question is answered."""
        due_ns = self.due_ns(asking=False)
        return due_ns is not None and due_ns <= until_ns

    def due_ns(self, *, asking: bool) -> int | None:
        """The time at which the next frame is due; 0 for at once, ``None`` if nothing waits.

        Args:
            asking: As for :meth:`take`.
        """
        if self._stops or (self._poll is not None and not asking):
            return 0
        if self._requests and self._may_request(asking):
            return 0
        return self._velocity_due_ns

    def _may_request(self, asking: bool) -> bool:
        # A frame without an answer cannot be confused with the one that is awaited.
        return not (asking and self._requests[0].timeout_ns > 0)

    def take(self, now_ns: int, *, busy: bool, asking: bool = False) -> Outgoing | None:
        """The frame to send now, if any.

        Args:
            busy: The board may be answering a question: only a stop may be sent.
            asking: A question is unanswered: no other one may be sent.
        """
        if self._stops:
            return self._sent(Outgoing(lane=FrameLane.STOP, frame=self._stops.popleft()))
        if busy:
            return None
        # In this order; none of them goes twice in a row.
        poll = self._poll is not None and not asking
        request = bool(self._requests) and self._may_request(asking)
        if (
            self._velocity is not None
            and self._velocity_due_ns is not None
            and self._velocity_due_ns <= now_ns
            and not (self._last is FrameLane.VELOCITY and (poll or request))
        ):
            self._velocity_due_ns = now_ns + self.resend_ns
            return self._sent(Outgoing(lane=FrameLane.VELOCITY, frame=self._velocity))
        if poll and not (self._last is FrameLane.POLL and request):
            assert self._poll is not None
            frame, self._poll = self._poll, None
            return self._sent(Outgoing(lane=FrameLane.POLL, frame=frame))
        if request:
            first = self._requests.popleft()
            lane = FrameLane.CONFIGURATION
            return self._sent(Outgoing(lane=lane, frame=first.frame, request=first))
        return None

    def _sent(self, outgoing: Outgoing) -> Outgoing:
        self._last = outgoing.lane
        return outgoing
