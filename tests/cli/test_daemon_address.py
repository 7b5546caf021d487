from __future__ import annotations

from pathlib import Path

from yahboomd.core.config import read
from yahboomd.tools.robot.daemon_address import client_options, configured_endpoints


def test_a_client_takes_namespace_and_file_from_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "zenoh.json5").write_text("{}")
    config = read(
        None,
        environ={},
        overrides=["zenoh.namespace=bot1", f"zenoh.config={tmp_path / 'zenoh.json5'}"],
    ).config
    made = client_options(("tcp/10.0.0.1:7447",), config)
    assert made.connect == ("tcp/10.0.0.1:7447",)
    assert made.namespace == "bot1"
    assert made.config_file == tmp_path / "zenoh.json5"
    assert not made.enforces


def test_an_address_of_every_interface_is_reached_on_this_machine() -> None:
    config = read(None, environ={}, overrides=['zenoh.listen=["tcp/0.0.0.0:7448"]']).config
    assert configured_endpoints(config)[0] == "tcp/127.0.0.1:7448"
