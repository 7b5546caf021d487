"""The guard's decisions, in every order in which owner, port, board and other programs can act.

Small models of them are explored together with the machine to a fixed point, in ticks of its
period. Then each rule of the machine is taken out, and the exploration has to find that.
"""

from __future__ import annotations

import inspect
import types
from collections import deque
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import pytest

from yahboomd.tools.port import guard_law as guard
from yahboomd.tools.port.guard_law import Limits

PROMISE = 2
LIMITS = Limits(
    repeat=1, late=1, patience=1, surest_after=2, kill_after=3, numbers=2, answer=2, lend=2
)
LATE = 2 * LIMITS.late + 1
"""The guard is late again when its patience ends."""

STANDS_WITHIN = {
    # The promise, and patience with a guard that woke late.
    "turn": PROMISE + LIMITS.late,
    "runaway": PROMISE + LIMITS.surest_after,
    # An owner that promises, and does not obey a request.
    "asked": LIMITS.answer,
    # The owner is dead.
    "left": 1,
    # A frozen owner that alone has the port is killed first.
    "locked": PROMISE + LIMITS.kill_after,
}
"""Ticks until wheels stand, by what they do or what keeps the guard from them."""


ENDS_WITHIN = LIMITS.lend + 3
"""Ticks until the guard of a dead owner ends beside standing wheels: it waits, opens and looks."""


class World(NamedTuple):
    """All that can differ; the time is 0, and the guard's times are relative to it.

    Attributes:
        guard: Its state; None once it has ended.
        knows: The number of the stop that the owner acknowledged last.
        writes: The owner has read the number, and writes a motion next.
        promise: What is left of the owner's promise; None if it made none since the wheels stood.
        own: The owner's descriptor: none, good or dead.
        shared: The guard's.
        lock: Who has locked the device: both, guard, foreign or nothing.
        wheels: They stand, turn, or run away, which only the surest stop ends.
        request: The time that the owner has to engage the emergency stop that a program asked for;
            None if no program did, or it is engaged.
        latching: A disk has that emergency stop to write, and takes its time.
        lent: The time that the next owner has to take the port; None if it asked for none.
    """

    guard: Any
    owner: str = "runs"
    knows: int = 0
    writes: bool = False
    promise: int | None = None
    own: str = ""
    shared: str = ""
    lock: str = ""
    wheels: str = "stand"
    hears: bool = True
    plugged: bool = True
    request: int | None = None
    latching: bool = False
    lent: int | None = None


class Broken(Exception):
    """A law is."""


class Explorer:
    """The laws of a machine, in every world that can be reached."""

    def __init__(self, machine: Any) -> None:
        self.machine = machine
        # Events without data are equal tuples.
        self.step = lru_cache(None)(
            lambda _kind, event, state: machine.step(state, event, 0, LIMITS)
        )
        self.worst: dict[str, int] = {}

    def explore(self) -> int:
        """Look at all of them; their number."""
        first = World(self.machine.State())
        self.worst = dict.fromkeys(STANDS_WITHIN, 0)
        seen, new = {first}, deque([first])
        while new:
            world = new.popleft()
            self.check(world)
            for after in map(self.settled, self.successors(world)):
                if after not in seen:
                    seen.add(after)
                    new.append(after)
        return len(seen)

    def check(self, world: World) -> None:
        """While it runs, and the board hears, and the port can be had, the wheels soon stand.

        Unless their owner drives them: it lives, and knows of the newest stop.
        """
        state = world.guard
        if state is None:
            return
        if state.acknowledged and world.owner != "dead" and world.knows != state.stop:
            raise Broken(f"its stop is not acknowledged: {world}")
        if over(state):
            if not world.latching:
                raise Broken(f"it stays for nothing: {world}")
            return
        if world.owner != "dead" and world.promise is None and world.shared and not world.own:
            raise Broken(f"it keeps a port that its owner may need: {world}")
        disobeys = world.owner == "runs" and state.acknowledged
        if world.wheels == "stand" and state.owner == "ended":
            self.ends(world)
        if world.wheels == "stand" or (disobeys and world.request is None):
            return
        # From now on nothing is in its way.
        lock = "" if world.lock == "foreign" else world.lock
        world = world._replace(hears=True, plugged=True, lock=lock)
        kind = "locked" if world.own == "good" != world.shared else world.wheels
        if disobeys and kind == "turn" and world.shared == "good":
            kind = "asked"
        elif world.owner == "dead" and world.shared == "good":
            kind = "left"
        self.worst[kind] = max(self.worst[kind], self.ticks(world, STANDS_WITHIN[kind], 1))
        # However late the guard wakes.
        self.ticks(world, 2 * STANDS_WITHIN[kind], LATE)

    def ends(self, world: World) -> None:
        lock = "" if world.lock == "foreign" else world.lock
        world = world._replace(hears=True, plugged=True, lock=lock)
        for _ in range(ENDS_WITHIN):
            (world,) = self.feed(self.later(world, 1), self.machine.Tick(), lucky=True)
            if world.guard is None or over(world.guard):
                return
        raise Broken(f"it does not end: {world}")

    def ticks(self, world: World, most: int, time: int) -> int:
        """How often the guard wakes before the wheels stand."""
        for ticks in range(1, most + 1):
            if world.owner == "dead" and world.guard.owner != "ended":
                (world,) = self.feed(world, self.machine.Ended(), lucky=True)
            elif world.owner == "runs" and world.promise is not None:
                (world,) = self.feed(world, self.machine.Renewed(PROMISE), lucky=True)
            if world.wheels != "stand":
                (world,) = self.feed(self.later(world, time), self.machine.Tick(), lucky=True)
            if world.wheels == "stand":
                return ticks
        raise Broken(f"they turn on: {world}")

    def successors(self, world: World) -> Iterator[World]:
        """What can happen next."""
        if world.guard is None:
            return
        machine = self.machine
        for time in (1, LATE):
            yield from self.feed(self.later(world, time), machine.Tick())
        yield from self.by_owner(world)
        if world.owner != "dead":
            frozen = "frozen" if world.owner == "runs" else "runs"
            yield world._replace(owner=frozen)
            yield self.killed(world)
        elif world.guard.owner != "ended":
            yield from self.feed(world, machine.Ended())
        if world.request is None:
            yield from self.feed(world._replace(request=LIMITS.answer), machine.Asked())
        if world.latching:
            written = world._replace(latching=False, request=None)
            yield from self.feed(written, machine.Latched())
        if world.lent is None:
            lent = LIMITS.lend if world.guard.owner == "ended" else None
            yield from self.feed(world._replace(lent=lent), machine.Wanted())
        yield world._replace(hears=not world.hears)
        if world.plugged:
            own, shared = (fd and "dead" for fd in (world.own, world.shared))
            yield world._replace(plugged=False, own=own, shared=shared, lock="")
        else:
            yield world._replace(plugged=True)
        if world.lock == "foreign":
            yield world._replace(lock="")
        elif world.plugged and not world.lock:
            yield world._replace(lock="foreign")
            # The next owner: it stops the wheels before it answers.
            yield from self.feed(self.stopped(world)._replace(lock="foreign"), machine.Relieved())

    def by_owner(self, world: World) -> Iterator[World]:
        if world.owner != "runs":
            return
        machine, state = self.machine, world.guard
        if world.request is not None:
            yield from self.feed(world._replace(request=None), machine.Obeyed())
        if world.writes:
            yield world._replace(writes=False)
            if world.own == "good" and world.hears:
                yield world._replace(writes=False, wheels="turn")
                yield world._replace(writes=False, wheels="runaway")
            return
        yield from self.feed(world, machine.Acknowledged(world.knows))
        if world.knows != state.stop:
            told = self.feed(world, machine.Acknowledged(state.stop))
            yield from (each._replace(knows=state.stop) for each in told)
        elif (
            world.own == world.shared == "good"
            and world.promise is not None
            and world.request is None
        ):
            yield world._replace(writes=True)
        if world.own == world.shared == "good":
            yield from self.feed(world._replace(promise=PROMISE), machine.Renewed(PROMISE))
        acknowledged, asked = world.knows == state.stop, world.request is not None
        begun = machine.begun(state.stop, acknowledged, asked, 0, LIMITS)
        other = self.unlocked(world._replace(guard=begun, shared=""))
        if world.promise is None:
            yield other
        else:
            yield from self.feed(other._replace(promise=PROMISE), machine.Renewed(PROMISE))
        if world.own == "good" and not world.shared:
            yield from self.feed(world._replace(shared="good"), machine.Shared())
        if world.shared:
            (closed,) = self.feed(world, machine.CloseAsked())
            if closed.shared:
                raise Broken(f"it keeps the port from its owner: {world}")
            yield closed
        elif world.own:
            yield self.unlocked(world._replace(own=""))
        elif world.plugged and not world.lock:
            opened = self.stopped(world)._replace(own="good", shared="good", lock="both")
            yield from self.feed(opened, machine.Shared())
        # It acknowledges, too.
        sees = world.own == "good" and world.hears and world.knows == state.stop
        if sees and world.wheels == "stand":
            yield from self.feed(world._replace(promise=None), machine.Standing())

    def feed(self, world: World, event: Any, *, lucky: bool = False) -> list[World]:
        """Let the machine act; the worlds that may follow, or the one where all succeeds."""
        before = world.guard
        state, actions = self.step(type(event), event, before)
        asked = world.request is not None and world.request <= 0
        if world.owner != "dead" and before.acknowledged and not (state.acknowledged or asked):
            if world.promise is None or world.promise > 0:
                raise Broken(f"a kept promise is interrupted: {world}")
            if world.promise < -LIMITS.late and not before.patient:
                raise Broken(f"it interrupts a promise for a pause of its own: {world}")
        left = over(state) and not over(before) and world.wheels != "stand"
        if left and world.lock != "foreign":
            raise Broken(f"it leaves turning wheels: {world}")
        if isinstance(event, self.machine.Asked) and state.stopped:
            raise Broken(f"it takes the stop of an earlier request for this one's: {world}")
        worlds = [world._replace(guard=state)]
        for number, action in enumerate(actions):
            if action == "latch" and isinstance(event, self.machine.Tick):
                self.check_order(worlds[0])
            if action in {"send zero", "send surest", "look"} and worlds[0].shared != "good":
                # What fails ends the row.
                return self.feed(worlds[0], self.machine.Gone(), lucky=lucky)
            worlds = [w for each in worlds for w in self.act(each, action, lucky=lucky)]
            assert len(worlds) == 1 or {*actions[number + 1 :]} <= {"latch"}
        due = before.due is not None and before.due <= 0 and isinstance(event, self.machine.Tick)
        if before.owner == "ended" and (due or isinstance(event, self.machine.Asked)):
            for after in worlds:
                if after.request is not None and not after.latching:
                    raise Broken(f"it does not write that a stop was asked for: {after}")
        return worlds

    def check_order(self, world: World) -> None:
        """A disk may hang: the stop goes first."""
        free = not world.lock and not world.lent
        reached = world.hears and world.plugged and (world.shared == "good" or free)
        if world.wheels != "stand" and reached:
            raise Broken(f"it writes to the disk before it stops: {world}")

    def act(self, world: World, action: str, *, lucky: bool) -> list[World]:
        machine = self.machine
        if action == "send zero":
            return [self.stopped(world) if world.wheels == "turn" else world]
        if action == "send surest":
            return [self.stopped(world)]
        if action in {"look", "open"} and world.lent:
            raise Broken(f"it takes the port from the next owner: {world}")
        if action == "look":
            if world.lock == "foreign":
                return self.feed(self.stopped(world), machine.Looked(False), lucky=lucky)
            world = self.stopped(world)._replace(lock="guard")
            stands = world.hears and world.wheels == "stand"
            seen = [machine.Looked(True)] if stands else []
            unseen = [] if lucky and seen else [machine.Looked(False)]
            return [w for each in seen + unseen for w in self.feed(world, each, lucky=lucky)]
        if action == "open":
            state = world.guard
            if state.stopped and not state.turning:
                raise Broken(f"it takes a port again and again that its owner may need: {world}")
            ours = world.plugged and not world.lock
            if ours:
                world = self.stopped(world)._replace(lock="guard", shared="good")
            return self.feed(world, machine.Opened(ours), lucky=lucky)
        if action == "close":
            return [self.unlocked(world._replace(shared=""))]
        if action == "unlock":
            if world.owner != "dead" or not world.shared:
                raise Broken(f"it lends what it has not: {world}")
            return [world if world.lock == "foreign" else world._replace(lock="")]
        if action == "latch":
            return [world if world.guard is None else world._replace(latching=True)]
        if action == "kill":
            if world.promise is None:
                raise Broken(f"it kills an owner whose wheels stand: {world}")
            return [self.killed(world)]
        if action == "end":
            if world.owner != "dead":
                raise Broken(f"it leaves its owner alone: {world}")
            if world.request is not None:
                raise Broken(f"it ends without the emergency stop that was asked for: {world}")
            return [world._replace(guard=None)]
        assert action == "answer"
        return [world]

    def stopped(self, world: World) -> World:
        return world._replace(wheels="stand") if world.hears and world.plugged else world

    def killed(self, world: World) -> World:
        return self.unlocked(world._replace(owner="dead", own="", writes=False))

    def unlocked(self, world: World) -> World:
        held = "good" in (world.own, world.shared)
        return world._replace(lock="" if world.lock != "foreign" and not held else world.lock)

    def later(self, world: World, time: int) -> World:
        promise = None if world.promise is None else max(-LATE, world.promise - time)
        request, lent = (t and max(0, t - time) for t in (world.request, world.lent))
        moved = later(world.guard, time)
        return world._replace(guard=moved, promise=promise, request=request, lent=lent or None)

    def settled(self, world: World) -> World:
        """The same without differences that mean nothing."""
        state = world.guard and settled(world.guard)
        if state and state.owner == "ended":
            # What a dead owner promised, knew and had to obey makes no difference.
            request = world.request and 0
            return world._replace(guard=state, promise=None, knows=0, request=request)
        return world if state is world.guard else world._replace(guard=state)


def over(state: Any) -> bool:
    """Whether the guard has left the wheels, and may wait for a disk alone."""
    return state.owner == "ended" and state.due is None


@lru_cache(None)
def later(state: Any, time: int) -> Any:
    """The state of a guard, some time later."""
    due, asked, lent = (
        None if t is None else t - time for t in (state.due, state.asked, state.lent)
    )
    return state._replace(
        until=state.until - time, since=state.since - time, due=due, asked=asked, lent=lent
    )


@lru_cache(None)
def settled(state: Any) -> Any:
    """The state without differences that mean nothing."""
    until = max(-LATE, state.until) if state.turning else 0
    since = 0 if state.acknowledged else max(-LIMITS.kill_after, state.since)
    due = None if state.due is None else max(-LATE, state.due)
    asked, lent = (time and max(0, time) for time in (state.asked, state.lent))
    state = state._replace(until=until, since=since, due=due, asked=asked, lent=lent)
    if state.owner == "ended":
        return state._replace(
            until=0, since=0, stop=0, acknowledged=True, patient=False, asked=asked and 0
        )
    return state if asked is not None else state._replace(stopped=False)


def test_wheels_stand_in_time_and_the_guard_ends_beside_standing_wheels() -> None:
    explorer = Explorer(guard)
    assert explorer.explore() > 10_000
    # No time is longer than it has to be.
    assert explorer.worst == STANDS_WITHIN


@pytest.mark.parametrize(
    ("rule", "without"),
    [
        ("promised = state.until if state.turning else None", "promised = None"),
        ("(promised, state.asked)", "(promised,)"),
        ("turning=True, until=until", "turning=True, until=now"),
        ("state._replace(turning=False)", "state"),
        ("if not state.acknowledged:", "if False:"),
        ("state if state.due is not None else state._replace(due=state.since)", "state"),
        (
            '(state._replace(due=None), ()) if state.stopped else (again, ("open",))',
            'again, ("open",)',
        ),
        ("if stop != state.stop:", "if False:"),
        ("acknowledged=acknowledged, since=now", "since=now"),
        ("asked=now + limits.answer if asked else None", "asked=None"),
        ("State(stop=stop, acknowledged", "State(acknowledged"),
        ('_replace(holds=False), ("close", "answer")', '_replace(holds=False), ("answer",)'),
        ('_replace(holds=True), ("answer",)', '_replace(holds=False), ("answer",)'),
        ('_replace(holds=False), ("close",)', "_replace(), ()"),
        ("holds=ours, due=now + limits.repeat", "holds=True, due=now + limits.repeat"),
        ("holds=ours, due=now + limits.repeat", "holds=ours, due=None"),
        ("if ours and not state.turning:", "if False:"),
        ("if ours and not state.turning:", "if ours:"),
        ("if stand else", "if True else"),
        ('if state.owner == "ended" else (state, ())', "if True else (state, ())"),
        ("(state, ()) if state.turning else _over(state)", "_over(state)"),
        ("(*acts, *_latch(state))", "acts"),
        ("(*acts, *_latch(state))", "(*_latch(state), *acts)"),
        ('owner="ended", due=now', 'owner="ended"'),
        ('*(_latch(state) or ("end",))', '*_latch(state), "end"'),
        ('*(_latch(state) or ("end",))', '"end"'),
        ("return _over(state) if over else", "return"),
        ('over = state.owner == "ended" and not state.turning', "over = not state.turning"),
        ('over = state.owner == "ended" and not state.turning', 'over = state.owner == "ended"'),
        ("turning=False, due=None", "due=None"),
        ("if not (state.turning or state.holds):", "if False:"),
        ("if state.due is None or now < state.due:", "if state.due is None:"),
        ('("look",) if state.holds else ("open",)', '("look",)'),
        ("if now - state.due > limits.late and not state.patient and not asked:", "if False:"),
        ("> limits.late and not state.patient and not asked:", "> limits.late and not asked:"),
        ("and not state.patient and not asked:", "and not state.patient:"),
        ("acknowledged=False, since=now", "since=now"),
        ("if overdue >= limits.surest_after", "if False"),
        ("if overdue >= limits.kill_after and", "if False and"),
        ("limits.kill_after and state.turning and", "limits.kill_after and"),
        ("again = state._replace(due=now + limits.repeat)", "again = state._replace(due=None)"),
        ("now + limits.answer if state.asked is None else state.asked", "now"),
        ("_awaiting(state), _latch(state)", "_awaiting(state), ()"),
        ("state = state._replace(asked=None)", "state = state"),
        ("asked=due, stopped=False", "asked=due"),
        ('("unlock",) if state.holds else ()', '("unlock",)'),
        ("if state.lent is not None and now < state.lent:", "if False:"),
        ("now < state.lent:", "True:"),
        ('acts = ("send surest",) if state.holds else ()', "acts = ()"),
        ('if state.owner != "ended":\n                return', "if False:\n                return"),
    ],
)
def test_without_any_one_rule_a_law_is_broken(rule: str, without: str) -> None:
    source = inspect.getsource(guard)
    assert source.count(rule) == 1
    machine = types.ModuleType("machine")
    exec(source.replace(rule, without), machine.__dict__)
    with pytest.raises((Broken, RecursionError)):
        Explorer(machine).explore()
