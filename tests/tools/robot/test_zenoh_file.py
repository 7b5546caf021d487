"""What is judged of the bus without a network, and the key of the user's file that is named."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec
import pytest
import zenoh

from yahboomd.core.bus.options import BusOptions, zenoh_config
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
        ('{ access_control: { enabled: true, default_permission: "maybe" } }',
         "access_control/default_permission"),
        ('{ transport: { link: { protocols: ["udp"] } } }', "transport/link/protocols"),
        (('{ transport: { auth: { usrpwd: { user: "a", password: "b",'
         ' dictionary_file: "/nowhere" } } } }'), "transport/auth/usrpwd/dictionary_file"),
        (('{ qos: { network: [{ messages: ["put"], key_exprs: ["**"], flows: ["egress"],'
         ' overwrite: { priority: "urgent" } }] } }'), "qos/network"),
        (('{ downsampling: [{ flows: ["egress"], messages: ["push"],'
         ' rules: [{ key_expr: "a//b", freq: 10 }] }] }'), "downsampling"),
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


@pytest.mark.parametrize(
    "text",
    [
        "{ transport: { unicast: { lowlatency: true, qos: { enabled: false } } } }",
        "{ adminspace: { enabled: true, permissions: { read: true, write: true } } }",
        "{ transport: { shared_memory: { enabled: true } } }",
        "{ timestamping: { enabled: false }, transport: { link: { tx: { lease: 10 } } } }",
    ],
)
def test_a_file_that_run_takes_passes(tmp_path: Path, text: str) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(text)
    # Whether this machine has the interface now is not for the file to say.
    options = BusOptions(config_file=file, listen=("tcp/192.0.2.1:7448#iface=wlan9",), connect=())
    judge(options)
    plain = msgspec.structs.replace(options, listen=("tcp/127.0.0.1:0",))
    zenoh.open(zenoh_config(plain)).close()


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
