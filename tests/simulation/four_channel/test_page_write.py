from __future__ import annotations

from random import Random

import pytest

from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.four_channel.page_write import PREPARE_NS, PageWrite

BEFORE, AFTER = FlashContent(lines=13, dead_zone=1900), FlashContent(lines=7, dead_zone=1900)
MS = 1_000_000


@pytest.fixture
def page() -> PageWrite:
    return PageWrite(BEFORE, AFTER, 0, Random(1))


def test_a_write_takes_65_to_116_ms_of_which_the_processor_is_halted_for_20_to_40() -> None:
    for seed in range(100):
        page = PageWrite(BEFORE, AFTER, 5 * MS, Random(seed))
        assert 63 * MS < page.filled_ns - 5 * MS < 116 * MS
        begin_ns = 5 * MS + PREPARE_NS
        assert page.halts_until_ns(begin_ns - 1) == begin_ns - 1
        assert 20 * MS <= page.halts_until_ns(begin_ns) - begin_ns <= 40 * MS
        assert page.halts_until_ns(page.erased_ns) == page.erased_ns


def test_power_that_fails_leaves_what_was_there_or_what_it_is_sold_with_or_erased_values(
    page: PageWrite,
) -> None:
    assert page.left(PREPARE_NS - 1) == BEFORE
    assert page.left(PREPARE_NS) == page.left(page.erased_ns - 1) == FlashContent()
    nothing = page.left(page.erased_ns)
    assert (nothing.motor_type, nothing.lines) == (0xFF, 0xFFFF)
    assert page.left(page.erased_ns + 5 * MS) == page.left(page.filled_ns) == AFTER
    # The gains are the last ones, as on the firmware.
    gains_lack = page.left(page.erased_ns + 3 * MS)
    assert gains_lack.lines == AFTER.lines
    assert (gains_lack.p, gains_lack.d) != (AFTER.p, AFTER.d)


def test_some_moment_leaves_each_share_of_the_values(page: PageWrite) -> None:
    random = Random(2)
    left = [page.left(page.some_moment_ns(random)) for _ in range(200)]
    assert FlashContent() in left
    assert {content.lines for content in left} == {11, 7, 0xFFFF}
