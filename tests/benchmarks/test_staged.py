"""The daemon still passes the stages of a command."""

import pytest

from benchmarks import cost
from benchmarks.staged import STAGES, spans

ORDERED = list(range(len(STAGES) + 1))


def test_times_that_cannot_be_are_refused():
    assert spans([ORDERED], 1) == [[1] * len(STAGES)]
    with pytest.raises(ValueError, match="only 1 of 3 commands"):
        spans([ORDERED], 3)
    with pytest.raises(ValueError, match="only 0 of 50"):
        spans([], 50)
    swapped = [0, 2, 1, *ORDERED[3:]]
    with pytest.raises(ValueError, match="negative times: unpacking of the sample"):
        spans([ORDERED, swapped], 2)


@pytest.mark.realtime
def test_a_command_passes_every_stage_in_order():
    # On a busy machine most take too long to be counted.
    assert spans(cost.staged(1.5), 1)
