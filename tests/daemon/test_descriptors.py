from __future__ import annotations

import resource
from collections.abc import Iterator

import pytest

from yahboomd.daemon.descriptors import WANTED, make_room


@pytest.fixture(autouse=True)
def limits() -> Iterator[int]:
    """The hard limit; what a test does to the soft one is taken back."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    yield hard
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def soft() -> int:
    return resource.getrlimit(resource.RLIMIT_NOFILE)[0]


def test_the_limit_is_raised_as_far_as_it_may_be(limits: int) -> None:
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, limits))
    make_room()
    assert soft() == (WANTED if limits == resource.RLIM_INFINITY else min(WANTED, limits))


def test_a_limit_that_is_higher_already_stays(limits: int) -> None:
    if limits != resource.RLIM_INFINITY and limits <= WANTED:
        resource.setrlimit(resource.RLIMIT_NOFILE, (limits, limits))
    else:
        resource.setrlimit(resource.RLIMIT_NOFILE, (WANTED + 1, limits))
    before = soft()
    make_room()
    assert soft() == before
