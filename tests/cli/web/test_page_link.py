"""Links to the page."""

from __future__ import annotations

import ipaddress

import segno

from yahboomd.cli.web.page_link import link, own_addresses, own_names, qr_lines, reachable_hosts


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
    # Black where nothing is drawn, on a white border.
    upper = [[char in " ▄" for char in line] for line in shown]
    lower = [[char in " ▀" for char in line] for line in shown]
    dark = [row for pair in zip(upper, lower, strict=True) for row in pair]
    wanted = [[bool(each) for each in row] for row in segno.make(text, error="l").matrix_iter()]
    assert dark[: len(wanted)] == wanted
