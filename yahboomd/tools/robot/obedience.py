"""Judges from its statuses whether a daemon obeys the commands of one source. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from yahboomd.client.streams import reason
from yahboomd.core.messages.native import DRIVABLE, StatusSample
from yahboomd.core.messages.status_fields import REFUSALS

PATIENCE = 2
"""Statuses in a row that must refuse every command before that is reported.

When control passes from one source to another, and after a pause, a daemon refuses a few.
"""


class Obedience:
    """Judges the statuses of a daemon while one source commands.

    Args:
        before: The status before the first command.

    Attributes:
        warnings: How the daemon changed commands that it obeyed, in sentences.
    """

    def __init__(self, source: str, before: StatusSample) -> None:
        self.warnings: list[str] = []
        self._source = source
        self._first = self._last = before
        self._refused_in_a_row = 0

    def trouble_before(self) -> str:
        """The reason why no command would be obeyed; empty if the daemon would obey."""
        accounts = _group(self._first.command, "sources")
        if accounts and self._source not in accounts:
            known = ", ".join(accounts)
            return (
                f"The daemon does not know the source {self._source}: its [command.sources] has "
                f"{known}."
            )
        return self._state_trouble(self._first)

    def trouble(self, status: StatusSample) -> str:
        """The reason why commands since the last status were not obeyed; empty if they were."""
        last, self._last = self._last, status
        if words := self._state_trouble(status):
            return words
        ignored = _number(self._account(status), "vy_ignored")
        if ignored > _number(self._account(self._first), "vy_ignored"):
            return "This base cannot drive sideways: --vy is ignored."
        if _number(self._account(status), "accepted") > _number(self._account(last), "accepted"):
            self._refused_in_a_row = 0
            return ""
        refused = self._refused(last, status)
        if not refused:
            return ""
        self._refused_in_a_row += 1
        if "lower_priority" not in refused and self._refused_in_a_row < PATIENCE:
            return ""
        return self._refusal(refused, status)

    def trouble_after(self) -> str:
        """The reason why no command was obeyed, after the last status; empty if one was."""
        first, last = self._account(self._first), self._account(self._last)
        if _number(self._last.command, "limited") > _number(self._first.command, "limited"):
            self.warnings.append(
                "The command was faster than the limits of this robot ([limits] in its "
                "configuration): it drove as fast as they allow."
            )
        if _number(self._last.command, "too_tight") > _number(self._first.command, "too_tight"):
            self.warnings.append(
                "The command was a tighter curve than this car can steer: it drove the tightest "
                "one that it can, and a turn on the spot not at all."
            )
        if _number(last, "accepted") > _number(first, "accepted"):
            return ""
        refused = self._refused(self._first, self._last)
        if refused:
            return self._refusal(refused, self._last)
        return (
            "No command arrived at the daemon. Does its Zenoh access control allow this client "
            f"to publish on {self._source}?"
        )

    def _state_trouble(self, status: StatusSample) -> str:
        return "" if status.state in DRIVABLE else reason(status)

    def _refusal(self, refused: Mapping[str, int], status: StatusSample) -> str:
        reason = max(refused, key=lambda each: refused[each])
        other = status.driver
        if reason in {"lower_priority", "not_standing"} and other not in {None, self._source}:
            return f"{other} has control of the robot; {self._source} does not take it over."
        return f"The daemon refuses the commands on {self._source}: {REFUSALS[reason]}."

    def _refused(self, earlier: StatusSample, later: StatusSample) -> dict[str, int]:
        before = _group(self._account(earlier), "refused")
        after = _group(self._account(later), "refused")
        more = {each: _number(after, each) - _number(before, each) for each in REFUSALS}
        return {reason: count for reason, count in more.items() if count > 0}

    def _account(self, status: StatusSample) -> Mapping[str, Any]:
        return _group(_group(status.command, "sources"), self._source)


def _group(facts: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = facts.get(name)
    return found if isinstance(found, Mapping) else {}


def _number(facts: Mapping[str, Any], name: str) -> int:
    value = facts.get(name)
    return value if isinstance(value, int) else 0
