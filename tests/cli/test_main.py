from __future__ import annotations

import argparse
import errno
import os
import stat
import subprocess
import sys
import types
from pathlib import Path

import pytest
from zenoh_fixtures import free_endpoint

from yahboomd import __version__
from yahboomd.cli import main as cli
from yahboomd.core.errors import ConfigError, PortDenied, PortMissing
from yahboomd.core.program import COMMANDS, install_command


@pytest.fixture
def command(monkeypatch):
    """Replace ``drive`` by a command that the test defines."""

    def install(body, options=()):
        module = types.ModuleType("yahboomd.cli.drive")

        def add_options(parser):
            for option in options:
                parser.add_argument(option)

        module.DESCRIPTION, module.EPILOG = "The keys are W A S D.", ""
        module.add_options = add_options
        module.run = body
        monkeypatch.setitem(sys.modules, "yahboomd.cli.drive", module)

    return install


def raising(error):
    def body(args: argparse.Namespace) -> int:
        raise error

    return body


def test_help_lists_every_command_in_one_line_each(capsys):
    with pytest.raises(SystemExit) as left:
        cli.main(["--help"])
    assert left.value.code == 0
    shown = capsys.readouterr().out
    lines = [line.split(maxsplit=1) for line in shown.splitlines()]
    assert all([name, text] in lines for name, text in COMMANDS.items())


def test_the_daemon_loads_none_of_the_libraries_that_it_has_no_use_for():
    script = (
        "import sys; from yahboomd.cli.main import main\n"
        "try: main(['run', '--help'])\n"
        "except SystemExit: pass\n"
        "import yahboomd.core.daemon.service\n"
        "loaded = {name for name, module in sys.modules.items() if module is not None}\n"
        "unused = {'_ssl', '_hashlib', 'rich', 'numpy', 'matplotlib', 'http', 'xml'}\n"
        "print(sorted(unused & loaded))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip().split("\n")[-1] == "[]"
    # hashlib complains if an algorithm is missing.
    assert not done.stderr


def test_a_command_gets_its_options_and_gives_the_exit_status(command):
    seen = []
    command(lambda args: seen.append(args.speed) or 7, options=["--speed"])
    assert cli.main(["drive", "--speed", "2"]) == 7
    assert seen == ["2"]


def test_the_version_is_that_of_the_package(capsys):
    with pytest.raises(SystemExit) as left:
        cli.main(["--version"])
    assert left.value.code == 0
    assert capsys.readouterr().out == f"yahboomd {__version__}\n"


def test_an_unknown_option_is_reported_with_the_usage_of_its_command(command, capsys):
    command(lambda args: 0, options=["--speed"])
    with pytest.raises(SystemExit) as left:
        cli.main(["drive", "--sped", "2"])
    assert left.value.code == 2
    words = capsys.readouterr().err
    assert "usage: yahboomd drive" in words
    assert "yahboomd drive: error: unrecognized arguments: --sped 2" in words


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (ConfigError("Two mistakes."), 78),
        (PortMissing("No port."), 69),
        (PortDenied("No permission."), 77),
    ],
)
def test_an_error_is_one_message_with_its_remedy_and_exit_status(command, capsys, error, status):
    error.remedy = "Do this."
    command(raising(error))
    assert cli.main(["drive"]) == status
    assert capsys.readouterr() == ("", f"yahboomd: {error.message} Do this.\n")


def test_control_c_ends_with_130_and_no_traceback(command, capsys):
    command(raising(KeyboardInterrupt()))
    assert cli.main(["drive"]) == 130
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("file", ["/x/y", Path("/x/y")])
def test_a_file_that_cannot_be_used_is_named(command, capsys, file):
    command(raising(OSError(errno.ENAMETOOLONG, "File name too long", file)))
    assert cli.main(["drive"]) == os.EX_IOERR
    assert capsys.readouterr() == ("", "yahboomd: /x/y: File name too long.\n")


def test_a_missing_extra_is_named_with_the_way_to_install_it(command, capsys):
    command(raising(ModuleNotFoundError("No module named 'rich.live'", name="rich.live")))
    assert cli.main(["drive"]) == 69
    assert f"needs rich: {install_command('monitor')}\n" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        ("rich", install_command("monitor")),
        ("zenoh", "needs the Python package zenoh"),
        ("yahboomd.cli.drive", "is not part of this installation"),
    ],
)
def test_a_command_that_cannot_be_imported_is_a_sentence(monkeypatch, capsys, missing, words):
    def refuse(name):
        raise ModuleNotFoundError(f"No module named {missing!r}", name=missing)

    monkeypatch.setattr(cli.importlib, "import_module", refuse)
    assert cli.main(["drive"]) == 69
    assert words in capsys.readouterr().err


def test_a_reader_that_leaves_is_no_error(tmp_path):
    # More than a pipe holds, so that writing meets the closed end in any case.
    script = (
        "import sys, types; from yahboomd.cli import main as cli\n"
        "module = types.ModuleType('yahboomd.cli.drive')\n"
        "module.DESCRIPTION = module.EPILOG = ''\n"
        "module.add_options = lambda parser: None\n"
        "module.run = lambda args: print('x' * 10_000_000) or 0\n"
        "sys.modules['yahboomd.cli.drive'] = module\n"
        "sys.exit(cli.main(['drive']))"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.read(1)
        process.stdout.close()
        complaint = process.stderr.read()
        assert process.wait(60) == 141
    assert complaint == b""


@pytest.fixture
def full_disk(tmp_path):
    """A file to which nothing can be written."""
    usual = Path("/dev/full")
    if usual.is_char_device():
        return usual
    made = tmp_path / "full"
    try:
        os.mknod(made, 0o666 | stat.S_IFCHR, os.makedev(1, 7))
        made.open("w").close()
    except PermissionError:
        pytest.skip("there is no /dev/full, and this user may not make one")
    return made


def test_a_full_disk_is_a_sentence(full_disk):
    with full_disk.open("w") as output:
        done = subprocess.run(
            [sys.executable, "-m", "yahboomd", "completions", "bash"],
            stdout=output,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 74
    assert done.stderr == "yahboomd: the output cannot be written: No space left on device.\n"


def test_an_argument_that_is_not_utf8_is_a_sentence(yahboomd):
    done = yahboomd("run", "--port", "/tmp/\udcff")
    assert done.returncode == os.EX_CONFIG
    assert "it is not UTF-8" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_variable_that_is_not_utf8_is_a_sentence(yahboomd):
    done = yahboomd("config", "check", YAHBOOMD_SERIAL__PORT="/\udcff")
    assert done.returncode == os.EX_CONFIG
    assert done.stderr.splitlines()[1:] == ["YAHBOOMD_SERIAL__PORT: serial.port: it is not UTF-8"]


CLOSED = """\
import os, threading
from yahboomd.cli import main as cli

def run(arguments):
    # A thread that runs on at the end, as Zenoh's do.
    threading.Thread(target=threading.Event().wait, daemon=True).start()
    print("lost")
    os.write(opened, str(os.open("/dev/null", os.O_RDWR)).encode())
    return 0

opened = int(os.environ["OPENED"])
cli._run = run
cli.main()
"""


@pytest.mark.cases(1)
@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_what_is_opened_never_takes_the_place_of_a_stream_that_the_caller_closed(closed):
    reading, writing = os.pipe()
    command = f'"$0" -c "$1" {closed}'
    done = subprocess.run(
        ["sh", "-c", command, sys.executable, CLOSED],
        capture_output=True,
        env=dict(os.environ, OPENED=str(writing)),
        pass_fds=[writing],
        timeout=60,
        check=False,
    )
    os.close(writing)
    with open(reading, "rb") as opened:
        assert int(opened.read()) > 2
    assert (done.returncode, done.stderr) == (0, b"")


class PanicException(BaseException):
    """Zenoh's panics are no Exceptions either."""


OPENING = """\
import sys, time
from yahboomd.cli.main import main

class Farewell:
    # The interpreter is torn down for so long that Zenoh gives up meanwhile, and comes back.
    def __del__(self, sleep=time.sleep):
        sleep(1.5)

farewell = Farewell()
sys.exit(main())
"""


@pytest.mark.cases(1)
@pytest.mark.realtime
@pytest.mark.parametrize("timeout_s", ["0", "0.2", "0.7"])
def test_a_session_that_is_still_opening_at_the_end_aborts_nothing(timeout_s):
    arguments = ["monitor", "--once", "--timeout", timeout_s, "--connect", free_endpoint()]
    done = subprocess.run(
        [sys.executable, "-c", OPENING, *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 69, done.stderr
    assert f"within {timeout_s} s" in done.stderr


def test_a_bug_keeps_its_traceback_and_its_status_while_a_thread_runs():
    script = (
        "import sys, threading, types; from yahboomd.cli import main as cli\n"
        "threading.Thread(target=threading.Event().wait, daemon=True).start()\n"
        "module = types.ModuleType('yahboomd.cli.drive')\n"
        "module.DESCRIPTION = module.EPILOG = ''\n"
        "module.add_options = lambda parser: None\n"
        "module.run = lambda args: 1 / 0\n"
        "sys.modules['yahboomd.cli.drive'] = module\n"
        "sys.argv[1:] = ['drive']\n"
        "sys.exit(cli.main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert done.stderr.rstrip().endswith("ZeroDivisionError: division by zero")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.EMFILE, "Too many open files"), "Too many open files"),
        (MemoryError(), "no memory is left"),
        (RuntimeError("can't start new thread"), "no thread can be started"),
        (PanicException("OS can't spawn worker thread: (os error 11)"), "no thread can be started"),
        (PanicException("Failed to init net"), "Zenoh cannot start its threads"),
        (ImportError("/x.so: failed to map segment from shared object"), "no memory is left"),
    ],
)
def test_a_shortage_is_known_by_its_error(error: BaseException, words: str) -> None:
    found = cli._shortage(error)
    assert found is not None
    assert found.message == f"The system gives this process too little: {words}."
    assert found.exit_code == os.EX_OSERR


def test_on_a_python_that_is_too_old_it_says_so_and_does_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "OLDEST", (9, 1))
    assert cli.main(["status"]) == os.EX_CONFIG
    assert capsys.readouterr().err.count("\n") == 1
