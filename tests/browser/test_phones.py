"""Two phones with sessions of their own: names, control, an ended session, links that work once."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from chromium import Page
from page_bench import PageBench

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]

CONTROLS = """[...document.querySelectorAll('button, input, nav a, .pad')]
    .filter((e) => e.checkVisibility()).length"""


def name(page: Page, text: str) -> None:
    """Give the phone a name, by its view."""
    page.evaluate("location.hash = 'phones'")
    page.until("document.querySelector('.phones form')?.checkVisibility()")
    page.evaluate(f"document.querySelector('#phone-name').value = '{text}'")
    page.evaluate("document.querySelector('#phone-name').dispatchEvent(new Event('input'))")
    page.click(".phones form button")
    page.says("#phones .files", text)
    page.evaluate("location.hash = 'drive'")


def test_two_phones_see_who_has_control_and_one_ends_the_session_of_the_other_in_mid_drive(
    make_bench: Callable[..., PageBench],
) -> None:
    bench = make_bench(listen="0.0.0.0")
    link, _ = bench.links()
    another, _ = bench.links()
    with bench.page(link, apart=True) as anne, bench.page(another, apart=True) as bert:
        for page, text in ((anne, "Anne"), (bert, "Bert")):
            # Two phones: both are seen.
            page.order("Emulation.setFocusEmulationEnabled", enabled=True)
            name(page, text)
            assert page.evaluate("location.href + document.cookie").count("token") == 0
        bench.press(anne)
        bert.says("#driver", "Anne drives.")
        bert.says(".words", "Anne has control of the robot.")
        bench.stops_after(lambda: bert.click(".take"))
        anne.says(".words", "Bert has control of the robot.")
        anne.lift()
        anne.click(".take")
        bert.says("#driver", "Anne has control")
        bench.press(anne)
        bert.evaluate("location.hash = 'phones'")
        bert.click("#phones button[aria-label='End the session of Anne']")
        bench.stops_after(lambda: bert.click("#phones .danger"))
        anne.says("#why", "The session of this phone was ended by Bert.")
        anne.says("#main", "yahboomd web --show-link")
        anne.lift()
        assert anne.evaluate(CONTROLS) == 0
        bert.says("#driver", "No page")
        # The history of its browser lets nobody in.
        anne.order("Page.navigate", url="about:blank")
        anne.go(link)
        anne.says("#why", "This link was used already: it lets one phone in, once.")
        assert anne.evaluate(CONTROLS) == 0
        bert.says("#phones", "links that were used before")
        # A new link in the same tab, without a reload by hand.
        fresh, _ = bench.links()
        anne.evaluate(f"location.href = '{fresh}'")
        bench.press(anne)
        bench.stops_after(anne.lift)
