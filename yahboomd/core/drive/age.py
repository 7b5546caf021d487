"""Judges the age of a command by its stamp, even if the clocks of sender and robot disagree.

``relative``: now minus the stamp, less the smallest such difference of that source in the last ten
seconds. A constant offset of the clocks cancels out; the delay of a held-up command does not.
``absolute``: the clocks agree, so the age is the difference itself. ``ignore``: stamps are unused.

Stamps in messages and stamps by the transport come from different clocks, so each has a history of
its own.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.drive.windows import SlidingMinimum

StampPolicy: TypeAlias = Literal["relative", "absolute", "ignore"]
AgeRefusal: TypeAlias = Literal["stale", "out_of_order", "from_the_future"]

HISTORY_NS = 10_000_000_000


class Age(msgspec.Struct, frozen=True, kw_only=True):
    """The age of a command by its stamp.

    Attributes:
        age_ns: The time that the command was under way, as far as it can be known.
        proven: Whether the stamp rules out that the command is part of a backlog. Only the
            sender's own stamp can prove it: a router stamps a sample when it receives it, however
            late that is. The first moments of a source prove nothing, because they may all belong
            to one backlog.
    """

    age_ns: int = 0
    proven: bool = False


class AgeJudge:
    """Judges the stamps of one source.

    A stamp before the newest one is refused, ``out_of_order``: the newer command stands. If the
    sender's clock was set back, this lasts until nothing has come in order for one timeout. By then
    the source's command has run out, and its history starts again. A repeated stamp is judged by
    its age like any other, and does not extend a command.

    Args:
        policy: See the top of this file.
        timeout_ns: An older command is refused, ``stale``. A stamp further ahead is refused too (in
            ``absolute``; ``relative`` cannot tell).
    """

    def __init__(self, policy: StampPolicy, timeout_ns: int) -> None:
        self._policy = policy
        self._timeout_ns = timeout_ns
        self.reset()

    def reset(self) -> None:
        """Begin new histories, because this clock stood still while the sender's went on."""
        self._histories = {True: _History(), False: _History()}

    def judge(
        self, now_ns: int, stamp_ns: int | None, *, by_sender: bool, wall_ns: int | None = None
    ) -> Age | AgeRefusal:
        """The age of a command that arrived at ``now_ns``, or the reason to refuse it.

        Args:
            stamp_ns: When it was given, on the giver's clock. ``None`` and 0 (ROS's value for a
                missing stamp) are no stamp.
            by_sender: The stamp came in the message, not from the transport.
            wall_ns: The time now on the clock that the sender shares, for ``absolute``; by default
                ``now_ns``.
        """
        if self._policy == "ignore" or stamp_ns is None or stamp_ns <= 0:
            return Age()
        history = self._histories[by_sender]
        if stamp_ns < history.newest_stamp_ns:
            if now_ns - history.in_order_ns <= self._timeout_ns:
                return "out_of_order"
            history.differences.clear()
        ours_ns = now_ns if wall_ns is None else wall_ns
        if self._policy == "absolute" and stamp_ns - ours_ns > self._timeout_ns:
            # Checked before the stamp is kept, so that it puts no other command out of order.
            return "from_the_future"
        history.newest_stamp_ns = stamp_ns
        history.in_order_ns = now_ns
        if self._policy == "absolute":
            age_ns = ours_ns - stamp_ns
            known = True
        else:
            difference = now_ns - stamp_ns
            smallest = history.differences.smallest(now_ns)
            if smallest is None:
                history.began_ns = now_ns
                smallest = difference
            history.differences.add(now_ns, difference)
            known = now_ns - history.began_ns >= self._timeout_ns
            age_ns = difference - smallest
        if age_ns > self._timeout_ns:
            return "stale"
        return Age(age_ns=max(0, age_ns), proven=by_sender and known)


class _History:
    def __init__(self) -> None:
        self.newest_stamp_ns = 0
        self.in_order_ns = 0
        self.began_ns = 0
        self.differences = SlidingMinimum(HISTORY_NS)
