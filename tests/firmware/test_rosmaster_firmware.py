"""The first stop on a port and stored gains, on the Rosmaster board's firmware 3.5.1."""

from __future__ import annotations

import pytest
from vendor_firmware import rosmaster, rosmaster_missing

from yahboomd.core.protocol.dialect import Setting
from yahboomd.core.protocol.first_words import FIRST_WORDS
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.rosmaster.functions import (
    AUTO_REPORT,
    IN_MEMORY,
    MOTOR_PID,
    TABLE,
    request,
)
from yahboomd.core.protocol.rosmaster.packets import PacketFramer, frame
from yahboomd.core.protocol.settings import BoardSettings, writes

pytestmark = pytest.mark.skipif(bool(rosmaster_missing()), reason=rosmaster_missing())

OWN = DIALECTS["rosmaster"]


@pytest.mark.parametrize("car_type", range(7))
@pytest.mark.parametrize(
    "command", [OWN.outputs((2200,) * 4, {}), OWN.speeds((300, 0, 0))], ids=["outputs", "speed"]
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


def test_gains_that_were_written_are_not_written_again() -> None:
    board = rosmaster(1, 1)

    def run() -> None:
        # It is deaf while it writes its flash.
        for _ in range(200):
            board.ms()

    board.put(frame(AUTO_REPORT, 0, IN_MEMORY))
    run()
    for thousandths in (1, 60, 250, 251, 500, 502, 800, 1003, *range(2000, 10_000, 501)):
        want: BoardSettings = {"pid": (thousandths / 1000.0,) * 3}
        for write in writes(TABLE, {"pid": (0.0, 0.0, 0.0)}, want):
            board.put(write.frame)
            run()
        board.get()
        board.put(request(MOTOR_PID, 1))
        run()
        answers = map(OWN.decode, PacketFramer().feed(board.get()))
        (shown,) = (each for each in answers if isinstance(each, Setting))
        assert writes(TABLE, {"pid": shown.value}, want) == ()
