"""A Zenoh client in a process of its own that subscribes and reads: it can be frozen."""

import json
import sys

import zenoh


def main() -> None:
    endpoint, key = sys.argv[1:]
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        session.declare_subscriber(key, lambda sample: None)
        print("ready", flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
