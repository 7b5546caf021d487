"""What is judged of the bus without a network, and the key of the user's file that is named."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from yahboomd.core.bus.options import BusOptions
from yahboomd.core.errors import BusConfigError
from yahboomd.tools.robot.zenoh_file import judge

OLD = """// Keys of 0.11 // and a comment
{ scouting: { multicast: { enabled: true, autoconnect: { router: "", peer: "router" } } },
  timestamping: { enabled: { router: true } } } // the end"""
RULES = """{ access_control: { enabled: true, default_permission: "deny",
  rules: [{ id: "r", permission: "allow", flows: ["ingress"], messages: ["put"],
            key_exprs: ["**"] }],
  subjects: [{ id: "s" }], policies: [{ rules: ["x"], subjects: ["s"] }] } }"""


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (OLD, "scouting/multicast/autoconnect/peer"),
        ('{ plugins_search_dirs: ["/usr/lib"], id: "ab" }', "plugins_search_dirs"),
        ('{ id: "ab", transport: { link: { tx: { lease: "x", batch_size: 9 } } } }',
         "transport/link/tx/lease"),
        ("{ transport: { unicast: { accept_timeout: 9, lowlatency: true } } }",
         "transport/unicast/lowlatency"),
        (RULES, "access_control"),
        ('{ mode: "router" }', "mode"),
        ('{ namespace: "bot7" }', "namespace"),
    ],
)  # fmt: skip
def test_a_file_that_no_network_can_mend_is_refused_with_its_key(
    tmp_path: Path, text: str, key: str
) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(text)
    with pytest.raises(BusConfigError) as caught:
        judge(BusOptions(config_file=file))
    assert caught.value.message.startswith(f"The Zenoh configuration {file} ")
    assert f" {key}: " in caught.value.message or f" sets {key}, " in caught.value.message


def test_a_file_that_is_no_json5_is_refused_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text("{\n  id: }")
    with pytest.raises(BusConfigError, match=r"cannot be used: --> 2:"):
        judge(BusOptions(config_file=file))


def test_a_certificate_that_is_a_pipe_hangs_nothing(tmp_path: Path) -> None:
    pipe = tmp_path / "key.pem"
    os.mkfifo(pipe)
    endpoint = f"tls/0.0.0.0:7447#listen_private_key_file={pipe}"
    try:
        with pytest.raises(BusConfigError, match="private key a pipe"):
            judge(BusOptions(listen=(endpoint,), open_timeout_s=0.1))
    finally:
        # Its thread waits for a writer.
        os.close(os.open(pipe, os.O_WRONLY))
