import json
import os
import traceback
from pathlib import Path

import pytest

from yahboomd.core.bus.options import BusOptions, admitted, open_offline, zenoh_config
from yahboomd.core.errors import BusConfigError, BusError


def read(config, key):
    return json.loads(config.get_json(key))


def test_by_default_only_this_machine_reaches_the_bus():
    config = zenoh_config(BusOptions())
    assert read(config, "mode") == "router"
    assert read(config, "listen/endpoints") == ["tcp/127.0.0.1:7448"]
    assert read(config, "scouting/multicast/enabled") is False
    assert read(config, "scouting/gossip/enabled") is False
    assert BusOptions().exposed == ()


def test_a_router_that_gossips_connects_to_no_node_it_hears_of():
    config = zenoh_config(BusOptions(gossip=True))
    assert read(config, "scouting/gossip/enabled") is True
    assert read(config, "scouting/gossip/autoconnect") == {"router": [], "peer": []}
    assert read(config, "scouting/multicast/enabled") is False
    uplink = zenoh_config(BusOptions(gossip=True), uplink=True)
    assert read(uplink, "scouting/gossip/enabled") is False


def test_the_machines_router_is_joined_by_a_client_of_its_own():
    options = BusOptions()
    assert options.has_uplink
    assert read(zenoh_config(options), "connect/endpoints") == []
    uplink = zenoh_config(options, uplink=True)
    assert read(uplink, "mode") == "client"
    assert read(uplink, "listen/endpoints") == []
    assert read(uplink, "connect/endpoints") == ["tcp/127.0.0.1:7447"]
    assert read(uplink, "connect/timeout_ms") == 0
    assert read(uplink, "scouting/multicast/enabled") is False
    assert not BusOptions(connect=()).has_uplink
    assert not BusOptions(mode="peer").has_uplink


def test_two_sessions_never_have_one_id(tmp_path):
    path = tmp_path / "zenoh.json5"
    path.write_text('{ id: "abc" }')
    options = BusOptions(config_file=path)
    assert read(zenoh_config(options), "id") == "abc"
    assert read(zenoh_config(options, uplink=True), "id") is None


def test_the_access_control_of_the_file_is_enforced_by_the_daemon_and_not_by_its_tools(tmp_path):
    path = tmp_path / "zenoh.json5"
    path.write_text(
        '{ access_control: { enabled: true, default_permission: "deny", '
        "rules: [], subjects: [], policies: [] } }"
    )
    daemon = BusOptions(config_file=path)
    assert read(zenoh_config(daemon), "access_control")["enabled"] is True
    assert read(zenoh_config(daemon, uplink=True), "access_control")["enabled"] is True
    tool = BusOptions(config_file=path, mode="client", enforces=False)
    assert read(zenoh_config(tool), "access_control")["enabled"] is False


def test_a_peer_tries_a_missing_router_for_ever_and_never_waits_for_it():
    config = zenoh_config(BusOptions(mode="peer"))
    assert read(config, "connect/endpoints") == ["tcp/127.0.0.1:7447"]
    assert read(config, "connect/timeout_ms") == -1
    assert read(config, "connect/exit_on_failure") is False
    assert read(config, "open/return_conditions/connect_scouted") is False


def test_a_client_gives_up_in_time_because_it_cannot_open_without_its_router():
    config = zenoh_config(BusOptions(mode="client"))
    assert read(config, "connect/timeout_ms") > 0
    assert read(config, "connect/exit_on_failure") is True
    assert read(config, "listen/endpoints") == []


def test_messages_are_stamped_and_no_memory_is_shared():
    config = zenoh_config(BusOptions(lease_s=1.5))
    assert read(config, "timestamping/enabled") is True
    assert read(config, "transport/shared_memory/enabled") is False
    assert read(config, "transport/link/tx/lease") == 1500


MTLS = "{ transport: { link: { tls: { enable_mtls: true } } } }"
USERS = '{ transport: { auth: { usrpwd: { dictionary_file: "/etc/users" } } } }'
RULES = '{ access_control: { enabled: true, default_permission: "deny" } }'


@pytest.mark.parametrize(
    ("text", "endpoint", "words"),
    [
        ("{}", "tcp/0.0.0.0:1", "every program that reaches it can drive"),
        (MTLS, "tcp/0.0.0.0:1", "every program that reaches it can drive"),
        (MTLS, "tls/0.0.0.0:1", "every certificate that {file} accepts can drive"),
        (MTLS, "", "every program that reaches it can drive"),
        (USERS, "tcp/0.0.0.0:1", "every user that {file} names can drive"),
        (USERS, "", "every program that reaches it can drive"),
        (RULES, "tcp/0.0.0.0:1", "the access control in {file} decides who can drive"),
        (RULES, "", "the access control in {file} decides who can drive"),
    ],
)
def test_who_can_drive_through_an_endpoint_is_as_the_file_says(
    tmp_path: Path, text: str, endpoint: str, words: str
) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(text)
    assert admitted(BusOptions(config_file=file), endpoint) == words.format(file=file)


def test_endpoints_beyond_loopback_are_named_as_exposed():
    options = BusOptions(
        listen=(
            "tcp/127.0.0.1:1",
            "tcp/0.0.0.0:2",
            "tls/[::1]:3",
            "unixsock-stream//run/z.sock",
            "tcp/robot.local:4",
        ),
    )
    assert options.exposed == ("tcp/0.0.0.0:2", "tcp/robot.local:4")


@pytest.mark.parametrize(
    "endpoint",
    ["127.0.0.1:7447", "tcp", "tcp/", "tcp/127.0.0.1", "tcp/:7447", "tcp/host:99999", "tcp/host:x",
     "foo/127.0.0.1:1", "unixsock-stream/relative.sock", "/127.0.0.1:7447"],
)  # fmt: skip
def test_wrong_endpoints_are_named_in_listen_and_in_connect(endpoint):
    for setting in ("listen", "connect"):
        with pytest.raises(BusError) as caught:
            zenoh_config(BusOptions(**{setting: (endpoint,)}))
        assert f"zenoh.{setting}" in str(caught.value)
        assert caught.value.exit_code == os.EX_CONFIG


def test_a_namespace_that_is_no_key_is_refused():
    with pytest.raises(BusError, match="The namespace cannot be used: it has a character"):
        zenoh_config(BusOptions(namespace="bot/*"))


def test_a_client_without_a_router_to_connect_to_is_refused():
    with pytest.raises(BusError, match=r"zenoh.connect is empty"):
        zenoh_config(BusOptions(mode="client", connect=()))


def test_what_the_users_file_sets_wins(tmp_path):
    path = tmp_path / "zenoh.json5"
    path.write_text("{ scouting: { gossip: { enabled: true } }, transport: { link: { tx: "
                    "{ lease: 7000 } } }, /* a comment */ }")  # fmt: skip
    config = zenoh_config(BusOptions(config_file=path))
    assert read(config, "scouting/gossip/enabled") is True
    assert read(config, "transport/link/tx/lease") == 7000
    assert read(config, "scouting/multicast/enabled") is False
    assert read(config, "listen/endpoints") == ["tcp/127.0.0.1:7448"]


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('{ mode: "peer" }', "zenoh.mode"),
        ('{ listen: { endpoints: ["tcp/0.0.0.0:7447"] } }', "zenoh.listen"),
        ('{ connect: { endpoints: ["tcp/1.2.3.4:7447"] } }', "zenoh.connect"),
        ('{ namespace: "bot1" }', "zenoh.namespace"),
    ],
)
def test_a_setting_with_a_name_of_ours_is_refused_in_the_users_file(tmp_path, text, name):
    path = tmp_path / "zenoh.json5"
    path.write_text(text)
    with pytest.raises(BusError) as caught:
        zenoh_config(BusOptions(config_file=path))
    assert str(path) in str(caught.value)
    assert name in caught.value.remedy


@pytest.mark.parametrize("text", ["{ mode:", "{ nonsense: 1 }", "{ mode: 'foo' }", ""])
def test_a_file_that_is_no_configuration_is_named(tmp_path, text):
    path = tmp_path / "zenoh.json5"
    path.write_text(text)
    with pytest.raises(BusError) as caught:
        zenoh_config(BusOptions(config_file=path))
    assert caught.value.exit_code == os.EX_CONFIG, "the service is not started again"
    assert str(path) in caught.value.message
    assert "\n" not in caught.value.message


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    binary = tmp_path / "binary.json5"
    binary.write_bytes(b"\xff\xfe\x00")
    for path in (Path("/nonexistent.json5"), tmp_path, binary):
        with pytest.raises(BusError, match="cannot be read") as caught:
            zenoh_config(BusOptions(config_file=path))
        assert str(path) in caught.value.message


@pytest.mark.cases(4)
@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        "{metadata: " + "[" * 100_000 + "]" * 100_000 + "}",
        "{a: " * 100_000 + "1" + "}" * 100_000,
        "[ // ]\n" * 100_000,
        "[ /* ] */" * 100_000,
        "[ ']' ," * 100_000,
        "/*" * 400_000 + "[" * 100_000,
        r"\"" * 400_000,
        "'" + "\\" * 999_999,
        "#" * 2_000_000,
    ],
    ids=[
        "lists",
        "within metadata",
        "objects",
        "behind comments",
        "behind long comments",
        "behind texts",
        "a comment without end",
        "texts without end",
        "an escape without end",
        "megabytes",
    ],
)
def test_a_file_that_zenohs_parser_would_not_survive_is_refused(tmp_path, text):
    path = tmp_path / "zenoh.json5"
    path.write_text(text)
    with pytest.raises(BusError, match="cannot be used") as caught:
        zenoh_config(BusOptions(config_file=path))
    assert len(str(caught.value)) < 1000, "Zenoh quotes the line"


def test_a_key_in_a_file_that_was_cut_off_is_not_in_the_error(tmp_path):
    path = tmp_path / "zenoh.json5"
    path.write_text(
        '{\n "transport": {"link": {"tls": {\n "listen_private_key_base64": "LS0tSECRET'
    )
    with pytest.raises(BusError, match=r"--> 3:42 = expected") as caught:
        zenoh_config(BusOptions(config_file=path))
    whole = "".join(traceback.format_exception(caught.value))
    assert "SECRET" not in whole


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('{ transport: { auth: { usrpwd: "anna:SECRET" } } }', "expected struct UsrPwdConf"),
        ('{ transport: { auth: { usrpwd: { password: ["SECRET"] } } } }', "expected a string"),
        ('{ transport: { auth: { usrpwd: { "anna:SECRET": "" } } } }', "expected one of `user`"),
        ('{ transport: { link: { tx: { lease: "SECRET, expected `: SECRET" } } } }', "number"),
        ('{ timestamping: { enabled: "a|SECRET" } }', "expected"),
        ('{ access_control: { default_permission: "`: SECRET" } }', "expected `allow` or `deny`"),
        ('{ aggregation: { subscribers: ["SECRET//`: x"] } }', "empty chunks are forbidden"),
        ('{ id: "SECRET" }', "a value that Zenoh does not take"),
        ('{ scouting: { multicast: { address: "SECRET" } } }', "invalid socket address"),
    ],
)  # fmt: skip
def test_a_value_of_the_file_is_not_in_the_error(tmp_path, text, why):
    path = tmp_path / "zenoh.json5"
    path.write_text(text)
    with pytest.raises(BusError) as caught:
        zenoh_config(BusOptions(config_file=path))
    assert why in caught.value.message
    assert "SECRET" not in "".join(traceback.format_exception(caught.value))


@pytest.mark.parametrize(
    ("text", "listen", "why"),
    [
        ("{ transport: { unicast: { lowlatency: true } } }", "tcp/192.0.2.1:1", "'lowlatency'"),
        ('{ transport: { auth: { usrpwd: { dictionary_file: "/nonexistent" } } } }',
         "tcp/192.0.2.1:1", "No such file"),
        ("{}", "tls/192.0.2.1:1", "Missing TLS private key"),
        ("{}", "quic/192.0.2.1:1#listen_private_key_file=/nonexistent", "No such file"),
    ],
)  # fmt: skip
def test_what_no_network_can_mend_is_found_without_one(tmp_path, text, listen, why):
    path = tmp_path / "zenoh.json5"
    path.write_text(text)
    with pytest.raises(BusConfigError, match=why) as caught:
        open_offline(BusOptions(config_file=path, listen=(listen,)))
    assert str(path) in caught.value.message


def test_what_only_the_network_can_tell_is_not_judged_without_one(tmp_path):
    path = tmp_path / "zenoh.json5"
    path.write_text('{ scouting: { multicast: { enabled: true, interface: "none0" } } }')
    away = ("tcp/192.0.2.1:1", "unixsock-stream//nonexistent/z.sock")
    open_offline(BusOptions(config_file=path, listen=away, connect=away, mode="client"))


def test_brackets_in_texts_and_comments_are_not_counted(tmp_path):
    path = tmp_path / "zenoh.json5"
    many = "[" * 999
    path.write_text(f"{{ /* {many} */ metadata: {{ a: '{many}' }} }} // {many}")
    config = zenoh_config(BusOptions(config_file=path))
    assert read(config, "metadata") == {"a": many}


def test_a_pipe_is_no_configuration_and_hangs_nothing(tmp_path):
    path = tmp_path / "zenoh.json5"
    os.mkfifo(path)
    with pytest.raises(BusError, match="it is no ordinary file"):
        zenoh_config(BusOptions(config_file=path))
