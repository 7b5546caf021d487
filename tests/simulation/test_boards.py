from __future__ import annotations

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.boards import BOARDS
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot


def test_there_is_a_board_for_every_dialect_and_no_other() -> None:
    assert list(BOARDS) == list(DIALECTS)


def test_a_board_that_is_none_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match="No morse board can be simulated; there are streamed"):
        SimulatedRobot(SimulationOptions(dialect="morse"))


def test_a_board_keeps_of_the_wanted_values_what_it_stores() -> None:
    assert BOARDS["streamed"].stored({"lines": 13, "shoes": 2}) == FlashContent(lines=13)
    assert BOARDS["polled"].stored({"lines": 13}) is None
