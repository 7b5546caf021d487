"""Prints the lowest versions that pyproject.toml allows, as constraints for pip: `make lowest`.

Of what people install: the tools of developers, which `dev` adds to it, are the newest.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path


def lowest(requirement: str) -> str:
    """The requirement with its lower bound as the version; the same if it has none."""
    return re.sub(r">=([\w.]+)[^;]*", r"==\1", requirement)


def main() -> None:
    project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
    optional = project["optional-dependencies"]
    installed = re.fullmatch(r"yahboomd\[(.*)\]", optional["dev"][0])
    assert installed, "dev begins with what people install"
    extras = (optional[name] for name in installed[1].split(","))
    for requirement in sorted(
        {*project["dependencies"], *(each for rows in extras for each in rows)}
    ):
        print(lowest(requirement))


if __name__ == "__main__":
    main()
