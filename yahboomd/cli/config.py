"""``yahboomd config``: check, show and explain the configuration."""

from __future__ import annotations

import argparse
import sys

from yahboomd.cli.shared_options import add_config_options, read_config

DESCRIPTION = "Check, show and explain the configuration. Nothing is opened or moved."

EPILOG = """\
examples:
  yahboomd config check                           the file that the service reads
  yahboomd config show --origin --config robot.toml
  yahboomd config reference --toml > robot.toml   every key, commented

exit status:
  0    the configuration can be used
  78   it has mistakes: each is on a line
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the four verbs."""
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)

    check = verbs.add_parser(
        "check",
        help="say whether the configuration can be used",
        description="Say whether the configuration can be used, and name every mistake if not.",
    )
    add_config_options(check)

    show = verbs.add_parser(
        "show",
        help="print the configuration in effect",
        description="Print the configuration in effect, as a commented file that can be used as "
        "such.",
    )
    add_config_options(show)
    show.add_argument(
        "--origin", action="store_true", help="say behind each value where it comes from"
    )

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


def run(args: argparse.Namespace) -> int:
    """Carry out one verb.

    Raises:
        ConfigError: Naming every mistake.
    """
    from yahboomd.config import reference, schema

    match args.verb:
        case "check":
            loaded = read_config(args)
            for warning in loaded.warnings:
                print(f"warning: {warning}", file=sys.stderr)
            print(f"ok: {reference.summary(loaded)}")
        case "show":
            loaded = read_config(args)
            origins = loaded.origins if args.origin else None
            print(reference.as_toml(loaded.config, origins=origins), end="")
        case "schema":
            print(schema.as_json(), end="")
        case _:
            print(reference.default_toml() if args.toml else reference.markdown(), end="")
    return 0
