"""A Zenoh client in a process of its own that sends as much as it is asked to, until it is killed.

Its only argument is JSON: ``endpoint``, ``settings`` (of Zenoh), ``key``, ``how`` (``put`` or
``get``), ``payload`` (``times`` times), ``hz``, and ``attachment`` and ``parameters``, in bytes.
"""

import json
import sys
import time

import zenoh


def opened(config: zenoh.Config) -> zenoh.Session:
    """A session, as soon as the router has time for it."""
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            time.sleep(0.02)


def main() -> None:
    what = json.loads(sys.argv[1])
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([what["endpoint"]]))
    config.insert_json5("scouting/multicast/enabled", "false")
    for name, value in what.get("settings", {}).items():
        config.insert_json5(name, json.dumps(value))
    attachment = bytes(what["attachment"]) if "attachment" in what else None
    carried = {
        "payload": what.get("payload", "").encode() * what.get("times", 1),
        "attachment": attachment,
        "congestion_control": zenoh.CongestionControl.BLOCK,
    }
    selector = what["key"]
    if "parameters" in what:
        selector += "?" + "x" * what["parameters"]
    with opened(config) as session:
        print("ready", flush=True)
        count, began = 0, time.monotonic()
        while True:
            if what["how"] == "put":
                session.put(what["key"], **carried)
            else:
                session.get(selector, lambda reply: None, timeout=1.0, **carried)
            count += 1
            if count % 10 == 0 or what["hz"] < 1000:
                time.sleep(max(0.0, count / what["hz"] - (time.monotonic() - began)))


if __name__ == "__main__":
    main()
