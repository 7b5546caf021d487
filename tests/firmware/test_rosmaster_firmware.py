"""The first stop on a port, on the firmware 3.5.1 of the Rosmaster board."""

from __future__ import annotations

import pytest
from vendor_firmware import rosmaster, rosmaster_missing

from yahboomd.protocol.first_words import FIRST_WORDS
from yahboomd.protocol.registry import DIALECTS

pytestmark = pytest.mark.skipif(bool(rosmaster_missing()), reason=rosmaster_missing())

OWN = DIALECTS["rosmaster"]


@pytest.mark.parametrize("car_type", range(7))
@pytest.mark.parametrize(
    "command", [OWN.outputs((2200,) * 4), OWN.speeds((300, 0, 0))], ids=["outputs", "speed"]
)
def test_the_first_words_stop_wheels_whatever_car_type_is_stored(
    car_type: int, command: bytes
) -> None:
    known = car_type not in {0, 3}
    board = rosmaster(car_type if known else 1, car_type)

    def run(milliseconds: int) -> float:
        for _ in range(milliseconds):
            board.ms()
        return max(map(abs, board.truth()["wheel"]))

    run(200)
    board.put(command)
    # Such a board obeys outputs alone.
    assert (run(1500) > 0.25) == (known or command[3] == 0x10)
    board.put(FIRST_WORDS["rosmaster"])
    assert run(80) < 0.03
    assert run(1000) == 0.0
