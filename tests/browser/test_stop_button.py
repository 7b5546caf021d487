"""The emergency stop: from every view, by touch and key, until it is acknowledged; its release."""

from __future__ import annotations

import signal

import pytest
from chromium import Page
from page_bench import PageBench
from page_checks import seen
from real_robot import wait_for

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]


@pytest.mark.nightly
@pytest.mark.parametrize("view", ["map", "drive", "wheels", "health"])
def test_the_button_is_seen_in_every_view_and_stops(
    bench: PageBench, page: Page, view: str
) -> None:
    page.evaluate(f"location.hash = '#{view}'")
    page.until(f"!document.querySelector('#{view}').hidden")
    page.tap("#estop")
    page.says("#state", "emergency stop")
    page.says("#estop-text", "acknowledged the emergency stop")
    bench.release(page)


def test_a_finger_on_the_button_stops_what_the_thumb_drives(bench: PageBench, page: Page) -> None:
    thumb = bench.press(page)
    button = page.middle("#estop")
    bench.stops_after(lambda: page.touch(thumb, button))
    page.says("#state", "emergency stop")
    page.lift()
    bench.release(page)


@pytest.mark.parametrize(
    "focus",
    [
        "#views a",
        *(pytest.param(each, marks=pytest.mark.nightly) for each in ("body", "#limit", ".pad")),
    ],
)
def test_space_stops_wherever_the_focus_is(bench: PageBench, page: Page, focus: str) -> None:
    page.evaluate(f"document.querySelector('{focus}').focus()")
    page.type("Space")
    page.says("#state", "emergency stop")
    assert page.evaluate("document.activeElement.nextElementSibling.id") == "release", "one Tab"
    bench.release(page)


def test_a_stop_that_is_not_acknowledged_is_tried_again_visibly_until_it_is(
    bench: PageBench, page: Page
) -> None:
    bench.server.process.send_signal(signal.SIGSTOP)
    page.tap("#estop")
    page.says("#estop-text", "attempt 3")
    assert "Switch the motors' supply off" in page.text("#estop-text")
    bench.server.process.send_signal(signal.SIGCONT)
    page.says("#estop-text", "acknowledged the emergency stop")
    page.says("#state", "emergency stop")
    bench.release(page)


@pytest.mark.nightly
def test_a_stop_is_tried_again_over_a_network_that_comes_back(bench: PageBench) -> None:
    with bench.page() as page:
        bench.ready(page)
        bench.network.cut()
        page.tap("#estop")
        page.says("#estop-text", "attempt 3")
        bench.network.refuses = False
        page.says("#estop-text", "acknowledged the emergency stop")
        bench.release(page)


@pytest.mark.nightly
def test_a_robot_that_is_stopped_is_not_driven_until_it_is_released(
    bench: PageBench, page: Page
) -> None:
    page.tap("#estop")
    page.says(".words", "Release the stop to drive")
    page.touch(page.middle(".pad"))
    x, y = page.middle(".pad")
    page.touch((x, y - 60), kind="touchMove")
    bench.stays()
    # The release does not wake a thumb that is down.
    page.lift()
    bench.release(page)
    bench.press(page)
    bench.stops_after(page.lift)


@pytest.mark.nightly
def test_a_fault_is_named_in_words_and_a_button_clears_it_on_the_page_that_takes_control(
    bench: PageBench, page: Page
) -> None:
    place = bench.press(page)

    def fails() -> bool:
        if page.text("#state") == "fault":
            return True
        # A machine that is too busy ends the drive before.
        if not page.says_driving():
            page.lift()
            bench.put_down(page, place)
        return False

    try:
        bench.robot.do("encoder-dead left")
        wait_for(fails, "a fault")
    finally:
        bench.robot.do("repair left")
    page.lift()
    page.says("#why", "left")
    # What the button does is no command to type; what only a terminal does is quoted.
    assert "release" not in page.text("#why")
    assert "`" not in page.text("#why")
    page.says("#release", "Clear the fault")
    with bench.page() as other:
        other.says("#release", "Take control")
        other.click("#release")
        other.says("#release", "Clear the fault")
        page.says("#release", "Take control")
        bench.release(other)
        page.says("#state", "standing")


MAY_TURN = "The wheels may still turn: switch the motors' supply off."


@pytest.mark.parametrize("size", [(390, 844), (844, 390)], ids=["upright", "on-its-side"])
def test_a_plug_that_is_pulled_in_motion_is_said_as_what_the_wheels_may_do(
    bench: PageBench, page: Page, size: tuple[int, int]
) -> None:
    page.resize(*size, phone=True)
    bench.press(page)
    bench.robot.do("unplug 600")
    try:
        page.says("#state", "may turn")
        page.lift()
        assert seen(page, "#why").startswith(MAY_TURN if size == (390, 844) else MAY_TURN[:25])
        page.says(".words", "The wheels may still turn")
        page.tap("#estop")
        page.says("#estop-text", "attempt 2")
        assert seen(page, "#estop-text").startswith("Switch the motors' supply off.")
        assert page.text("#state") == "may turn"
    finally:
        bench.robot.do("replug")
    page.says("#estop-text", "acknowledged the emergency stop")
    page.says("#state", "emergency stop")
    bench.release(page)
