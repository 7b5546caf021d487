"""The steps of a tuning as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from yahboomd.core.errors import Refused
from yahboomd.tools.tune.estimates.step_response import BAND, StepFigures
from yahboomd.tools.tune.traces import TICK_S
from yahboomd.tools.tune.tuning_result import Result, WheelTuning

BEFORE, AFTER = "#d55e00", "#0072b2"
"""Colours of Okabe and Ito, which people with colour blindness can tell apart."""

COLUMNS = 2


def save_picture(result: Result, path: Path) -> None:
    """Draw the steps of each wheel into a file.

    Raises:
        Refused: It cannot be written.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    try:
        draw(result).savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        if path.is_file():
            # Leave no partial picture.
            path.unlink()
        raise Refused(f"{path} cannot be written: {error}") from error


def draw(result: Result) -> Any:  # noqa: ANN401 - matplotlib has no types
    """The picture as a figure of matplotlib."""
    from matplotlib.figure import Figure

    rows = -(-len(result.wheels) // COLUMNS)
    figure = Figure(figsize=(12.0, 1.0 + 4.0 * rows), layout="constrained")
    figure.suptitle(f"a step of {result.speed_m_s:.2f} m/s, wheels in the air")
    axes = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True, sharey=True)
    for index, wheel in enumerate(result.wheels):
        _wheel(axes[index // COLUMNS][index % COLUMNS], result, index, wheel)
    for spare in range(len(result.wheels), rows * COLUMNS):
        axes[spare // COLUMNS][spare % COLUMNS].set_axis_off()
    return figure


def _wheel(axes: Any, result: Result, index: int, wheel: WheelTuning) -> None:  # noqa: ANN401
    target = result.speed_m_s
    axes.set(title=f"{wheel.name} (M{wheel.position})", xlabel="time, s", ylabel="m/s")
    axes.grid(alpha=0.3)
    axes.axhspan(target * (1.0 - BAND), target * (1.0 + BAND), color="#888888", alpha=0.2, lw=0)
    axes.axhline(target, color="#444444", lw=0.9, ls="--")
    for name, colour, found in (("before", BEFORE, wheel.before), ("after", AFTER, wheel.after)):
        if found is None or name not in result.traces:
            continue
        trace = result.traces[name][index]
        times = [tick * TICK_S for tick in range(len(trace))]
        axes.plot(times, trace, color=colour, lw=1.6, label=f"{name}: {summary(found)}")
        if found.settling_s is not None:
            axes.axvline(found.settling_s, color=colour, lw=0.9, ls=":")
    axes.set_ylim(bottom=min(0.0, *axes.get_ylim()))
    axes.legend(loc="lower right", fontsize="small")


def summary(found: StepFigures) -> str:
    """The figures in a line."""
    rise = "never" if found.rise_s is None else f"{found.rise_s:.2f} s"
    settled = "not settled" if found.settling_s is None else f"settled {found.settling_s:.2f} s"
    return f"rise {rise}, overshoot {found.overshoot:.1%}, {settled}"
