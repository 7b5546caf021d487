"""Answers as `yahboomd moves` does, for tests of its clients."""

from __future__ import annotations

from typing import Any

import msgspec

from make.schema_files.move_samples import SAMPLES
from yahboomd.client.move_messages import BEAT, CANCEL, MOVES, PAUSE, RESUME, START, MoveSample
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.services import BusQuery, Response
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import ServiceReply

RUNNING: MoveSample = msgspec.structs.replace(
    SAMPLES["MoveSample"],  # type: ignore[arg-type]
    state="running",
    reason="",
    message="",
)


class FakeMoves:
    """Answers as `yahboomd moves` does, and publishes what a test wants."""

    def __init__(self, bus: Bus) -> None:
        self.requests: list[dict[str, Any]] = []
        self.asked: list[str] = []
        self.beats: list[str] = []
        self.tokens: set[str] = set()
        self.answer = ServiceReply(success=True, message="", data={"id": "m1"})
        self._bus = bus
        self._publisher = bus.publisher(MOVES)
        bus.subscribe(BEAT, self._beat)
        bus.watch_tokens("yahboomd/moves/holder/*", self._changed)
        for key in (START, CANCEL, PAUSE, RESUME):
            bus.serve(key, self._ask, fallback=lambda *_: self._reply())

    def _beat(self, arrivals: list[Any]) -> None:
        self.beats += [msgspec.json.decode(each.payload)["id"] for each in arrivals]

    def _changed(self, changes: list[Any]) -> None:
        for change in changes:
            name = change.key.rpartition("/")[2]
            (self.tokens.add if change.present else self.tokens.discard)(name)

    def _ask(self, query: BusQuery) -> Response:
        self.asked.append(query.key)
        self.requests.append(msgspec.json.decode(query.payload))
        return self._reply()

    def _reply(self) -> Response:
        return Response(payload=encode(self.answer, "json"))

    def tell(self, **fields: Any) -> None:
        sample = msgspec.structs.replace(RUNNING, **{"id": "m1", **fields})
        self._publisher.put(encode(sample, "json"))
