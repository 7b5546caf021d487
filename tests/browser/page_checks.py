"""What everybody can read and use: checks of a page by axe-core, and of its width."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from chromium import Page

OTHER_STATUS = """(() => {
    const parse = JSON.parse;
    JSON.parse = (text) => [parse(text)].flat().map((each) =>
        each.type === 'status' ? { ...each, sample: { ...each.sample, ...moment } } : each);
})()"""
"""From then on each status has what ``window.moment`` has."""


def axe() -> str:
    """The program that checks accessibility; skips the test if it is missing."""
    cache = os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")
    folder = Path(os.environ.get("YAHBOOMD_CACHE", Path(cache) / "yahboomd"))
    path = folder / "browser" / "axe" / "axe.min.js"
    if not path.exists():
        pytest.skip("axe-core is not there: make browser fetches it")
    return path.read_text()


def violations(page: Page) -> list[str]:
    """What axe-core finds wrong, each with the element."""
    found = page.evaluate("axe.run(document, { resultTypes: ['violations'] })")
    return [
        f"{each['id']}: {node['target']} {node['failureSummary']}"
        for each in found["violations"]
        for node in each["nodes"]
    ]


def spills(page: Page) -> list[str]:
    """The elements that are wider than the screen."""
    found: list[str] = page.evaluate(
        "[...document.querySelectorAll('body *')].filter((e) => e.checkVisibility()"
        " && !e.closest('nav, .tools, .skip')"
        " && e.getBoundingClientRect().right > innerWidth + 0.5)"
        ".map((e) => e.tagName + '.' + e.className)"
    )
    return found


def enlarge(page: Page, percent: int) -> None:
    """The size of text that a person chose in the browser."""
    sizes = {"standard": 16 * percent // 100, "fixed": 13 * percent // 100}
    page.order("Page.setFontSizes", fontSizes=sizes)


def seen(page: Page, selector: str) -> str:
    """The first words of a box that are inside of it, as far as its height shows them."""
    words: str = page.evaluate(
        f"""(() => {{
            const box = document.querySelector('{selector}');
            const edge = box.getBoundingClientRect();
            const walker = document.createTreeWalker(box, NodeFilter.SHOW_TEXT);
            let found = "";
            for (let node = walker.nextNode(); node; node = walker.nextNode())
                for (let at = 0; at < node.length; at += 1) {{
                    const range = document.createRange();
                    range.setStart(node, at);
                    range.setEnd(node, at + 1);
                    const letter = range.getBoundingClientRect();
                    if (letter.bottom <= edge.bottom + 1 && letter.right <= edge.right + 1)
                        found += node.data[at];
                }}
            return found;
        }})()"""
    )
    return words
