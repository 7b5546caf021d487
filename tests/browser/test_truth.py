"""What the page says while the truth moves: the first words, and a dash for what is not known."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from chromium import Page
from page_bench import PageBench
from page_checks import OTHER_STATUS, seen

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]

SIZES = {"upright": (390, 844), "on-its-side": (844, 390)}
FIGURES = "[...document.querySelectorAll('#battery, #driver, .speed')].map((e) => e.innerText)"
MAY_TURN = "The wheels may still turn: switch the motors' supply off. Not seen for"
TURNED = "The wheels turned "


@contextmanager
def unplugged(bench: PageBench) -> Iterator[None]:
    bench.robot.do("unplug 600")
    yield
    bench.robot.do("replug")


@contextmanager
def mute(bench: PageBench) -> Iterator[None]:
    bench.robot.do("mute 10")
    yield


@contextmanager
def frozen(bench: PageBench) -> Iterator[None]:
    process = bench.robot.daemon.process
    process.send_signal(signal.SIGSTOP)
    yield
    process.send_signal(signal.SIGCONT)


@contextmanager
def killed(bench: PageBench) -> Iterator[None]:
    bench.robot.daemon.end(signal.SIGKILL)
    yield
    bench.robot.start_daemon()


@contextmanager
def cut_off(bench: PageBench) -> Iterator[None]:
    bench.network.cut()
    yield
    bench.network.refuses = False


STATES = {
    "unplugged": (unplugged, MAY_TURN),
    "mute": (mute, MAY_TURN),
    "frozen": (frozen, TURNED),
    "killed": (killed, TURNED),
    "cut-off": (cut_off, TURNED),
}


@pytest.mark.nightly
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("state", STATES)
def test_the_first_words_are_what_the_wheels_may_do_and_no_figure_is_an_old_one(
    make_bench: Callable[..., PageBench], state: str, size: str
) -> None:
    bench = make_bench()
    lose, words = STATES[state]
    with bench.page() as page:
        page.resize(*SIZES[size], phone=True)
        bench.press(page)
        page.until("document.querySelector('#battery').innerText.includes('V')")
        with lose(bench):
            page.says("#why", words)
            page.lift()
            shown = 60 if size == "upright" else 25
            assert seen(page, "#why").startswith(words[:shown])
            # Neither speed nor driver, and no charge.
            page.until(f"!/[0-9]/.test({FIGURES}.at(-1).replace(/\\/s/g, ''))")
            if words == TURNED:
                page.until(f"{FIGURES}.slice(0, 2).join() === '\\u2013,\\u2013'")
        page.until("document.querySelector('#state').dataset.state === 'standing'")


@pytest.mark.parametrize("size", SIZES)
def test_a_stop_under_way_says_first_that_the_wheels_still_turn(page: Page, size: str) -> None:
    page.resize(*SIZES[size], phone=True)
    # A real one is over before a busy machine has looked.
    page.evaluate(f"window.moment = {{}}; {OTHER_STATUS}")
    for state in ("stopping", "estopped"):
        page.evaluate(f"moment = {{ wheels: 'turning', state: '{state}' }}; 0")
        page.until(f"document.querySelector('#state').dataset.state === '{state}'")
        assert seen(page, "#why").startswith("The wheels still turn.")
    page.evaluate("moment = { wheels: 'turning', state: 'driving' }; 0")
    page.until("!document.querySelector('#why').innerText.includes('wheels')")


def test_an_old_pose_is_a_dash(bench: PageBench, page: Page) -> None:
    page.evaluate("location.hash = '#map'")
    page.says(".where", "heading")
    bench.robot.do("mute 4")
    page.says(".where", "The last pose is")
    page.says(".where", "x \u2013, y \u2013, heading \u2013.")
    page.until("!document.querySelector('.where').innerText.includes('\u2013')")
