"""A real ustreamer on the page: its picture is live in every layout, else it is marked."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from chromium import Chromium, Page
from page_bench import PageBench
from page_checks import axe, enlarge, spills, violations
from real_robot import wait_for
from ustreamer_camera import UStreamer

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]

LIVE = "document.querySelector('.camera')?.dataset.live === 'true'"
MARKED = (
    "document.querySelector('.camera')?.dataset.live === 'false'"
    " && getComputedStyle(document.querySelector('.veil')).opacity === '1'"
)
BOXES = """(() => {
  const box = (selector) => {
    const { left, top, right, bottom } = document.querySelector(selector).getBoundingClientRect();
    return { left, top, right, bottom };
  };
  return { picture: box(".camera"), pad: box(".pad"), stop: box("#estop") };
})()"""
PICTURE = """(() => {
  const context = document.querySelector(".camera canvas").getContext("2d");
  return context.getImageData(0, 0, 64, 8).data.join();
})()"""


@pytest.fixture(scope="module")
def camera(tmp_path_factory: pytest.TempPathFactory) -> Iterator[UStreamer]:
    camera = UStreamer(tmp_path_factory.mktemp("camera"))
    yield camera
    camera.close()


@pytest.fixture(scope="module")
def robot(
    tmp_path_factory: pytest.TempPathFactory, browser: Chromium, camera: UStreamer
) -> Iterator[PageBench]:
    """A robot with that camera."""
    web = ("--set", f"web.camera={camera.address}")
    bench = PageBench(tmp_path_factory.mktemp("robot"), browser, web=web)
    yield bench
    bench.close()


@pytest.fixture
def looking(robot: PageBench, camera: UStreamer) -> Iterator[Page]:
    """A phone that sees the picture."""
    robot.recover()
    with robot.page() as page:
        robot.ready(page)
        page.until(LIVE)
        yield page
    camera.thaw()
    robot.recover()


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("size", "phone"),
    [((844, 390), True), ((360, 740), True), ((768, 1024), True), ((1920, 1080), False)],
)
def test_the_picture_is_live_in_every_layout_and_covers_no_control(
    robot: PageBench, size: tuple[int, int], phone: bool
) -> None:
    with robot.page(width=size[0], height=size[1], phone=phone) as page:
        robot.ready(page)
        page.until(LIVE)
        before = page.evaluate(PICTURE)
        page.until(f"({PICTURE}) !== '{before}'")
        boxes = page.evaluate(BOXES)
        picture, pad = boxes["picture"], boxes["pad"]
        assert 0 <= picture["left"] < picture["right"] <= size[0]
        assert 0 <= picture["top"] < picture["bottom"] <= size[1]
        if size[0] < size[1]:
            # Behind the joystick.
            assert picture["left"] <= pad["left"] < pad["right"] <= picture["right"]
            assert picture["bottom"] <= boxes["stop"]["top"]
        elif phone:
            # Between the emergency stop and the joystick.
            assert boxes["stop"]["right"] <= picture["left"] < picture["right"] <= pad["left"]
        else:
            assert pad["right"] <= picture["left"]
        for control in (".pad", "#estop"):
            found = (
                f"(() => {{ const e = document.querySelector('{control}');"
                " const b = e.getBoundingClientRect();"
                " return e.contains(document.elementFromPoint(b.x + b.width / 2,"
                " b.y + b.height / 2)); })()"
            )
            assert page.evaluate(found)
        assert page.problems() == []


@pytest.mark.nightly
@pytest.mark.parametrize("size", [(360, 740), (844, 390)], ids=["upright", "on-its-side"])
def test_the_picture_has_no_barrier_that_axe_finds_live_or_not_also_at_twice_the_text(
    robot: PageBench, looking: Page, camera: UStreamer, size: tuple[int, int]
) -> None:
    looking.evaluate(axe() + "; 0")
    looking.resize(*size, phone=True)
    looking.until(LIVE)
    for stands in (False, True):
        if stands:
            camera.freeze()
            looking.until(MARKED)
        for view in ("drive", "camera"):
            looking.evaluate(f"location.hash = '#{view}'")
            looking.until("document.querySelector('.camera').checkVisibility()")
            for percent in (100, 200):
                enlarge(looking, percent)
                assert violations(looking) == []
                assert not [each for each in spills(looking) if "camera" in each]
    camera.thaw()


@pytest.mark.nightly
def test_the_robot_is_driven_and_stopped_as_ever_while_it_is_seen(
    robot: PageBench, looking: Page
) -> None:
    robot.press(looking)
    looking.until(LIVE)
    robot.stops_after(looking.lift)
    looking.click("#estop")
    looking.says("#state", "emergency stop")


@pytest.mark.nightly
def test_a_camera_that_stands_still_is_marked_and_comes_back(
    looking: Page, camera: UStreamer
) -> None:
    camera.freeze()
    looking.until(MARKED)
    looking.says(".camera-age", "Not live")
    looking.says(".camera-words", "sends no")
    camera.thaw()
    looking.until(LIVE)


@pytest.mark.nightly
def test_a_camera_that_is_unplugged_repeats_a_picture_which_is_marked(
    looking: Page, camera: UStreamer
) -> None:
    camera.unplug()
    looking.says(".camera-words", "repeats one picture")
    looking.until(MARKED)
    camera.plug()
    looking.until(LIVE)
    looking.until("document.querySelector('.camera-words').innerText === ''")


@pytest.mark.nightly
def test_a_camera_that_is_gone_is_reported_in_words_and_found_again(
    looking: Page, camera: UStreamer
) -> None:
    camera.close()
    looking.says(".camera-words", "The camera at 127.0.0.1")
    looking.until(MARKED)
    camera.start()
    looking.until(LIVE)


@pytest.mark.nightly
def test_pictures_that_come_late_through_the_network_never_look_live(
    robot: PageBench, looking: Page
) -> None:
    """New ones arrive all the time: each is older than half a second when it does."""
    robot.network.delay_s = 0.4
    # The picture that was asked for before is half as late, and live for a moment.
    for _ in range(2):
        before = looking.evaluate(PICTURE)
        looking.until(f"({PICTURE}) !== '{before}'")
    looking.until(MARKED)
    looking.evaluate(f"""window.seen = new Set(); window.looked = [];
      (function look() {{
        seen.add({PICTURE});
        looked.push({MARKED});
        requestAnimationFrame(look);
      }})(); 0""")
    looking.until("seen.size > 2")
    assert looking.evaluate("looked.every(Boolean)")
    robot.network.delay_s = 0.0
    looking.until(LIVE)


@pytest.mark.nightly
def test_a_connection_on_which_nothing_comes_is_marked(robot: PageBench, looking: Page) -> None:
    robot.network.held = True
    looking.until(MARKED)
    robot.network.held = False
    looking.until(LIVE)


@pytest.mark.nightly
def test_nothing_is_fetched_from_the_camera_unless_somebody_looks(
    looking: Page, camera: UStreamer
) -> None:
    wait_for(lambda: camera.clients() == 1, "one client")
    looking.evaluate("location.hash = '#wheels'")
    wait_for(lambda: camera.clients() == 0, "no client")
    looking.evaluate("location.hash = '#drive'")
    looking.until(LIVE)
    assert camera.clients() == 1


@pytest.mark.nightly
def test_a_robot_without_a_camera_shows_nothing_of_it(page: Page) -> None:
    assert page.evaluate("document.querySelector('.camera')") is None
    assert not page.evaluate(
        "document.querySelector('#views [data-view=camera]').checkVisibility()"
    )
    page.evaluate("location.hash = '#camera'")
    page.until("document.querySelector('#views [aria-current]').dataset.view === 'drive'")
    loaded = page.evaluate("performance.getEntriesByType('resource').map((each) => each.name)")
    assert not [name for name in loaded if "camera" in name]
