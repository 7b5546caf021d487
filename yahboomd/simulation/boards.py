"""The boards by the name of their dialect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from random import Random
from typing import Final

import msgspec

from yahboomd.core.errors import ConfigError
from yahboomd.simulation.board import BoardModel, Emit
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.four_channel.polled_board import PolledBoard
from yahboomd.simulation.four_channel.streamed_board import StreamedBoard
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.rosmaster.rosmaster_board import RosmasterBoard
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored


class BoardKind(msgspec.Struct, frozen=True, kw_only=True):
    """One board that can be simulated.

    Attributes:
        make: Makes one from a robot's options, its plant, and a receiver of its bytes.
        flash: Its stored settings, with the factory settings as defaults; None: it stores nothing.
    """

    make: Callable[[SimulationOptions, Plant, Emit, Random], BoardModel]
    flash: type[msgspec.Struct] | None = None

    def stored(self, values: Mapping[str, object]) -> msgspec.Struct | None:
        """The contents of its flash; values that it does not store are ignored."""
        if self.flash is None:
            return None
        known = {name: values[name] for name in self.flash.__struct_fields__ if name in values}
        return self.flash(**known)


BOARDS: Final[dict[str, BoardKind]] = {
    "streamed": BoardKind(make=StreamedBoard, flash=FlashContent),
    "polled": BoardKind(make=PolledBoard),
    "rosmaster": BoardKind(make=RosmasterBoard, flash=RosmasterStored),
}
"""Every board, by the configuration's name of its dialect."""


def make_board(options: SimulationOptions, plant: Plant, emit: Emit, random: Random) -> BoardModel:
    """The board of a robot.

    Raises:
        ConfigError: There is no such board.
    """
    kind = BOARDS.get(options.dialect)
    if kind is None:
        names = ", ".join(BOARDS)
        raise ConfigError(f"No {options.dialect} board can be simulated; there are {names}.")
    return kind.make(options, plant, emit, random)
