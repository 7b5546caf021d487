"""One browser and one robot for all tests of a process; each test opens pages of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from chromium import Chromium, Page
from page_bench import PageBench


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    """Debian's Chromium; skips the test if it is missing."""
    browser = Chromium(tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def shared_bench(
    tmp_path_factory: pytest.TempPathFactory, browser: Chromium
) -> Iterator[PageBench]:
    """A robot whose emergency stop is released before each test."""
    bench = PageBench(tmp_path_factory.mktemp("robot"), browser)
    yield bench
    bench.close()


@pytest.fixture
def bench(shared_bench: PageBench) -> Iterator[PageBench]:
    """The same, as a test finds it: it stands, and the network is good."""
    yield shared_bench
    shared_bench.recover()


@pytest.fixture
def make_bench(
    tmp_path_factory: pytest.TempPathFactory, browser: Chromium
) -> Iterator[Callable[..., PageBench]]:
    """Makes robots of a test's own: ``make_bench(simulate=(...), web=(...))``."""
    made: list[PageBench] = []

    def make(**arguments: Any) -> PageBench:
        made.append(PageBench(tmp_path_factory.mktemp("robot"), browser, **arguments))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def page(bench: PageBench) -> Iterator[Page]:
    """A phone with the page, which is ready to drive."""
    with bench.page() as page:
        bench.ready(page)
        yield page
        assert page.problems() == []
