"""The certificate for TLS: read, or made for this machine with openssl."""

from __future__ import annotations

import ipaddress
import ssl
import subprocess
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from yahboomd.core.errors import ConfigError
from yahboomd.web.session_files import keep

CERTIFICATE = "web-certificate.pem"
KEY = "web-key.pem"

DAYS = 825
"""The longest that phones accept."""

_FINGERPRINT = ("-noout", "-fingerprint", "-sha256")


class Certificate(msgspec.Struct, frozen=True, kw_only=True):
    """The files of a certificate for TLS."""

    certificate: Path
    key: Path

    def context(self) -> ssl.SSLContext:
        """Read them.

        Raises:
            ConfigError: They cannot be read, or do not belong together.
        """
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        for path in (self.certificate, self.key):
            try:
                if path.exists() and not path.is_file():
                    # A pipe would block the start.
                    raise ConfigError(f"{path} cannot be read: it is no ordinary file.")
                path.read_bytes()
            except OSError as error:
                raise ConfigError(
                    f"{path} cannot be read: {error.strerror}.",
                    remedy="Make a certificate with `yahboomd web --make-certificate`.",
                ) from error
        try:
            context.load_cert_chain(self.certificate, self.key)
        except ssl.SSLError as error:
            raise ConfigError(
                f"{self.certificate} and {self.key} are not a certificate and its key "
                f"({error.reason or 'not PEM'}).",
                remedy="Make both with `yahboomd web --make-certificate`.",
            ) from error
        return context

    def lacks(self, hosts: Sequence[str]) -> str:
        """A sentence if it was not made for the first of these addresses; else empty.

        The names in a certificate that an authority signed are not read.
        """
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.load_verify_locations(self.certificate)
        made = [each.get("subjectAltName", ()) for each in context.get_ca_certs()]
        names = [str(entry[1]) for entries in made for entry in entries]
        if not names or not hosts or hosts[0] in names:
            return ""
        return (
            f"{self.certificate} is for {', '.join(names)}, and not for {hosts[0]}, where phones "
            "reach this machine now: browsers warn, and an iPhone only stays silent. Make a new "
            "one, and start the page again: yahboomd web --make-certificate"
        )


def make_certificate(folder: Path, hosts: Iterable[str]) -> tuple[Path, Path, str]:
    """Make a certificate and its key; older ones are replaced.

    Args:
        folder: The folder for both; only this user can read the key.
        hosts: The names and addresses that browsers use.

    Returns:
        The certificate, the key, and the fingerprint that a browser shows.

    Raises:
        ConfigError: There is no openssl, or the folder cannot be written to.
    """
    certificate, key = folder / CERTIFICATE, folder / KEY
    try:
        # Not in the folder, where other users may have put links.
        with tempfile.TemporaryDirectory(prefix="yahboomd-web-") as made:
            new_certificate, new_key = Path(made) / CERTIFICATE, Path(made) / KEY
            _openssl(
                *("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1"),
                *("-nodes", "-keyout", str(new_key), "-out", str(new_certificate)),
                *("-days", str(DAYS), "-subj", "/CN=yahboomd"),
                *("-addext", f"subjectAltName={','.join(map(_name, hosts))}"),
                *("-addext", "extendedKeyUsage=serverAuth"),
            )
            shown = _openssl("x509", "-in", str(new_certificate), *_FINGERPRINT)
            keep(folder, KEY, new_key.read_bytes())
            keep(folder, CERTIFICATE, new_certificate.read_bytes())
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
