"""Draws the path of the robot as a map of dots. Pure.

A character of the Braille block is a grid of two by four dots, so a small corner of a terminal
shows a path well. The axes are the pose's: x points up the screen, y to the left, as seen from
above and behind the robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

# The dots of a Braille character, by (column, row), as bits of its number.
_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
_BRAILLE = 0x2800

SMALLEST_M = 0.5
"""The least extent of a map in metres; with less, noise of a standing robot would fill it."""

JUMP_M = 0.5
"""Points farther apart than this are not joined."""

_ARROWS = "↑↖←↙↓↘→↗"


def path_map(
    trail: Sequence[tuple[float, float]], *, theta: float, width: int, height: int
) -> tuple[list[str], tuple[int, int], float]:
    """Draw a path, to scale, as large as fits.

    Args:
        trail: Positions (x, y) in metres, the newest last; at least one.
        theta: The heading now, radians.

    Returns:
        The lines; the column and line of the robot, drawn as an arrow; and the height of a line in
        metres.
    """
    xs, ys = [x for x, _ in trail], [y for _, y in trail]
    middle_x, middle_y = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
    columns, rows = 2 * width, 4 * height
    # Dots of most fonts are square: a character is about twice as high as wide. A margin of one
    # dot at each side keeps the extremes inside.
    metres_per_dot = max(
        (max(ys) - min(ys)) / max(1, columns - 3),
        (max(xs) - min(xs)) / max(1, rows - 3),
        SMALLEST_M / max(1, rows - 3),
    )

    def dot(x: float, y: float) -> tuple[int, int]:
        column = round((columns - 1) / 2 - (y - middle_y) / metres_per_dot)
        row = round((rows - 1) / 2 - (x - middle_x) / metres_per_dot)
        return min(max(column, 0), columns - 1), min(max(row, 0), rows - 1)

    cells = [[0] * width for _ in range(height)]
    before = trail[0]
    for point in trail:
        # A farther point is a pose that was set: the robot did not drive to it.
        (x, y), (x_end, y_end) = before if math.dist(before, point) < JUMP_M else point, point
        steps = math.ceil(math.dist((x, y), point) / metres_per_dot)
        for share in (step / max(1, steps) for step in range(steps + 1)):
            column, row = dot(x + (x_end - x) * share, y + (y_end - y) * share)
            cells[row // 4][column // 2] |= _DOTS[column % 2][row % 4]
        before = point
    lines = [[chr(_BRAILLE + bits) if bits else " " for bits in line] for line in cells]
    column, row = dot(*trail[-1])
    place = (column // 2, row // 4)
    lines[place[1]][place[0]] = _ARROWS[round(theta / (math.pi / 4)) % 8]
    return ["".join(line) for line in lines], place, 4 * metres_per_dot
