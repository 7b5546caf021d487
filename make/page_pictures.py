"""Pictures of the page in Chromium, with a simulated robot: docs/images, or every view and state.

make pictures                               docs/images/page.png, page_desktop.png, page_tools.png
make pictures ARGS='build/pictures'         every view and state, in five sizes, light and dark
make pictures ARGS='build/pictures --text 200 --width 360 --only drives --only view-map'
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from chromium import BrowserError, Chromium, Page
from page_bench import PageBench
from page_checks import enlarge
from PIL import Image
from real_robot import Process
from ustreamer_camera import UStreamer

IMAGES = Path(__file__).resolve().parents[1] / "docs/images"
PHONE, ON_ITS_SIDE, TABLET = (360, 740), (844, 390), (768, 1024)
LAPTOP, DESKTOP = (1366, 768), (1920, 1080)
SIZES = (PHONE, ON_ITS_SIDE, TABLET, LAPTOP, DESKTOP)
CURVE = "board.battery_curve=[[6.0, 0.0], [8.0, 1.0]]"
BATTERY = ("board.battery_low_v=6.8", "board.battery_stop_v=6.2", "board.battery_period_s=1")
GAP, GREY = 16, "#80868c"
SETTLE_S = 0.5
"""For charts and maps to draw what is new."""


class Robots:
    """A robot whose phones have sessions, and one with a camera."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._ending = ExitStack()
        self.browser = Chromium(folder)
        self._ending.callback(self.browser.close)
        self.plain = self._bench("plain", listen="0.0.0.0", run=_sets(CURVE, *BATTERY))
        self._seen: PageBench | None = None

    def _bench(self, name: str, **arguments: Any) -> PageBench:
        (self._folder / name).mkdir()
        battery = ("--battery", "7.4")
        bench = PageBench(self._folder / name, self.browser, simulate=battery, **arguments)
        self._ending.callback(bench.close)
        return bench

    @property
    def seen(self) -> PageBench:
        """The robot with a camera."""
        if self._seen is None:
            self.camera = UStreamer(self._folder)
            self._ending.callback(self.camera.close)
            self._seen = self._bench("seen", web=_sets(f"web.camera={self.camera.address}"))
        return self._seen

    @contextmanager
    def phone(self, name: str = "Anne", *, drives: bool = True) -> Iterator[Page]:
        """A phone with a session and a name."""
        link = self.plain.links()[not drives]
        page = self.browser.open(link, apart=True)
        page.order("Emulation.setFocusEmulationEnabled", enabled=True)
        page.until("document.querySelector('#state').dataset.state === 'standing'")
        page.evaluate(NAME % name)
        try:
            yield page
        finally:
            page.evaluate(END)
            page.close()

    def close(self) -> None:
        self._ending.close()


def _sets(*settings: str) -> tuple[str, ...]:
    return tuple(word for each in settings for word in ("--set", each))


NAME = """fetch("/session/name", { method: "POST", headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ name: "%s" }) }).then(() => 0)"""

END = """fetch("/sessions").then((answer) => answer.json()).then(({ sessions }) =>
    fetch(`/sessions/${sessions.find((each) => each.mine).id}/end`, { method: "POST",
        headers: { "Content-Type": "application/json" }, body: "{}" })).then(() => 0)"""
"""This phone's session ends: the next one may have its name."""

State = Iterator[tuple[Page, Callable[[], object]]]
"""A page in a state, and what brings that state about anew in another size."""


def nothing() -> None:
    """A state that a change of the size does not end."""


def show(page: Page, view: str) -> None:
    page.evaluate(f"location.hash = '#{view}'")
    page.until(f"document.querySelector('#{view}')?.checkVisibility()")


def there(page: Page, selector: str) -> None:
    page.until(f"document.querySelector('{selector}') !== null")


def drive(bench: PageBench, page: Page, right: float = 0.45, up: float = 0.75) -> None:
    """A thumb is on the pad, and the wheels turn."""
    bench.ready(page)
    place = bench.place(page, right, up)
    bench.drives(page, lambda: bench.put_down(page, place), page.lift)


def draw_a_path(bench: PageBench, page: Page) -> None:
    """Two bends, driven slowly."""
    for right in (0.5, -0.7, -0.5):
        drive(bench, page, right)
        time.sleep(2.0)
        page.lift()
    bench.robot.settled_truth()


def views(robots: Robots, view: str) -> State:
    with robots.phone() as page:
        if view in ("map", "wheels"):
            draw_a_path(robots.plain, page)
            # Commands that were refused meanwhile are named for a while.
            page.says("#why", "Ready.")
        show(page, view)
        yield page, nothing


PAD = "document.querySelector('.pad')?.checkVisibility()"
"""Not beside the map of a phone upright."""


def driving(robots: Robots, view: str = "drive") -> State:
    with robots.phone() as page:
        page.evaluate(f"location.hash = '#{view}'")

        def press() -> None:
            page.lift()
            if page.evaluate(PAD):
                drive(robots.plain, page)

        yield page, press
        page.lift()
        robots.plain.robot.settled_truth()


def stopped(robots: Robots, view: str = "drive") -> State:
    with robots.phone() as page:
        page.evaluate(f"location.hash = '#{view}'")
        page.click("#estop")
        page.says("#state", "emergency stop")
        yield page, nothing
    robots.plain.recover()


def stop_unanswered(robots: Robots) -> State:
    with robots.phone() as page:
        robots.plain.network.held = True
        page.click("#estop")
        page.says("#estop-text", "attempt 3")
        yield page, nothing
        robots.plain.recover()
        page.says("#state", "emergency stop")
    robots.plain.recover()


def no_board(robots: Robots) -> State:
    with robots.phone() as page:
        robots.plain.robot.do("unplug 600")
        page.says("#state", "waiting")
        yield page, nothing
        robots.plain.robot.do("replug")
        page.says("#state", "standing")


def fault(robots: Robots) -> State:
    with robots.phone() as page:
        drive(robots.plain, page, 0.0, 0.9)
        robots.plain.robot.do("encoder-dead left")
        page.says("#state", "fault")
        page.lift()
        yield page, nothing
        robots.plain.robot.do("repair left")
    robots.plain.recover()


def lost_server(robots: Robots) -> State:
    with robots.phone() as page:
        robots.plain.server.end()
        page.says("#why", "Attempt")
        yield page, nothing
        robots.plain.start_server()


def no_daemon(robots: Robots) -> State:
    with robots.phone() as page:
        robots.plain.robot.daemon.end()
        page.says("#state", "no daemon")
        yield page, nothing
        robots.plain.robot.start_daemon()
        page.says("#state", "standing")


def slow_network(robots: Robots) -> State:
    with robots.phone() as page:
        robots.plain.network.delay_s = 0.4
        page.says("#state", "slow network")
        yield page, nothing
        robots.plain.recover()


def no_session(robots: Robots) -> State:
    page = robots.browser.open(robots.plain.url, apart=True)
    page.says("#state", "no access")
    yield page, nothing
    page.close()


def viewer(robots: Robots) -> State:
    with robots.phone("Tablet in the hall", drives=False) as page:
        yield page, nothing


def another_drives(robots: Robots) -> State:
    with robots.phone() as anne, robots.phone("Bert") as bert:
        bert.says("#driver", "has control")
        drive(robots.plain, anne)
        anne.lift()
        bert.says(".words", "Anne has control")
        yield bert, nothing


def low(robots: Robots, volts: float = 6.6, word: str = "low") -> State:
    with robots.phone() as page:
        robots.plain.robot.do(f"battery {volts}")
        page.says("#battery", word)
        yield page, nothing
        robots.plain.robot.do("battery 7.4")
        page.until(f"!document.querySelector('#battery').innerText.includes('{word}')")


def settings(robots: Robots) -> State:
    with robots.phone() as page:
        page.click(".gear")
        yield page, nothing


def pose_form(robots: Robots) -> State:
    with robots.phone() as page:
        show(page, "map")
        page.click(".tools button[aria-expanded]")
        yield page, nothing


def going(robots: Robots) -> State:
    moves = Process("moves", "--connect", robots.plain.robot.endpoint)
    with robots.phone() as page:
        show(page, "map")
        page.evaluate("[...document.querySelectorAll('.tools button')].at(-1).click()")
        there(page, ".going")

        def mark() -> None:
            # Large text has it below the screen's end; there the stop is.
            page.evaluate("document.querySelector('.place').scrollIntoView({ block: 'center' })")
            x, y = page.middle("canvas.map")
            page.touch((x + 20, y - 10))
            page.lift()

        yield page, mark
    moves.end()


def going_without(robots: Robots) -> State:
    with robots.phone() as page:
        show(page, "map")
        page.evaluate("[...document.querySelectorAll('.tools button')].at(-1).click()")
        there(page, ".going")
        yield page, nothing


def calibrating(robots: Robots) -> State:
    with robots.phone() as page:
        show(page, "calibrate")
        there(page, ".choice:not([hidden]) [type=submit]")
        page.click(".choice [type=submit]")
        there(page, ".calibrate .hold")
        yield page, nothing
        page.evaluate("document.querySelector('.wizard > button').click()")


def measuring(robots: Robots) -> State:
    with robots.phone() as page:
        show(page, "calibrate")
        there(page, ".choice:not([hidden]) details")
        page.evaluate("document.querySelector('[name=speed]').value = 0.4")
        page.click(".choice [type=submit]")

        def run() -> bool:
            # Enter would answer the question.
            if page.evaluate("document.querySelector('.calibrate .hold:not(.held)') !== null"):
                page.evaluate("document.querySelector('.calibrate .hold')?.focus()")
                page.key("Enter", down=False)
                page.key("Enter", down=True)
            return bool(page.evaluate("Boolean(document.querySelector('#answer'))"))

        there(page, ".calibrate .hold")
        until(run)
        page.key("Enter", down=False)
        yield page, nothing
        page.evaluate("document.querySelector('.wizard > button').click()")


def until(found: Callable[[], object]) -> None:
    while not found():
        time.sleep(0.5)


def recording(robots: Robots) -> State:
    with robots.phone() as page:
        show(page, "record")
        page.says(".record button", "Begin to record")
        page.click(".record button")
        page.says(".record", "Recording run-")
        yield page, nothing
        page.click(".record button")
        page.says(".record", "none lost")


def boxes(robots: Robots) -> State:
    with robots.phone() as page:
        page.click("#estop")
        page.says("#state", "emergency stop")
        robots.plain.recover()
        show(page, "boxes")
        page.says(".boxes .files", "Emergency stop")
        page.evaluate("document.querySelectorAll('.boxes .files li button')[0].click()")
        there(page, ".story table")
        yield page, lambda: page.evaluate("document.querySelector('.story').scrollIntoView()")


def phones(robots: Robots) -> State:
    with robots.phone() as page, robots.phone("Bert"), robots.phone("Hall", drives=False):
        show(page, "phones")
        page.says("#phones .files", "Hall")
        page.click("#phones button[aria-label='End the session of Bert']")
        yield page, nothing


LIVE = "document.querySelector('.camera')?.dataset.live === '%s'"


def camera(robots: Robots, view: str = "drive", *, stands: bool = False) -> State:
    bench = robots.seen
    with bench.page() as page:
        bench.ready(page)
        page.evaluate(f"location.hash = '#{view}'")
        page.until(LIVE % "true")

        def look() -> None:
            robots.camera.thaw()
            page.until(LIVE % "true")
            if stands:
                robots.camera.freeze()
                page.until(LIVE % "false")

        yield page, look
        robots.camera.thaw()


def camera_gone(robots: Robots) -> State:
    bench = robots.seen
    with bench.page() as page:
        bench.ready(page)
        page.until(LIVE % "true")
        robots.camera.close()
        page.says(".camera-words", "The camera at")
        yield page, nothing
        robots.camera.start()


def camera_drives(robots: Robots) -> State:
    bench = robots.seen
    with bench.page() as page:
        bench.ready(page)
        page.until(LIVE % "true")

        def press() -> None:
            page.lift()
            drive(bench, page)

        yield page, press
        page.lift()


VIEWS = ("map", "wheels", "health", "calibrate", "record", "boxes", "phones", "menu")
STATES: dict[str, Callable[[Robots], State]] = {
    "ready": lambda robots: views(robots, "drive"),
    **{f"view-{view}": lambda robots, view=view: views(robots, view) for view in VIEWS},
    "drives": driving,
    "drives-map": lambda robots: driving(robots, "map"),
    "stopped": stopped,
    "stopped-map": lambda robots: stopped(robots, "map"),
    "stop-unanswered": stop_unanswered,
    "no-board": no_board,
    "fault": fault,
    "lost-server": lost_server,
    "no-daemon": no_daemon,
    "slow-network": slow_network,
    "no-session": no_session,
    "viewer": viewer,
    "another-drives": another_drives,
    "battery-low": low,
    "battery-empty": lambda robots: low(robots, 6.0, "empty"),
    "settings": settings,
    "pose": pose_form,
    "going": going,
    "going-without": going_without,
    "calibrating": calibrating,
    "measuring": measuring,
    "recording": recording,
    "box": boxes,
    "sessions": phones,
    "camera": camera,
    "camera-view": lambda robots: camera(robots, "camera"),
    "camera-drives": camera_drives,
    "camera-old": lambda robots: camera(robots, stands=True),
    "camera-gone": camera_gone,
}


def take_all(
    robots: Robots, folder: Path, names: list[str], percent: int, widths: list[int]
) -> None:
    """Every state in every size and scheme."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names or STATES:
        try:
            with contextmanager(STATES[name])(robots) as (page, again):
                for size in [each for each in SIZES if not widths or each[0] in widths]:
                    page.resize(*size, phone=size not in {LAPTOP, DESKTOP})
                    enlarge(page, percent)
                    again()
                    for scheme in ("light", "dark"):
                        page.prefer(scheme)
                        time.sleep(SETTLE_S)
                        text = "" if percent == 100 else f"-{percent}"
                        page.picture(folder / f"{name}-{size[0]}-{scheme}{text}.png")
            print(name, flush=True)
        except (pytest.fail.Exception, BrowserError) as error:
            # On a busy machine a robot may not do what the state needs.
            print(f"{name}: not taken: {error}", flush=True)
            robots.plain.recover()


BUSY = "too slow|Waiting|Stopping|touch again|Nothing c|refused lately"
"""What the page says on a busy machine; no picture of the manual shows it."""


def take(
    robots: Robots, folder: Path, name: str, size: tuple[int, int], scheme: str
) -> Image.Image:
    """One state, as a picture of that size."""
    with contextmanager(STATES[name])(robots) as (page, again):
        page.resize(*size, phone=size not in {LAPTOP, DESKTOP})
        page.prefer(scheme)

        def taken() -> bool:
            again()
            time.sleep(SETTLE_S)
            words = page.text("body")
            page.picture(folder / "taken.png")
            return not re.search(BUSY, words) and (
                not name.startswith("drives") or "Driving." in words
            )

        until(taken)
    return Image.open(folder / "taken.png").convert("RGB").resize(size, Image.Resampling.LANCZOS)


def beside(rows: list[list[Image.Image]], path: Path) -> None:
    """Rows of pictures as one, on grey."""
    wide = max(sum(each.width + GAP for each in row) for row in rows) + GAP
    high = sum(max(each.height for each in row) + GAP for row in rows) + GAP
    whole = Image.new("RGB", (wide, high), GREY)
    top = GAP
    for row in rows:
        left = (wide - sum(each.width + GAP for each in row) + GAP) // 2
        for each in row:
            whole.paste(each, (left, top))
            left += each.width + GAP
        top += max(each.height for each in row) + GAP
    whole.save(path, optimize=True)
    print(path)


def take_for_docs(robots: Robots, folder: Path) -> None:
    """The three pictures of docs/web.md."""

    def each(size: tuple[int, int], *wanted: tuple[str, str]) -> list[Image.Image]:
        return [take(robots, folder, name, size, scheme) for name, scheme in wanted]

    sideways = each(ON_ITS_SIDE, ("drives-map", "light"), ("stopped-map", "dark"))
    small = [one.resize((560, 259), Image.Resampling.LANCZOS) for one in sideways]
    upright = each(PHONE, ("drives", "light"), ("view-map", "light"), ("view-wheels", "dark"))
    beside([small, upright], IMAGES / "page.png")
    tools = each(PHONE, ("measuring", "light"), ("recording", "light"), ("box", "dark"))
    beside([tools], IMAGES / "page_tools.png")
    (wide,) = each(DESKTOP, ("view-map", "dark"))
    wide.resize((1200, 675), Image.Resampling.LANCZOS).save(
        IMAGES / "page_desktop.png", optimize=True
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("folder", nargs="?", type=Path, help="take every view and state into it")
    parser.add_argument("--text", type=int, default=100, help="the size of text, in percent")
    parser.add_argument(
        "--width", action="append", type=int, default=[], help="only this size", metavar="PIXELS"
    )
    parser.add_argument("--only", action="append", default=[], choices=list(STATES))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(
        prefix="yahboomd-pictures-",
        ignore_cleanup_errors=True,  # The browser ends a moment later.
    ) as name:
        robots = Robots(Path(name))
        try:
            if args.folder:
                take_all(robots, args.folder, args.only, args.text, args.width)
            else:
                take_for_docs(robots, Path(name))
        finally:
            robots.close()


if __name__ == "__main__":
    main()
