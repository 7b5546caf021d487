"""Links to the page."""

from __future__ import annotations

import ipaddress
import os
import time
from pathlib import Path

import msgspec
import pytest
import segno

from yahboomd.core.clock import SystemClock
from yahboomd.core.errors import ConfigError
from yahboomd.tools.metrics.http_listener import Place
from yahboomd.web import page_link
from yahboomd.web.page_link import (
    SERVED,
    default_address,
    end_sessions,
    last_served,
    link,
    own_addresses,
    print_links,
    print_sessions,
    qr_lines,
    reachable_hosts,
)
from yahboomd.web.session_files import PREFIX, StoredSession, keep, make_entry


def test_the_token_is_in_the_fragment() -> None:
    assert link("127.0.0.1", 8480, tls=False) == "http://127.0.0.1:8480/"
    assert link("192.168.1.5", 8480, tls=True, token="abc") == "https://192.168.1.5:8480/#token=abc"
    assert link("::1", 1, tls=False) == "http://[::1]:1/"


def test_every_interface_means_the_addresses_of_this_machine() -> None:
    assert reachable_hosts("192.168.1.5") == ["192.168.1.5"]
    assert "0.0.0.0" not in reachable_hosts("0.0.0.0")
    assert default_address() in {"", *own_addresses()}
    assert not any(ipaddress.ip_address(each).is_loopback for each in own_addresses())


def test_the_first_link_has_the_default_routes_address(monkeypatch: pytest.MonkeyPatch) -> None:
    """And not that of a lidar's interface, which comes first in the kernel's list."""
    own = ["192.168.158.10", "10.1.2.3", "172.17.0.1"]
    monkeypatch.setattr(page_link, "own_addresses", lambda: iter(own))
    monkeypatch.setattr(page_link, "default_address", lambda: "10.1.2.3")
    assert reachable_hosts("0.0.0.0") == ["10.1.2.3", "192.168.158.10", "172.17.0.1"]


def test_without_a_network_no_link_is_shown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(page_link, "own_addresses", lambda: iter(()))
    print_links(tmp_path, Place(host="0.0.0.0", port=8480), SystemClock(), tls=False)
    words = capsys.readouterr().out
    assert "no address on a network" in words
    assert "http" not in words
    assert not list(tmp_path.iterdir())


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


def store(folder: Path, number: str, name: str, idle_s: float) -> None:
    stored = StoredSession(role="viewer", name=name, key="0" * 64, made_s=0)
    keep(folder, f"{PREFIX}{number}", msgspec.json.encode(stored))
    used_s = time.time() - idle_s
    os.utime(folder / f"{PREFIX}{number}", (used_s, used_s))


def test_sessions_are_listed_with_their_last_use_and_command_no_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    print_sessions(tmp_path, SystemClock())
    assert "No phone has a session" in capsys.readouterr().out
    store(tmp_path, "3f9a2c", "Anne's phone", -1000)
    store(tmp_path, "b00b1e", "\x1b[31mBert", 3 * 86400 + 60)
    print_sessions(tmp_path, SystemClock())
    head, *rows, last = capsys.readouterr().out.splitlines()
    assert head.split() == ["number", "may", "last", "used", "name"]
    assert rows[0].split(maxsplit=3) == ["3f9a2c", "watch", "now", "Anne's phone"]
    assert rows[1].split(maxsplit=5) == ["b00b1e", "watch", "3", "days", "ago", "[31mBert"]
    assert "--end-session NUMBER" in last


def test_one_session_is_ended_by_its_number_or_all_with_every_link(tmp_path: Path) -> None:
    store(tmp_path, "3f9a2c", "Anne", 0)
    store(tmp_path, "b00b1e", "Bert", 0)
    make_entry(tmp_path, "driver", SystemClock())
    assert end_sessions(tmp_path, "3f9a2c").startswith("Session 3f9a2c is ended")
    for wrong in ("3f9a2c", "", "Bert", "../x"):
        with pytest.raises(ConfigError, match=r"There is no session .*--sessions"):
            end_sessions(tmp_path, wrong)
    assert end_sessions(tmp_path, "all") == "1 sessions are ended, and 1 unused links are void."
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("which", ["3f9a2c", "all"])
def test_a_session_whose_file_cannot_be_read_is_ended_too(tmp_path: Path, which: str) -> None:
    """A server that runs has it in memory, and ends it when its file is gone."""
    store(tmp_path, "3f9a2c", "Anne", 0)
    (tmp_path / f"{PREFIX}3f9a2c").write_bytes(b"")
    (tmp_path / f"{PREFIX}000000").mkdir()
    (tmp_path / f"{PREFIX}other").write_bytes(b"")
    end_sessions(tmp_path, which)
    assert {each.name for each in tmp_path.iterdir()} == {f"{PREFIX}000000", f"{PREFIX}other"}
