"""The services: e-stop and its release, the pose, the configuration, the board."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from yahboomd.bus import keys
from yahboomd.bus.services import Request, Response
from yahboomd.bus.session import Bus
from yahboomd.bus.subscriptions import Arrival
from yahboomd.daemon.operator import Operator
from yahboomd.messages.codecs import (
    Encoding,
    NativeEncoding,
    Refusal,
    decode_set_pose,
    encode_reply,
    encoding_name,
    encoding_of,
    is_release_attempt,
)
from yahboomd.messages.native import ServiceReply
from yahboomd.model import Pose2d

Facts = Callable[[], dict[str, Any]]
Action = Callable[[Request], ServiceReply]
"""Does what is asked, and says what became of it."""
Answer = Callable[[Request, ServiceReply], Response]
"""Encodes what became of a request."""


class Services:
    """Answers queries, and hears the e-stop.

    Args:
        operator: Carries out what is asked.
        encoding: How a request without a recognisable payload is answered.
        config: The effective configuration, for ``yahboomd/config``.
        board: What is known of the board, for ``yahboomd/board``.
    """

    def __init__(
        self, operator: Operator, *, encoding: NativeEncoding, config: Facts, board: Facts
    ) -> None:
        self._operator = operator
        self._encoding: NativeEncoding = encoding
        self._config = config
        self._board = board
        self.actions: dict[str, Action] = {
            keys.ESTOP: self._estop_query,
            keys.ESTOP_RESET: self._estop_reset,
            keys.ODOMETRY_RESET: self._odometry_reset,
            keys.ODOMETRY_SET_POSE: self._set_pose,
            keys.CONFIG: self._tell_config,
            keys.BOARD: self._tell_board,
        }
        """What each service does, by its key; the e-stop first."""

    def serve(self, bus: Bus) -> None:
        """Declare everything on an open session; the e-stop first."""
        bus.subscribe(keys.ESTOP, self._estop_samples, urgent=True, keep_oversize=True)
        for key, action in self.actions.items():
            self.offer(bus, key, action)

    def offer(
        self, bus: Bus, key: str, action: Action, answer: Answer | None = None, *, at: str = ""
    ) -> None:
        """Serve one action.

        Args:
            bus: An open session.
            key: The service's own key.
            action: What it does.
            answer: Encodes the reply; unless given, in the encoding of the request.
            at: Where it is offered, if that is another key.
        """
        encode = answer or self._answer
        estop = key == keys.ESTOP
        bus.serve(
            at or key,
            lambda request: encode(request, action(request)),
            fallback=lambda reason, request: encode(
                request, ServiceReply(success=False, message=reason)
            ),
            urgent=estop,
            keep_oversize=estop,
            wildcards=key in _READ_ONLY,
        )

    def _estop_samples(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            if not arrival.oversize and is_release_attempt(arrival.payload):
                self._operator.refuse_release("a sample on yahboomd/estop")
            else:
                self._operator.engage_estop("a sample on yahboomd/estop")

    def _estop_query(self, request: Request) -> ServiceReply:
        if not request.oversize and is_release_attempt(request.payload, query=True):
            words = self._operator.refuse_release("a query on yahboomd/estop")
            return ServiceReply(success=False, message=words)
        words = self._operator.engage_estop("a query on yahboomd/estop")
        return ServiceReply(success=True, message=words)

    def _estop_reset(self, _request: Request) -> ServiceReply:
        released, words = self._operator.release_estop()
        return ServiceReply(success=released, message=words)

    def _odometry_reset(self, _request: Request) -> ServiceReply:
        words = self._operator.set_pose(Pose2d(), None)
        return ServiceReply(success=True, message=words)

    def _set_pose(self, request: Request) -> ServiceReply:
        wanted = decode_set_pose(request.payload)
        if isinstance(wanted, Refusal):
            words = f"The pose stays as it is: {wanted.reason}: {wanted.detail}"
            return ServiceReply(success=False, message=words)
        pose = Pose2d(x=wanted.x, y=wanted.y, theta=wanted.theta)
        words = self._operator.set_pose(pose, wanted.covariance)
        return ServiceReply(success=True, message=words)

    def _tell_config(self, _request: Request) -> ServiceReply:
        return ServiceReply(
            success=True, message="The configuration in effect.", data=self._config()
        )

    def _tell_board(self, _request: Request) -> ServiceReply:
        data = self._board()
        known = bool(data.get("dialect"))
        words = "What the board told at connecting." if known else "No board is connected."
        return ServiceReply(success=known, message=words, data=data)

    def _answer(self, request: Request, reply: ServiceReply) -> Response:
        """The answer in the encoding of the question."""
        encoding: Encoding = self._encoding
        if asked := request.payload or request.head:
            encoding = encoding_of(asked) or self._encoding
        return Response(
            payload=encode_reply(reply, encoding), encoding=encoding_name(ServiceReply, encoding)
        )


_READ_ONLY = frozenset({keys.CONFIG, keys.BOARD})
