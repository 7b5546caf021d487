from __future__ import annotations

import pytest

from yahboomd.core.config.mistakes import shown


def nested() -> list:
    value: list = []
    for _ in range(2000):
        value = [value]
    return value


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[serail]\n", 'serail: unknown section; did you mean "serial"?'),
        (
            "[chassis]\nwheel_diamter = 0.065\n",
            (
                "chassis.wheel_diamter: unknown key; did you mean "
                '"wheel_radius_m", half of the diameter?'
            ),
        ),
        (
            "[chassis]\ntrack_width_m = 0.15\n",
            'chassis.track_width_m: unknown key; did you mean "wheel_separation_m"?',
        ),
        ("[command]\ntimeout = 1.0\n", 'command.timeout: unknown key; did you mean "timeout_s"?'),
        ("[command]\nframe_id = 'x'\n", 'command.frame_id: unknown key; "frame_id" belongs to'),
        ("motors = 3\n", 'motors: unknown section; "motors" belongs to [chassis]'),
        (
            "[chassis]\ncommand_sign = -1\n",
            "belongs to each entry of chassis.motors, { position, command_sign, ",
        ),
        ("[log]\nxyzzy = 1\n", "log.xyzzy: unknown key; known here: level"),
        ("serial = 3\n", "serial: expected a table { port, baudrate, dialect, "),
        ("[serial]\nbaudrate = '115200'\n", 'got "115200" (a number takes no quotes)'),
        ("[serial]\nbaudrate = 115200.0\n", "expected a whole number from 1200 to 4000000"),
        ("[serial]\nport = 3\n", "serial.port: expected text, got 3 (text needs quotes)"),
        ("[serial]\ndtr = 1\n", "serial.dtr: expected true or false, got 1"),
        ("[serial]\nport = 1979-05-27\n", "expected text, got 1979-05-27"),
        ("[limits]\nlinear = 3\n", "expected a table { velocity, acceleration, deceleration, jerk"),
        ("[limits]\nlinear = { velocity = nan }\n", "expected a number greater than 0, got nan"),
        (
            "[board]\nprofile = 'tt-none'\n",
            'a TT motor without encoder gives no odometry, got "tt-none"',
        ),
        ("[zenoh]\nlisten = 'tcp/[::]:1'\n", "unixsock-stream) (a list stands in [ ])"),
        ("[zenoh]\nnamespace = '/bot'\n", "it may not begin or end with '/'"),
        ("[command.sources.'a/']\n", 'command.sources."a/": it may not begin or end with'),
        (
            "[chassis.motors]\nleft = []\n",
            "expected a list of 1 to 4, each entry a table { position, command_sign, ",
        ),
        ("[chassis.motors]\nleft = [{}]\n", "left[0].position: missing; expected a whole number"),
        ("[chassis.motors]\nleft = { position = 1 }\n", "(a list stands in [ ])"),
        ("[log]\nlevel = 'warn'\n", 'got "warn"; the nearest is "warning"'),
        ("[ros2]\ndistro = 'Jazy'\n", 'or "rolling", got "Jazy"; the nearest is "jazzy"'),
        ("[ros2]\ndistro = 'mango'\n", 'or "rolling", got "mango"; the nearest is "lyrical"'),
        ("[ros2]\ndistro = 'foxy'\n", 'or "rolling", got "foxy"; the nearest is "humble"'),
        ("[ros2]\ndistro = ''\n", 'got ""; the nearest is "humble"'),
        ("[zenoh]\nmode = 'xyzzy'\n", 'zenoh.mode: expected "router", "peer" or "client"'),
    ],
)
def test_a_mistake_says_what_was_expected_and_what_was_found(complaints, text, words):
    assert any(words in line for line in complaints(text)), complaints(text)


@pytest.mark.parametrize(
    "text",
    [
        "[web]\ncamera = 'http://me:hunter2@robot/stream'\n",
        "[web]\ncamera = 'http://robot/stream?psw=hunter2'\n",
        "[web]\ncamera = ['http://robot/stream?psw=hunter2']\n",
        "web = 'http://robot/stream?psw=hunter2'\n",
        "[zenoh]\nlisten = ['tls/robot:7447#password=hunter2']\n",
        "[zenoh]\nlisten = 'tls/robot:7447#password=hunter2'\n",
        "[zenoh]\nlisten = [{ password = 'hunter2' }]\n",
        "[zenoh]\nconnect = ['me:hunter2@tcp/robot:7447']\n",
        "[zenoh]\nconnect = ['tcp/hunter2@robot:7447']\n",
        "[zenoh]\nnamespace = '@hunter2'\n",
        "[zenoh]\nmode = 'hunter2'\n",
        "[zenoh]\nconfig = 'hunter2'\n",
        "[zenoh]\nconfig = '/hunter2'\n",
        "[zenoh]\npassword = 'hunter2'\n",
    ],
)
def test_a_secret_in_an_address_is_refused_and_not_repeated(complaints, text):
    (mistake,) = complaints(text)
    assert "hunter2" not in mistake


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (True, "true"),
        ("a\nb", '"a\\nb"'),
        ([1, "x"], '[1, "x"]'),
        ({"a b": {}}, '{ "a b" = {} }'),
        (float("inf"), "inf"),
    ],
)
def test_a_value_is_shown_as_toml_writes_it(value, words):
    assert shown(value) == words


@pytest.mark.parametrize("value", [1 << 30_000, nested()], ids=["long", "deep"])
def test_a_value_that_cannot_be_written_is_not_shown(value):
    assert shown(value) == "a value too long to show"


def test_a_long_value_is_cut():
    assert len(shown("x" * 10_000)) == 60
