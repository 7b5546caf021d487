"""Who listens on a port; connections that are stuck."""

import os
import socket
from contextlib import suppress

import pytest
from zenoh_fixtures import free_endpoint

from yahboomd.core.bus.zenoh_sessions import hang_up_stuck, port_holder


def test_who_listens_on_a_port_is_found_while_its_other_files_come_and_go():
    with open(os.devnull) as other, socket.create_server(("127.0.0.1", 0)) as listening:
        # Its number is the first that is free, and is gone once the files have been listed.
        other.close()
        holder = port_holder(listening.getsockname()[1])
    assert holder is not None
    assert holder.endswith(f"({os.getpid()})")


def test_a_free_port_has_no_listener():
    assert port_holder(int(free_endpoint().rpartition(":")[2])) is None


@pytest.fixture
def connection():
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = socket.create_connection(server.getsockname())
        far, _ = server.accept()
        with near, far:
            yield near, far


def ends(near):
    return tuple("tcp/{}:{}".format(*end) for end in (near.getsockname(), near.getpeername()))


def fill(near):
    near.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            near.send(b"x" * 65536)


def is_shut(near):
    near.settimeout(0)
    try:
        return near.recv(1) == b""
    except BlockingIOError:
        return False


def test_a_connection_that_takes_nothing_is_hung_up_on(connection):
    near, _ = connection
    fill(near)
    link = ends(near)
    assert hang_up_stuck(lambda: [] if is_shut(near) else [link]) == [link[1]]
    assert is_shut(near)


def test_a_connection_with_nothing_waiting_is_left_alone(connection):
    near, far = connection
    near.send(b"read and acknowledged")
    far.recv(100)
    assert hang_up_stuck(lambda: [ends(near)]) == []
    assert not is_shut(near)


def test_sockets_that_are_not_named_are_left_alone(connection):
    near, _ = connection
    fill(near)
    assert hang_up_stuck(lambda: [("tcp/127.0.0.1:1", "tcp/127.0.0.1:2")]) == []
    assert not is_shut(near)


def test_no_descriptor_is_lost_by_looking(connection):
    near, _ = connection
    fill(near)
    hang_up_stuck(lambda: [] if is_shut(near) else [ends(near)])
    copies = []
    for fd in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            copies += [fd] * os.path.sameopenfile(int(fd), near.fileno())
    assert copies == [str(near.fileno())]
