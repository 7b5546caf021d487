"""The exceptions: a sentence, a remedy, a status."""

from __future__ import annotations

import errno
import os

import pytest

from yahboomd.core import errors
from yahboomd.core.errors import ConfigError, LinkError, PortDenied, YahboomdError, shortage


def test_what_a_person_reads_is_the_message_and_the_remedy() -> None:
    error = LinkError("/dev/x: gone.", remedy="Plug it in.")
    assert str(error) == "/dev/x: gone. Plug it in."
    assert (error.message, error.remedy) == ("/dev/x: gone.", "Plug it in.")


def test_without_a_remedy_nothing_trails() -> None:
    assert str(LinkError("/dev/x: gone.")) == "/dev/x: gone."


@pytest.mark.parametrize(
    ("error", "status"),
    [(ConfigError, 78), (LinkError, 69), (PortDenied, 77), (errors.BusError, 69)],
)
def test_statuses_are_those_of_sysexits(error: type[YahboomdError], status: int) -> None:
    assert error.exit_code == status
    assert os.EX_CONFIG == 78


class PanicException(BaseException):
    """Zenoh's panics are no Exceptions either."""


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.EMFILE, "Too many open files"), "Too many open files"),
        (MemoryError(), "no memory is left"),
        (RuntimeError("can't start new thread"), "no thread can be started"),
        (PanicException("OS can't spawn worker thread: (os error 11)"), "no thread can be started"),
        (PanicException("Failed to init net"), "Zenoh cannot start its threads"),
        (ImportError("/x.so: failed to map segment from shared object"), "no memory is left"),
    ],
)
def test_a_shortage_is_known_by_its_error(error: BaseException, words: str) -> None:
    found = shortage(error)
    assert found is not None
    assert found.message == f"The system gives this process too little: {words}."
    assert found.exit_code == os.EX_OSERR


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOENT, "x"), RuntimeError("x"), SystemExit("Failed to init net")]
)
def test_another_error_is_no_shortage(error: BaseException) -> None:
    assert shortage(error) is None


def test_every_error_is_one_of_the_tree() -> None:
    found = {
        each
        for each in vars(errors).values()
        if isinstance(each, type) and issubclass(each, Exception)
    }
    assert all(issubclass(each, YahboomdError) for each in found)
    assert errors.__doc__ is not None
    assert all(each.__name__ in errors.__doc__ for each in found)
