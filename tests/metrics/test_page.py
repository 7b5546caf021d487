from __future__ import annotations

from prometheus_client.openmetrics.parser import text_string_to_metric_families

from yahboomd.metrics.page import FRESH_NS, Page
from yahboomd.metrics.robot_metrics import RobotFacts


class Robots:
    """Two robots, and how often they were asked."""

    def __init__(self) -> None:
        self.asked = 0
        self.now_ns = 0

    def __call__(self) -> list[RobotFacts]:
        self.asked += 1
        return [RobotFacts(name="front", unreadable=self.asked), RobotFacts(name="rear")]


def test_a_flood_of_scrapes_makes_the_page_once_for_each_format() -> None:
    robots = Robots()
    page = Page(lambda: robots.now_ns, robots, version="1")
    pages = {page.text(openmetrics) for openmetrics in (True, False) for _ in range(1000)}
    assert len(pages) == 2
    assert robots.asked == 2


def test_the_page_follows_what_is_known() -> None:
    robots = Robots()
    page = Page(lambda: robots.now_ns, robots, version="1")
    before = page.text(openmetrics=True)
    robots.now_ns += FRESH_NS
    assert page.text(openmetrics=True) != before


def test_it_has_every_robot_the_version_and_what_became_of_scrapers() -> None:
    robots = Robots()
    page = Page(lambda: 0, robots, version="1.2")
    page.connections = {"answered": 3, "bad_host": 0}
    samples = [
        (sample.name, tuple(sample.labels.values()), sample.value)
        for family in text_string_to_metric_families(page.text(openmetrics=True))
        for sample in family.samples
    ]
    assert ("yahboomd_up", ("front",), 0) in samples
    assert ("yahboomd_up", ("rear",), 0) in samples
    assert ("yahboomd_metrics_info", ("1.2",), 1) in samples
    assert ("yahboomd_metrics_connections_total", ("answered",), 3) in samples
