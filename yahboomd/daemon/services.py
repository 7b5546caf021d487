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

    def serve(self, bus: Bus) -> None:
        """Declare everything on an open session; the e-stop first."""
        bus.subscribe(keys.ESTOP, self._estop_samples, urgent=True, keep_oversize=True)
        bus.serve(
            keys.ESTOP,
            self._estop_query,
            fallback=self._fallback,
            urgent=True,
            keep_oversize=True,
        )
        for key, handler in {
            keys.ESTOP_RESET: self._estop_reset,
            keys.ODOMETRY_RESET: self._odometry_reset,
            keys.ODOMETRY_SET_POSE: self._set_pose,
            keys.CONFIG: self._tell_config,
            keys.BOARD: self._tell_board,
        }.items():
            bus.serve(key, handler, fallback=self._fallback, wildcards=key in _READ_ONLY)

    def _estop_samples(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            if not arrival.oversize and is_release_attempt(arrival.payload):
                self._operator.refuse_release("a sample on yahboomd/estop")
            else:
                self._operator.engage_estop("a sample on yahboomd/estop")

    def _estop_query(self, request: Request) -> Response:
        if not request.oversize and is_release_attempt(request.payload, query=True):
            words = self._operator.refuse_release("a query on yahboomd/estop")
            return self._reply(request, ServiceReply(success=False, message=words))
        words = self._operator.engage_estop("a query on yahboomd/estop")
        return self._reply(request, ServiceReply(success=True, message=words))

    def _estop_reset(self, request: Request) -> Response:
        released, words = self._operator.release_estop()
        return self._reply(request, ServiceReply(success=released, message=words))

    def _odometry_reset(self, request: Request) -> Response:
        words = self._operator.set_pose(Pose2d(), None)
        return self._reply(request, ServiceReply(success=True, message=words))

    def _set_pose(self, request: Request) -> Response:
        wanted = decode_set_pose(request.payload)
        if isinstance(wanted, Refusal):
            words = f"The pose stays as it is: {wanted.reason}: {wanted.detail}"
            return self._reply(request, ServiceReply(success=False, message=words))
        pose = Pose2d(x=wanted.x, y=wanted.y, theta=wanted.theta)
        words = self._operator.set_pose(pose, wanted.covariance)
        return self._reply(request, ServiceReply(success=True, message=words))

    def _tell_config(self, request: Request) -> Response:
        reply = ServiceReply(
            success=True, message="The configuration in effect.", data=self._config()
        )
        return self._reply(request, reply)

    def _tell_board(self, request: Request) -> Response:
        data = self._board()
        known = bool(data.get("dialect"))
        words = "What the board told at connecting." if known else "No board is connected."
        return self._reply(request, ServiceReply(success=known, message=words, data=data))

    def _reply(self, request: Request, reply: ServiceReply) -> Response:
        """The answer in the encoding of the question."""
        encoding: Encoding = self._encoding
        if request.payload:
            encoding = encoding_of(request.payload) or self._encoding
        return Response(
            payload=encode_reply(reply, encoding), encoding=encoding_name(ServiceReply, encoding)
        )

    def _fallback(self, reason: str, request: Request) -> Response:
        return self._reply(request, ServiceReply(success=False, message=reason))


_READ_ONLY = frozenset({keys.CONFIG, keys.BOARD})
