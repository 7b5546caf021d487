"""The steps of a tuning, without terminal and pictures: measure, suggest, store, measure again."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Awaitable, Callable
from functools import partial
from typing import TypeAlias, TypeVar

import msgspec

from yahboomd.core.clock import Clock
from yahboomd.core.config import Config
from yahboomd.core.errors import BoardError, PortLost, YahboomdError
from yahboomd.core.link import storing
from yahboomd.core.link.port import Opener
from yahboomd.core.link.vital_tasks import undisturbed
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.settings import VERSION, BoardSettings, SettingWrite
from yahboomd.tools.port.guarded import LeftTurning, LostInMotion
from yahboomd.tools.tune.estimates import dead_zone, loop_model, step_response
from yahboomd.tools.tune.estimates.loop_model import Gains, Step
from yahboomd.tools.tune.estimates.step_response import StepFigures
from yahboomd.tools.tune.estimates.suggestion import suggest
from yahboomd.tools.tune.stand import Stand
from yahboomd.tools.tune.traces import TICK_S, Traces, odd_one
from yahboomd.tools.tune.tuning_result import (
    DEAD_ZONE,
    GAINS,
    Result,
    WheelTuning,
    no_worse,
    rank_of,
    tuned_of,
    worst,
)
from yahboomd.tools.tune.wheel_faults import WheelFault

T = TypeVar("T")

Figures: TypeAlias = list[StepFigures | None]

HOLD_S = 1.5
REPEATS = 2
"""Repetitions of each step, in each direction."""

SPARE_STEPS = 8
"""The most steps that are repeated because readings came late or damaged."""

MOST_WRITES = 3
"""The most values written. Each is measured alone and undone by one more, so the last is kept."""

SLOWER = 1.5
UNSEEN = 0.6
"""The least time constant of a closed loop, in times between two readings of the counts."""

TRUSTED = 0.06
"""A model that leaves more than this share of a step unexplained suggests no gains."""

TRIAL = Gains(0.2, 0.02, 0.0)
SOFTER = 0.2
HARDER = 5.0
STICKS = 1.45
"""A wheel that begins to turn at this many times the output at which it stops hides its motor."""

FOLLOWS = 0.3
"""A wheel that reaches less than this share of a step shows too little of its motor."""

TOO_SMALL_SHARE = 0.2
"""A wheel that begins to turn at this share of full output above the stored dead zone may stand in
a step: the board's loop gives 2000 of 3600 beyond that dead zone, and needs time for it."""

DEAD_ZONE_OFF_SHARE = 0.012
GAP_LEFT = 0.05
FASTEST_M_S = 1.5


Agree = Callable[[BoardSettings, Dialect], Awaitable[bool]]
"""Announces the values to be written; returns whether the person agrees."""

Save = Callable[[Dialect, BoardSettings], None]
"""Saves the board's settings to disk, before the first write."""


class Measured(msgspec.Struct, frozen=True):
    """What a board stores, and how its wheels follow."""

    figures: Figures
    stored: BoardSettings
    trial: bool = False

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """A sort key, the best first."""
        return rank_of(self.figures, trial=self.trial)


class Procedure:
    """One tuning.

    Args:
        speed_m_s: The speed of the steps; lowered if the board or the wheels are slower.

    Attributes:
        restored: The tuning ended early, and the board has its own values again.
    """

    def __init__(
        self,
        opener: Opener,
        clock: Clock,
        config: Config,
        *,
        speed_m_s: float,
        say: Callable[[str], None],
    ) -> None:
        self._opener = opener
        self._clock = clock
        self._config = config
        self._say = say
        self.result = Result(speed_m_s=speed_m_s)
        self.restored = False
        self._steps: list[list[Step]] = []
        self._dialect: Dialect | None = None
        self._stored: BoardSettings = {}
        self._count = 0.0

    async def examine(self, ready: Callable[[], None] = lambda: None) -> None:
        """Check each wheel, find its dead zone, and measure the steps of the stored gains.

        Args:
            ready: Called before a wheel turns if the board stores gains; raises if they could not
                be saved.

        Raises:
            BoardError: A wheel touches the ground, or does not do as it is commanded.
            LinkError: The port or the board cannot be used.
        """
        result = self.result
        async with Stand.open(self._opener, self._clock, self._config, self._say) as stand:
            dialect, settings = stand.dialect, stand.settings or {}
            self._dialect = dialect
            self._stored = {name: settings[name] for name in settings if name != VERSION}
            result.dialect, result.volts = dialect.name, stand.volts
            result.firmware = str(settings.get(VERSION) or "")
            result.speed_m_s = min(result.speed_m_s, 0.6 * stand.top_m_s)
            result.stored_before = result.stored_now = tuned_of(settings)
            result.wheels = [
                WheelTuning(name=motor.name, position=motor.position) for motor in stand.motors
            ]
            if dialect.settings:
                ready()
            if dialect.most_output:
                await self._ramps(stand)
            else:
                result.notes.append(
                    "This board cannot drive a motor without regulation: no dead zone is measured, "
                    "and only you can see whether the wheels are in the air."
                )
            figures = await self._measure(stand, "before")
            for wheel, each in zip(result.wheels, figures, strict=True):
                wheel.before = each
        if not dialect.settings:
            result.notes.append(
                f"A board of the {dialect.name} dialect stores no gains: nothing to suggest."
            )
        elif not dialect.loop_ns:
            result.notes.append("Nothing is known of this board's speed loop: no gains.")
        else:
            self._suggest()

    async def _ramps(self, stand: Stand) -> None:
        stores = DEAD_ZONE in self.result.stored_before
        how = "output slowly up and down" if stores else "output slowly up"
        for motor, wheel in zip(stand.motors, self.result.wheels, strict=True):
            turning, stopping = [], []
            for way in (1, -1):
                self._say(f"{motor.name}: {how}, {'forward' if way > 0 else 'backward'}")
                rise, fall = await self._repeated(
                    stand, partial(stand.ramp, motor, way, down=stores)
                )
                begins = dead_zone.turning_output(rise)
                assert begins is not None, "a rise ends when the wheel has turned"
                turning.append(begins)
                if fall:
                    stopping.append(dead_zone.stopping_output(fall))
            if max(turning) > self._too_small(stand.dialect):
                stand.may_stand = True
            wheel.turning_output = (turning[0], turning[1])
            wheel.stopping_output = (stopping[0], stopping[1]) if stopping else None

    def _too_small(self, dialect: Dialect) -> float:
        """The output above which the stored dead zone may be too small to start a wheel."""
        stored = self.result.stored_before.get(DEAD_ZONE)
        spare = TOO_SMALL_SHARE * dialect.most_output
        return stored + spare if isinstance(stored, int | float) else math.inf

    async def _measure(self, stand: Stand, name: str) -> list[StepFigures]:
        """Steps of all wheels together, forward and backward; the figures of their means."""
        speed_m_s = self.result.speed_m_s
        steps: list[Traces] = []
        spare = SPARE_STEPS
        while len(steps) < 2 * REPEATS:
            way = -1 if sum(step.speed_m_s for step in steps) > 0.0 else 1
            self._say(f"step {len(steps) + 1} of {2 * REPEATS}: {way * speed_m_s:+.2f} m/s")
            damages = stand.damages
            step = await self._repeated(
                stand, partial(stand.step, way * speed_m_s, HOLD_S), chances=1
            )
            damaged = stand.damages > damages or stand.noisy
            if (step.whole and not damaged) or not (spare or stand.damages):
                steps.append(step)
                if (
                    len(steps) == 2 * REPEATS
                    and (spare == SPARE_STEPS or (spare and stand.damages))
                    and (odd := odd_one(steps))
                ):
                    spare -= 1
                    steps.remove(odd)
                    self._say("a step went elsewhere than the others: once more")
            elif spare and not stand.noisy:
                spare -= 1
                why = "damaged on the line" if damaged else "held up, as on a busy computer"
                self._say(f"readings were {why}: once more")
            else:
                raise stand.line_fault()
        travels = [
            step_response.mean([step.travel_m[index] for step in steps])
            for index in range(len(stand.motors))
        ]
        traces = [step_response.speeds(travel, TICK_S) for travel in travels]
        self.result.traces[name] = traces
        unit = stand.units(speed_m_s) / speed_m_s
        self._count = stand.motors[0].metres_per_tick * unit
        gains = self.result.stored_now.get(GAINS)
        if isinstance(gains, tuple):
            apart = max(1, round(stand.ticks_apart_s / TICK_S))
            self._steps = self._steps or [[] for _ in travels]
            for own, travel in zip(self._steps, travels, strict=True):
                own.append(
                    Step(
                        gains=Gains(*gains),
                        target=speed_m_s * unit,
                        travel=[unit * each for each in travel],
                        apart=apart,
                    )
                )
        return [step_response.figures(trace, speed_m_s, TICK_S) for trace in traces]

    async def _repeated(
        self, stand: Stand, measure: Callable[[], Awaitable[T]], *, chances: int = 0
    ) -> T:
        """Measure, and repeat it if the line may have caused the fault of a wheel.

        Args:
            chances: The repetitions without visible damage: a garbled command leaves no trace.
        """
        excused = -chances
        while True:
            try:
                return await measure()
            except WheelFault as fault:
                if not await stand.excuses(excused):
                    raise
                excused += 1
                self._say(f"{fault.message} The line may have damaged a command: once more")

    # Suggesting.

    def _suggest(self, least_lambda_s: float = 0.0) -> None:
        """Fit the motors to all measured steps; suggest gains, or trial ones without a good fit."""
        result, dialect = self.result, self._dialect
        assert dialect is not None
        tick_s = dialect.loop_ns / 1e9
        target = self._steps[0][0].target
        fastest = target / result.speed_m_s * FASTEST_M_S
        models = []
        for wheel, steps in zip(result.wheels, self._steps, strict=True):
            found = loop_model.fit(steps, tick_s=tick_s, fastest=fastest)
            if found[1] > TRUSTED:
                # Steps with gains that made it chatter explain nothing; the latest may.
                found = loop_model.fit(steps[-1:], tick_s=tick_s, fastest=fastest)
            wheel.model, wheel.unexplained = found
            models.append(found[0])
        wanted: BoardSettings = {}
        stopping = [each for wheel in result.wheels for each in wheel.stopping_output or ()]
        stored = result.stored_now.get(DEAD_ZONE)
        if stopping and isinstance(stored, int | float):
            measured = dead_zone.made_up_for(stopping, dialect.most_output)
            if abs(measured - stored) > DEAD_ZONE_OFF_SHARE * dialect.most_output:
                wanted[DEAD_ZONE] = measured
                most = GAP_LEFT * target
                models = [msgspec.structs.replace(it, gap=min(it.gap, most)) for it in models]
        unexplained = max(wheel.unexplained or 0.0 for wheel in result.wheels)
        if unexplained > TRUSTED or not self._follows:
            result.expected = None
            wanted[GAINS] = self._trial()
        else:
            result.expected = suggest(
                models,
                target,
                tick_s=tick_s,
                count=self._count,
                # Readings do not show motion between them.
                least_lambda_s=max(least_lambda_s, UNSEEN * TICK_S * self._steps[0][0].apart),
            )
            gains = result.expected.gains
            wanted[GAINS] = (gains.p, gains.i, gains.d)
        result.suggested = wanted

    def _trial(self) -> tuple[float, float, float]:
        """Gains to measure the motors with, after steps that explained nothing."""
        last = self._steps[0][-1].gains
        if not self._follows or self._sticks:
            return max(TRIAL.p, HARDER * last.p), max(TRIAL.i, HARDER * last.i), 0.0
        return round(SOFTER * last.p, 3), round(SOFTER * last.i, 3), 0.0

    @property
    def _follows(self) -> bool:
        """Whether every wheel comes near the latest step by its end."""
        return all(
            steps[-1].travel[-1] - steps[-1].travel[-11] > 10 * TICK_S * FOLLOWS * steps[-1].target
            for steps in self._steps
        )

    @property
    def _sticks(self) -> bool:
        """Whether a wheel at rest needs so much more output that a step begins with a leap."""
        return any(
            min(wheel.turning_output) > STICKS * max(wheel.stopping_output)
            for wheel in self.result.wheels
            if wheel.turning_output and wheel.stopping_output
        )

    # Storing.

    async def store(self, agree: Agree, save: Save) -> bool:
        """Store the suggestion and measure it; suggest again if it is not good enough.

        The best measured values are stored at the end. The board's own values are restored if none
        is better, and also if the tuning ends early while it has the port.

        Returns:
            Whether the board stores better values now.

        Raises:
            BoardError: As :meth:`examine`, and if the board does not store the values.
        """
        result = self.result
        assert self._dialect is not None
        if not await agree(result.suggested, self._dialect):
            result.notes.append("Nothing was stored.")
            return False
        # Save all settings: if power fails within a write, the board may lose the others too.
        save(self._dialect, self._stored)
        before: Figures = [wheel.before for wheel in result.wheels]
        best = Measured(before, result.stored_before)
        try:
            for field in self._order():
                try_it = self._try_gains if field == GAINS else self._try_dead_zone
                best = await try_it(best)
                if best.stored != result.stored_now:
                    await self._write(best.stored)
        except (PortLost, LostInMotion, LeftTurning):
            raise
        except BaseException:
            await undisturbed(self._restore())
            raise
        if best.figures is before:
            result.notes.append("No values were better: the board has its own again.")
            return False
        for wheel, each in zip(result.wheels, best.figures, strict=True):
            wheel.after = each
        return True

    def _order(self) -> list[str]:
        """The fields to store. A dead zone that hides the motors comes before the gains."""
        fields = [field for field in (GAINS, DEAD_ZONE) if field in self.result.suggested]
        _, settling_s = worst([wheel.before for wheel in self.result.wheels])
        chatters = self.result.expected is None and self._follows and not self._sticks
        return fields[::-1] if (settling_s is None or self._sticks) and not chatters else fields

    async def _try_gains(self, best: Measured) -> Measured:
        """Store gains and measure them, and others if they are not good enough."""
        result = self.result
        while self._may_write:
            trial = result.expected is None
            await self._write({GAINS: result.suggested[GAINS]})
            after = await self._measured(trial=trial)
            if after.rank < best.rank:
                best = after
                if not trial and not after.rank[0]:
                    break
            if self._may_write:
                self._suggest(result.expected.lambda_s * SLOWER if result.expected else 0.0)
        return best

    async def _try_dead_zone(self, best: Measured) -> Measured:
        """Store the dead zone, and keep it unless the wheels follow worse."""
        result = self.result
        if not self._may_write:
            result.notes.append(
                f"The dead zone of {result.suggested[DEAD_ZONE]} is not stored, since "
                f"{result.writes} values were written: tune again to store it."
            )
            return best
        await self._write({DEAD_ZONE: result.suggested[DEAD_ZONE]})
        self._steps = []
        after = await self._measured(trial=best.trial)
        if not no_worse(after.figures, best.figures):
            return best
        if best.stored == result.stored_before and self._may_write:
            # The motors show more of themselves, and gains come next.
            stored = {DEAD_ZONE: result.suggested[DEAD_ZONE]}
            self._suggest()
            result.suggested = stored | result.suggested
        return after

    @property
    def _may_write(self) -> bool:
        """Whether a value may be written that one more write can undo."""
        return self.result.writes + 2 <= MOST_WRITES

    async def _measured(self, *, trial: bool) -> Measured:
        async with Stand.open(self._opener, self._clock, self._config, self._say) as stand:
            figures: Figures = [*await self._measure(stand, "after")]
        return Measured(figures, self.result.stored_now, trial=trial)

    async def _restore(self) -> None:
        """Restore the board's own values; errors are suppressed in favour of the tuning's error."""
        with contextlib.suppress(YahboomdError):
            await self._write(self.result.stored_before)
            self.restored = True

    async def _write(self, want: BoardSettings) -> None:
        result = self.result
        outcome = await storing.store(self._opener, self._clock, want, _Said(self._say))
        result.writes += sum(step.attempts for step in outcome.steps)
        result.resets += sum(step.write.resets for step in outcome.steps)
        result.stored_now = tuned_of(outcome.has)
        if not outcome.complete:
            step = outcome.steps[-1]
            answer = f" ({step.answer!r})" if step.answer else ""
            raise storing_failed(step.write.text, answer)


class _Said(storing.Progress):
    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say

    def begins(
        self,
        dialect: Dialect,  # noqa: ARG002
        writes: tuple[SettingWrite, ...],
        had: BoardSettings,  # noqa: ARG002
    ) -> None:
        restart = ", which restarts the board" if any(each.resets for each in writes) else ""
        names = "; ".join(each.text for each in writes) or "nothing that differs"
        self._say(f"writing to the board's flash{restart}: {names}")

    def stored(self, step: storing.StoringStep, has: BoardSettings) -> None:  # noqa: ARG002
        self._say(f"{step.write.text}: {step.outcome}")


def storing_failed(what: str, answer: str) -> Exception:
    """The error of a value that the board does not store."""
    return BoardError(
        f"The board does not store {what}{answer}.",
        remedy="`yahboomd tune --undo` restores its own values.",
    )
