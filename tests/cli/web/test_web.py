"""The command as a process, on a real daemon with the simulated board."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import tomllib
from pathlib import Path

import pytest
from real_robot import Process, free_endpoint

from yahboomd.cli.main import main
from yahboomd.cli.web import state_folder

pytestmark = pytest.mark.realtime


def test_it_prints_its_address_and_ends_in_order() -> None:
    web = Process("web", "--listen", "127.0.0.1:0", "--connect", free_endpoint())
    try:
        web.says("The page is at http://127.0.0.1:")
        web.says("does not answer; it is waited for")
    finally:
        status = web.end(signal.SIGTERM)
    assert status == 0
    assert "Traceback" not in web.output


def test_the_extra_has_what_the_commands_behind_the_page_need() -> None:
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())
    extras = project["project"]["optional-dependencies"]
    assert {*extras["record"], *extras["calibrate"]} <= set(extras["web"])


def test_beyond_loopback_links_are_made_by_a_command_and_never_printed_into_a_log(
    tmp_path: Path,
) -> None:
    environ = {"STATE_DIRECTORY": str(tmp_path)}
    web = Process(*("web", "--listen", "0.0.0.0:0", "--connect", free_endpoint()), environ=environ)
    try:
        web.says("--show-link")
        web.says("Without TLS everybody")
    finally:
        assert web.end(signal.SIGINT) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["web-served.json"]
    link = Process("web", "--show-link", environ=environ)
    assert link.end_by_itself() == 0
    tokens = re.findall(r"#token=([\w-]{22})", link.output)
    assert len(set(tokens)) == 2
    assert not any(token in web.output for token in tokens)


@pytest.mark.nightly
def test_a_folder_that_others_may_write_to_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    environ = {"STATE_DIRECTORY": str(tmp_path)}
    web = Process(*("web", "--listen", "0.0.0.0:0", "--connect", free_endpoint()), environ=environ)
    assert web.end_by_itself() == 78
    assert "Other users may write to" in web.output


def test_sessions_are_listed_and_ended_by_commands(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    assert main(["web", "--sessions"]) == 0
    assert "No phone has a session" in capsys.readouterr().out
    status, words = failed(capsys, "--end-session", "3f9a2c")
    assert (status, "There is no session 3f9a2c" in words) == (78, True)
    assert main(["web", "--end-session", "all"]) == 0
    assert "0 sessions are ended" in capsys.readouterr().out


def failed(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    status = main(["web", *arguments])
    return status, capsys.readouterr().err


def test_mistakes_are_named_with_what_to_do(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    status, words = failed(capsys, "--listen", "here")
    assert (status, "no address and port" in words) == (78, True)
    status, words = failed(capsys, "--certificate", "a.pem")
    assert (status, "belong together" in words) == (78, True)
    status, words = failed(
        capsys, "--certificate", str(tmp_path / "a.pem"), "--key", str(tmp_path / "b.pem")
    )
    assert (status, "a.pem cannot be read" in words) == (78, True)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        status, words = failed(capsys, "--listen", f"127.0.0.1:{taken.getsockname()[1]}")
    assert (status, "Choose another port" in words) == (69, True)


@pytest.mark.parametrize("name", ["", "a b", "a,URI:x", "a\nb", "/", "-x"])
def test_a_name_that_no_machine_has_is_refused(
    capsys: pytest.CaptureFixture[str], name: str
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["web", "--make-certificate", f"--host-name={name}"])
    assert f"{name!r} is no name of a machine" in capsys.readouterr().err


def test_a_name_is_one_as_browsers_send_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    names = ("robot.local", "b\u00fccher.local", "fe80::1")
    assert main(["web", "--make-certificate", *(f"--host-name={name}" for name in names)]) == 0
    assert capsys.readouterr().out.startswith("A certificate is made")
    shown = ["openssl", "x509", "-noout", "-ext", "subjectAltName", "-in"]
    found = subprocess.check_output([*shown, str(tmp_path / "web-certificate.pem")], text=True)
    for name in ("DNS:robot.local", "DNS:xn--bcher-kva.local", "IP Address:FE80:"):
        assert name in found


def test_a_certificate_is_made_by_one_command_and_used_from_then_on(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    assert main(["web", "--show-link"]) == 78
    assert "add --listen" in capsys.readouterr().err
    assert main(["web", "--make-certificate"]) == 0
    assert f"{tmp_path}/web-certificate.pem" in capsys.readouterr().out
    assert main(["web", "--show-link", "--listen", "192.0.2.5:8480"]) == 0
    assert "https://192.0.2.5:8480/#" in capsys.readouterr().out


def test_tokens_are_kept_where_the_state_of_this_user_belongs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert state_folder({"STATE_DIRECTORY": "/var/lib/a:/b"}, 0) == Path("/var/lib/a")
    for has_service, folder in (
        (True, "/var/lib/yahboomd-web"),
        (False, "/root/.local/state/yahboomd"),
    ):
        monkeypatch.setattr(Path, "is_dir", lambda _path, is_dir=has_service: is_dir)
        assert state_folder({"HOME": "/root"}, 0) == Path(folder)
    assert state_folder({"XDG_STATE_HOME": "/s"}, 1000) == Path("/s/yahboomd")
    assert state_folder({"HOME": "/h"}, 1000) == Path("/h/.local/state/yahboomd")
