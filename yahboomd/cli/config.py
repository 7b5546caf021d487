"""``yahboomd config``: checks, shows and explains the configuration."""

from __future__ import annotations

import argparse
import sys

from yahboomd.cli.shared_options import add_config_options, read_config
from yahboomd.tools.ros_files.node_parameters import PARAMETERS
from yahboomd.tools.ros_files.robot_model import urdf
from yahboomd.tools.ros_files.yaml_text import as_yaml

DESCRIPTION = "Check, show and explain the configuration. No port is opened, no wheel moved."

EPILOG = """\
examples:
  yahboomd config check                           the file that the service reads
  yahboomd config show --origin --config robot.toml
  yahboomd config reference --toml > robot.toml   every key, commented
  yahboomd config urdf > robot.urdf               the robot's model for ROS 2
  yahboomd config parameters nav2                 what Nav2 has to know of this base

exit status:
  0    the configuration can be used
  78   it has mistakes: each is on a line
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)

    check = verbs.add_parser(
        "check",
        help="check whether the configuration can be used",
        description="Check whether the configuration can be used, and name every mistake if not. "
        "The file of zenoh.config and its certificates are judged as by `yahboomd run`.",
    )
    add_config_options(check)

    show = verbs.add_parser(
        "show",
        help="print the configuration in effect",
        description="Print the configuration in effect, as a commented file that can be used as "
        "such.",
    )
    add_config_options(show)
    form = show.add_mutually_exclusive_group()
    form.add_argument(
        "--origin", action="store_true", help="print the origin of each value beside it"
    )
    form.add_argument("--json", action="store_true", help="print JSON, for programs")

    verbs.add_parser(
        "schema",
        help="print a JSON Schema of the configuration",
        description="Print a JSON Schema of the configuration, for editors that check TOML.",
    )
    reference = verbs.add_parser(
        "reference",
        help="explain every key",
        description="Print the reference of every key, in Markdown.",
    )
    reference.add_argument(
        "--toml", action="store_true", help="print the commented default file instead"
    )

    model = verbs.add_parser(
        "urdf",
        help="print the robot's model for ROS 2",
        description="Print the robot's model as URDF, for robot_state_publisher: the wheels as "
        "configured, and the frames in ros2.static_transforms.",
    )
    add_config_options(model)
    parameters = verbs.add_parser(
        "parameters",
        help="print parameters of ROS 2 nodes that fit the base",
        description="Print parameters of ROS 2 nodes that follow from the configuration, as YAML: "
        "frames, topics, speeds, message types. Those of nav2 and slam_toolbox are laid over the "
        "files that these packages come with; those of robot_localization and joystick stand "
        "alone.",
    )
    parameters.add_argument("package", choices=tuple(PARAMETERS), help="whose nodes")
    add_config_options(parameters)


def run(args: argparse.Namespace) -> int:
    """Carry out one verb."""
    from yahboomd.core.config import schema
    from yahboomd.tools.schemas import reference

    match args.verb:
        case "check":
            from yahboomd.core.daemon.assembly import bus_options
            from yahboomd.tools.robot.zenoh_file import judge

            loaded = read_config(args)
            for warning in loaded.warnings:
                print(f"warning: {warning}", file=sys.stderr)
            judge(bus_options(loaded.config))
            print(f"ok: {reference.summary(loaded)}")
        case "show":
            loaded = read_config(args)
            if args.json:
                print(loaded.config.resolved().model_dump_json(indent=2))
                return 0
            origins = loaded.origins if args.origin else None
            print(reference.as_toml(loaded.config, origins=origins), end="")
        case "urdf":
            print(urdf(read_config(args).config), end="")
        case "parameters":
            tree = PARAMETERS[args.package](read_config(args).config)
            print(f"# Parameters of {args.package} by `yahboomd config parameters`.")
            print(as_yaml(tree), end="")
        case "schema":
            print(schema.as_json(), end="")
        case _:
            print(reference.default_toml() if args.toml else reference.markdown(), end="")
    return 0
