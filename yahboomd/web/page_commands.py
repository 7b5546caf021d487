"""Decides which commands of a page are obeyed.

- One page has control: a driver's page that asked for it. If another page had it, the wheels are
  stopped first.
- A command for motion becomes at most one sample on the bus. It is refused if its beat is older
  than :data:`LAPSE_NS`. Nothing is repeated. A held place of the map is such a
  command, and becomes a beat of its move.
- A zero from the page in control always stops, also with an old beat.
- When motion is refused, or the page falls silent in mid-motion, loses control or is closed, the
  wheels get zeros for a second; then nothing, because a zero holds control of the robot.
- After that a page has to let go first: motion is refused until it has sent a zero.
- A page that has not driven for :data:`LETS_GO_NS` loses control: the next one need not ask.
"""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Callable
from typing import TypeAlias

import msgspec

from yahboomd.core.clock import Clock
from yahboomd.core.model import STANDSTILL, Twist2d
from yahboomd.web.page_session import Go
from yahboomd.web.session_files import since_boot_ns

PERIOD_NS = 50_000_000

LAPSE_NS = 300_000_000
"""A command whose beat is older is refused, and a page that drives and is silent for this time is
stopped."""

KEPT = 200
"""Ten seconds; older beats are unknown."""

ZEROS_NS = 1_000_000_000
"""How long zeros are sent after motion."""

LETS_GO_NS = 30_000_000_000
"""How long a page that does not drive keeps control."""


Wanted: TypeAlias = Twist2d | Go


class PageRefusal(msgspec.Struct, frozen=True, kw_only=True):
    """The reason why a page's command moves nothing: a word, and a sentence for people."""

    why: str
    text: str
    age_ns: int | None = None


LATE = (
    "The network is too slow to drive safely: your command took more than 0.3 s. The robot is "
    "stopped. Let go, wait for a better connection, and press again."
)
LAPSED = PageRefusal(
    why="lapse",
    text="Nothing came from this page for 0.3 s, so the robot was stopped. Let go, then press "
    "again.",
)
ENDED = PageRefusal(why="ended", text="The page's server is ending.")
LET_GO = PageRefusal(why="let_go", text="Let go, then press again.")
NOT_YOURS = PageRefusal(
    why="not_yours", text="This page has no control of the robot. Take control to drive from here."
)
VIEWER = PageRefusal(
    why="viewer", text="This link lets you watch and stop the robot, not drive it."
)
CALIBRATES = PageRefusal(
    why="calibrating", text="A calibration drives the robot. End it to drive from here."
)


def late(age_ns: int | None) -> PageRefusal | None:
    """The refusal of a command whose beat is unknown or too old."""
    known = age_ns is not None and age_ns <= LAPSE_NS
    return None if known else PageRefusal(why="late", text=LATE, age_ns=age_ns)


class PageCommands:
    """The commands of all pages.

    Args:
        obstacle: Returns the reason why no page can drive like this now, if there is one.
        changed: Called when another page has control, or none.
        lapsed: Called with the page that fell silent in mid-motion.
        kept: Returns whether the page in control needs it although it does not drive.
    """

    def __init__(
        self,
        clock: Clock,
        put: Callable[[Wanted], None],
        *,
        obstacle: Callable[[Wanted], PageRefusal | None],
        changed: Callable[[], None],
        lapsed: Callable[[int, PageRefusal], None],
        kept: Callable[[], bool],
    ) -> None:
        self._clock = clock
        self._put = put
        self._obstacle = obstacle
        self._changed = changed
        self._lapsed = lapsed
        self._kept = kept
        self._driver: int | None = None
        self._ended = False
        self._moving: type[Wanted] | None = None
        self._moved_ns: int | None = None
        self._pressed = set[int]()
        self._silence = clock.alarm(self._fell_silent)
        self._zeros = clock.alarm(self._repeat_zero)
        self._idle = clock.alarm(self._was_idle)

    @property
    def driver(self) -> int | None:
        """The page in control."""
        return self._driver

    def take_control(self, page: int) -> None:
        """Give control to a page, which its person asked for."""
        if page != self._driver:
            self._stop()
            self._driver = page
            self._changed()
        self.used(page)

    def used(self, page: int) -> None:
        """Note that the page in control uses it: it keeps control from now on for the full time."""
        if page == self._driver:
            self._idle.set(self._clock.now_ns() + LETS_GO_NS)

    def give_back(self, page: int) -> None:
        """Take control from a page that no longer wants it, or is closed."""
        if page == self._driver:
            self._stop()
            self._driver = None
            self._idle.set(None)
            self._changed()

    def closed(self, page: int) -> None:
        """Note that a page is gone."""
        self.give_back(page)
        self._pressed.discard(page)

    def command(self, page: int, wanted: Wanted, age_ns: int | None) -> PageRefusal | None:
        """Obey a command, or return the reason why not.

        Args:
            age_ns: The age of its beat; None if it is unknown.
        """
        self.used(page)
        if wanted.is_zero:
            self._pressed.discard(page)
            if page == self._driver:
                self._zero()
            return None
        refusal = self._refusal(page, wanted, age_ns)
        if refusal is not None:
            self._pressed.add(page)
            if page == self._driver:
                self._stop()
            return refusal
        self._zeros.set(None)
        self._moving = type(wanted)
        self._moved_ns = self._clock.now_ns()
        self._silence.set(self._moved_ns + LAPSE_NS)
        self._put(wanted)
        return None

    def end(self) -> None:
        """Stop the robot if a page drives it, and refuse all motion from now on."""
        self._ended = True
        self._stop()

    def close(self) -> None:
        self._silence.close()
        self._zeros.close()
        self._idle.close()

    def _refusal(self, page: int, wanted: Wanted, age_ns: int | None) -> PageRefusal | None:
        if self._ended:
            return ENDED
        if page != self._driver:
            return NOT_YOURS
        if obstacle := self._obstacle(wanted):
            return obstacle
        if (refusal := late(age_ns)) is not None:
            return refusal
        # Only one of joystick and map can be held: release it before the other one counts.
        other = self._moving is not None and not isinstance(wanted, self._moving)
        return LET_GO if other or page in self._pressed else None

    def _zero(self) -> None:
        # The page repeats its own zeros for that time.
        since_ns = None if self._moved_ns is None else self._clock.now_ns() - self._moved_ns
        if self._moving or (since_ns is not None and since_ns < ZEROS_NS + LAPSE_NS):
            if self._moving:
                self._moved_ns = self._clock.now_ns()
            self._moving = None
            self._silence.set(None)
            self._put(STANDSTILL)

    def _stop(self) -> None:
        if self._moving:
            self._zero()
            self._zeros.set(self._clock.now_ns() + PERIOD_NS)

    def _repeat_zero(self) -> None:
        now_ns = self._clock.now_ns()
        if self._moved_ns is not None and now_ns - self._moved_ns < ZEROS_NS:
            self._put(STANDSTILL)
            self._zeros.set(now_ns + PERIOD_NS)

    def _fell_silent(self) -> None:
        page = self._driver
        if self._moving and page is not None:
            self._pressed.add(page)
            self._stop()
            self._lapsed(page, LAPSED)

    def _was_idle(self) -> None:
        if (page := self._driver) is None:
            return
        if self._kept():
            self.used(page)
        else:
            self.give_back(page)


class Beats:
    """The server's beats, which show the age of a page's command.

    Every command carries the last beat that its page received. A beat's age is the time since it
    was made, and includes every delay: here, on the way to the page, in the page, and on the way
    back. So a command from a queue is as old as the beat in it.

    Args:
        clock: Measures their age. The time that the machine was suspended counts too.
    """

    def __init__(self, clock: Clock) -> None:
        # A random start: beats of another server, or from before a restart, are not valid here.
        self.latest = secrets.randbelow(1 << 40)
        self._clock = clock
        self._made_ns: deque[int] = deque(maxlen=KEPT)

    def beat(self) -> int:
        """Make the next one."""
        self.latest += 1
        self._made_ns.append(since_boot_ns(self._clock))
        return self.latest

    def age_ns(self, beat: int, joined: int) -> int | None:
        """The age of a beat; None if the page cannot have received it.

        Args:
            beat: As the page sent it.
            joined: The latest beat when the page connected.
        """
        behind = self.latest - beat
        if beat <= joined or not 0 <= behind < len(self._made_ns):
            return None
        return since_boot_ns(self._clock) - self._made_ns[-1 - behind]
