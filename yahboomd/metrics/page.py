"""The page that scrapers get: all robots, and this process itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from yahboomd.metrics.exposition import Exposition
from yahboomd.metrics.robot_metrics import RobotFacts, add_robot

FRESH_NS = 500_000_000
"""A page is kept for so long: a flood of scrapes writes it out again, and computes nothing."""


class Page:
    """Makes the page, at most once in half a second for each format.

    Args:
        now_ns: Monotonic time.
        robots: What is known of each robot.
        version: This program's.
    """

    def __init__(
        self, now_ns: Callable[[], int], robots: Callable[[], Sequence[RobotFacts]], *, version: str
    ) -> None:
        self.connections: Mapping[str, int] = {}
        self._now_ns = now_ns
        self._robots = robots
        self._version = version
        self._kept: dict[bool, tuple[int, str]] = {}

    def text(self, openmetrics: bool) -> str:
        """The page in OpenMetrics, or in Prometheus' older format."""
        now_ns = self._now_ns()
        made_ns, text = self._kept.get(openmetrics, (None, ""))
        if made_ns is None or now_ns - made_ns >= FRESH_NS:
            text = self._make().text(openmetrics=openmetrics)
            self._kept[openmetrics] = (now_ns, text)
        return text

    def _make(self) -> Exposition:
        exposition = Exposition()
        for robot in self._robots():
            add_robot(exposition, robot)
        exposition.family("yahboomd_metrics", "info", "this exporter").set(
            1, {"version": self._version}
        )
        connections = exposition.family(
            "yahboomd_metrics_connections", "counter", "connections of scrapers, by what they got"
        )
        for outcome, count in self.connections.items():
            connections.set(count, {"outcome": outcome})
        return exposition
