"""The guard's decisions: the time-out that the board lacks, as a pure machine.

Whatever turns wheels promises, again and again, to go on for a moment, and may share its open port
with the guard. If the promise lapses the guard stops the wheels; if the owner ends without having
seen them stand, it stops them until they were seen to stand. No other process is believed.

A request to stop is the owner's to obey: it engages its emergency stop. If it does not do so in
time the guard sends the stop itself; if it ends first, the guard engages it on file.

The machine takes events and returns actions; the time is an argument, in milliseconds. The I/O
around it carries out each action before the next event. One that fails ends the row, and answers:

- ``Send``: write whole frames; :class:`Gone` if the descriptor is dead;
- ``Open``: open the device, by its identity, which sends its first stop; :class:`Opened`;
- ``Look``: stop the board, ask for counts, and watch them for some seconds; :class:`Looked`, or
  :class:`Gone`;
- ``Latch``: have the emergency stop put on file, which a disk may hold up; :class:`Latched` follows
  once it is there, or cannot be.

What the owner wrote before its end is handed over before :class:`Ended`.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias


class Limits(NamedTuple):
    """Times in milliseconds, and how many numbers stops have.

    Attributes:
        repeat: The period of stops, and of attempts to open the device.
        late: A guard that wakes later than this may have stood still with its owner.
        patience: The time that it gives the owner then.
        surest_after: An unacknowledged stop becomes the surest one.
        kill_after: The owner of an unacknowledged stop is killed if wheels may turn.
        answer: The time that the owner has to obey a request.
        lend: The time that the next owner has to open the port and stop its board.
    """

    repeat: int = 100
    late: int = 200
    patience: int = 500
    surest_after: int = 600
    kill_after: int = 5000
    answer: int = 50
    lend: int = 3000
    numbers: int = 65536


class Shared(NamedTuple):
    """The owner handed its open port over; it drives no wheel before the answer."""


class CloseAsked(NamedTuple):
    """The owner closes its port, or opens it, after the answer."""


class Renewed(NamedTuple):
    """The owner promises to renew again before ``until``; from now on wheels may turn."""

    until: int


class Standing(NamedTuple):
    """The owner has seen the wheels stand, and drives none before it promises again."""


class Acknowledged(NamedTuple):
    """Everything that the owner wrote before it knew of a stop is on the wire, and a resync."""

    stop: int


class Asked(NamedTuple):
    """A program of this machine asks for the emergency stop."""


class Obeyed(NamedTuple):
    """The owner has engaged it, for all requests so far."""


class Latched(NamedTuple):
    """The emergency stop is on file, or cannot be."""


class Ended(NamedTuple):
    """The owner's process has ended."""


class Gone(NamedTuple):
    """The descriptor is dead."""


class Opened(NamedTuple):
    """An attempt to open the device; ``ours``: it is open, and a stop was sent."""

    ours: bool


class Looked(NamedTuple):
    """Counts were watched; ``stand``: they showed standing wheels."""

    stand: bool


class Wanted(NamedTuple):
    """The next owner asks for the device."""


class Relieved(NamedTuple):
    """The next owner's guard answers that it holds the device, and sent its stop."""


class Tick(NamedTuple):
    """Time has passed."""


Event: TypeAlias = (
    Shared
    | CloseAsked
    | Renewed
    | Standing
    | Acknowledged
    | Asked
    | Obeyed
    | Latched
    | Ended
    | Gone
    | Opened
    | Looked
    | Wanted
    | Relieved
    | Tick
)

Action: TypeAlias = Literal[
    "answer", "send zero", "send surest", "open", "look", "latch", "unlock", "close", "kill", "end"
]


class State(NamedTuple):
    """What the guard knows.

    Attributes:
        owner: Killed: by this guard; its end is awaited.
        holds: It has a descriptor of the port.
        turning: Wheels may turn: the owner promised, and did not see them stand since.
        until: When the promise lapses.
        stop: The number of the newest stop of a living owner's wheels; the owner reads it before
            each write.
        acknowledged: The owner wrote no motion after that stop, and may drive again.
        since: When that stop was first sent.
        due: When to act next; None for nothing to do.
        patient: The guard woke late, and waits once more.
        asked: By when the owner has to obey a request; None if it has.
        stopped: The guard sent the stop of that request on a port that the owner had closed.
        lent: Until when the next owner may take the port: it is written to, and neither read nor
            locked.
    """

    owner: Literal["lives", "killed", "ended"] = "lives"
    holds: bool = False
    turning: bool = False
    until: int = 0
    stop: int = 0
    acknowledged: bool = True
    since: int = 0
    due: int | None = None
    patient: bool = False
    asked: int | None = None
    stopped: bool = False
    lent: int | None = None


def begun(stop: int, acknowledged: bool, asked: bool, now: int, limits: Limits) -> State:
    """How a guard begins after one that its owner replaced: with that one's stop and request."""
    state = State(stop=stop, acknowledged=acknowledged, since=now)
    return _awaiting(state._replace(asked=now + limits.answer if asked else None))


Step: TypeAlias = tuple[State, tuple[Action, ...]]


def step(state: State, event: Event, now: int, limits: Limits) -> Step:
    """Take an event; returns the next state and what to do, in this order."""
    match event:
        case Shared():
            return state._replace(holds=True), ("answer",)
        case CloseAsked():
            return state._replace(holds=False), ("close", "answer")
        case Renewed(until):
            return _awaiting(state._replace(turning=True, until=until, patient=False)), ()
        case Standing():
            return _awaiting(state._replace(turning=False)), ()
        case Acknowledged(stop):
            if stop != state.stop:
                return state, ()
            return _awaiting(state._replace(acknowledged=True)), ()
        case Asked():
            due = now + limits.answer if state.asked is None else state.asked
            state = state._replace(asked=due, stopped=False)
            return _awaiting(state), _latch(state)
        case Obeyed() | Latched():
            state = state._replace(asked=None)
            over = state.owner == "ended" and not state.turning
            return _over(state) if over else (_awaiting(state), ())
        case Ended():
            # The tick that follows acts at once.
            state = state._replace(owner="ended", due=now)
            return (state, ()) if state.turning else _over(state)
        case Gone():
            # The next tick opens the device again.
            return state._replace(holds=False), ("close",)
        case Opened(ours):
            if ours and not state.turning:
                # The stop was sent; a suspended owner, or another program, needs the port.
                return state._replace(stopped=True), ("close",)
            return state._replace(holds=ours, due=now + limits.repeat), ()
        case Looked(stand):
            return _over(state) if stand else (state._replace(due=now + limits.repeat), ())
        case Wanted():
            if state.owner != "ended":
                return state, ()
            return state._replace(lent=now + limits.lend), ("unlock",) if state.holds else ()
        case Relieved():
            return _over(state) if state.owner == "ended" else (state, ())
        case Tick():
            return _acted(state, now, limits)


def _awaiting(state: State) -> State:
    """When to act next while the owner lives."""
    if state.owner == "ended":
        return state
    if not state.acknowledged:
        return state if state.due is not None else state._replace(due=state.since)
    promised = state.until if state.turning else None
    due = min((t for t in (promised, state.asked) if t is not None), default=None)
    return state._replace(due=due)


def _latch(state: State) -> tuple[Literal["latch"], ...]:
    """Obey a request in place of an owner that no longer can."""
    return ("latch",) if state.owner == "ended" and state.asked is not None else ()


def _over(state: State) -> Step:
    """The wheels stand, or are the next owner's: end, once a request is on file."""
    state = state._replace(holds=False, turning=False, due=None)
    return state, ("close", *(_latch(state) or ("end",)))


def _acted(state: State, now: int, limits: Limits) -> Step:
    if state.due is None or now < state.due:
        return state, ()
    again = state._replace(due=now + limits.repeat)
    if state.owner == "ended":
        acts: tuple[Action, ...] = ("look",) if state.holds else ("open",)
        if state.lent is not None and now < state.lent:
            acts = ("send surest",) if state.holds else ()
        else:
            again = again._replace(lent=None)
        # The stop goes before the disk.
        return again, (*acts, *_latch(state))
    if not (state.turning or state.holds):
        # A request, beside an owner that closed its port.
        return (state._replace(due=None), ()) if state.stopped else (again, ("open",))
    if state.acknowledged:
        asked = state.asked is not None and now >= state.asked
        if now - state.due > limits.late and not state.patient and not asked:
            return state._replace(patient=True, due=now + limits.patience), ()
        again = again._replace(
            stop=(state.stop + 1) % limits.numbers, acknowledged=False, since=now, patient=False
        )
    overdue = now - again.since
    actions: tuple[Action, ...] = ("open",)
    if again.holds:
        actions = ("send surest",) if overdue >= limits.surest_after else ("send zero",)
    if overdue >= limits.kill_after and state.turning and again.owner == "lives":
        return again._replace(owner="killed"), ("kill", *actions)
    return again, actions
