"""Vibration, full screen, a screen that stays on: what the page asks of a browser, and when."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from chromium import Page
from page_bench import PageBench
from real_robot import wait_for

from yahboomd.web.certificate import CERTIFICATE, KEY, make_certificate

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser"), pytest.mark.nightly]

ASKED = """
window.felt = [];
Navigator.prototype.vibrate = (ms) => felt.push(ms) > 0;
window.locks = [];
if (window.WakeLock) {
  const ask = WakeLock.prototype.request;
  WakeLock.prototype.request = async function (kind) {
    const lock = await ask.call(this, kind);
    locks.push(lock);
    return lock;
  };
}
"""
"""Notes vibrations, in ms, and the locks of the screen that the browser gave."""

AT_THE_EDGE, STOPPED = 12, 120
HOST = "robot.test"


@pytest.fixture
def page(bench: PageBench) -> Iterator[Page]:
    """A phone that notes it."""
    with bench.page("about:blank#") as page:
        page.order("Page.addScriptToEvaluateOnNewDocument", source=ASKED)
        page.go(bench.url)
        bench.ready(page)
        yield page
        assert page.problems() == []


def felt(page: Page, ms: int) -> int:
    """How often."""
    found: int = page.evaluate(f"felt.filter((each) => each === {ms}).length")
    return found


def touched(page: Page) -> None:
    """Before that a browser lets no page vibrate."""
    page.tap("#robot")
    page.until("navigator.userActivation.hasBeenActive")


def test_the_rings_edge_is_felt_once_each_time_it_is_reached(bench: PageBench, page: Page) -> None:
    touched(page)
    bench.press(page, up=0.4)
    assert felt(page, AT_THE_EDGE) == 0

    def at_the_edge() -> bool:
        # A machine that is too busy ends the drive.
        if not page.says_driving():
            page.lift()
            bench.press(page, up=0.4)
        known = felt(page, AT_THE_EDGE)
        for up in (0.8, 0.9, 1.0):
            page.touch(bench.place(page, 0.0, up), kind="touchMove")
        found = felt(page, AT_THE_EDGE) - known
        page.touch(bench.place(page, 0.0, 0.3), kind="touchMove")
        return found == 1

    # Each way back from it makes it new.
    wait_for(at_the_edge, "the edge is felt")
    wait_for(at_the_edge, "the edge is felt again")
    page.lift()


STOPS: dict[str, Callable[[Page], object]] = {
    "emergency stop": lambda page: page.click("#estop"),
    "another limit": lambda page: page.click(".presets button"),
    "another view": lambda page: page.evaluate("location.hash = '#record'"),
}


@pytest.mark.parametrize("stop", STOPS.values(), ids=STOPS)
def test_a_stop_is_felt_and_a_lifted_thumb_is_not(
    bench: PageBench, page: Page, stop: Callable[[Page], object]
) -> None:
    touched(page)

    def lifted() -> bool:
        bench.press(page)
        known = felt(page, STOPPED)
        page.lift()
        page.until("!document.querySelector('.pad.held')")
        return felt(page, STOPPED) == known

    wait_for(lifted, "a thumb is lifted, and nothing is felt")
    bench.press(page)
    known = felt(page, STOPPED)
    stop(page)
    wait_for(lambda: felt(page, STOPPED) > known, "the stop is felt")
    page.lift()


def test_nothing_vibrates_before_the_first_touch(bench: PageBench, page: Page) -> None:
    bench.hold(page, "ArrowUp")
    assert page.evaluate("navigator.userActivation.hasBeenActive") or not page.evaluate("felt")
    page.key("ArrowUp", down=False)


def test_full_screen_is_entered_and_left_by_one_button(page: Page) -> None:
    page.click(".gear")
    for words, shown in (("Full screen", "documentElement"), ("Leave full screen", "null")):
        assert page.text(".full") == words
        page.evaluate("document.querySelector('.full').focus()")
        page.type("Enter")
        wanted = "null" if shown == "null" else f"document.{shown}"
        page.until(f"document.fullscreenElement === {wanted}")
        page.until(f"document.querySelector('.full').innerText !== '{words}'")


def test_a_browser_without_full_screen_has_no_button_for_it_but_the_way_to_it(
    bench: PageBench,
) -> None:
    with bench.page("about:blank#") as page:
        page.order(
            "Page.addScriptToEvaluateOnNewDocument",
            source="Object.defineProperty(document, 'fullscreenEnabled', { value: false })",
        )
        page.go(bench.url)
        bench.ready(page)
        page.click(".gear")
        page.says(".settings", "Added to the home screen, it is.")
        assert not page.evaluate("document.querySelector('.full').checkVisibility()")


RELEASED = "locks.map((each) => each.released).join()"


def drive(bench: PageBench, page: Page) -> None:
    """Drive, and let go."""
    bench.press(page)
    page.lift()


def passes(page: Page, seconds: int) -> None:
    """Time passes for the page, faster than on the wall."""

    def over() -> int:
        return sum(
            each["method"] == "Emulation.virtualTimeBudgetExpired"
            and each.get("sessionId") == page.session
            for each in page.browser.events
        )

    known = over()
    page.order("Emulation.setVirtualTimePolicy", policy="advance", budget=1000 * seconds)
    wait_for(lambda: over() > known, "the time has passed")


def test_with_tls_the_screen_stays_on_from_the_drive_on_and_two_minutes_longer(
    make_bench: Callable[..., PageBench], tmp_path: Path
) -> None:
    make_certificate(tmp_path, [HOST])
    files = ("--certificate", str(tmp_path / CERTIFICATE), "--key", str(tmp_path / KEY))
    bench = make_bench(web=(*files, "--host-name", HOST))
    with bench.page("about:blank#") as page:
        page.order("Security.setIgnoreCertificateErrors", ignore=True)
        page.order("Page.addScriptToEvaluateOnNewDocument", source=ASKED)
        page.go(f"https://{HOST}:{bench.network.port}/")
        bench.ready(page)
        page.click(".gear")
        page.says(".settings", "Stays on while you drive, and two minutes longer.")
        assert "TLS" not in page.text(".settings")
        page.click(".gear")
        assert page.evaluate(RELEASED) == ""
        drive(bench, page)
        page.until(f"{RELEASED} === 'false'")
        drive(bench, page)
        assert page.evaluate(RELEASED) == "false"
        # Another tab is in front: the browser takes it back, and the next drive asks again.
        other = page.browser.order("Target.createTarget", url="about:blank")["targetId"]
        page.until(f"document.hidden && {RELEASED} === 'true'")
        page.browser.order("Target.closeTarget", targetId=other)
        page.until("!document.hidden")
        drive(bench, page)
        page.until(f"{RELEASED} === 'true,false'")
        for seconds, released in ((110, "true,false"), (20, "true,true")):
            passes(page, seconds)
            page.until(f"{RELEASED} === '{released}'")


def test_a_system_that_refuses_to_keep_the_screen_on_is_named(bench: PageBench, page: Page) -> None:
    descriptor = {"name": "screen-wake-lock"}
    page.browser.order("Browser.setPermission", permission=descriptor, setting="denied")
    try:
        drive(bench, page)
        page.click(".gear")
        page.says(".settings", "The system refuses to keep it on")
    finally:
        page.browser.order("Browser.resetPermissions")


def test_without_tls_the_screen_may_go_dark_and_the_page_names_the_way_to_tls(
    make_bench: Callable[..., PageBench],
) -> None:
    bench = make_bench(web=("--host-name", HOST))
    with bench.page("about:blank#") as page:
        page.order("Page.addScriptToEvaluateOnNewDocument", source=ASKED)
        page.go(f"http://{HOST}:{bench.network.port}/")
        bench.ready(page)
        assert not page.evaluate("isSecureContext || navigator.wakeLock || navigator.getGamepads")
        drive(bench, page)
        page.click(".gear")
        page.says(".settings", "May go dark: keeping it on needs TLS, see below.")
        page.says(".settings", "the page on phones")
        # What needs no TLS is there.
        assert page.evaluate("document.querySelector('.full').checkVisibility()")
