"""Lines that damage bytes, on virtual time: they are blamed, and no wheel."""

from __future__ import annotations

import pytest
from tuning_bench import TuningBench

from yahboomd.core.errors import BoardError
from yahboomd.simulation.options import ImpairmentOptions
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.tune.stand import Stand


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@pytest.mark.parametrize("damage", ["loss", "corruption"])
@on_virtual_time
async def test_a_line_that_damages_bytes_is_blamed_not_a_wheel(dialect, damage) -> None:
    bench = TuningBench(dialect=dialect)

    async def work() -> None:
        async with Stand.open(bench.link.open, bench.link.clock, bench.config) as stand:
            bench.link.robot.impairments.change(**{damage: 0.05})
            while True:
                await stand.step(0.4, 1.0)

    with pytest.raises(BoardError, match=r"^/dev/simulated: the line .* Check the USB cable"):
        await work()


@pytest.mark.nightly
@pytest.mark.cases(1)
@pytest.mark.parametrize(("corruption", "seeds"), [(0.0002, 4), (0.0005, 3), (0.002, 3)])
@pytest.mark.parametrize("dialect", ["polled", "streamed"])
def test_over_a_line_that_garbles_bytes_figures_are_right_or_the_line_is_blamed(
    dialect, corruption, seeds
) -> None:
    @on_virtual_time
    async def tune(seed: int) -> tuple[str, list[float | None]]:
        line = ImpairmentOptions(corruption=corruption)
        options = {"seed": seed, "impairments": line}
        procedure = TuningBench("520", dialect=dialect, options=options).procedure()
        blamed = ""
        try:
            await procedure.examine()
        except BoardError as error:
            blamed = error.message
        return blamed, [each.before.settling_s for each in procedure.result.wheels if each.before]

    for seed in range(seeds):
        blamed, settling_s = tune(seed)
        if blamed:
            assert blamed.startswith("/dev/simulated: the line to the board loses or alters bytes")
        else:
            assert settling_s == pytest.approx([0.41, 0.41], abs=0.04)
