"""Links to the page."""

from __future__ import annotations

import ipaddress
from pathlib import Path

import pytest
import segno

from yahboomd.core.errors import ConfigError
from yahboomd.tools.metrics.http_listener import Place
from yahboomd.web.entry_tokens import Tokens
from yahboomd.web.page_link import (
    SERVED,
    announce,
    last_served,
    link,
    own_addresses,
    own_names,
    qr_lines,
    reachable_hosts,
)


def test_the_token_is_in_the_fragment() -> None:
    assert link("127.0.0.1", 8480, tls=False) == "http://127.0.0.1:8480/"
    assert link("192.168.1.5", 8480, tls=True, token="abc") == "https://192.168.1.5:8480/#token=abc"
    assert link("::1", 1, tls=False) == "http://[::1]:1/"


def test_every_interface_means_the_addresses_of_this_machine() -> None:
    assert reachable_hosts("192.168.1.5") == ["192.168.1.5"]
    found = reachable_hosts("0.0.0.0")
    assert found
    assert "0.0.0.0" not in found
    assert not any(ipaddress.ip_address(each).is_loopback for each in own_addresses())


def test_names_of_this_machine_are_those_that_phones_use() -> None:
    assert any(name.endswith(".local") for name in own_names())


def test_a_link_fits_a_terminal_as_a_qr_code_of_white_and_black() -> None:
    text = "https://192.168.100.100:8480/#token=" + "x" * 22
    lines = qr_lines(text).splitlines()
    assert len(lines) < 24
    white, end = "\x1b[38;5;231;48;5;16m", "\x1b[0m"
    assert all(line.startswith(white) and line.endswith(end) for line in lines)
    shown = [line.removeprefix(white).removesuffix(end) for line in lines]
    assert max(map(len, shown)) < 80
    # Undrawn cells are black, on a white border.
    upper = [[char in " ▄" for char in line] for line in shown]
    lower = [[char in " ▀" for char in line] for line in shown]
    dark = [row for pair in zip(upper, lower, strict=True) for row in pair]
    wanted = [[bool(each) for each in row] for row in segno.make(text, error="l").matrix_iter()]
    assert dark[: len(wanted)] == wanted


@pytest.mark.parametrize("tls", [True, False])
def test_where_the_page_was_served_last_is_remembered(tmp_path: Path, *, tls: bool) -> None:
    place = Place(host="192.0.2.5", port=8480)
    announce(place, Tokens(driver="d" * 22, viewer="v" * 22), tmp_path, tls=tls)
    assert last_served(tmp_path) == (place, tls)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (None, "there is no {path}"),
        (b"", "{path} cannot be used: Input data was truncated"),
        (b"\xff\x00", "{path} cannot be used: JSON is malformed"),
        (b'{"listen": 5, "tls": true}', "{path} cannot be used: Expected `str`"),
        (b'{"listen": "here", "tls": true}', "{path} names no address and port"),
        (b"[" * 100_000, "{path} cannot be used: "),
    ],
)
def test_a_damaged_memory_of_that_is_named(tmp_path: Path, content: bytes | None, why: str) -> None:
    path = tmp_path / SERVED
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError) as refused:
        last_served(tmp_path)
    assert refused.value.message.startswith(
        f"The page's last address is not known: {why.format(path=path)}"
    )
    assert "add --listen" in refused.value.remedy
