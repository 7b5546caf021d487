"""The views show the robot, and everybody can read and use them."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from chromium import Page
from page_bench import PageBench
from page_checks import OTHER_STATUS, axe, enlarge, spills, violations
from real_robot import Process, free_endpoint, wait_for

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]

VIEWS = ("drive", "map", "wheels", "health", "calibrate", "record", "boxes", "phones")
PHONE, LAPTOP, DESKTOP = (360, 740), (1366, 768), (1920, 1080)
ON_ITS_SIDE, SMALL_ON_ITS_SIDE = (844, 390), (740, 360)
WITH_PAD = ("map", "wheels", "health")
"""The views that stand beside the joystick on a phone on its side."""

RELEASABLE = "document.querySelector('#release').checkVisibility()"
"""The robot acknowledged the stop, and this page may release it."""


def show(page: Page, view: str) -> None:
    page.evaluate(f"location.hash = '#{view}'")
    page.until(f"document.querySelector('#views [aria-current]').dataset.view === '{view}'")


@pytest.mark.parametrize(
    ("scheme", "size"),
    [
        pytest.param("light", PHONE, id="light-phone"),
        pytest.param("dark", DESKTOP, id="dark-desktop", marks=pytest.mark.nightly),
        pytest.param("dark", PHONE, id="dark-phone", marks=pytest.mark.nightly),
        pytest.param("light", DESKTOP, id="light-desktop", marks=pytest.mark.nightly),
        pytest.param("dark", ON_ITS_SIDE, id="dark-phone-on-its-side", marks=pytest.mark.nightly),
        pytest.param(
            "light",
            SMALL_ON_ITS_SIDE,
            id="light-small-phone-on-its-side",
            marks=pytest.mark.nightly,
        ),
    ],
)
def test_no_view_has_a_barrier_that_axe_finds_and_none_is_wider_than_the_screen(
    bench: PageBench, page: Page, scheme: str, size: tuple[int, int]
) -> None:
    page.evaluate(axe() + "; 0")
    page.prefer(scheme)
    bench.make_events()
    page.resize(*size, phone=size != DESKTOP)
    for view in VIEWS if size == PHONE else VIEWS[1:]:
        show(page, view)
        assert violations(page) == [], view
        assert spills(page) == [], view
    show(page, "map")
    page.click(".tools button[aria-expanded]")
    assert violations(page) == []
    page.click("#estop")
    page.says("#state", "emergency stop")
    assert violations(page) == []


@pytest.mark.nightly
def test_where_less_motion_is_preferred_the_page_moves_nothing_and_says_the_same(
    bench: PageBench, page: Page
) -> None:
    bench.network.held = True
    page.click("#estop")
    page.until("document.getAnimations().length === 1")
    page.prefer("light", reduced_motion=True)
    page.until("document.getAnimations().length === 0")
    assert page.text("#estop") == "Stopping\u2026"
    bench.network.held = False
    page.says("#estop-text", "acknowledged the emergency stop")


def box(page: Page, selector: str) -> list[float]:
    """Left, top, width and height."""
    found: list[float] = page.evaluate(
        f"(() => {{ const b = document.querySelector('{selector}').getBoundingClientRect();"
        " return [b.left, b.top, b.width, b.height]; })()"
    )
    return found


def covered(page: Page, selector: str) -> list[list[float]]:
    """The points of an element, its middle and near its corners, that a finger does not reach."""
    found: list[list[float]] = page.evaluate(
        f"(() => {{ const e = document.querySelector('{selector}');"
        " const b = e.getBoundingClientRect(); const n = e.matches('.pad') ? 0.34 : 0.45;"
        " return [[0, 0], [-n, -n], [n, -n], [-n, n], [n, n]]"
        ".map(([x, y]) => [b.x + (0.5 + x) * b.width, b.y + (0.5 + y) * b.height])"
        ".filter(([x, y]) => !e.contains(document.elementFromPoint(x, y))); })()"
    )
    return found


def cut(page: Page, selector: str) -> bool:
    """Whether an element's contents are larger than it is."""
    found: bool = page.evaluate(
        f"(() => {{ const e = document.querySelector('{selector}');"
        " return e.scrollWidth > e.clientWidth + 1 || e.scrollHeight > e.clientHeight + 1; })()"
    )
    return found


@pytest.mark.parametrize(
    ("size", "percent"),
    [
        pytest.param(SMALL_ON_ITS_SIDE, 200, id="small-200"),
        pytest.param(SMALL_ON_ITS_SIDE, 100, id="small-100", marks=pytest.mark.nightly),
        pytest.param(ON_ITS_SIDE, 200, id="200", marks=pytest.mark.nightly),
        pytest.param(ON_ITS_SIDE, 100, id="100", marks=pytest.mark.nightly),
    ],
)
def test_on_its_side_the_pad_is_whole_and_still_and_the_stop_is_pressed_in_every_view(
    bench: PageBench, page: Page, size: tuple[int, int], percent: int
) -> None:
    page.resize(*size, phone=True)
    enlarge(page, percent)
    page.until("document.querySelector('.pad').clientWidth > 199")
    pad = None
    for engaged in (False, True):
        stop = box(page, "#estop")
        for view in VIEWS[1:]:
            show(page, view)
            page.until(f"document.querySelector('#{view}')?.hidden === false")
            assert covered(page, "#estop") == [], view
            assert not cut(page, "#estop")
            assert box(page, "#estop") == pytest.approx(stop, abs=1.0), view
            if engaged:
                assert covered(page, "#release") == [], view
                assert not cut(page, "#release")
            page.until(
                f"document.querySelector('#drive').hidden === {str(view not in WITH_PAD).lower()}"
            )
            if view in WITH_PAD:
                assert covered(page, ".pad") == [], view
                pad = pad or box(page, ".pad")
                assert box(page, ".pad") == pytest.approx(pad, abs=1.0), view
                assert min(pad[2:]) >= 200
            assert box(page, "#views a[data-view=map]")[3] > 30
        if not engaged:
            page.tap("#estop")
            page.says("#state", "emergency stop")
            page.until(RELEASABLE)
            assert "`" not in page.text("#why")


SIZES = (PHONE, ON_ITS_SIDE, (768, 1024), LAPTOP, DESKTOP)
OUTSIDE = """['#estop', '#release'].filter((each) => {
    const { left, top, right, bottom } = document.querySelector(each).getBoundingClientRect();
    const isWhole = left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight;
    return !isWhole || right - left < 44 || bottom - top < 40;
})"""
SIDEWAYS = """[...document.querySelectorAll('html, header, nav, nav a, main, main > section')]
    .filter((each) => each.checkVisibility() && each.scrollWidth > each.clientWidth + 1)
    .map((each) => `${each.tagName} ${each.id || each.innerText}`)"""


@pytest.mark.parametrize(
    ("size", "percent"),
    [
        pytest.param(
            size,
            percent,
            id=f"{size[0]}-{percent}",
            marks=() if (size, percent) in {(PHONE, 100), (LAPTOP, 200)} else pytest.mark.nightly,
        )
        for size in SIZES
        for percent in (100, 200)
    ],
)
def test_stop_and_release_stay_in_the_window_and_no_view_scrolls_sideways(
    bench: PageBench, page: Page, size: tuple[int, int], percent: int
) -> None:
    page.resize(*size, phone=size not in {LAPTOP, DESKTOP})
    enlarge(page, percent)
    page.click("#estop")
    page.until(RELEASABLE)
    for view in VIEWS:
        page.evaluate(f"location.hash = '#{view}'")
        page.until(f"document.querySelector('#{view}')?.hidden === false")
        assert page.evaluate(OUTSIDE) == [], view
        assert page.evaluate(SIDEWAYS) == [], view


@pytest.mark.parametrize("size", [PHONE, (768, 1024)])
def test_five_links_stand_at_the_bottom_and_more_has_the_rest(
    page: Page, size: tuple[int, int]
) -> None:
    page.resize(*size, phone=True)
    words = """[...document.querySelectorAll('%s')].filter((each) => each.checkVisibility())
        .map((each) => each.innerText)"""
    assert page.evaluate(words % "nav a") == ["Drive", "Map", "Wheels", "Health", "More"]
    sizes = (
        "[...document.querySelectorAll('nav a:not(.rest)')].map((e) => e.getBoundingClientRect())"
    )
    assert page.evaluate(
        f"{sizes}.every((e) => e.width * e.height === 0 || (e.width >= 44 && e.height >= 44))"
    )
    show(page, "menu")
    rest = ["Calibrate", "Record", "Black boxes", "Phones"]
    assert page.evaluate(words % ".menu a") == rest
    page.click(".menu a")
    page.says("#calibrate", "calibration")
    both = "[...document.querySelectorAll('nav [aria-current]')].map((e) => e.dataset.view)"
    assert page.evaluate(both) == ["calibrate", "menu"]


@pytest.mark.nightly
@pytest.mark.parametrize("size", [ON_ITS_SIDE, SMALL_ON_ITS_SIDE])
@pytest.mark.parametrize("percent", [100, 200])
def test_on_its_side_axe_finds_nothing_at_either_size_of_text_while_it_is_stopped(
    bench: PageBench, page: Page, size: tuple[int, int], percent: int
) -> None:
    page.evaluate(axe() + "; 0")
    page.resize(*size, phone=True)
    enlarge(page, percent)
    page.click("#estop")
    page.says("#state", "emergency stop")
    for view in VIEWS[1:]:
        show(page, view)
        assert violations(page) == [], view
        assert spills(page) == [], view


@pytest.mark.nightly
def test_pad_and_stop_change_sides_by_a_button_and_keep_them(bench: PageBench, page: Page) -> None:
    page.resize(*SMALL_ON_ITS_SIDE, phone=True)
    page.until("document.querySelector('.pad').clientWidth > 199")
    assert page.middle(".pad")[0] > page.middle("#estop")[0]
    for _ in range(2):
        page.click(".gear")
        page.click(".swap")
        left = page.evaluate("document.body.dataset.pad") == "left"
        page.go(bench.url)
        bench.ready(page)
        assert (page.middle(".pad")[0] < page.middle("#estop")[0]) == left
        assert covered(page, ".pad") == covered(page, "#estop") == []
        assert min(box(page, ".pad")[2:]) >= 200
        show(page, "record")
        page.until("document.querySelector('#record')?.hidden === false")
        assert covered(page, "#record") == covered(page, "#estop") == []
        show(page, "map")
    bench.press(page)
    bench.stops_after(page.lift)


def sizes_of_text(page: Page) -> list[float]:
    """Of the words, the release and the stop below every view, in pixels."""
    found: list[float] = page.evaluate(
        "['#estop-text', '#release', '#estop'].map((each) =>"
        " parseFloat(getComputedStyle(document.querySelector(each)).fontSize))"
    )
    return found


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("size", "percent"),
    [
        pytest.param(size, percent, id=f"{size[0]}-{percent}")
        for size in (PHONE, (768, 1024), DESKTOP)
        for percent in (100, 200)
    ],
)
def test_neither_a_stop_nor_its_words_move_or_cover_the_pad_and_they_grow_with_the_text(
    bench: PageBench, page: Page, size: tuple[int, int], percent: int
) -> None:
    page.resize(*size, phone=size != DESKTOP)
    usual = sizes_of_text(page)
    enlarge(page, percent)
    page.until("document.querySelector('.pad').clientWidth > 190")
    before = box(page, ".pad")
    assert covered(page, ".pad") == spills(page) == []
    assert not cut(page, "header")
    assert sizes_of_text(page) == pytest.approx([each * percent / 100 for each in usual])
    page.click("#estop")
    page.until(RELEASABLE)
    assert covered(page, ".pad") == covered(page, "#estop") == covered(page, "#release") == []
    assert not cut(page, "#estop")
    assert not cut(page, "#release")
    assert spills(page) == []
    assert box(page, ".pad") == pytest.approx(before, abs=1.0)


@pytest.mark.nightly
@pytest.mark.parametrize("size", [(1280, 800), DESKTOP])
def test_map_and_joystick_are_used_together_on_a_wide_screen(
    bench: PageBench, page: Page, size: tuple[int, int]
) -> None:
    page.resize(*size, phone=False)
    show(page, "map")
    page.says(".where", "heading")
    page.until("document.querySelector('.pad').clientWidth > 199")
    assert covered(page, ".pad") == covered(page, ".place") == covered(page, "#estop") == []
    before = page.text(".where")
    bench.press(page)
    page.until(f"document.querySelector('.where').innerText !== {json.dumps(before)}")
    wait_for(lambda: page.evaluate(INK), "the path is drawn")
    bench.stops_after(page.lift)
    # A finger on the map moves the map alone.
    x, y = page.middle("canvas.map")
    page.touch((x, y))
    page.touch((x - 80, y + 60), kind="touchMove")
    bench.stays()
    page.lift()
    page.until("document.querySelector('.tools [aria-pressed]').ariaPressed === 'false'")


@pytest.mark.nightly
@pytest.mark.parametrize("size", [PHONE, ON_ITS_SIDE])
def test_a_long_reason_is_read_whole_and_moves_nothing_and_a_touch_of_it_opens_health(
    bench: PageBench, page: Page, size: tuple[int, int]
) -> None:
    page.resize(*size, phone=True)
    page.until("document.querySelector('.pad').clientWidth > 199")
    pad, stop = box(page, ".pad"), box(page, "#estop")
    try:
        bench.press(page)
        bench.robot.do("unplug 600")
        page.says("#state", "may turn")
        page.lift()
        page.says("#why", BOARD)
        assert not cut(page, "#why"), page.text("#why")
        assert not cut(page, "header")
        assert box(page, ".pad") == pytest.approx(pad, abs=1.0)
        assert box(page, "#estop") == pytest.approx(stop, abs=1.0)
        page.tap("#why")
        page.says("#health", "there is no such port")
    finally:
        bench.robot.do("replug")
    page.says("#state", "standing")


@pytest.mark.parametrize("size", [PHONE, ON_ITS_SIDE, (768, 1024), LAPTOP])
def test_a_fault_is_read_whole_with_what_to_check(page: Page, size: tuple[int, int]) -> None:
    page.resize(*size, phone=size != LAPTOP)
    reasons = [{"kind": "fault", "text": FAULT}]
    page.evaluate(f"window.moment = {{ state: 'fault', reasons: {json.dumps(reasons)} }}; 0")
    page.evaluate(OTHER_STATUS)
    page.says("#why", FAULT)
    assert not cut(page, "#why")
    assert not cut(page, "header")
    assert covered(page, "#estop") == covered(page, "#release") == []


@pytest.mark.nightly
def test_without_a_daemon_the_page_says_so_in_a_sentence_and_shows_no_old_figures(
    make_bench: Callable[..., PageBench],
) -> None:
    bench = make_bench()
    with bench.page() as page:
        bench.ready(page)
        page.says("#battery", "V")
        bench.robot.daemon.end()
        page.says("#state", "no daemon")
        page.says("#why", "Is yahboomd running on the robot? Details are in Health.")
        assert page.text("#battery") == "\u2013"
        show(page, "health")
        page.says("#health", "yahboomd")
        page.until(
            "/no yahboomd is there|No yahboomd answers|lost/.test("
            "document.querySelector('#health').innerText)"
        )
        bench.robot.start_daemon()
        page.says("#state", "standing")


FAULT = (
    "front right turned, is commanded -0.40 m/s, and its encoder shows no motion any more: check "
    "whether the wheel is blocked, then the plug of motor and encoder, and the motor supply. "
    "(since 12.3 s)"
)
LATELY = "Commands refused lately: 3 no_velocity."
STOP = "Emergency stop, engaged by x: y."
BOARD = "The motor board is not connected. Details are in Health."


def test_the_daemons_reasons_stay_exact_but_for_what_no_phone_needs(page: Page) -> None:
    lost = "cmd_vel drove and was lost 3.0 s ago: its client left the bus."
    for driver, reasons, shown in (
        (None, [("ended", "The page ended with a zero command 72.9 s ago.")], "Ready."),
        (None, [("ended", "cmd_vel ended with a zero command 1.5 kg ago.")], "Ready."),
        (None, [("no_command", "No source commands motion.")], "Ready."),
        (None, [("estop", STOP), ("release", "To drive again: `yahboomd stop`.")], STOP),
        (None, [("lost", lost)], lost),
        (None, [("estop", STOP), ("lost", lost), ("refused", LATELY)], STOP),
        (None, [("fault", "Try `yahboomd tune`.")], "Try \u201cyahboomd tune\u201d."),
        ("cmd_vel/web", [("zero_command", "The page commands zero.")], "Ready."),
        ("cmd_vel", [("zero_command", "cmd_vel commands zero.")], "cmd_vel commands zero."),
        (None, [("no_command", "No source."), ("refused", LATELY)], LATELY),
        (None, [("waiting_for_board", "/dev/ttyUSB0: no such port.")], BOARD),
    ):
        status = {
            "reasons": [{"kind": kind, "text": text} for kind, text in reasons],
            "driver": driver,
            "state": "standing",
        }
        hello = "{ newest: () => ({ source: 'cmd_vel/web' }) }"
        asked = f"import('/page/header.js').then((m) => m.plain({json.dumps(status)}, {hello}))"
        assert page.evaluate(asked) == shown


@pytest.mark.nightly
def test_the_battery_is_shown_in_percent_by_its_curve_and_low_in_colour_and_words(
    make_bench: Callable[..., PageBench],
) -> None:
    curve = "board.battery_curve=[[6.0, 0.0], [8.0, 1.0]]"
    limits = ("--set", "board.battery_low_v=7.6", "--set", "board.battery_period_s=1")
    bench = make_bench(run=("--set", curve, *limits), simulate=("--battery", "7.4"))
    with bench.page() as page:
        bench.ready(page)
        page.says("#battery", "70 % low")
        assert page.evaluate("document.querySelector('#battery').matches('.low')")
        show(page, "health")
        page.says("#health", "70 %, 7.40 V, low: 7.4 V at rest")


@pytest.mark.nightly
@pytest.mark.parametrize("size", [PHONE, SMALL_ON_ITS_SIDE, DESKTOP])
def test_a_page_without_a_session_shows_how_to_get_in_and_no_dead_controls(
    make_bench: Callable[..., PageBench], size: tuple[int, int]
) -> None:
    bench = make_bench(listen="0.0.0.0")
    with bench.page() as page:
        page.resize(*size, phone=size != DESKTOP)
        page.says("#main", "yahboomd web --show-link")
        page.says("#state", "no access")
        page.says("#why", "This phone has no session")
        seen = "[...document.querySelectorAll('button, input, nav a, .pad')]"
        assert page.evaluate(f"{seen}.filter((e) => e.checkVisibility()).length") == 0
        assert spills(page) == []


@pytest.mark.nightly
def test_the_keyboard_alone_reaches_and_reads_everything(bench: PageBench, page: Page) -> None:
    page.resize(*DESKTOP, phone=False)
    page.evaluate("document.activeElement.blur()")
    reached = set[str]()
    for _ in range(60):
        page.type("Tab")
        focus = page.evaluate(
            "(() => { const e = document.activeElement; const b = e.getBoundingClientRect();"
            " return [e.id || e.classList[0] || e.dataset.view || e.textContent,"
            " getComputedStyle(e).outlineStyle, b.width * b.height]; })()"
        )
        if page.evaluate("document.activeElement !== document.body"):
            reached.add(focus[0])
            assert focus[1] != "none", f"{focus[0]} has the focus, and one does not see it"
    everything = {"skip", "pad", "limit", "estop", "map", "wheels", "health"}
    assert everything <= reached, reached
    page.evaluate("document.querySelector('#views a[data-view=health]').focus()")
    page.type("Enter")
    page.says("#health", "Battery")


@pytest.mark.nightly
def test_the_map_draws_the_path_that_was_driven_and_follows_the_robot(
    bench: PageBench, page: Page
) -> None:
    show(page, "map")
    page.says(".where", "heading")
    before = page.text(".where")
    show(page, "drive")
    bench.press(page)
    enough_m = bench.robot.travelled_m() + 1.0

    def driven() -> bool:
        # A machine that is too busy ends the drive; then press again.
        if not page.says_driving():
            page.lift()
            bench.press(page)
        return bench.robot.travelled_m() > enough_m

    wait_for(driven, "a metre is driven")
    page.lift()
    bench.robot.settled_truth()
    show(page, "map")
    wait_for(lambda: page.text(".where") != before, "the pose on the map changes")
    truth = bench.application.latest("pose")
    shown = page.text(".where").replace("\u2212", "-").split()
    assert float(shown[1]) == pytest.approx(truth["x"], abs=0.02)
    assert float(shown[5]) == pytest.approx(truth["y"], abs=0.02)
    page.evaluate("window.isBefore = true")
    page.order("Page.reload")
    page.until("!window.isBefore && document.readyState === 'complete'")
    page.says(".where", "heading")
    # It is there again, and a robot that stands adds nothing.
    inked = wait_for(lambda: page.evaluate(INK), "the path is drawn")
    page.click(".tools button[title^=Forget]")
    wait_for(lambda: page.evaluate(INK) < inked, "the path is gone")


def test_a_path_that_was_written_is_read_again_and_no_other_text_is(page: Page) -> None:
    kept = """import('/page/path.js').then(({ Path }) => {
      const path = new Path(), again = new Path();
      for (let n = 0; n < 30_000; n += 1) path.add(Math.sin(n / 900), n / 1e4);
      again.read(path.write());
      const same = again.write() === path.write();
      for (const text of ["", "null", "{}", '{"spacing":1,"x":[1],"y":[null],"starts":[1]}',
        '{"spacing":1,"x":[1],"y":[1,2],"starts":[1]}']) again.read(text);
      return [same, again.length === path.length, path.length > 1000, path.write().length];
    })"""
    *true, size = page.evaluate(kept)
    assert all(true)
    assert size < 200_000


INK = """(() => {
  const canvas = document.querySelector('canvas.map');
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let blue = 0;
  for (let at = 0; at < data.length; at += 4)
    if (data[at + 3] > 200 && data[at] < 60 && data[at + 2] > 140) blue += 1;
  return blue;
})()"""
"""How many points of the map have the colour of the path."""


def test_a_pose_is_set_by_a_touch_on_the_map_and_a_drag_along_the_heading(
    bench: PageBench, page: Page
) -> None:
    show(page, "map")
    page.says(".where", "heading")
    page.click(".tools button[aria-expanded]")
    x, y = page.middle("canvas.map")
    page.touch((x + 60, y))
    page.touch((x + 60, y - 50), kind="touchMove")
    page.lift()
    page.click(".setpose button[type=submit]")
    page.until("document.querySelector('.setpose [role=status]').innerText.length > 3")
    wanted = page.evaluate(
        "[...document.querySelectorAll('.setpose input')].map((i) => i.valueAsNumber)"
    )
    assert wanted[2] == 90
    wait_for(
        lambda: bench.application.latest("pose")["x"] == pytest.approx(wanted[0], abs=0.02),
        "the pose is set",
    )
    assert bench.application.latest("pose")["theta"] == pytest.approx(1.571, abs=0.02)


@pytest.mark.nightly
def test_two_fingers_zoom_the_map_and_one_moves_it(bench: PageBench, page: Page) -> None:
    show(page, "map")
    page.says(".where", "heading")
    x, y = page.middle("canvas.map")
    page.touch((x - 30, y), (x + 30, y))
    for spread in (40, 60, 80, 120):
        page.touch((x - spread, y), (x + spread, y), kind="touchMove")
    page.lift()
    assert page.evaluate("document.querySelector('.tools [aria-pressed]').ariaPressed") == "true"
    page.touch((x, y))
    page.touch((x + 30, y + 30), kind="touchMove")
    page.lift()
    page.until("document.querySelector('.tools [aria-pressed]').ariaPressed === 'false'")


def test_wheels_and_health_show_what_the_bus_says(bench: PageBench, page: Page) -> None:
    show(page, "wheels")
    page.says(".charts", "left")
    show(page, "health")
    volts = bench.application.latest("battery")["volts"]
    page.says(".facts", f"{volts:.1f}")
    bench.make_events()
    for event in bench.application.samples["events"][-2:]:
        page.says(".events", event["message"])
    # A later page knows the earlier events, and the meaning of the counters.
    with bench.page() as other:
        show(other, "health")
        other.says(".events", bench.application.samples["events"][-1]["message"])
        other.says("#health", "connections with a recognised board")


@pytest.mark.nightly
def test_a_source_that_the_daemon_does_not_have_is_named_before_a_touch(bench: PageBench) -> None:
    port = free_endpoint().rsplit(":", 1)[1]
    address, connect = f"127.0.0.1:{port}", bench.robot.endpoint
    server = Process("web", "--listen", address, "--connect", connect, "--source", "cmd_vel/phone")
    try:
        server.says("answers")
        with bench.page(f"http://{address}/") as page:
            page.says(".words", "its configuration has no source cmd_vel/phone.")
            assert page.evaluate("document.querySelector('.pad.barred') !== null")
    finally:
        server.end()
