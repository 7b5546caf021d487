"""The joystick in the hand: where it begins, how it answers, and a gamepad in its place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from chromium import Page
from page_bench import PageBench
from real_robot import wait_for

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]


def velocities(bench: PageBench, page: Page) -> list[dict[str, Any]]:
    """The commands that a page has sent."""
    return [frame for _, frame in bench.sent_by(page) if frame["type"] == "drive"]


def drag(bench: PageBench, page: Page) -> dict[float, dict[str, Any]]:
    """Land beside the pad's middle and move up by shares of its travel; what was sent for each.

    Empty if this machine was too busy to drive meanwhile.
    """
    page.lift()
    bench.ready(page)
    radius: float = page.evaluate("document.querySelector('.pad').offsetWidth / 2")
    x, y = bench.place(page, 0.3, -0.6)
    found = {}
    page.touch((x, y))
    for share in (0.0, 0.05, 0.5, 1.05):
        if share:
            page.touch((x, y - share * 0.69 * radius), kind="touchMove")
        known = len(velocities(bench, page))
        wait_for(
            lambda known=known: len(velocities(bench, page)) > known + 1 or not page.says_driving(),
            "the page sends",
        )
        if not page.says_driving():
            return {}
        found[share] = velocities(bench, page)[-1]
    assert page.middle(".pad") == pytest.approx((x, y), abs=1.0) or not page.says_driving()
    return found if page.says_driving() else {}


def test_a_thumb_moves_nothing_as_it_lands_and_steers_from_there_finer_near_its_middle(
    bench: PageBench, page: Page
) -> None:
    found = wait_for(lambda: drag(bench, page), "it drives")
    assert found[0.0]["vx"] == found[0.05]["vx"] == 0
    assert all(each["wz"] == 0 for each in found.values())
    assert 0.2 < found[0.5]["vx"] / found[1.05]["vx"] < 0.35
    # At its end, all of the preset's speed.
    assert page.text(".presets [aria-pressed=true]") == "Normal"
    assert page.text(".limit output").startswith(f"{found[1.05]['vx']:.2f} m/s")
    bench.stops_after(page.lift)


PAD = """
window.pad = window.other = { index: 0, mapping: "standard", connected: true,
  id: "Test pad (STANDARD GAMEPAD)", axes: [0, 0, 0, 0],
  buttons: Array.from({ length: 17 }, () => ({ pressed: false })) };
navigator.getGamepads = () => [window.pad];
dispatchEvent(new Event("gamepadconnected"));
"""
"""A gamepad in the browser's own format."""

HELD = "window.pad.buttons[4].pressed"


def unplug(page: Page) -> None:
    page.evaluate("window.pad = null; dispatchEvent(new Event('gamepaddisconnected'))")


LOSSES: dict[str, tuple[Callable[[Page], Any], str]] = {
    "let go": (lambda page: page.evaluate(f"{HELD} = false"), "Ready"),
    "unplugged": (unplug, "The gamepad is gone"),
    "unplugged unnoticed": (lambda page: page.evaluate("window.pad = null"), "gamepad is gone"),
    "focus lost": (
        lambda page: page.evaluate("dispatchEvent(new Event('blur'))"),
        "Release the gamepad's button and press it again",
    ),
}


@pytest.mark.parametrize(
    ("loss", "words"),
    [
        pytest.param(*loss, id=name, marks=() if name == "unplugged" else pytest.mark.nightly)
        for name, loss in LOSSES.items()
    ],
)
def test_a_gamepad_drives_while_its_button_is_held_and_each_loss_of_it_stops_the_wheels(
    bench: PageBench, page: Page, loss: Callable[[Page], Any], words: str
) -> None:
    # A button that is down when the pad comes counts for nothing, whatever the stick does.
    page.evaluate(PAD.replace("pressed: false", "pressed: true") + "window.pad.axes[1] = -0.8")
    bench.stays()
    page.evaluate(f"{HELD} = false")

    def press() -> None:
        # Long enough to be seen, each.
        for down in ("false", "true"):
            page.evaluate(f"new Promise((on) => {{ {HELD} = {down}; setTimeout(on, 150); }})")

    def lost() -> bool:
        """Drive, and lose the pad; a machine that is too busy loses it first."""
        page.evaluate("window.pad ??= window.other; 0")
        bench.drives(page, press, lambda: page.evaluate(f"{HELD} = false"))
        bench.stops_after(lambda: loss(page))
        return words in page.text(".words")

    wait_for(lost, f"it is {words}")
    # Its button is down all the time: it has to be pressed again.
    page.evaluate("window.pad ??= window.other; 0")
    bench.stays()


@pytest.mark.nightly
def test_b_of_a_gamepad_is_the_emergency_stop_and_start_releases_it(
    bench: PageBench, page: Page
) -> None:
    bench.ready(page)
    page.evaluate(PAD + "; 0")
    tap = "new Promise((t) => setTimeout(t, 100)).then(() => { pad.buttons[%d].pressed = %s; })"
    for button, state in ((1, "emergency stop"), (9, "standing")):
        page.evaluate(tap % (button, "true"))
        page.says("#state", state)
        if button == 1:
            page.until("document.querySelector('#release').checkVisibility()")
        page.evaluate(tap % (button, "false"))
        page.evaluate(tap % (button, "false"))


@pytest.mark.nightly
def test_without_tls_the_settings_name_what_the_browser_withholds_and_how_to_get_it(
    make_bench: Callable[..., PageBench],
) -> None:
    bench = make_bench(listen="0.0.0.0")
    driver, _ = bench.links()
    # Chromium calls this machine's own addresses secure, whatever they are served with.
    with bench.page("about:blank#") as page:
        page.order(
            "Page.addScriptToEvaluateOnNewDocument",
            source="Object.defineProperty(window, 'isSecureContext', { value: false });"
            " Object.defineProperty(navigator, 'wakeLock', { value: undefined });"
            " Object.defineProperty(navigator, 'getGamepads', { value: undefined });",
        )
        page.go(driver)
        bench.ready(page)
        page.click(".gear")
        page.says(".settings", "the page on phones")
        page.says(".settings", "Needs TLS")
        # The panel covers the joystick.
        page.touch(page.middle(".settings"))
        bench.stays()
        page.lift()
    with bench.page(bench.url) as page:
        bench.ready(page)
        page.click(".gear")
        page.says(".settings", "None yet. Press a button of it.")
        assert "TLS" not in page.text(".settings")
