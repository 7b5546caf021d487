"""Several pages: one has control, taking over is a deliberate act, viewers watch and stop."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import pytest
from chromium import Page
from page_bench import PageBench

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]


@pytest.mark.nightly
def test_a_second_page_drives_only_after_it_took_control(bench: PageBench, page: Page) -> None:
    page.order("Emulation.setFocusEmulationEnabled", enabled=True)  # Two phones: both are seen.
    bench.press(page)
    with bench.page() as other:
        other.says(".words", "has control of the robot.")
        x, y = other.middle(".pad")
        bench.put_down(other, (x, y + 60))
        other.says(".words", "has control of the robot.")
        page.says("#driver", "This page")
        other.lift()
        bench.stops_after(lambda: other.click(".take"))
        page.until("/^Page \\d+ has control/.test(document.querySelector('#driver').innerText)")
        # The first thumb is still down, and drives nothing.
        page.touch((x, y - 70), kind="touchMove")
        bench.stays()
        bench.press(other)
        bench.stops_after(other.lift)
    page.lift()


@pytest.mark.nightly
def test_a_page_that_gave_control_back_leaves_the_robot_to_the_next_that_touches(
    bench: PageBench, page: Page
) -> None:
    bench.press(page)
    bench.stops_after(page.lift)
    with bench.page() as other:
        other.says(".words", "has control of the robot.")
        bench.put_down(other, bench.place(other, 0.0, 0.8))
        other.lift()
        page.click(".take")
        page.says("#driver", "No page")
        other.says(".words", "Ready.")
        bench.press(other)
        bench.stops_after(other.lift)


@pytest.mark.nightly
def test_a_page_without_control_takes_it_where_the_stop_is_released(
    bench: PageBench, page: Page
) -> None:
    bench.press(page)
    bench.stops_after(page.lift)
    page.click("#estop")
    with bench.page() as other:
        other.says("#release", "Take control")
        other.click("#release")
        other.says("#release", "Release the stop")
        other.click("#release")
        other.says("#state", "standing")


@pytest.mark.nightly
def test_a_viewer_watches_and_stops_and_neither_drives_nor_releases(
    make_bench: Callable[..., PageBench],
) -> None:
    bench = make_bench(listen="0.0.0.0")
    driver, viewer = bench.links()
    with bench.page(url=viewer) as page:
        page.says(".words", "watch and stop")
        assert page.evaluate("location.hash + document.cookie") == ""
        assert not page.evaluate("document.querySelector('.pad').checkVisibility()")
        x, y = page.middle(".zone")
        page.touch((x, y))
        page.touch((x, y - 60), kind="touchMove")
        bench.stays()
        page.lift()
        page.tap("#estop")
        page.says("#estop-text", "A phone that may drive can release it")
        assert page.evaluate("document.querySelector('#release').hidden")
    with bench.page(url=driver) as page:
        page.until("document.querySelector('#release').checkVisibility()")
        page.click("#release")
        page.says("#state", "standing")
        bench.press(page)
        bench.stops_after(page.lift)


@pytest.mark.nightly
def test_thirty_pages_at_once_watch_while_one_drives(bench: PageBench) -> None:
    with ExitStack() as stack:
        page = stack.enter_context(bench.page())
        bench.ready(page)
        others = [stack.enter_context(bench.page()) for _ in range(29)]
        for other in others:
            other.until("document.querySelector('#state').dataset.state === 'standing'")
        page.order("Page.bringToFront")
        bench.press(page)
        bench.stops_after(page.lift)
        for other in others:
            other.says("#driver", "Page ")
