"""Tunings of simulated boards on virtual time: measured, suggested and written values."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import msgspec
import pytest
from tuning_bench import TuningBench

from yahboomd.core.errors import BoardError
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.options import PLAIN_GAIN
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.tune.estimates.step_response import StepFigures
from yahboomd.tools.tune.procedure import MOST_WRITES, Procedure
from yahboomd.tools.tune.stand import Stand
from yahboomd.tools.tune.tuning_result import no_worse
from yahboomd.tools.tune.wheel_faults import WheelFault


def writes(bench: TuningBench) -> list[bytes]:
    frames = [frame for port in bench.link.ports for frame in port.frames]
    return [frame for frame in frames if frame.startswith((b"$MPID", b"$deadzone"))]


# Every motor from every start: `make tuning`.
@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("profile", "start", "most_writes"),
    [("310", "too soft, no dead zone stored", 3), ("tt", "oscillates", 2), ("r2", "too soft", 2)],
)
@on_virtual_time
async def test_gains_with_5_percent_of_overshoot_settle_30_percent_sooner(
    profile, start, most_writes
) -> None:
    bench = TuningBench(profile, start)
    before = await bench.true_step()
    result = await bench.tune()
    after = await bench.true_step()
    assert after.overshoot <= 0.05
    assert after.settling_s is not None
    assert before.settling_s is None or after.settling_s <= 0.7 * before.settling_s
    assert result.writes <= most_writes
    # The measured values are the true ones, to the ticks of a slope.
    worst = max(wheel.after.settling_s for wheel in result.wheels)
    assert worst == pytest.approx(after.settling_s, abs=0.1)


@pytest.mark.nightly
@on_virtual_time
async def test_gains_that_chatter_are_followed_by_trial_ones_which_show_the_motors() -> None:
    bench = TuningBench("520", "chatters")
    result = await bench.tune()
    assert (await bench.true_step()).overshoot <= 0.05
    assert result.expected is not None
    assert result.writes == len(writes(bench)) <= MOST_WRITES


FLOORS = {"friction_scales": (1.0, 1.1), "loop_gain": PLAIN_GAIN}


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("friction", "stick", "start"),
    [
        (1440, 1.6, "as sold"),
        *(
            pytest.param(friction, stick, start, marks=pytest.mark.nightly)
            for friction in (1440, 1950)
            for stick in (1.0, 1.3, 1.6)
            for start in ("as sold", "oscillates", "chatters")
        ),
    ],
)
@on_virtual_time
async def test_wheels_that_stick_follow_no_worse_after_three_writes_at_most(
    friction: int, stick: float, start: str
) -> None:
    options = FLOORS | {"motor_dead_zone": friction, "sticks": (stick,)}
    bench = TuningBench("520", start, options=options)
    before = await bench.true_step()
    result = await bench.tune()
    after = await bench.true_step()
    assert no_worse([after], [before])
    assert result.writes == len(writes(bench)) <= MOST_WRITES
    # Below the moving friction of every wheel, and near to it.
    assert friction - 130 <= result.suggested["deadzone"] <= friction


@on_virtual_time
async def test_a_far_too_small_dead_zone_is_found_where_a_wheel_cannot_start() -> None:
    # One wheel turns in the first step; the other one needs more than the loop gives.
    options = FLOORS | {"motor_dead_zone": 1440, "sticks": (1.3,)}
    bench = TuningBench("520", "no dead zone stored", options=options)
    with pytest.raises(WheelFault, match="stood while another wheel turned"):
        await bench.true_step()
    result = await bench.tune()
    assert 1440 - 130 <= result.stored_now["deadzone"] <= 1440
    assert result.writes == len(writes(bench)) <= MOST_WRITES
    assert (await bench.true_step()).settling_s is not None


@pytest.mark.cases(1)
@pytest.mark.parametrize("worse", ["gains", "dead zone"])
@on_virtual_time
async def test_a_value_with_which_wheels_follow_worse_is_taken_back_by_the_third_write(
    worse: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = TuningBench("520", "as sold")
    procedure = bench.procedure()
    await procedure.examine()
    result = procedure.result
    before, steps = dict(result.stored_before), [wheel.before for wheel in result.wheels]
    slow = [msgspec.structs.replace(step, settling_s=9.0) for step in steps]
    soon = [msgspec.structs.replace(step, settling_s=0.1) for step in steps]
    measured = [slow, slow] if worse == "gains" else [soon, slow]

    async def figures(_stand: Stand, _name: str) -> list[StepFigures]:
        return measured.pop(0)

    monkeypatch.setattr(procedure, "_measure", figures)
    monkeypatch.setattr(procedure, "_suggest", lambda _least=0.0: None)
    gains = result.suggested["pid"]
    assert await procedure.store(bench.agree, bench.save) == (worse == "dead zone")
    assert result.writes == len(writes(bench)) == MOST_WRITES
    assert result.stored_now == (before if worse == "gains" else before | {"pid": gains})


@pytest.mark.nightly
@on_virtual_time
async def test_where_no_gains_are_better_the_board_has_its_own_again(monkeypatch) -> None:
    bench = TuningBench("520", "as sold")
    procedure = bench.procedure()
    await procedure.examine()
    # Suggestions of a wrong model: they settle later than the board's own gains.
    monkeypatch.setattr(
        Procedure, "_suggest", lambda self, _least=0.0: self.result.suggested.update(pid=BAD)
    )
    procedure.result.suggested = {"pid": BAD}
    before = dict(procedure.result.stored_before)
    assert not await procedure.store(bench.agree, bench.save)
    assert procedure.result.stored_now == before
    assert "the board has its own again" in "".join(procedure.result.notes)


BAD = (0.05, 0.01, 0.0)


@on_virtual_time
async def test_a_board_that_stores_no_gains_is_measured_and_says_so() -> None:
    bench = TuningBench("520", dialect="polled")
    result = await bench.tune()
    assert all(wheel.before.settling_s is not None for wheel in result.wheels)
    assert result.suggested == {}
    assert any("stores no gains" in note for note in result.notes)
    assert any("no dead zone is measured" in note for note in result.notes)


@pytest.mark.nightly
@on_virtual_time
async def test_steps_whose_readings_were_held_up_are_measured_again() -> None:
    bench = TuningBench("520", "oscillates")
    procedure = bench.procedure()

    async def busy() -> None:
        """The line brings nothing for a while, once."""
        while "step 2 of 4: -0.40 m/s" not in bench.said:
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.3)
        bench.link.robot.hold(bench.link.clock.now_ns(), 0.15)

    held = asyncio.ensure_future(busy())
    await procedure.examine()
    await held
    assert bench.said.count("step 2 of 4: -0.40 m/s") == 2
    assert procedure.result.wheels[0].before.overshoot == pytest.approx(0.35, abs=0.12)


class Garbling:
    """Alters answers of a polled board while its wheels turn."""

    def __init__(self, bench: TuningBench) -> None:
        self.bench = bench
        self.answers = 0
        self.altered: list[bytes] = []
        self._board = bench.link.robot.board
        self._emit, self._board.emit = self._board.emit, self._pass
        self.alter = lambda _number, data: data

    def _pass(self, data: bytes, now_ns: int) -> None:
        if max(map(abs, self.bench.link.rim_speeds)) > 0.3:
            self.answers += 1
            altered = self.alter(self.answers, data)
            if altered != data:
                self.altered.append(data)
            data = altered
        self._emit(data, now_ns)


@pytest.mark.nightly
@on_virtual_time
async def test_a_count_with_an_altered_digit_accuses_no_wheel_and_alters_no_figure() -> None:
    bench = TuningBench("520", dialect="polled")
    garbling = Garbling(bench)
    # Far backward, far ahead, and at last a damage that shows.
    amiss = {20: b"$data:-", 50: b"$data:9", 80: b"$data:8", 120: b"$daXa:"}
    garbling.alter = lambda number, data: data.replace(b"$data:", amiss.get(number, b"$data:"))
    procedure = bench.procedure()
    await procedure.examine()
    assert len(garbling.altered) == len(amiss)
    for wheel in procedure.result.wheels:
        assert wheel.before.overshoot < 0.01
        assert wheel.before.settling_s == pytest.approx(0.42, abs=0.02)


@pytest.mark.cases(1)
@pytest.mark.parametrize("damaged", [False, True])
@pytest.mark.parametrize(
    ("garbled", "words"),
    [
        (b",0,-0", "right (M3) stood while another wheel turned"),
        (b",0,-3", "a step went elsewhere than the others"),
    ],
)
@on_virtual_time
async def test_a_step_whose_command_the_line_may_have_garbled_is_measured_again(
    garbled, words, damaged
) -> None:
    bench = TuningBench("520", dialect="polled")
    garbling = Garbling(bench)
    if damaged:
        garbling.alter = lambda number, data: data.replace(b"$d", b"$X") if number == 60 else data

    def garble(data: bytes) -> bytes:
        second = "step 2 of 4: -0.40 m/s"
        if bench.said and bench.said[-1] == second and bench.said.count(second) == 1:
            return data.replace(b",0,-4", garbled)
        return data

    bench.link.on_write = garble
    procedure = bench.procedure()
    await procedure.examine()
    assert [words in line and "once more" in line for line in bench.said].count(True) == 1
    assert all(wheel.before.overshoot < 0.01 for wheel in procedure.result.wheels)
    for wheel in procedure.result.wheels:
        assert wheel.before.steady_error == pytest.approx(0.0, abs=0.02)


class Ends(list[str]):
    """Ends a tuning when the steps with its first gains begin."""

    def __init__(self, end: Callable[[], object]) -> None:
        super().__init__()
        self._end = end

    def append(self, words: str) -> None:
        super().append(words)
        if words.startswith("step 2") and any("stored" in each for each in self):
            self._end()


@pytest.mark.cases(1)
@pytest.mark.parametrize("how", ["fault", "signal"])
@on_virtual_time
async def test_a_tuning_that_ends_early_leaves_the_board_as_it_was_saved(
    how: str,
) -> None:
    bench = TuningBench("520", "oscillates")
    before = bench.link.robot.board.flash
    task = asyncio.current_task()
    assert task is not None
    written: list[object] = []

    def end() -> None:
        written.append(bench.link.robot.board.flash)
        if how == "signal":
            task.cancel("SIGINT")
        else:
            now_ns = bench.link.clock.now_ns()
            bench.link.robot.set_faults("left", FAULTS["encoder-dead"], now_ns=now_ns)

    def save(_dialect, settings):
        assert writes(bench) == []
        bench.saved.append(settings)

    bench.said = Ends(end)
    procedure = bench.procedure()
    await procedure.examine()
    with pytest.raises((BoardError, asyncio.CancelledError)):
        await procedure.store(bench.agree, save)
    assert procedure.result.stored_before == {"pid": (0.3, 0.6, 0.0), "deadzone": 1600}
    whole = {"motor_type": 1, "lines": 11, "ratio": 30, "wheel_diameter_mm": 67.0}
    assert bench.saved == [procedure.result.stored_before | whole]
    announced = [line for line in bench.said if line.startswith("writing to the board's flash")]
    assert announced[0] == (
        "writing to the board's flash, which restarts the board: gains P, I, D "
        + ",".join(f"{gain:.3f}" for gain in bench.asked[0]["pid"])
    )
    task.uncancel()
    assert written[0] != before
    assert procedure.restored
    assert bench.link.robot.board.flash == before
    assert not any(bench.link.rim_speeds)
