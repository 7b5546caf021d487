"""Draws sampled stacks as a flame graph, and sums them as shares of each room."""

from __future__ import annotations

import html
from collections import Counter
from pathlib import Path

Stacks = dict[tuple[str, ...], int]

WIDTH, ROW = 1200, 17
COLOURS = {
    "yahboomd.core.link": "#f4a261",
    "yahboomd.core.protocol": "#e9c46a",
    "yahboomd.core.odometry": "#2a9d8f",
    "yahboomd.core.drive": "#8ab17d",
    "yahboomd.core.daemon": "#e76f51",
    "yahboomd.core.messages": "#90a8ed",
    "yahboomd.core.bus": "#c77dff",
    "yahboomd.ros2": "#9d4edd",
    "yahboomd": "#f7b9a6",
    "asyncio": "#bbbbbb",
    "selectors": "#dddddd",
}
IDLE = "selectors:"


def read(path: Path) -> Stacks:
    """Read the sampler's file, without frames outside the event loop and without waiting."""
    stacks: Counter[tuple[str, ...]] = Counter()
    for line in path.read_text().splitlines():
        stack, _, count = line.rpartition(" ")
        names = stack.split(";")
        start = next((n for n, name in enumerate(names) if name.endswith("_run_once")), None)
        if start is not None and not names[-1].startswith(IDLE):
            stacks[tuple(names[start:])] += int(count)
    return dict(stacks)


def by_room(stacks: Stacks) -> Counter[str]:
    """Samples by the innermost room; calls outside yahboomd count for their caller."""
    rooms: Counter[str] = Counter()
    for stack, count in stacks.items():
        ours = [name for name in stack if name.startswith("yahboomd.")]
        parts = ours[-1].split(":")[0].split(".") if ours else ["asyncio"]
        # A door is one level, a room of the core two.
        rooms[".".join(parts[: 3 if parts[1:2] == ["core"] else 2])] += count
    return rooms


def by_function(stacks: Stacks) -> Counter[str]:
    """Samples by the innermost function of yahboomd."""
    functions: Counter[str] = Counter()
    for stack, count in stacks.items():
        ours = [name for name in stack if name.startswith("yahboomd.")]
        functions[ours[-1] if ours else "(the event loop)"] += count
    return functions


def draw(stacks: Stacks, path: Path, title: str) -> None:
    """Write the graph as SVG: the width is time, and callees lie above their callers."""
    total = sum(stacks.values())
    depth = max((len(stack) for stack in stacks), default=0)
    height = (depth + 2) * ROW
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}"',
        'font-family="sans-serif" font-size="11"><rect width="100%" height="100%" fill="white"/>',
        f'<text x="4" y="12">{html.escape(title)}</text>',
    ]
    _draw(out, stacks, 0, 0.0, total)
    path.write_text("\n".join([*out, "</svg>"]) + "\n")


def _draw(out: list[str], stacks: Stacks, depth: int, left: float, total: int) -> None:
    groups: dict[str, Stacks] = {}
    for stack, count in stacks.items():
        if len(stack) > depth:
            groups.setdefault(stack[depth], {})[stack] = count
    for name, group in sorted(groups.items()):
        count = sum(group.values())
        width = count / total * WIDTH
        if width >= 1.0:
            y = (depth + 1) * ROW
            label = name.split(":")[-1]
            fits = int(width / 6.2)
            words = label if len(label) <= fits else label[: max(0, fits - 1)] + "…" * (fits > 3)
            out.append(
                f"<g><title>{html.escape(name)}: {100.0 * count / total:.1f} %</title>"
                f'<rect x="{left:.1f}" y="{y}" width="{width - 0.3:.1f}" height="{ROW - 1}" '
                f'fill="{_colour(name)}"/><text x="{left + 2:.1f}" y="{y + 12}">'
                f"{html.escape(words)}</text></g>"
            )
            _draw(out, group, depth + 1, left, total)
        left += width


def _colour(name: str) -> str:
    return next((colour for room, colour in COLOURS.items() if name.startswith(room)), "#eeeeee")
