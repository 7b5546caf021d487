from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core import program
from yahboomd.core.config import Config


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An environment of its own, in the folder that the person is in; not on the PATH."""
    own = tmp_path / ".venv" / "bin" / "yahboomd"
    own.parent.mkdir(parents=True)
    own.touch(mode=0o755)
    monkeypatch.setattr("sys.executable", str(own.with_name("python")))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "/nowhere")
    return own


def test_an_environment_that_is_not_active_is_named_in_what_is_pasted(own: Path) -> None:
    text = "Run `yahboomd probe --write`. To drive again: yahboomd stop --release"
    assert program.pasteable(text) == (
        "Run `.venv/bin/yahboomd probe --write`. To drive again: .venv/bin/yahboomd stop --release"
    )


def test_from_another_folder_the_whole_path_is_named(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (own.parents[2] / "elsewhere").mkdir()
    monkeypatch.chdir(own.parents[2] / "elsewhere")
    assert program.pasteable("`yahboomd stop`") == f"`{own} stop`"


def test_what_is_on_the_path_is_named_as_it_is(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link = own.parents[2] / "local"
    link.mkdir()
    (link / "yahboomd").symlink_to(own)
    monkeypatch.setenv("PATH", str(link))
    assert program.pasteable("`yahboomd stop`") == "`yahboomd stop`"


def test_another_one_on_the_path_is_not_meant(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = own.parents[2] / "other"
    other.mkdir()
    (other / "yahboomd").touch(mode=0o755)
    monkeypatch.setenv("PATH", str(other))
    assert program.pasteable("`yahboomd stop`") == "`.venv/bin/yahboomd stop`"


def test_an_extra_is_installed_into_the_environment_that_runs_and_from_its_own_source(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = Path(program.__file__).parents[2]
    assert program.install_command("web") == (f".venv/bin/python -m pip install '{source}[web]'")
    assert program.install_command("fleet").endswith(f" install {source}/extras/fleet")
    monkeypatch.setattr("sys.executable", f"{source}/.venv/bin/python")
    monkeypatch.chdir(source)
    assert program.install_command("web") == ".venv/bin/python -m pip install '.[web]'"
    assert program.install_command("fleet").endswith(" install ./extras/fleet")
    monkeypatch.setattr(program, "__file__", str(own.with_name("yahboomd") / "core/program.py"))
    assert program.install_command("web").endswith("install 'yahboomd[web]'")
    assert program.install_command("fleet").endswith("install yahboomd-fleet")
    # A service's folder: its words are read elsewhere.
    monkeypatch.chdir("/")
    assert program.install_command("web").startswith(f"{source}/.venv/bin/python -m")


@pytest.mark.parametrize(
    "text",
    [
        "yahboomd drives the wheels",
        "the service yahboomd/estop/reset",
        "sudo /opt/yahboomd stop",
        ".venv/bin/yahboomd stop",
    ],
)
def test_what_is_no_command_stays(own: Path, text: str) -> None:
    assert program.pasteable(text) == text


def test_what_is_printed_cannot_command_a_terminal() -> None:
    text = "firmware \x1b[2J\x9b31m1.7\x7f\r: ok,\n\tgrün"
    assert program.readable(text) == "firmware ?[2J?31m1.7??: ok,\n\tgrün"
    assert program.readable("plain") == "plain"


@given(st.text())
def test_what_comes_over_the_bus_cannot_command_the_terminal(text: str) -> None:
    assert "\x1b" not in program.plain(text)
    assert program.plain(text).isprintable()
    assert len(program.plain(text)) == len(text)


@pytest.mark.parametrize(
    ("namespace", "listen", "command"),
    [
        ("", (program.STANDARD_LISTEN,), "yahboomd stop --release"),
        ("", (), "yahboomd stop --release"),
        ("bot1", ("tcp/x:1",), "yahboomd stop --release --namespace bot1 --connect tcp/x:1"),
        ("", ("tcp/0.0.0.0:7", "tcp/x:1"), "yahboomd stop --release --connect tcp/127.0.0.1:7"),
        ("", ("tcp/[::]:7",), "yahboomd stop --release --connect 'tcp/[::1]:7'"),
    ],
)
def test_the_command_that_releases_reaches_the_daemon_that_was_stopped(
    namespace: str, listen: tuple[str, ...], command: str
) -> None:
    assert program.release_command(namespace, listen) == command


def test_where_a_daemon_has_its_standard_address_is_as_configured() -> None:
    assert Config().zenoh.listen == (program.STANDARD_LISTEN,)


def test_in_a_folder_that_was_removed_the_whole_path_is_named(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = own.parents[2] / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert program.pasteable("`yahboomd stop`") == f"`{own} stop`"
    assert program.install_command("web").startswith(f"{own.with_name('python')} -m pip")
