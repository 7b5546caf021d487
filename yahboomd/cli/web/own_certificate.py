"""A certificate for this machine, made by openssl and signed by itself."""

from __future__ import annotations

import ipaddress
import os
import subprocess
from collections.abc import Iterable
from pathlib import Path

from yahboomd.errors import ConfigError
from yahboomd.web.entry_tokens import give_to_owner

CERTIFICATE = "web-certificate.pem"
KEY = "web-key.pem"

DAYS = 825
"""The longest that phones accept."""


def make_certificate(folder: Path, hosts: Iterable[str]) -> tuple[Path, Path, str]:
    """Make a certificate and its key; those of before are replaced.

    Args:
        folder: Where they go; the key is for this user alone.
        hosts: Names and addresses by which browsers ask.

    Returns:
        The certificate, the key, and the fingerprint that a browser shows.

    Raises:
        ConfigError: There is no openssl, or the folder cannot be written to.
    """
    certificate, key = folder / CERTIFICATE, folder / KEY
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        key.unlink(missing_ok=True)
        # openssl writes into a file that others could not read at any moment.
        os.close(os.open(key, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
        _openssl(
            *("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1"),
            *("-nodes", "-keyout", str(key), "-out", str(certificate), "-days", str(DAYS)),
            *("-subj", "/CN=yahboomd", "-addext", f"subjectAltName={','.join(map(_name, hosts))}"),
            *("-addext", "extendedKeyUsage=serverAuth"),
        )
        for each in (certificate, key):
            give_to_owner(folder, each)
        shown = _openssl("x509", "-in", str(certificate), "-noout", "-fingerprint", "-sha256")
    except OSError as error:
        raise ConfigError(
            f"The certificate cannot be written to {folder}: {error.strerror}.",
            remedy="Set XDG_STATE_HOME to a folder that this user may write to.",
        ) from error
    return certificate, key, shown.strip().partition("=")[2]


def _name(host: str) -> str:
    try:
        return f"IP:{ipaddress.ip_address(host)}"
    except ValueError:
        return f"DNS:{host}"


def _openssl(*arguments: str) -> str:
    try:
        done = subprocess.run(  # noqa: S603
            ["openssl", *arguments],  # noqa: S607 - wherever it is
            capture_output=True,
            text=True,
            check=False,
        )
    except FileNotFoundError:
        raise ConfigError(
            "A certificate is made by the program openssl, which is not installed.",
            remedy="`sudo apt install openssl`, or give your own with --certificate and --key.",
        ) from None
    if done.returncode:
        raise ConfigError(f"openssl did not make a certificate: {done.stderr.strip()}.")
    return done.stdout
