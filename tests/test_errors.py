"""The exceptions: a sentence, a remedy, a status."""

from __future__ import annotations

import os

import pytest

from yahboomd.core import errors
from yahboomd.core.errors import ConfigError, LinkError, PortDenied, YahboomdError


def test_what_a_person_reads_is_the_message_and_the_remedy() -> None:
    error = LinkError("/dev/x: gone.", remedy="Plug it in.")
    assert str(error) == "/dev/x: gone. Plug it in."
    assert (error.message, error.remedy) == ("/dev/x: gone.", "Plug it in.")


def test_without_a_remedy_nothing_trails() -> None:
    assert str(LinkError("/dev/x: gone.")) == "/dev/x: gone."


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (ConfigError, 78),
        (LinkError, 69),
        (PortDenied, 77),
        (errors.BusError, 69),
        (errors.BusConfigError, 78),
    ],
)
def test_statuses_are_those_of_sysexits(error: type[YahboomdError], status: int) -> None:
    assert error.exit_code == status
    assert os.EX_CONFIG == 78


def test_every_error_is_one_of_the_tree() -> None:
    found = {
        each
        for each in vars(errors).values()
        if isinstance(each, type) and issubclass(each, Exception)
    }
    assert all(issubclass(each, YahboomdError) for each in found)
    assert errors.__doc__ is not None
    assert all(each.__name__ in errors.__doc__ for each in found)
