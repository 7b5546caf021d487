"""The configuration as parameters: each value by its dotted name, described, without secrets."""

from __future__ import annotations

from typing import Any

from ros_oracle import Oracle

from yahboomd.core.config import read
from yahboomd.ros2.ros2_parameters import parameter_server

SECRET = "hunter2"


class Asked:
    """A node's parameters as a client reads them."""

    def __init__(self, oracle: Oracle, *given: str) -> None:
        self._oracle = oracle
        config = read(None, environ={}, overrides=given).config
        self._services = parameter_server(config).services

    def ask(self, service: str, **request: Any) -> Any:
        ros_type, respond = self._services[service]
        response = respond(self._oracle.encode(f"{ros_type}_Request", request))
        return self._oracle.decode(f"{ros_type}_Response", response)

    def names(self) -> list[str]:
        return list(self.ask("list_parameters", prefixes=[], depth=0)["result"]["names"])

    def values(self) -> dict[str, Any]:
        fields = ("", "bool", "integer", "double", "string")
        fields += tuple(f"{kind}_array" for kind in ("byte", "bool", "integer", "double", "string"))
        names = self.names()
        got = self.ask("get_parameters", names=names)["values"]
        return {
            name: value[f"{fields[value['type']]}_value"]
            for name, value in zip(names, got, strict=True)
        }


def test_every_key_is_a_parameter_with_its_value(oracle: Oracle) -> None:
    values = Asked(
        oracle,
        "board.battery_curve=[[9, 0], [12, 1]]",
        'ros2.static_transforms=[{parent="base_link",child="laser",x=0.1}]',
        'chassis.preset="4wd"',
    ).values()
    assert values["serial.baudrate"] == 115200
    assert values["odometry.poll_rate_hz"] == 50.0
    assert values["ros2.bridge"] is True
    assert values["zenoh.listen"] == ["tcp/127.0.0.1:7448"]
    assert values["command.sources.cmd_vel/teleop.priority"] == 100
    assert values["board.battery_curve.1"] == [12.0, 1.0]
    assert values["ros2.static_transforms.0.child"] == "laser"
    assert values["ros2.static_transforms.0.x"] == 0.1
    assert values["ros2.stamped_commands"] == []


def test_every_parameter_is_described_and_read_only(oracle: Oracle) -> None:
    asked = Asked(oracle, "board.battery_curve=[[9, 0], [12, 1]]")
    described = asked.ask("describe_parameters", names=asked.names())["descriptors"]
    assert all(each["description"] for each in described)
    assert all(each["additional_constraints"] for each in described)
    assert all(each["read_only"] for each in described)
    by_name = {each["name"]: each for each in described}
    assert by_name["command.timeout_s"]["additional_constraints"].startswith("a number")
    assert "silence" in by_name["command.timeout_s"]["description"]


def test_what_names_keys_and_passwords_is_no_parameter(oracle: Oracle, tmp_path: Any) -> None:
    file = tmp_path / SECRET
    file.write_text("{}")
    asked = Asked(
        oracle,
        f"zenoh.config={file}",
        f'zenoh.listen=["tls/127.0.0.1:745#listen_private_key_file=/{SECRET}", "tcp/[::1]:748"]',
        f'zenoh.connect=["tls/127.0.0.1:7451#root_ca_certificate_file=/{SECRET}"]',
    )
    values = asked.values()
    assert values["zenoh.listen"] == ["tls/127.0.0.1:745", "tcp/[::1]:748"]
    assert values["zenoh.connect"] == ["tls/127.0.0.1:7451"]
    assert "zenoh.config" not in values
    assert SECRET not in repr(values)
    assert SECRET not in repr(asked.ask("get_parameters", names=["zenoh.config", *values]))


def test_a_refusal_names_the_way_to_change_it(oracle: Oracle) -> None:
    value = Asked(oracle).ask("get_parameters", names=["serial.dtr"])["values"][0]
    wanted = [{"name": "serial.dtr", "value": value}]
    (result,) = Asked(oracle).ask("set_parameters", parameters=wanted)["results"]
    assert not result["successful"]
    assert "config.toml" in result["reason"]
    assert "restart" in result["reason"]
