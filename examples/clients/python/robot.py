"""Reads and drives a robot: ``python robot.py square``.

It needs ``pip install eclipse-zenoh msgspec``, and nothing of yahboomd. The contract of its
commands and exit codes is in examples/clients/README.md.
"""

import json
import signal
import sys
import time

import msgspec
import zenoh
from messages import ROBOT, PoseSample, ServiceReply, StatusSample, fail, key
from moves import drive_moves
from square import Square

USAGE = """usage: robot.py pose | status | estop | release | set-pose X Y THETA | config
                | square [SIDE] | moves [SIDE] | decode PoseSample|StatusSample|ServiceReply"""

MESSAGES = {each.__name__: each for each in (PoseSample, StatusSample, ServiceReply)}
NUMBERS = {
    **dict.fromkeys(("pose", "status", "estop", "release", "config"), (0,)),
    "set-pose": (3,),
    "square": (0, 1),
    "moves": (0, 1),
}
SERVICES = {
    "estop": "yahboomd/estop",  # any payload engages, also none
    "release": "yahboomd/estop/reset",
    "set-pose": "yahboomd/odometry/set_pose",
    "config": "yahboomd/config",
}


def show(message: msgspec.Struct) -> None:
    print(msgspec.json.encode(message).decode(), flush=True)


def connect() -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([ROBOT]))
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        fail(69, f"No yahboomd answers at {ROBOT}. Start one with `yahboomd run`, or set ROBOT.")


def ask(session: zenoh.Session, name: str, payload: str | None = None) -> tuple[bytes, str]:
    """The answer to a query, and which message it is."""
    # ALL: an e-stop must reach every daemon, even where another client answers that key.
    replies = session.get(key(name), payload=payload, target=zenoh.QueryTarget.ALL, timeout=5.0)
    answer = next((reply.ok for reply in replies if reply.ok is not None), None)
    if answer is None:
        fail(69, f"Nothing at {ROBOT} answers {key(name)}. Is yahboomd running, in this NAMESPACE?")
    return answer.payload.to_bytes(), str(answer.encoding).partition(";")[2]


def ask_moves(session: zenoh.Session, name: str, payload: str) -> ServiceReply:
    # A session that was just opened may not know the service: then a query ends at once.
    until = time.monotonic() + 1.0
    while True:
        replies = session.get(key(name), payload=payload, timeout=5.0)
        answer = next((reply.ok for reply in replies if reply.ok is not None), None)
        if answer is not None:
            return msgspec.json.decode(answer.payload.to_bytes(), type=ServiceReply)
        if time.monotonic() > until:
            fail(69, f"No `yahboomd moves` answers at {ROBOT}. Start it beside yahboomd.")
        time.sleep(0.1)


def call(session: zenoh.Session, name: str, payload: str | None = None) -> int:
    reply = msgspec.json.decode(ask(session, name, payload)[0], type=ServiceReply)
    show(reply)
    return 0 if reply.success else 1


def newest(session: zenoh.Session, name: str, kind: type[msgspec.Struct]) -> msgspec.Struct:
    payload, message = ask(session, name)
    if message == "ServiceReply":  # no sample yet
        fail(69, msgspec.json.decode(payload, type=ServiceReply).message)
    return msgspec.json.decode(payload, type=kind)


def decode(name: str) -> None:
    try:
        show(msgspec.json.decode(sys.stdin.buffer.read(), type=MESSAGES[name]))
    except msgspec.MsgspecError as error:
        fail(65, f"This is no {name}: {error}")


def main(command: str = "", *words: str) -> int:
    if command == "decode" and len(words) == 1 and words[0] in MESSAGES:
        decode(words[0])
        return 0
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        fail(64, USAGE)
    if len(numbers) not in NUMBERS.get(command, ()):
        fail(64, USAGE)
    with connect() as session:
        if command in SERVICES:
            payload = json.dumps(dict(zip(("x", "y", "theta"), numbers, strict=False)))
            return call(session, SERVICES[command], payload if numbers else None)
        if command == "pose":
            show(newest(session, "yahboomd/pose", PoseSample))
        elif command == "status":
            show(newest(session, "yahboomd/status", StatusSample))
        elif command == "moves":
            end = drive_moves(session, ask_moves, *numbers)
            show(end)
            if end.reason != "reached":
                fail(75, end.message)
        else:
            Square(session).drive(*numbers)
    return 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        sys.exit(main(*sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
