from __future__ import annotations

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from yahboomd.core.names import (
    camera_problem,
    endpoint_problem,
    host_and_port,
    is_local,
    is_ros_name,
    name_problem,
    source_words,
)

CHUNKS = st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=4).map("/".join)


def test_names_that_zenoh_or_a_reader_would_trip_over_are_refused():
    for name in ("/bot1", "bot1/", "a//b", "bot*", "a/**", "b$t", "who?", "a#b", "a b", "@bot", ""):
        assert name_problem(name), name
    assert name_problem("bot\udcff") == "it is not UTF-8"
    assert name_problem("/bot1") == name_problem("bot1/") == "it may not begin or end with '/'"


def test_usual_names_are_accepted():
    for name in ("bot1", "site/hall-2/bot_1", "Roboter.7", "café"):
        assert name_problem(name) is None, name


@settings(max_examples=30)
@given(CHUNKS)
def test_zenoh_takes_every_name_that_is_accepted(name):
    if name_problem(name) is None:
        assert str(zenoh.KeyExpr(f"{name}/yahboomd/pose")) == f"{name}/yahboomd/pose"


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7448",
        "tcp/[::1]:7447",
        "tcp/[fe80::1%eth0]:7447",
        "udp/robot.local:0",
        "udp/robot.local:65535",
        "tls/10.0.0.1:7447#root_ca_certificate=/etc/ca.pem",
        "tcp/10.0.0.1:7447?rel=1#iface=eth0",
        "quic/localhost:7447",
        "unixsock-stream//run/yahboomd/zenoh.sock",
        "tls/r:1?rel=1;prio=1-3#iface=eth0;connect_private_key_file=/etc/k.pem;enable_mtls=true",
    ],
)
def test_endpoints_that_zenoh_takes_are_taken(endpoint):
    assert endpoint_problem(endpoint) is None


@pytest.mark.parametrize(
    "endpoint",
    [
        "",
        "127.0.0.1:7448",
        "tcp:127.0.0.1:7448",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:65536",
        "tcp/:7447",
        "tcp/::1:7447",
        "tcp/a b:7447",
        "http/localhost:80",
        "ws/localhost:80",
        "serial//dev/ttyUSB0",
        "unixsock-stream/",
        "unixsock-stream/relative.sock",
        "tcp/127.0.0.1:7448\n",
        "tcp/robot\udcff:7448",
        "tls/robot:7447#connect_private_key_base64=c2VjcmV0",
        "tls/robot:7447#connect_private_key_file=LS0tLS1CRUdJTg",
        "tls/robot:7447?password=secret",
        "tls/robot:7447#psw=secret",
        "tls/robot:7447#iface=eth0;loginpas=secret",
        "tls/me:secret@robot:7447",
        "tls/secret@robot:7447",
    ],
)
def test_endpoints_that_zenoh_cannot_use_are_refused(endpoint):
    assert endpoint_problem(endpoint)


@pytest.mark.parametrize(
    "address",
    [
        "",
        "http://127.0.0.1:8080/stream",
        "http://localhost:8080/?action=stream",
        "http://127.0.0.1:1984/api/stream.mjpeg?src=design",
        "http://esp32-cam.local",
        "http://[fd00::1]:81/stream",
        "http://robot:8080/stream?topic=/camera/image_raw&type=mjpeg&width=640&quality=50",
    ],
)
def test_addresses_of_cameras_are_taken(address):
    assert camera_problem(address) is None


@pytest.mark.parametrize(
    "address",
    [
        "127.0.0.1:8080",
        "https://127.0.0.1/stream",
        "file:///etc/passwd",
        "http://",
        "http://robot:65536/stream",
        "http://robot:/stream",
        "http://robot/a b",
        "http://robot/a\r\nHost: x",
        "http://robot/a\n",
        "http://robot/#part",
        "http://r\u00f6bot/",
        "http://\u0661.1.1.1/",
        "http://robot/\udcff",
    ],
)
def test_what_names_no_camera_is_refused(address):
    assert "not of the form" in str(camera_problem(address))


@pytest.mark.parametrize(
    "address",
    [
        "http://me:hunter2@robot/stream",
        "https://me:hunter2@robot/stream",
        "http://robot/stream?user=me&password=hunter2",
        "http://robot/stream?access_token=hunter2",
        "http://robot/stream?API_KEY=hunter2",
        "http://robot/stream?loginuse=me&loginpas=hunter2",
        "http://robot/stream?psw=hunter2",
        "http://robot/stream?u=me&p=hunter2",
        "http://robot/stream;password=hunter2",
        "http://robot/stream?action=stream;password=hunter2",
        "http://robot/stream?action=stream%26psw%3Dhunter2",
        "http://robot/user=me_password=hunter2_channel=1",
        "http://robot/?hunter2",
        "http://robot/?src=rtsp://me:hunter2@camera",
        "http://robot?psw=hunter2",
    ],
)
def test_a_secret_in_the_address_of_a_camera_is_refused_and_not_repeated(address):
    problem = str(camera_problem(address))
    assert "secret" in problem
    assert "hunter2" not in problem


@pytest.mark.parametrize(
    ("endpoint", "local"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/127.8.0.1:7447?rel=1#iface=lo", True),
        ("tcp/localhost:7447", True),
        ("udp/[::1]:7447", True),
        ("unixsock-stream//run/bus.sock", True),
        ("tcp/127.example.org:7447", False),
        ("tcp/[::]:7447", False),
        ("tcp/192.168.1.5:7447", False),
        ("tls/robot:7447", False),
        ("tls/robot:7447#connect_private_key_file=/etc/yahboomd/key.pem", False),
    ],
)
def test_endpoints_of_this_machine_are_local(endpoint, local):
    assert is_local(endpoint) is local
    assert endpoint_problem(endpoint) is None


def test_what_is_no_endpoint_is_not_local():
    assert not is_local("7447")


@pytest.mark.parametrize(
    ("endpoint", "place"),
    [
        ("tcp/10.0.0.1:7447?rel=1#iface=eth0", ("10.0.0.1", 7447)),
        ("tcp/[fe80::1%eth0]:7447", ("fe80::1%eth0", 7447)),
        ("unixsock-stream//run/bus.sock", None),
        ("7447", None),
    ],
)
def test_host_and_port_of_an_endpoint(endpoint, place):
    assert host_and_port(endpoint) == place


@pytest.mark.parametrize("name", ["odom", "wheel/odom", "_a/b1"])
def test_relative_names_of_ros(name):
    assert is_ros_name(name)


@pytest.mark.parametrize("name", ["", "/odom", "odom/", "a//b", "1odom", "my-bot", "odom\n"])
def test_names_that_ros_refuses(name):
    assert not is_ros_name(name)


def test_the_source_of_the_page_is_called_the_page_and_others_by_their_key():
    assert source_words("cmd_vel/web") == "The page"
    assert source_words("cmd_vel/teleop") == "cmd_vel/teleop"
