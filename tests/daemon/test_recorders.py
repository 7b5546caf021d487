"""What only records may fail: nothing else notices, and it is reported once."""

from __future__ import annotations

import logging

import pytest

from yahboomd.core.daemon.recorders import Recorders


class Panic(BaseException):
    """As Zenoh's library raises it."""


class Part:
    def __init__(self, error: BaseException | None) -> None:
        self.error = error
        self.calls = 0

    def take(self, number: int = 0, *, more: int = 0) -> int:
        self.calls += 1
        if self.error is not None:
            raise self.error
        return number + more


@pytest.mark.parametrize("error", [ValueError("no"), OSError(28, "No space left"), Panic("panic")])
def test_a_part_that_raises_is_switched_off_counted_and_reported_once(
    error: BaseException, caplog: pytest.LogCaptureFixture
) -> None:
    recorders, part = Recorders(), Part(error)
    for _ in range(3):
        assert recorders.call("The part", part.take, 1, default=7) == 7
    assert part.calls == 1
    assert not recorders.works("The part")
    status = recorders.status_values()
    assert status["recorder_failures"] == 1
    assert "The part: " in status["recorders_off"]
    (record,) = caplog.records
    assert record.levelno == logging.ERROR
    # The others go on.
    assert recorders.call("Another part", Part(None).take, 5) == 5


def test_every_method_of_a_guarded_part_is_harmless_once_one_failed() -> None:
    recorders, part = Recorders(), Part(None)
    recorders.guard("The part", part)
    assert part.take(1, more=2) == 3
    part.error = ValueError("no")
    assert part.take(1) is None
    part.error = None
    assert part.take(1) is None
    assert recorders.failures == 1


def test_an_end_of_the_process_is_not_caught() -> None:
    with pytest.raises(SystemExit):
        Recorders().call("The part", Part(SystemExit(1)).take)
