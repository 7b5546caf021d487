"""A banner, an answer, and lines that may be either."""

from __future__ import annotations

import pytest

from yahboomd.core.link.start_notices import LATEST_ANSWER_NS, StartNotices
from yahboomd.core.protocol.four_channel.texts import decode_text

ANSWER = ("read_flash:OK!", "Motor_Version:1.7.3", "Motor_type:1", "Dead_Zone:1600")


@pytest.mark.parametrize(
    ("lines", "notices"),
    [
        (ANSWER, ["none"] * 4),
        (ANSWER + ANSWER, ["none"] * 8),
        (ANSWER[1:], ["unclear", "none", "none"]),
        (("Motor_Version:1.7.3",), ["unclear"]),
        (("Reset MCUMotor_Version:1.7.3",), ["start"]),
        (("read_flash:OK!", "Reset MCUMotor_Version:1.7.3"), ["none", "start"]),
        # An answer whose version was lost does not hide the banner that comes later.
        ((ANSWER[0], *ANSWER[2:], "Motor_Version:1.7.3"), ["none"] * 3 + ["unclear"]),
        (("$MAll:1,2Motor_Version:1.7.3",), ["unclear"]),
    ],
)
def test_only_a_version_behind_the_head_of_an_answer_is_certainly_none(
    lines: tuple[str, ...], notices: list[str]
) -> None:
    found = StartNotices()
    found.asked(0)
    assert [found.judge(decode_text(line), LATEST_ANSWER_NS) for line in lines] == notices


def test_a_version_alone_is_a_start_where_no_answer_can_be_on_its_way() -> None:
    found = StartNotices()
    alone = decode_text("Motor_Version:1.7.3")
    assert found.judge(alone, 1) == "start"
    found.asked(5)
    assert found.judge(alone, 5 + LATEST_ANSWER_NS) == "unclear"
    assert found.judge(alone, 6 + LATEST_ANSWER_NS) == "start"
