"""Samples and answers as they are on the bus."""

from __future__ import annotations

import daemon_samples
import msgspec
import pytest

from yahboomd.core.bus.keys import POSE
from yahboomd.core.errors import Refused
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import PoseSample, ServiceReply
from yahboomd.tools.robot.on_bus import newest, one_line


class Asked:
    """A robot whose daemons give these answers."""

    def __init__(self, *payloads: bytes) -> None:
        self.payloads = payloads

    async def ask(self, key: str) -> list[bytes]:
        assert key == POSE
        return list(self.payloads)


POSE_PAYLOAD = encode(daemon_samples.pose(), "json")


async def test_the_newest_sample_comes_with_its_payload() -> None:
    found = await newest(Asked(POSE_PAYLOAD), POSE, PoseSample)
    assert found == (POSE_PAYLOAD, daemon_samples.pose())


async def test_a_sample_that_there_is_not_yet_is_refused_in_the_daemons_words() -> None:
    reply = encode(ServiceReply(success=False, message="There is no pose yet."), "json")
    with pytest.raises(Refused, match=r"There is no pose yet\."):
        await newest(Asked(reply), POSE, PoseSample)


async def test_a_second_daemon_is_named_and_the_first_one_counts(capsys) -> None:
    other = encode(daemon_samples.pose(x=9.0), "json")
    payload, _ = await newest(Asked(POSE_PAYLOAD, other), POSE, PoseSample)
    assert payload == POSE_PAYLOAD
    assert "2 daemons answer" in capsys.readouterr().err


def test_both_encodings_are_one_line_of_the_same_json() -> None:
    spaced = msgspec.json.format(POSE_PAYLOAD, indent=2)
    packed = encode(daemon_samples.pose(), "msgpack")
    assert msgspec.json.decode(one_line(spaced)) == msgspec.json.decode(one_line(packed))
    assert "\n" not in one_line(spaced)
