"""``yahboomd tune --undo``: restores the board's settings from before a tuning.

It restores the values that a tuning writes, and others that the board has lost: if power fails
within a write, the board may lose all its settings.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from yahboomd.core.clock import Clock
from yahboomd.core.errors import Refused
from yahboomd.core.link.port import Opener
from yahboomd.core.link.storing import Progress, store
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import BoardSettings, SettingWrite
from yahboomd.tools.tune.procedure import storing_failed
from yahboomd.tools.tune.saved import NAME, SavedSettings, read_saved, remove, settings_of
from yahboomd.tools.tune.tune_text import values
from yahboomd.tools.tune.tuning_result import DEAD_ZONE, GAINS


async def undo(opener: Opener, clock: Clock, place: Path, *, as_json: bool) -> int:
    """Store the saved values that were tuned or lost; then remove the file.

    Raises:
        Refused: Nothing is saved, or it is not this board's.
        BoardError: The board does not store it.
        LinkError: The port or the board cannot be used.
    """
    saved = read_saved(place)
    if saved is None:
        others = ", ".join(sorted(each.name for each in place.parent.glob(f"{NAME}*.json")))
        raise Refused(
            f"{place} is not there: no tuning has written to this board, or it was undone already.",
            remedy=f"Name the port or the namespace of the tuning; there are {others}."
            if others
            else "",
        )
    checked = _Checked(saved)
    has = (await store(opener, clock, {}, checked)).has
    table = DIALECTS[saved.dialect].settings
    lost = [row for row in table if row.field in has and not row.allows(has[row.field])]
    fields = {GAINS, DEAD_ZONE, *(row.field for row in lost)}
    want = {name: value for name, value in settings_of(saved).items() if name in fields}
    outcome = await store(opener, clock, want, checked)
    if not outcome.complete:
        raise storing_failed(outcome.steps[-1].write.text, "")
    remove(place)
    writes = sum(step.attempts for step in outcome.steps)
    also = [
        f"{row.label} {row.words(want[row.field])}"
        for row in lost
        if row.field in want and row.field not in {GAINS, DEAD_ZONE}
    ]
    stores = "; ".join([values(want), *also])
    if as_json:
        print(msgspec.json.encode({"stored_now": want, "writes": writes}).decode())
    elif writes:
        print(f"The board stores again: {stores}. Values written: {writes}.")
    else:
        print(f"The board stores this already: {stores}. Nothing was written.")
    return os.EX_OK


class _Checked(Progress):
    """Refuses a board that is not the one whose settings were saved."""

    def __init__(self, saved: SavedSettings) -> None:
        self._saved = saved

    def begins(
        self,
        dialect: Dialect,
        writes: tuple[SettingWrite, ...],  # noqa: ARG002
        had: BoardSettings,  # noqa: ARG002
    ) -> None:
        if dialect.name != self._saved.dialect:
            raise Refused(
                f"The saved settings are those of a {self._saved.dialect} board at "
                f"{self._saved.port}, and this is a {dialect.name} board: nothing was stored."
            )
