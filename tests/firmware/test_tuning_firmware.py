"""`tune` on the vendor's firmware, whose speed loop and flash are its own."""

from __future__ import annotations

import pytest
from tuning_bench import TuningBench
from vendor_firmware import KINDS, MOTORS, ON_THE_FIRMWARE, STICKING, of_all

from yahboomd.simulation.virtual_time import on_virtual_time

pytestmark = ON_THE_FIRMWARE


@pytest.mark.parametrize("motor", [*of_all(MOTORS, 3, 4), *STICKING])
@on_virtual_time
async def test_each_motor_follows_better_after_three_writes_at_most(motor: str) -> None:
    result = await TuningBench(options=KINDS[motor]).tune()
    for wheel in result.wheels:
        assert wheel.before is not None
        assert wheel.after is not None
        assert wheel.before.settling_s is not None
        assert wheel.after.settling_s is not None
        assert wheel.after.settling_s < 0.75 * wheel.before.settling_s
    assert result.writes <= 3
