"""Drives a square by moves: `yahboomd moves` closes the loop, and this program stays there."""

import json
import math
import secrets
import time
from collections.abc import Callable

import msgspec
import zenoh
from messages import MoveSample, ServiceReply, fail, key

BEAT_S = 0.1
SILENCE_S = 2.0  # Progress comes ten times a second.

Ask = Callable[[zenoh.Session, str, str], ServiceReply]


def drive_moves(session: zenoh.Session, ask: Ask, side: float = 1.0) -> MoveSample:
    """Ask for the square, keep it alive, and return how it ended."""
    holder = secrets.token_hex(8)  # Its token goes with this program: then the moves end.
    token = session.liveliness().declare_token(key(f"yahboomd/moves/holder/{holder}"))
    progress = session.declare_subscriber(key("yahboomd/moves"), zenoh.handlers.RingChannel(1))
    corner = [
        {"kind": "straight", "distance_m": side},
        {"kind": "turn", "angle_rad": math.pi / 2},
    ]
    request = json.dumps({"moves": corner * 4, "by": "square", "holder": holder})
    reply = ask(session, "yahboomd/moves/start", request)
    if not reply.success:
        fail(75, reply.message)
    chosen = json.dumps({"id": reply.data["id"]})
    heard = time.monotonic()
    over = False
    try:
        # One loop reads and sends: one that stalls sends no beat, and the robot stops.
        while time.monotonic() - heard < SILENCE_S:
            session.put(key("yahboomd/moves/beat"), chosen)
            time.sleep(BEAT_S)
            news = progress.try_recv()
            if news is None:
                continue
            sample = msgspec.json.decode(news.payload.to_bytes(), type=MoveSample)
            if sample.id != reply.data["id"]:
                continue
            heard = time.monotonic()
            print(f"{sample.done:.0%}, {sample.left_s:.1f} s are left", flush=True)
            if sample.state == "ended":
                over = True
                return sample
        fail(69, "`yahboomd moves` is gone: the robot stops by itself.")
    finally:
        if not over:
            ask(session, "yahboomd/moves/cancel", chosen)
        token.undeclare()
