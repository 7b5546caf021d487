"""Plots for the page. Importing matplotlib takes a second, so functions import it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.results import Section

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#666666", "#f4a261", "#2a9d8f", "#c77dff", "#e76f51")


def blank(width: float = 7.5, height: float = 4.2) -> tuple[Figure, Axes]:
    """A figure with one pair of axes."""
    from matplotlib.figure import Figure as NewFigure

    figure = NewFigure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.grid(True, which="major", color="#e5e5e5", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure, axes


def shares(
    axes: Axes, values: Mapping[str, Sequence[float]], *, lines: Sequence[str] = ("-",)
) -> None:
    """Plot the share of each list below a value, on a logarithmic axis."""
    for n, (name, found) in enumerate(values.items()):
        ordered = sorted(found)
        share = [(rank + 1) / len(ordered) for rank in range(len(ordered))]
        axes.semilogx(ordered, share, lines[n % len(lines)], color=COLOURS[n], label=name)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.legend(fontsize=8, frameon=False)


def keep(section: Section, figure: Figure, images: Path, name: str, caption: str) -> None:
    """Write the picture, and list it in the section."""
    figure.savefig(images / name, dpi=130)
    section.images.append((name, caption))
