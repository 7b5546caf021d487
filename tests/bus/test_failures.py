import os
import socket

import pytest
import zenoh
from zenoh_fixtures import free_endpoint

from yahboomd.bus.failures import open_failure, port_holder
from yahboomd.bus.options import BusOptions, zenoh_config
from yahboomd.errors import BusError


@pytest.fixture
def listener():
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        yield listening.getsockname()[1]


def failure(options):
    with pytest.raises(zenoh.ZError) as caught:
        zenoh.open(zenoh_config(options))
    error = open_failure(caught.value, options)
    assert isinstance(error, BusError)
    assert ".rs:" not in str(error)
    return error


def test_who_listens_on_a_port_is_found(listener):
    holder = port_holder(listener)
    assert holder is not None
    assert holder.endswith(f"({os.getpid()})")


def test_nobody_listens_on_a_free_port():
    assert port_holder(int(free_endpoint().rpartition(":")[2])) is None


def test_an_address_in_use_is_told_with_its_holder_and_the_remedy(listener):
    endpoint = f"tcp/127.0.0.1:{listener}"
    error = failure(BusOptions(listen=(endpoint,), connect=()))
    assert endpoint in error.message
    assert f"({os.getpid()})" in error.message
    assert "zenoh.listen" in error.remedy


def test_an_address_of_another_machine_is_told():
    error = failure(BusOptions(listen=("tcp/192.0.2.1:7448",), connect=()))
    assert "no address tcp/192.0.2.1:7448" in error.message


def test_a_router_that_is_not_there_is_told_to_a_client():
    endpoint = free_endpoint()
    error = failure(BusOptions(mode="client", connect=(endpoint,)))
    assert endpoint in error.message
    assert "'router'" in error.remedy


def test_a_socket_in_a_folder_that_is_not_there_is_told(tmp_path):
    path = tmp_path / "missing" / "bus.sock"
    error = failure(BusOptions(listen=(), connect=(), unix_socket=path))
    assert str(path) in error.message
    assert "folder" in error.remedy


def test_tls_without_certificates_is_told():
    endpoint = free_endpoint().replace("tcp", "tls")
    error = failure(BusOptions(listen=(endpoint,), connect=()))
    assert "TLS" in error.message
    assert "zenoh.config" in error.remedy
