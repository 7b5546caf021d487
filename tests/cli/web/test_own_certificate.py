"""The certificate that openssl makes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.web.certificate import CERTIFICATE, KEY, Certificate, make_certificate


def test_it_names_every_host_and_its_key_is_for_this_user_alone(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    certificate, key, fingerprint = make_certificate(folder, ["192.168.1.5", "::1", "robot.local"])
    assert key.stat().st_mode & 0o777 == 0o600
    text = subprocess.run(
        ["openssl", "x509", "-in", certificate, "-noout", "-ext", "subjectAltName"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    for name in ("IP Address:192.168.1.5", "IP Address:0:0:0:0:0:0:0:1", "DNS:robot.local"):
        assert name in text
    assert fingerprint.count(":") == 31
    # Again: the one before is replaced.
    assert make_certificate(folder, ["robot.local"])[2] != fingerprint


def test_one_for_yesterdays_address_says_which_it_names_and_how_to_make_a_new_one(
    tmp_path: Path,
) -> None:
    certificate, key, _ = make_certificate(tmp_path, ["192.168.1.5", "robot.local"])
    made = Certificate(certificate=certificate, key=key)
    assert made.lacks(["192.168.1.5", "172.17.0.1"]) == ""
    assert made.lacks([]) == ""
    words = made.lacks(["10.0.0.7", "192.168.1.5"])
    assert "is for 192.168.1.5, robot.local, and not for 10.0.0.7" in words
    assert words.endswith("yahboomd web --make-certificate")


def test_it_replaces_links_and_never_writes_through_them(tmp_path: Path) -> None:
    """Root makes it in a folder of the service's user, who could point root at any file."""
    precious, folder = tmp_path / "precious", tmp_path / "state"
    precious.write_text("precious")
    folder.mkdir()
    for name in (CERTIFICATE, KEY):
        (folder / name).symlink_to(precious)
    for made in make_certificate(folder, ["robot.local"])[:2]:
        assert not made.is_symlink()
        assert made.stat().st_mode & 0o777 == 0o600
    assert precious.read_text() == "precious"
    assert {each.name for each in folder.iterdir()} == {CERTIFICATE, KEY}


def test_without_openssl_or_a_folder_it_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot be written"):
        make_certificate(tmp_path / "file", ["robot.local"])
    with pytest.raises(ConfigError, match="openssl did not make"):
        make_certificate(tmp_path, ["a b,IP:nonsense"])
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ConfigError, match="apt install openssl"):
        make_certificate(tmp_path, ["robot.local"])
