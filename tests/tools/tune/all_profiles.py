"""Every motor profile from every bad start, on virtual time: by `make tuning`."""

from __future__ import annotations

import pytest
from floor_options import floor_options
from tuning_bench import PROFILES, STARTS, TuningBench

from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.tune.estimates.step_response import StepFigures


def settled(found: StepFigures) -> str:
    return "never" if found.settling_s is None else f"{found.settling_s:.2f} s"


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("start", STARTS)
@on_virtual_time
async def test_gains_with_6_percent_of_overshoot_settle_30_percent_sooner(profile, start) -> None:
    bench = TuningBench(profile, start, options=dict(floor_options()))
    before = await bench.true_step()
    result = await bench.tune()
    after = await bench.true_step()
    gains = ", ".join(f"{gain:g}" for gain in result.stored_now["pid"])
    print(
        f"| {profile} | {start} | {before.overshoot:.0%} | {settled(before)} | "
        f"{after.overshoot:.1%} | {settled(after)} | {gains} | {result.writes} |"
    )
    assert after.overshoot <= 0.06
    assert after.settling_s is not None
    assert before.settling_s is None or after.settling_s <= 0.7 * before.settling_s
    assert result.writes <= 3
