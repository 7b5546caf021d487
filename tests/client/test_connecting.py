from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.client import connect
from yahboomd.client.connection import client_options


def test_a_client_listens_nowhere_and_enforces_no_access_control() -> None:
    made = client_options("tcp/10.0.0.1:7447", namespace="bot1", zenoh_file="/etc/zenoh.json5")
    assert made.mode == "client"
    assert made.listening == ()
    assert made.connect == ("tcp/10.0.0.1:7447",)
    assert made.namespace == "bot1"
    assert made.config_file == Path("/etc/zenoh.json5")
    assert not made.enforces
    assert client_options(["tcp/a:1", "tcp/b:2"]).connect == ("tcp/a:1", "tcp/b:2")


@pytest.mark.parametrize(
    "wrong", [{"source": "/x"}, {"deadman_s": 0.0}, {"rate_hz": 1.0}, {"wait_s": -1.0}]
)
def test_an_argument_that_cannot_be_is_refused_at_once(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        connect(**wrong)  # type: ignore[arg-type]
