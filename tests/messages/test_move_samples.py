"""The golden samples of `yahboomd moves`."""

from __future__ import annotations

import msgspec
import pytest

from make.schema_files.move_samples import SAMPLES
from yahboomd.client import move_messages
from yahboomd.client.move_messages import Move
from yahboomd.core.messages.codecs import encode
from yahboomd.core.model import Pose2d
from yahboomd.moves.motion.base_limits import Base
from yahboomd.moves.motion.move_plan import plan
from yahboomd.moves.motion.speed_profile import SpeedLimits

LIMITS = SpeedLimits(speed=1.0, acceleration=1.0, braking=2.0, jerk=10.0)


def test_there_is_one_of_each_message() -> None:
    defined = {
        name
        for name, each in vars(move_messages).items()
        if isinstance(each, type)
        and issubclass(each, msgspec.Struct)
        and each.__module__ == move_messages.__name__
    }
    assert defined - SAMPLES.keys() == {"Move"}


@pytest.mark.parametrize("name", SAMPLES)
def test_each_is_read_back_as_it_was_from_both_encodings(name: str) -> None:
    sample = SAMPLES[name]
    message = type(sample)
    assert msgspec.json.decode(encode(sample, "json"), type=message) == sample
    assert msgspec.msgpack.decode(encode(sample, "msgpack"), type=message) == sample


def test_the_moves_of_the_sample_can_be_driven() -> None:
    moves: tuple[Move, ...] = SAMPLES["MoveRequest"].moves  # type: ignore[attr-defined]
    legs = plan(moves, Pose2d(), Base(way=LIMITS, turn=LIMITS))
    assert {leg.move for leg in legs} == set(range(len(moves)))
