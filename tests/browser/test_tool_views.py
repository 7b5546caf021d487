"""On the phone: the robot is calibrated by a button that is held, recorded, and explains itself."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from chromium import Chromium, Page
from mcap.reader import make_reader
from page_bench import PageBench
from real_robot import wait_for

from yahboomd.blackbox.box_file import read_box

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]

TRUE_RADIUS_M, TRUE_TRACK_M = 0.0345, 0.162
"""Configured are 0.0335 and 0.150."""


@pytest.fixture(scope="module")
def larger_robot(
    tmp_path_factory: pytest.TempPathFactory, browser: Chromium
) -> Iterator[PageBench]:
    """A robot of another size than is configured; server and daemon have one state directory."""
    size = ("--wheel-radius", str(TRUE_RADIUS_M), "--wheel-separation", str(TRUE_TRACK_M))
    folder = tmp_path_factory.mktemp("robot")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STATE_DIRECTORY", str(folder))
        made = PageBench(folder, browser, simulate=size)
        yield made
        made.close()


@pytest.fixture
def bench(larger_robot: PageBench) -> Iterator[PageBench]:
    """The same, and no test leaves it stopped to the next one."""
    yield larger_robot
    larger_robot.recover()


@pytest.fixture
def page(bench: PageBench) -> Iterator[Page]:
    """A phone that asks to hold the button for a straight of a metre."""
    with bench.page(f"{bench.url}#calibrate") as page:
        begin(page)
        yield page
        page.evaluate("location.hash = '#calibrate'")
        page.evaluate("document.querySelector('.wizard > button').click()")
        gone(page, ".wizard:not([hidden])")
        assert page.problems() == []


AGAIN = "document.querySelector('.question').innerText.includes('does not count')"


def there(page: Page, selector: str) -> None:
    page.until(f"document.querySelector('{selector}') !== null")


def gone(page: Page, selector: str) -> None:
    page.until(f"document.querySelector('{selector}') === null")


def begin(page: Page) -> None:
    """Begin by tape, with short and quick runs."""
    there(page, ".choice:not([hidden]) details")
    # What the page may not do, it names.
    page.says(".calibrate", "on its own computer")
    page.evaluate("document.querySelector('.choice details').open = true")
    for name, value in (("straight", 1), ("turns", 1), ("speed", 0.4), ("turn-speed", 2)):
        page.evaluate(f"document.querySelector('[name={name}]').value = {value}")
    page.evaluate("document.querySelector('.choice [type=submit]').scrollIntoView()")
    page.tap(".choice [type=submit]")
    there(page, ".calibrate .hold")


def hold(bench: PageBench, page: Page, *, by_enter: bool = False) -> None:
    """Hold the button, by a thumb or by Enter; returns once the wheels turn."""

    def press() -> None:
        if by_enter:
            page.evaluate("document.querySelector('.calibrate .hold').focus()")
            page.key("Enter", down=True)
        else:
            page.touch(page.middle(".calibrate .hold"))

    def moves() -> bool:
        # On a busy machine a hold may come too late: then it has to be pressed again.
        if not page.evaluate("document.querySelector('.calibrate .hold.held') !== null"):
            page.key("Enter", down=False) if by_enter else page.lift()
            press()
        return bench.is_moving()

    press()
    wait_for(moves, "the wheels turn")


def hide(page: Page) -> None:
    """Another tab comes to the front."""
    other = page.browser.order("Target.createTarget", url="about:blank")["targetId"]
    page.until("document.hidden")
    page.browser.order("Target.closeTarget", targetId=other)


def another_view(page: Page) -> None:
    page.evaluate("location.hash = '#wheels'")


def second_finger(page: Page) -> None:
    page.touch(page.middle(".calibrate .hold"), (30.0, 20.0))


LOSSES: dict[str, Callable[[Page], None]] = {
    "released": Page.lift,
    "tab hidden": hide,
    "another view": another_view,
    "second finger": second_finger,
}
SHORT = {"released"}


@pytest.mark.parametrize(
    "loss",
    [
        pytest.param(loss, id=name, marks=() if name in SHORT else pytest.mark.nightly)
        for name, loss in LOSSES.items()
    ],
)
def test_a_button_that_is_lost_stops_the_wheels_at_once_and_the_run_is_done_again(
    bench: PageBench, page: Page, loss: Callable[[Page], None]
) -> None:
    hold(bench, page)
    bench.stops_after(lambda: loss(page))
    page.says(".question", "The button was let go") if loss is not another_view else None


@pytest.mark.nightly
def test_a_page_that_is_closed_while_it_is_held_stops_the_wheels_and_ends_the_wizard(
    bench: PageBench,
) -> None:
    with bench.page(f"{bench.url}#calibrate") as page:
        begin(page)
        hold(bench, page)
        bench.stops_after(lambda: page.order("Page.navigate", url="about:blank"))
    with bench.page(f"{bench.url}#calibrate") as page:
        there(page, ".choice:not([hidden])")


@pytest.mark.nightly
def test_a_network_that_is_cut_while_it_is_held_stops_the_wheels(
    bench: PageBench, page: Page
) -> None:
    hold(bench, page)

    def cut() -> None:
        bench.network.held = True

    bench.stops_after(cut)
    page.lift()
    bench.recover()
    there(page, ".choice:not([hidden])")


@pytest.mark.nightly
def test_the_button_works_by_enter_and_the_space_bar_is_the_emergency_stop(
    bench: PageBench, page: Page
) -> None:
    hold(bench, page, by_enter=True)
    bench.stops_after(lambda: page.key("Enter", down=False))
    page.says(".question", "The button was let go")
    hold(bench, page, by_enter=True)
    bench.stops_after(lambda: page.type("Space"))
    page.key("Enter", down=False)
    page.says("#state", "emergency stop")
    page.tap("#release")
    page.says("#state", "standing")


@pytest.mark.nightly
def test_a_calibration_by_tape_through_the_page_writes_the_true_size(
    bench: PageBench, page: Page
) -> None:
    def run() -> tuple[float, float]:
        while not page.evaluate("document.querySelector('#answer') !== null"):
            before = bench.robot.settled_truth()
            hold(bench, page)
            gone(page, ".calibrate .hold.held")
            page.lift()
            page.until(f"!document.querySelector('.calibrate .hold') || {AGAIN}")
        after = bench.robot.settled_truth()
        turned = math.degrees(abs(after.theta - before.theta))
        return math.hypot(after.x - before.x, after.y - before.y), turned

    def answer(text: str) -> None:
        page.evaluate("document.querySelector('#answer').focus()")
        page.order("Input.insertText", text=text)
        page.tap(".answer [type=submit]")

    length_m, _ = run()
    page.tap(".answer [type=submit]")
    page.says(".wizard .error", "Type what you measured")
    answer("far")
    page.says(".wizard .error", "A number of metres")
    answer(f"{length_m:.4f}")
    page.says(".question", "How far to the left of its line")
    answer("")
    for first in (True, False):
        there(page, ".calibrate .hold")
        _, turned = run()
        if first:
            page.says(".question", "To which side did it turn")
            answer("1")
        answer(f"{turned - 360.0:.3f}".replace(".", ","))
    page.says(".calibrate", "It is written.")
    file = bench.robot.folder / "calibration.toml"
    found = tomllib.loads(file.read_text())
    assert found["method"] == "tape"
    radii = found["chassis"]["wheel_radius_multiplier"]
    assert radii == pytest.approx(dict.fromkeys(radii, TRUE_RADIUS_M / 0.0335), rel=2e-3)
    track = found["chassis"]["wheel_separation_multiplier"]
    assert track == pytest.approx(TRUE_TRACK_M / 0.150, rel=2e-3)
    page.evaluate("[...document.querySelectorAll('.calibrate button')].at(-1).click()")
    page.says(".calibrate", "Taken back")
    assert not file.exists()
    begin(page)


MEASURED = {
    "straight": ("length", "left"),
    "turn": ("beyond",),
    "sideways": ("length",),
    "square": ("ahead", "left", "heading"),
}
QUESTIONS = [
    {"name": name, "run": f"{run} {way}" if way else run}
    for run, measured in MEASURED.items()
    for way in ((None,) if run == "straight" else ("left", "right"))
    for name in ("move", "moved", *measured)
] + [{"name": "rest"}, {"name": "turned"}]
"""All that a person is asked to do, and to measure; the side to which it went has no picture."""

LOOK = """async (asked) => {
    const { picture } = await import('/page/calibrate_pictures.js');
    const found = picture(asked);
    document.getElementById('main').append(found);
    const svg = found.querySelector('svg'), seen = svg.getBoundingClientRect();
    const spills = [...svg.querySelectorAll(':scope > :not(defs)')].filter((each) => {
        const box = each.getBoundingClientRect();
        return box.left < seen.left - 1 || box.right > seen.right + 1
            || box.top < seen.top - 1 || box.bottom > seen.bottom + 1;
    });
    const result = { bytes: svg.innerHTML.length, words: found.innerText, spills: spills.length };
    found.remove();
    return result;
}"""


@pytest.mark.nightly
def test_every_question_has_a_small_picture_and_a_measure_says_between_which_points(
    bench: PageBench,
) -> None:
    with bench.page(bench.url) as page:
        for asked in QUESTIONS:
            found = page.evaluate(f"({LOOK})({json.dumps(asked)})")
            assert found["bytes"] < 1800, asked
            assert found["spills"] == 0, asked
            measures = asked["name"] not in {"move", "moved", "rest", "turned"}
            assert found["words"].endswith(".") == measures, asked
        assert page.problems() == []


@pytest.mark.nightly
def test_a_recording_is_made_downloaded_and_removed(bench: PageBench, tmp_path: Path) -> None:
    with bench.page(f"{bench.url}#record") as page:
        page.order("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
        page.says(".record button", "Begin to record")
        page.tap(".record button")
        page.says(".record", "Recording run-001:")
        page.says(".files .fact", "recording")
        page.until("document.querySelector('.links a[download*=native]') !== null")
        page.says(".record button", "End the recording")
        page.tap(".record button")
        page.says(".record", "none lost")

        page.evaluate("document.querySelector('.links a[download*=native]').click()")
        path = tmp_path / "run-001-native_0.mcap"
        wait_for(path.exists, "it is downloaded")
        with path.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        assert summary is not None
        assert "yahboomd/pose" in {each.topic for each in summary.channels.values()}

        page.evaluate("document.querySelector('[aria-label=\"Remove run-001\"]').click()")
        page.says(".doubt", "Remove run-001 for good?")
        page.evaluate("document.querySelector('.doubt button').click()")
        page.until("document.querySelector('.doubt') === null")
        page.evaluate("document.querySelector('[aria-label=\"Remove run-001\"]').click()")
        page.evaluate("document.querySelector('.doubt .danger').click()")
        page.until("document.querySelector('.files').children.length === 0")
        page.says(".record", "0 recordings")
        assert page.problems() == []


@pytest.mark.nightly
def test_a_box_that_is_saved_while_its_view_is_opened_is_listed_without_another_event(
    bench: PageBench,
) -> None:
    with bench.page() as page:
        page.tap("#estop")
        page.says("#state", "emergency stop")
        page.evaluate("location.hash = '#boxes'")
        page.says(".boxes .files", "Emergency stop")


@pytest.mark.nightly
def test_a_page_that_waits_for_its_turn_at_the_boxes_says_so_and_asks_again(page: Page) -> None:
    page.evaluate("""window.isBusy = true;
        const real = fetch;
        window.fetch = async (...asked) =>
            isBusy ? new Response("Too many people ask.", { status: 503 }) : real(...asked);
        0""")
    page.evaluate("location.hash = '#boxes'")
    page.says(".boxes .card", "Too many people ask.")
    page.evaluate("isBusy = false")
    page.says(".boxes .files", "The last minute, in memory")
    assert "Too many" not in page.text(".boxes .card")
    page.evaluate("isBusy = true; document.querySelector('.boxes .files button').click()")
    page.says(".boxes .story", "Too many people ask.")
    page.evaluate("isBusy = false")
    page.until("!/moment|Too many/.test(document.querySelector('.boxes .story').innerText)")


BESIDE = """document.querySelector('.story')?.getBoundingClientRect().left
    >= document.querySelector('.boxes .files').getBoundingClientRect().right"""


@pytest.mark.nightly
def test_an_emergency_stop_is_listed_explained_and_downloaded_and_a_box_is_saved_now(
    bench: PageBench, tmp_path: Path
) -> None:
    with bench.page(f"{bench.url}#boxes") as page:
        page.order("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
        page.says(".files", "The last minute, in memory")
        page.tap("#estop")
        page.says("#state", "emergency stop")
        page.says(".files", "Emergency stop")
        bench.release(page)
        # This machine may have boxes of others, and a daemon saves what an earlier one left.
        saved = max(bench.robot.folder.rglob("*_estop*.blackbox"))
        page.until(f"document.querySelector('a[href$=\"{saved.stem}\"]') !== null")
        row = f"document.querySelector('a[href$=\"{saved.stem}\"]').closest('li')"
        page.evaluate(f"{row}.querySelector('button').click()")
        page.until(f"{row}.innerText.includes('mergency stop engaged by the page')")
        page.resize(1366, 768, phone=False)
        page.until(BESIDE)
        page.resize(390, 844, phone=True)
        page.until(f"{row}.contains(document.querySelector('.story'))")
        page.evaluate(f"{row}.querySelector('a').click()")
        wait_for((tmp_path / saved.name).exists, "it is downloaded")
        assert read_box((tmp_path / saved.name).read_bytes()).records
        page.evaluate("document.querySelector('.boxes button').click()")
        page.says(".boxes [role=status]", "saved")
        assert page.problems() == []


@pytest.mark.nightly
def test_a_box_that_has_to_wait_a_minute_is_listed_when_it_is_saved(bench: PageBench) -> None:
    boxes = "document.querySelectorAll('.boxes .files a').length"
    with bench.page(f"{bench.url}#boxes") as page:
        page.says(".files", "The last minute, in memory")
        page.evaluate("document.querySelector('.boxes button').click()")
        page.until("/aved/.test(document.querySelector('.boxes [role=status]').innerText)")
        page.until(f"{boxes} > 0")
        before = page.evaluate(boxes)
        page.tap("#estop")
        page.until(f"{boxes} > {before}", 120.0)
