"""Draws docs/images/path.png: the simulated robot follows a path by its own odometry.

    .venv/bin/python make/picture.py [docs/images/path.png]

Three processes, as on a robot: a simulated board on a pseudo-terminal, the daemon on its port, and
this application. It steers by `yahboomd/pose` alone. Afterwards it compares every published pose
with the true pose of the simulated robot at that moment.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl

from yahboomd.client import PoseSample, Robot
from yahboomd.simulation.truth import TruthSample, pose_at, read_truth

mpl.use("Agg")
from matplotlib import pyplot as plt

SPEED_M_S = 0.4
LOOK_AHEAD_M = 0.15
ROUNDS = 3
LENGTH_M, WIDTH_M = 2.4, 0.8

PAPER, INK, MUTED = "#ffffff", "#1f2328", "#8c959f"
TRUE, POSE, ERROR = "#f4b183", "#0b5cad", "#0b5cad"


class Pose(NamedTuple):
    """A published pose; its stamp is on the monotonic clock, like the ground truth's."""

    t_ns: int
    x: float
    y: float
    theta: float


def figure_of_eight(share: float) -> tuple[float, float]:
    """A point of the path, at ``share`` of a round.

    It starts at the origin along x, like the robot: on top of the left half.
    """
    turn = 2 * math.pi * (share - 1 / 8)
    x, y = LENGTH_M / 2 * math.sin(turn), -WIDTH_M / 2 * math.sin(2 * turn)
    return x + LENGTH_M / 2 * math.sin(math.pi / 4), y - WIDTH_M / 2


@contextlib.contextmanager
def robot(folder: Path) -> Iterator[str]:
    """A simulated board and its daemon; yields the daemon's endpoint."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    port = folder / "board"
    yahboomd = [sys.executable, "-m", "yahboomd"]
    with contextlib.ExitStack() as running:

        def start(*arguments: str) -> None:
            process = subprocess.Popen([*yahboomd, *arguments])
            running.callback(process.wait)
            running.callback(process.send_signal, signal.SIGTERM)

        start("simulate", "--link", str(port), "--truth", str(folder / "truth"))
        while not port.exists():
            time.sleep(0.05)
        own = [f"zenoh.listen={endpoint}", "zenoh.connect=", f"estop.latch_file={folder}/estop"]
        start("run", "--port", str(port), *(word for key in own for word in ("--set", key)))
        yield endpoint


def drive(endpoint: str) -> list[Pose]:
    """Follow the path (pure pursuit), and return every pose that was published."""
    poses: list[Pose] = []
    offset_ns = time.time_ns() - time.monotonic_ns()
    with Robot(endpoint, wait_s=30.0) as robot:
        share = 0.0
        for sample in robot.samples(PoseSample):
            x, y, theta = sample.x, sample.y, sample.theta
            poses.append(Pose(sample.stamp_ns - offset_ns, x, y, theta))
            if share >= ROUNDS:
                if robot.commanded is None and robot.standing():
                    break
                continue
            while share < ROUNDS and math.dist((x, y), figure_of_eight(share)) < LOOK_AHEAD_M:
                share += 0.001
            goal_x, goal_y = figure_of_eight(share)
            aside = math.atan2(goal_y - y, goal_x - x) - theta
            robot.drive(SPEED_M_S, 2 * SPEED_M_S * math.sin(aside) / LOOK_AHEAD_M, for_s=0.3)
    return poses


def errors_mm(poses: list[Pose], truth: list[TruthSample]) -> list[float]:
    """The distance of each pose from the robot's true place at its stamp."""
    true = [pose_at(truth, pose.t_ns) for pose in poses]
    return [1e3 * math.hypot(p.x - t.x, p.y - t.y) for p, t in zip(poses, true, strict=True)]


def draw(poses: list[Pose], truth: list[TruthSample], target: Path) -> None:
    """Draw the path above, and the error below."""
    plt.rcParams.update({"font.size": 10, "text.color": INK, "axes.edgecolor": MUTED})
    plt.rcParams.update({"axes.labelcolor": INK, "xtick.color": MUTED, "ytick.color": MUTED})
    figure, (path, error) = plt.subplots(
        2, 1, figsize=(8.4, 5.6), height_ratios=[2.6, 1], layout="constrained", facecolor=PAPER
    )
    driven = math.fsum(math.dist((a.x, a.y), (b.x, b.y)) for a, b in itertools.pairwise(truth))
    worst = errors_mm(poses, truth)
    path.plot(
        [t.x for t in truth],
        [t.y for t in truth],
        color=TRUE,
        lw=7,
        solid_capstyle="round",
        label="where the simulated robot was",
    )
    path.plot(
        [p.x for p in poses],
        [p.y for p in poses],
        color=POSE,
        lw=1.3,
        label="yahboomd/pose, from the encoders",
    )
    path.plot(0, 0, "o", color=INK, ms=5)
    path.annotate("start", (0, 0), (0, 9), textcoords="offset points", ha="center")
    path.set_aspect("equal")
    path.margins(0.06, 0.12)
    path.set_xlabel("x in m")
    path.set_ylabel("y in m")
    path.set_title(f"{ROUNDS} rounds, {driven:.1f} m at {SPEED_M_S:g} m/s", loc="left")
    path.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, borderpad=0)
    start_ns = poses[0].t_ns
    error.plot([(p.t_ns - start_ns) / 1e9 for p in poses], worst, color=ERROR, lw=1)
    error.set_xlim(0, (poses[-1].t_ns - start_ns) / 1e9)
    error.set_ylim(0)
    error.set_xlabel("s")
    error.set_ylabel("error in mm")
    error.set_title(
        f"distance between the two at each pose: {max(worst):.1f} mm at most", loc="left"
    )
    for axes in (path, error):
        axes.grid(color="#eaeef2", lw=0.8)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.1)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=130, bbox_inches="tight", pad_inches=0.12)
    print(f"{target}: {driven:.2f} m, {len(poses)} poses, off by {max(worst):.1f} mm at most")


def main() -> None:
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/path.png")
    with tempfile.TemporaryDirectory(prefix="yahboomd-picture-") as name:
        with robot(Path(name)) as endpoint:
            poses = drive(endpoint)
        truth = read_truth(Path(name) / "truth")
    poses = [pose for pose in poses if truth[0].t_ns < pose.t_ns < truth[-1].t_ns]
    draw(poses, truth, target)


if __name__ == "__main__":
    main()
