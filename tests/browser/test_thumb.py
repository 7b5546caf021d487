"""Every way of losing the thumb: zero on the wire, and nothing moves the robot then."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from chromium import Page
from page_bench import PageBench
from real_robot import wait_for

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]


def lift(page: Page) -> None:
    page.lift()


def cancel(page: Page) -> None:
    page.order("Input.dispatchTouchEvent", type="touchCancel", touchPoints=[])


def hide(page: Page) -> None:
    """Another tab comes to the front."""
    other = page.browser.order("Target.createTarget", url="about:blank")["targetId"]
    page.until("document.hidden")
    page.browser.order("Target.closeTarget", targetId=other)


def freeze(page: Page) -> None:
    """The screen is locked: a phone hides the page, and then freezes it."""
    page.order("Page.setWebLifecycleState", state="frozen")


def lose_focus(page: Page) -> None:
    """Another window, or the address bar."""
    page.evaluate("window.dispatchEvent(new Event('blur'))")


def leave(page: Page) -> None:
    page.order("Page.navigate", url="about:blank")


def reload(page: Page) -> None:
    page.order("Page.reload")


def crash(page: Page) -> None:
    page.begin("Page.crash")  # It is never answered.


def another_view(page: Page) -> None:
    page.evaluate("location.hash = '#wheels'")


LOSSES: dict[str, Callable[[Page], None]] = {
    "released": lift,
    "interrupted by the system": cancel,
    "tab hidden": hide,
    "screen locked": freeze,
    "focus lost": lose_focus,
    "page left": leave,
    "page reloaded": reload,
    "page crashed": crash,
    "another view": another_view,
}


IN_SHORT = {"screen locked"}


def screen(page: Page, width: int, height: int, angle: int = 0) -> None:
    """Change the screen's size under fingers that stay in their places."""
    kind = "landscapePrimary" if angle else "portraitPrimary"
    page.order(
        "Emulation.setDeviceMetricsOverride",
        width=width, height=height, deviceScaleFactor=2, mobile=True,
        screenOrientation={"type": kind, "angle": angle},
    )  # fmt: skip


def turn_over(page: Page) -> None:
    """The sizes stay: a phone is turned by half a turn, or a square screen by a quarter."""
    screen(page, 360, 740, 180)


def magnify(page: Page) -> None:
    """By the system: two fingers on the page would end it anyway."""
    page.order("Emulation.setPageScaleFactor", pageScaleFactor=1.5)


def scroll(page: Page) -> None:
    """Another program, such as a screen reader, scrolls the page under the finger."""
    page.evaluate("document.getElementById('main').scrollTop = 9")


CHANGES: dict[str, Callable[[Page], None]] = {
    "phone turned": lambda page: screen(page, 740, 360, 90),
    "phone turned over": turn_over,
    "split screen": lambda page: screen(page, 360, 420),
    "a bar of the browser": lambda page: screen(page, 360, 700),
    "magnified": magnify,
    "scrolled": scroll,
}


@pytest.mark.parametrize(
    "loss",
    [
        pytest.param(loss, id=name, marks=() if name in IN_SHORT else pytest.mark.nightly)
        for name, loss in LOSSES.items()
    ],
)
def test_a_thumb_that_is_lost_ends_in_zero(bench: PageBench, loss: Callable[[Page], None]) -> None:
    with bench.page() as page:
        bench.press(page)
        bench.stops_after(lambda: loss(page))


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(change, id=name, marks=() if name == "phone turned" else pytest.mark.nightly)
        for name, change in CHANGES.items()
    ],
)
def test_another_screen_under_the_thumb_stops_and_no_pixel_of_it_steers(
    bench: PageBench, page: Page, change: Callable[[Page], None]
) -> None:
    if change is scroll:
        longer = "'display: block; flex: none; height: 40rem'"
        page.evaluate(f"document.querySelector('.keys').style.cssText = {longer}")
    thumb = bench.press(page)
    bench.stops_after(lambda: change(page))
    # It is still down, and moves.
    page.touch((thumb[0] + 1, thumb[1]), kind="touchMove")
    page.touch((thumb[0] + 40, thumb[1] + 20), kind="touchMove")
    bench.stays()
    page.says(".words", "Lift your thumb and touch again")
    page.lift()
    # The next press measures the pad again: up drives straight ahead. The wheels themselves differ
    # by a count while they start.
    pressed_ns = time.monotonic_ns()
    bench.press(page)
    commanded = bench.motions(pressed_ns)
    assert commanded
    assert all(left == right for left, _, right, _ in commanded.values()), commanded


def test_a_second_finger_anywhere_stops_and_the_first_drives_again_only_when_lifted(
    bench: PageBench, page: Page
) -> None:
    first = bench.press(page)
    second = (30.0, 20.0)
    bench.stops_after(lambda: page.touch(first, second))
    # The first thumb is still down, and moves.
    page.touch((first[0] + 20, first[1]), second, kind="touchMove")
    page.touch((first[0] + 20, first[1]), kind="touchEnd")
    page.touch((first[0] - 20, first[1]), kind="touchMove")
    bench.stays()
    page.lift()
    bench.press(page)
    bench.stops_after(page.lift)


SIZES = [
    pytest.param((360, 740), id="upright"),
    pytest.param((844, 390), id="on its side"),
    pytest.param((740, 360), id="small, on its side"),
]


@pytest.mark.nightly
@pytest.mark.parametrize("size", SIZES)
def test_texts_that_grow_while_the_thumb_is_down_neither_move_the_pad_nor_end_the_drive(
    bench: PageBench, page: Page, size: tuple[int, int]
) -> None:
    page.resize(*size, phone=True)
    before = page.middle(".pad")
    bench.press(page)
    for place in ("header", "footer", ".drive .line"):
        grows = "const p = document.createElement('p'); p.style.height = '9rem'"
        page.evaluate(f"{{ {grows}; document.querySelector('{place}').append(p); }}")
    assert page.middle(".pad") == pytest.approx(before, abs=1.0)
    moves = len(bench.motions())
    wait_for(lambda: len(bench.motions()) > moves + 5, "it drives on")
    assert page.says_driving()
    bench.stops_after(page.lift)


@pytest.mark.nightly
@pytest.mark.parametrize("size", SIZES)
def test_the_pad_does_not_move_under_the_thumb_whatever_the_page_says(
    bench: PageBench, page: Page, size: tuple[int, int]
) -> None:
    page.resize(*size, phone=True)
    before = page.middle(".pad")
    bench.press(page)
    places = [page.middle(".pad")]
    page.touch(bench.place(page, 0, 0.8), (30.0, 20.0))
    page.says(".words", "second finger")
    places.append(page.middle(".pad"))
    page.lift()
    bench.robot.settled_truth()
    bench.network.held = True
    page.until("/Nothing came|No connection/.test(document.querySelector('.words').innerText)")
    places.append(page.middle(".pad"))
    assert all(place == pytest.approx(before, abs=1.0) for place in places)


@pytest.mark.nightly
def test_two_thumbs_at_once_drive_nothing_but_what_the_first_one_did_alone(
    bench: PageBench, page: Page
) -> None:
    x, y = page.middle(".pad")
    # One of them comes first, if only by a moment.
    bench.stops_after(lambda: page.touch((x - 40, y), (x + 40, y)))
    page.touch((x - 40, y - 50), (x + 40, y - 50), kind="touchMove")
    bench.stays()
    page.lift()


def test_the_page_sends_zeros_for_a_second_and_then_nothing(bench: PageBench, page: Page) -> None:
    bench.press(page)
    page.order("Network.enable")
    page.lift()
    bench.robot.settled_truth()
    bench.stays()
    sent = bench.sent_by(page)
    last_motion = max(at for at, frame in sent if frame["type"] == "drive" and frame["vx"])
    zeros = [at for at, frame in sent if frame["type"] == "drive" and at > last_motion]
    # Twenty a second; a busy machine leaves some out.
    assert 5 <= len(zeros) <= 25
    assert 0.5 < zeros[-1] - zeros[0] < 1.3


@pytest.mark.nightly
def test_keys_drive_while_they_are_held(bench: PageBench, page: Page) -> None:
    bench.hold(page, "ArrowUp")
    bench.stops_after(lambda: page.key("ArrowUp", down=False))


@pytest.mark.nightly
def test_a_key_whose_release_is_never_reported_stops_with_the_focus(
    bench: PageBench, page: Page
) -> None:
    bench.hold(page, "KeyW")
    bench.stops_after(lambda: lose_focus(page))
    page.key("KeyW", down=False)


@pytest.mark.nightly
def test_another_speed_limit_in_mid_drive_stops_the_robot(bench: PageBench, page: Page) -> None:
    """Or it would go on as fast as before, until the key is let go."""
    change = "limit.value = 20; limit.dispatchEvent(new Event('input'))"
    bench.hold(page, "KeyW")
    bench.stops_after(
        lambda: page.evaluate(f"{{ const limit = document.getElementById('limit'); {change} }}")
    )
    page.key("KeyW", down=False)


@pytest.mark.nightly
def test_a_menu_that_takes_the_keys_away_stops_the_robot(bench: PageBench, page: Page) -> None:
    """The window keeps the focus, and the key's release goes to the menu."""
    x, y = page.middle("h1")
    bench.hold(page, "KeyW")
    bench.stops_after(
        lambda: page.order(
            "Input.dispatchMouseEvent",
            type="mousePressed", button="right", buttons=2, clickCount=1, x=x, y=y,
        )
    )  # fmt: skip
    page.key("KeyW", down=False)


@pytest.mark.nightly
def test_a_velocity_out_of_all_proportion_is_refused_with_the_reason_and_nothing_is_sent(
    make_bench: Callable[..., PageBench],
) -> None:
    fast = ("limits.angular.velocity=9000",)
    bench = make_bench(run=tuple(word for each in fast for word in ("--set", each)))
    with bench.page() as page:
        bench.ready(page)
        bench.put_down(page, bench.place(page, 0.99, 0.0))
        page.says(".words", "rad/s, more than any robot drives")
        bench.stays()
        assert not any(frame.get("wz") for _, frame in bench.sent_by(page))
        page.lift()
