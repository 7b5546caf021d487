"""A network that is cut, held up or slow, a server that ends or hangs, while a thumb is down."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from chromium import Page
from page_bench import PageBench

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]

SILENT = """/silent|not connected/.test(document.querySelector("#state").innerText)"""
"""Why the page does not drive: first nothing comes, then it gave the connection up."""


@pytest.fixture
def page(bench: PageBench) -> Iterator[Page]:
    """The browser complains of connections that fail, as it should."""
    with bench.page() as page:
        yield bench.ready(page)


def set_held(bench: PageBench, held: bool) -> None:
    bench.network.held = held


@pytest.mark.nightly
def test_a_network_that_is_cut_stops_the_robot_and_the_page_comes_back_by_itself(
    bench: PageBench, page: Page
) -> None:
    bench.press(page)
    bench.stops_after(bench.network.cut)
    page.says("#state", "not connected")
    page.says("#why", "Connecting to the robot's computer.")
    page.says(".words", "Waiting: see above.")
    bench.network.refuses = False
    page.says(".words", "touch again")
    # The thumb is down all the time: it does not count any more.
    bench.stays()
    page.lift()
    bench.press(page)
    bench.stops_after(page.lift)


@pytest.mark.nightly
def test_what_a_silent_network_held_back_moves_nothing_when_it_comes(
    bench: PageBench, page: Page
) -> None:
    place = bench.press(page)
    bench.stops_after(lambda: set_held(bench, True))
    page.until(SILENT)
    page.touch((place[0] + 5, place[1]), kind="touchMove")
    set_held(bench, False)
    bench.stays()
    # Nothing is in the way any more, but this thumb does not count.
    page.says(".words", "Lift your thumb and touch again.")
    page.lift()


def test_500_ms_of_delay_in_mid_motion_stop_the_robot_and_the_page_says_why(
    bench: PageBench, page: Page
) -> None:
    place = bench.press(page)

    def slower() -> None:
        bench.network.delay_s = 0.5

    bench.stops_after(slower)
    page.touch((place[0] + 5, place[1]), kind="touchMove")
    page.says("#why", "The network is too slow to drive: ")
    page.lift()
    # A thumb that is put down again drives nothing either.
    bench.put_down(page, place)
    bench.stays()
    page.lift()
    page.says("#state", "slow network")
    page.says(".words", "Waiting: see above.")
    bench.network.delay_s = 0.0
    page.says(".words", "Ready.")
    bench.press(page)
    bench.stops_after(page.lift)


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_server_that_ends_leaves_a_robot_that_stands(
    bench: PageBench, page: Page, number: signal.Signals
) -> None:
    bench.press(page)
    bench.stops_after(lambda: bench.server.end(number))
    page.says("#state", "not connected")
    page.lift()
    bench.start_server()
    bench.press(page)
    bench.stops_after(page.lift)


def test_a_server_that_hangs_stops_the_robot_and_moves_nothing_when_it_goes_on(
    bench: PageBench, page: Page
) -> None:
    bench.press(page)
    bench.stops_after(lambda: bench.server.process.send_signal(signal.SIGSTOP))
    page.until(SILENT)
    bench.server.process.send_signal(signal.SIGCONT)
    bench.stays()
    page.lift()


@pytest.mark.nightly
def test_a_browser_that_stands_still_as_in_a_laptop_asleep_drives_nothing_when_it_wakes(
    bench: PageBench, page: Page
) -> None:
    bench.press(page)
    bench.stops_after(page.browser.pause)
    page.browser.resume()
    bench.stays()
    page.until("document.querySelector('.words').innerText.length > 10")
    page.lift()
