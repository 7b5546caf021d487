"""``yahboomd blackbox``: lists black boxes, explains why the robot stopped, exports, saves one."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from yahboomd.cli.shared_options import (
    add_bus_options,
    add_config_options,
    add_port_option,
    read_config,
)
from yahboomd.core.program import pasteable

if TYPE_CHECKING:
    from yahboomd.blackbox.box_file import Box
    from yahboomd.client import AsyncRobot
    from yahboomd.tools.blackbox.box_places import BoxQuery, Found, Places

DESCRIPTION = """\
Why did the robot stop? The daemon keeps the last minute of bytes, commands, decisions and events in
memory, and saves it at each fault, emergency stop, disconnect and crash. List the saved boxes,
explain one in plain words, export it, or have it saved now. Only `save` needs a daemon.
"""

EPILOG = """\
examples:
  yahboomd blackbox                          the saved boxes, and those in memory
  yahboomd blackbox explain                  why the robot stopped last, with times
  yahboomd blackbox explain 12               the box with this number; a file will do, too
  yahboomd blackbox explain --namespace bot1 of this robot, if there are several
  yahboomd blackbox explain --json | jq .why
  yahboomd blackbox export 12 stop.mcap      for Foxglove and other readers of MCAP
  yahboomd blackbox save                     save it now, by the daemon

exit status:
  0    it was done
  1    it was refused: the message has the reason
  69   no daemon is there, for `save`
  78   no such black box, or it cannot be read
"""

WORDS = {
    "saved": "saved",
    "running": "in memory: its daemon runs",
    "left": "not saved: its daemon ended",
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    from yahboomd.cli.attended import add_robot_options

    verbs = parser.add_subparsers(dest="verb", metavar="VERB")
    listing = verbs.add_parser(
        "list", help="list them, which is done without a verb as well", description="List them."
    )
    explain = verbs.add_parser(
        "explain",
        help="why the robot stopped, in plain words",
        description="Explain in plain words, with times, why the robot stopped.",
    )
    export = verbs.add_parser(
        "export", help="write it as MCAP", description="Write a black box as an MCAP file."
    )
    save = verbs.add_parser(
        "save",
        help="have the daemon save it now",
        description="Have the daemon save its black box now. It does so at most once a minute.",
    )
    explain.add_argument(
        "box",
        metavar="BOX",
        nargs="?",
        help="its number or name in the list, or its file (default: the newest, saved or not)",
    )
    export.add_argument("box", metavar="BOX", help="its number or name in the list, or its file")
    export.add_argument("path", metavar="FILE", type=Path, help="the file to write, such as x.mcap")
    for each in (parser, listing, explain, save):
        each.add_argument("--json", action="store_true", help="print JSON, for programs")
    for each in (listing, explain, export):
        add_bus_options(each)
        add_port_option(each)
        add_config_options(each)
    add_robot_options(save)


def run(args: argparse.Namespace) -> int:
    """Carry out one verb."""
    if args.verb == "save":
        return _save(args)
    where, wanted = places_asked(args)
    from yahboomd.tools.blackbox.box_places import boxes, choose, load

    found = boxes(where)
    match args.verb:
        case "explain":
            path = choose(found, args.box, wanted)
            _explain(load(path), path, as_json=args.json)
            if args.box is None:
                _name_others(found, path)
        case "export":
            from yahboomd.tools.blackbox.box_export import export

            count = export(load(choose(found, args.box, wanted)), args.path)
            print(f"Wrote {count} messages to {args.path}.")
        case _:
            own = [each for each in found if wanted.fits(each.robot)] if wanted.named else found
            _list(own, where, as_json=args.json)
    return os.EX_OK


def places_asked(args: argparse.Namespace) -> tuple[Places, BoxQuery]:
    """The folders that may hold boxes, and the robot that is meant."""
    from yahboomd.core.config import Config
    from yahboomd.core.config.models import blackbox_folder
    from yahboomd.tools.blackbox.box_places import BoxQuery, places

    for name, default in (("config", None), ("overrides", []), ("namespace", None), ("port", None)):
        if not hasattr(args, name):
            setattr(args, name, default)
    loaded = read_config(args)
    config, usual = loaded.config, Config().zenoh
    own = blackbox_folder(config, os.environ, loaded.path, user_id=os.geteuid())
    connect = tuple(getattr(args, "connect", None) or ())
    elsewhere = (config.zenoh.listen, config.zenoh.connect) != (usual.listen, usual.connect)
    is_named = args.namespace is not None or config.zenoh.namespace != usual.namespace
    named = is_named or elsewhere or bool(connect or config.serial.port)
    wanted = BoxQuery(
        namespace=config.zenoh.namespace if is_named or not named else None,
        endpoints=connect or (config.zenoh.listen if elsewhere or not named else ()),
        port=config.serial.port,
        named=named,
    )
    return places(os.environ, own), wanted


def _list(found: list[Found], where: Places, *, as_json: bool) -> None:
    from yahboomd.core.program import plain
    from yahboomd.tools.blackbox.box_story import utc

    if as_json:
        rows = [
            {
                "name": each.name,
                "kind": each.kind,
                "path": str(each.path),
                "written_ns": each.written_ns,
                "bytes": each.size,
                "robot": "" if each.robot is None else each.robot.words,
            }
            for each in found
        ]
        print(json.dumps({"boxes": rows, "denied": [str(each) for each in where.denied]}))
        return
    for each in found:
        saved = each.path.stem.rpartition("Z_")[2].partition(".")[0]
        reason = saved if each.kind == "saved" else WORDS[each.kind]
        robot = "" if each.robot is None else f"  {each.robot.words}"
        size = f"{each.size / 1024:.0f} kB"
        print(
            f"{each.name:>9}  {utc(each.written_ns)[:19]}  {reason:<26}  {size:>7}  "
            f"{plain(str(each.path))}{robot}"
        )
    for folder in where.denied:
        from yahboomd.tools.blackbox.box_places import REMEDY

        print(f"{folder} cannot be read. {REMEDY}")
    if not found:
        print("There is no black box here: nothing was saved, and no daemon of yours runs.")


def _name_others(found: list[Found], shown: Path) -> None:
    """Name the newest box of the other kind, saved or of a running daemon, and other robots."""
    robot = next((each.robot for each in found if each.path == shown), None)
    key = robot and robot.key
    own = [each for each in found if each.robot and each.robot.key == key]
    running = [each for each in own if each.kind == "running"]
    saved = [each for each in own if each.kind != "running"]
    here = any(each.path == shown for each in running)
    others = saved if here else running
    if others:
        words = "The newest that is saved" if here else "A daemon runs. Its last minute"
        print(
            pasteable(f"\n{words}: `yahboomd blackbox explain {others[-1].name}`."),
            file=sys.stderr,
        )
    newest = max(found, key=lambda each: each.written_ns)
    beside = [each.robot for each in found if each.kind == "running" or each == newest]
    for other in {each.key: each for each in beside if each and each.key != key}.values():
        words = f"Of {other.words}: `yahboomd blackbox explain {other.option}`."
        print(pasteable(words), file=sys.stderr)


def _explain(box: Box, path: Path, *, as_json: bool) -> None:
    from yahboomd.tools.blackbox.box_places import robot_of
    from yahboomd.tools.blackbox.box_story import before, story, summary, utc, wall_clock

    text, wall_clock_ns = story(box), wall_clock(box)
    if as_json:
        robot = robot_of(box.header)
        facts = {
            "path": str(path),
            "robot": robot.words,
            "namespace": robot.namespace,
            "port": robot.port,
            "version": box.header.version,
            "reasons": list(box.header.saved.reasons) if box.header.saved else [],
            "why": text.why,
            "damaged": box.damaged,
            "cut": box.cut,
            "end": utc(wall_clock_ns(text.end_ns)),
            "lines": [
                {
                    "before_s": round((text.end_ns - line.at_ns) * 1e-9, 3),
                    "stamp_ns": wall_clock_ns(line.at_ns),
                    "what": line.what,
                    "words": line.words,
                }
                for line in text.lines
            ],
        }
        print(json.dumps(facts))
        return
    print(f"{path}\n{summary(box)}\n\n{text.why}\n")
    for line in text.lines:
        print(f"{before(line.at_ns, text.end_ns, text.end)}: {line.words}")


def _save(args: argparse.Namespace) -> int:
    from yahboomd.cli.attended import attend

    async def work(robot: AsyncRobot) -> int:
        from yahboomd.core.bus.keys import BLACKBOX_SAVE

        answer = await robot.call(BLACKBOX_SAVE, b'{"by": "yahboomd blackbox"}')
        path = answer.data.get("path")
        print(
            json.dumps({"message": answer.message, "path": path}) if args.json else answer.message
        )
        return os.EX_OK

    return attend(args, work)
