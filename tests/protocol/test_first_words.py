from __future__ import annotations

from yahboomd.core.protocol.first_words import FIRST_WORDS, SPACING_S
from yahboomd.core.protocol.registry import DIALECTS, connect_spacing_ns, connect_stop


def test_the_first_words_are_what_the_dialects_say_of_themselves():
    assert list(FIRST_WORDS) == list(DIALECTS)
    assert [resync + stop for resync, stop in connect_stop()] == list(FIRST_WORDS.values())
    assert connect_spacing_ns() == SPACING_S * 1e9
