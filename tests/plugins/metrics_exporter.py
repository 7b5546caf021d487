"""`yahboomd metrics` as a real process. Import the fixture to have it."""

from __future__ import annotations

import urllib.request
from collections.abc import Callable, Iterator

import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from real_robot import Process

Labels = tuple[tuple[str, str], ...]


class Exporter:
    """`yahboomd metrics` on a free port."""

    def __init__(self, *arguments: str) -> None:
        self.process = Process("metrics", "--listen", "127.0.0.1:0", *arguments)
        self.url = self.process.says("Metrics at ").removeprefix("Metrics at ")

    def page(self, accept: str = "application/openmetrics-text") -> str:
        """The page, in OpenMetrics."""
        request = urllib.request.Request(self.url, headers={"Accept": accept})
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.read().decode()

    def classic_page(self) -> str:
        """The page in Prometheus' older format."""
        return self.page("text/plain")

    def series(self) -> dict[tuple[str, Labels], float]:
        """Every series as the official parser reads it."""
        return {
            (sample.name, tuple(sample.labels.items())): sample.value
            for family in text_string_to_metric_families(self.page())
            for sample in family.samples
        }

    def value(self, name: str, robot: str = "yahboomd", **labels: str) -> float | None:
        """One series of one robot; None if it does not exist."""
        return self.series().get((name, (("robot", robot), *labels.items())))


@pytest.fixture
def exporter() -> Iterator[Callable[..., Exporter]]:
    """Starts exporters: ``exporter("--connect", endpoint)``."""
    made: list[Exporter] = []

    def start(*arguments: str) -> Exporter:
        made.append(Exporter(*arguments))
        return made[-1]

    yield start
    for each in made:
        each.process.end()
