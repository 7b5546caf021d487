"""A place of the map is held: the robot goes there; whatever ends the hold stops the wheels."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable, Iterator

import pytest
from chromium import Page
from page_bench import PageBench
from real_robot import Process, wait_for

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]

WORDS = ".go > p"


@pytest.fixture(scope="module")
def moves(shared_bench: PageBench) -> Iterator[Process]:
    """The service that drives moves."""
    process = Process("moves", "--connect", shared_bench.robot.endpoint)
    yield process
    process.end()


@pytest.fixture
def page(bench: PageBench, moves: Process) -> Iterator[Page]:
    """A phone with the map, on which places can be held."""
    with bench.page(f"{bench.url}#map") as page:
        page.says(".where", "heading")
        page.click(".tools button:last-child")
        page.says(WORDS, "Hold a place")
        yield page


def ahead(bench: PageBench, page: Page, pixels: float) -> tuple[float, float]:
    """A place of the map before the robot: straight is quicker driven than a turn."""
    x, y = page.middle("canvas.map")
    theta = bench.application.latest("pose")["theta"]
    return x + pixels * math.cos(theta), y - pixels * math.sin(theta)


def hold(bench: PageBench, page: Page, button: str = "") -> tuple[float, float]:
    """Hold a place of the map, or a button; returns once the wheels turn. Where the finger is."""
    place = page.middle(button) if button else ahead(bench, page, 90)

    def held() -> bool:
        return bool(page.evaluate("document.querySelector('.go.held') !== null"))

    def moves() -> bool:
        if not held():
            page.lift()
            page.touch(place)
            patience = time.monotonic() + 2.0
            wait_for(lambda: held() or time.monotonic() > patience, "it is held")
        return bench.is_moving()

    wait_for(moves, "the wheels turn")
    return place


def reach(bench: PageBench, page: Page, button: str) -> None:
    """Hold a button until the goal is reached, again if this machine was too busy to hold it."""

    def reached() -> bool:
        if "The goal is reached" in page.text(WORDS):
            return True
        if page.evaluate("document.querySelector('.go.held') === null"):
            hold(bench, page, button)
        return False

    wait_for(reached, "the goal is reached", 120.0)
    page.lift()


def second_finger(page: Page) -> None:
    page.touch(page.middle("canvas.map"), (30.0, 20.0))


def hide(page: Page) -> None:
    """Another tab comes to the front."""
    other = page.browser.order("Target.createTarget", url="about:blank")["targetId"]
    page.until("document.hidden")
    page.browser.order("Target.closeTarget", targetId=other)


def freeze(page: Page) -> None:
    page.order("Page.setWebLifecycleState", state="frozen")


def another_view(page: Page) -> None:
    page.evaluate("location.hash = '#wheels'")


def reload(page: Page) -> None:
    page.order("Page.reload")


LOSSES: dict[str, Callable[[Page], None]] = {
    "second finger": second_finger,
    "tab hidden": hide,
    "screen locked": freeze,
    "another view": another_view,
    "page reloaded": reload,
}


@pytest.mark.nightly
@pytest.mark.parametrize(
    "loss",
    [pytest.param(loss, id=name) for name, loss in LOSSES.items()],
)
def test_a_place_that_is_lost_stops_the_wheels(
    bench: PageBench, page: Page, loss: Callable[[Page], None]
) -> None:
    hold(bench, page)
    bench.stops_after(lambda: loss(page))


def test_a_place_that_is_let_go_stops_the_robot_and_the_page_says_so(
    bench: PageBench, page: Page
) -> None:
    hold(bench, page)
    page.says(WORDS, "left. Let go to stop.")
    bench.stops_after(page.lift)
    page.says(WORDS, "You let go: the robot stops.")


@pytest.mark.nightly
def test_the_robot_goes_to_a_place_that_was_marked_by_a_short_touch(
    bench: PageBench, page: Page
) -> None:
    page.touch(ahead(bench, page, 50))
    page.lift()
    bench.stays()
    reach(bench, page, ".go .hold")
    assert page.evaluate("document.querySelector('.go progress').value") == 1


@pytest.mark.nightly
def test_the_robot_turns_to_a_place_that_was_marked_by_a_short_touch(
    bench: PageBench, page: Page
) -> None:
    before = bench.robot.settled_truth()
    x, y = page.middle("canvas.map")
    page.touch((x, y - 60))
    page.lift()
    bench.stays()
    reach(bench, page, ".go .hold:last-child")
    turned = bench.robot.settled_truth()
    assert math.hypot(turned.x - before.x, turned.y - before.y) < 0.02
    # North on the map.
    theta = bench.application.latest("pose")["theta"]
    assert math.cos(theta - math.pi / 2) > 0.999


@pytest.mark.nightly
def test_a_server_that_is_killed_ends_the_move(bench: PageBench, page: Page) -> None:
    hold(bench, page)
    bench.stops_after(lambda: bench.server.end(signal.SIGKILL))
    page.lift()
    bench.start_server()


@pytest.mark.nightly
def test_without_the_service_the_page_says_so_and_drives_nowhere(
    bench: PageBench, moves: Process
) -> None:
    moves.end()
    with bench.page(f"{bench.url}#map") as page:
        page.says(".where", "heading")
        page.click(".tools button:last-child")
        page.says(WORDS, "`yahboomd moves` does not run")
        page.touch(page.middle("canvas.map"))
        bench.stays()
        page.lift()
