"""Which requests are from our own page."""

from __future__ import annotations

import pytest

from yahboomd.web.web_application import RequestOrigin

ON_NETWORK = RequestOrigin(["robot", "robot.local"], local=False, tls=False)
LOCAL = RequestOrigin([], local=True, tls=False)
SECURE = RequestOrigin(["robot.local"], local=False, tls=True)


@pytest.mark.parametrize(
    "host",
    [
        *("192.168.1.5:8480", "[2001:db8::1]:8480", "127.0.0.1", "localhost:8480"),
        *("robot.local:8480", "ROBOT.local.", "robot"),
    ],
)
def test_addresses_and_the_names_of_this_machine_are_ours(host: str) -> None:
    assert ON_NETWORK.host_is_ours(host)


@pytest.mark.parametrize(
    "host",
    [
        *("", "evil.example", "evil.example:8480", "robot.local.evil.example", "localhost.evil"),
        *("robot@evil.example", "127.0.0.1.evil.example:8480", "robot.local:8480:1", "[::1", "a b"),
        *("robot.local/", "127.0.0.1:8480\n", "0x7f000001.evil"),
    ],
)
def test_a_name_that_anybody_may_have_point_here_is_not_ours(host: str) -> None:
    assert not ON_NETWORK.host_is_ours(host)


def test_on_loopback_other_addresses_and_names_are_not_ours() -> None:
    assert LOCAL.host_is_ours("127.0.0.1:8480")
    assert LOCAL.host_is_ours("[::1]:8480")
    assert LOCAL.host_is_ours("localhost:8480")
    assert not LOCAL.host_is_ours("192.168.1.5:8480")
    assert not LOCAL.host_is_ours("robot.local:8480")


@pytest.mark.parametrize(
    "origin",
    [
        *("null", "", "http://evil.example", "https://robot.local:8480", "http://robot.local"),
        *("http://robot.local:8481", "http://robot.local:8480.evil.example", "robot.local:8480"),
        *("http://x@robot.local:8480", "http://[robot", "file://"),
    ],
)
def test_another_origin_is_foreign(origin: str) -> None:
    assert not ON_NETWORK.origin_is_ours(origin, "robot.local:8480")


def test_the_origin_of_our_page_is_ours() -> None:
    assert ON_NETWORK.origin_is_ours("http://robot.local:8480", "Robot.local:8480")
    assert SECURE.origin_is_ours("https://robot.local", "robot.local")
    assert not SECURE.origin_is_ours("http://robot.local", "robot.local")
