"""Reads the points of a path from a file in CSV."""

from __future__ import annotations

import csv
import itertools
import math
import re
from pathlib import Path

from yahboomd.core.config.reading import PIPE_S, read_named
from yahboomd.core.errors import Refused
from yahboomd.tools.terminal.words import decimal

MOST_BYTES = 130_000
"""A request may have 65,000 bytes and 2,000 points. The csv module takes no longer line."""

COLUMNS = ("x", "y", "theta")

_UNIT = re.compile(r"[ _]?[\[(]?(?<=[ _\[(])(m|rad)[\])]?$")
_BEGINS_LIKE_A_NUMBER = re.compile(r"\s*[-+]?\.?\d")


def read_points(path: Path, *, wait_s: float = PIPE_S) -> tuple[tuple[float, ...], ...]:
    """The points of a file. A first row without numbers names the columns, in any order.

    Args:
        wait_s: The longest wait for the next bytes of a pipe.

    Raises:
        Refused: The file cannot be read, has other columns, or a line that is no point.
    """
    try:
        raw = read_named(path, MOST_BYTES + 1, wait_s=wait_s)
        text = raw.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", "it is no UTF-8 text; save it as such")
        raise Refused(f"{path} cannot be read: {why}.") from error
    if len(raw) > MOST_BYTES:
        raise Refused(f"{path} has more than {MOST_BYTES} bytes: that is no path.")
    names: list[str] = []
    points: list[tuple[float, ...]] = []
    for line, row in enumerate(text.splitlines(), 1):
        cells = next(csv.reader([row.replace("\0", "?")]), [])
        heads = [_UNIT.sub("", cell.lower().strip(" \t#")) for cell in cells]
        is_heading = not (names or points or any(map(_BEGINS_LIKE_A_NUMBER.match, cells)))
        # Some programs write the names of the columns as a comment.
        is_comment = row.lstrip().startswith("#") and not (is_heading and {"x", "y"} <= {*heads})
        if is_comment or not any(heads):
            continue
        if is_heading:
            names = heads
            good = sorted(names) in (["x", "y"], ["theta", "x", "y"])
        else:
            columns = names or COLUMNS
            filled = zip(columns, cells, strict=False)
            given = {name: decimal(cell) for name, cell in filled if cell.strip()}
            points.append(tuple(given[name] for name in COLUMNS if name in given))
            known = {"x", "y"} <= given.keys() and len(cells) <= len(columns)
            # More radians than a turn are usually degrees.
            good = known and abs(sum(points[-1][2:])) <= math.tau and sum(points[-1]) < math.inf
        if not good:
            raise Refused(
                f"{path}, line {line}: {row.strip()[:60]!r} is no point. A line is x,y or "
                "x,y,theta, in metres and radians: decimal points, commas between, and no other "
                "columns. --speed sets the speed."
            )
    if not points:
        raise Refused(f"{path} has no points.")
    return tuple(points)


def summary(points: tuple[tuple[float, ...], ...]) -> str:
    """What will be driven, for a person who knows what was meant."""
    metres = sum(math.dist(a[:2], b[:2]) for a, b in itertools.pairwise(points))
    headings = sum(len(point) == 3 for point in points)
    turned = f", with a heading at {headings}" if headings else ""
    return f"{len(points)} points, {metres:.2f} m from the first to the last{turned}."
