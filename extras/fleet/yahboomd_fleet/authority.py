"""The fleet's own authority: its key, and the certificates that it signs."""

from __future__ import annotations

import ipaddress
from datetime import datetime, timedelta
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

DAYS = 90
"""The life of a certificate."""

AUTHORITY_DAYS = 3650

_SKEW = timedelta(hours=1)
"""Certificates are valid from this time before now: a robot's clock may be behind."""


class Issued(NamedTuple):
    """A certificate and its private key, in PEM."""

    certificate: bytes
    key: bytes


class Authority:
    """Signs certificates.

    Args:
        issued: Its own certificate and key.
    """

    def __init__(self, issued: Issued) -> None:
        self._certificate = x509.load_pem_x509_certificate(issued.certificate)
        key = serialization.load_pem_private_key(issued.key, password=None)
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise ValueError("it is no key of an elliptic curve")  # noqa: TRY004 - as for a bad file
        self._key = key

    def issue(self, name: str, hosts: tuple[str, ...], now: datetime) -> Issued:
        """Sign a certificate for a name.

        Args:
            hosts: The names and addresses at which others reach it; none for one who only connects.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        usages = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if hosts:
            usages.append(ExtendedKeyUsageOID.SERVER_AUTH)
        builder = (
            _builder(name, self._certificate.subject, key, now, DAYS)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        )
        if hosts:
            names = x509.SubjectAlternativeName([_host(each) for each in hosts])
            builder = builder.add_extension(names, critical=False)
        return _pem(builder.sign(self._key, hashes.SHA256()), key)


def make_authority(fleet: str, now: datetime) -> Issued:
    """Make the certificate and key of a new authority, which may sign certificates only."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = f"robots of {fleet}"
    signs = x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=False,
        encipher_only=False,
        decipher_only=False,
    )
    builder = (
        _builder(name, _named(name), key, now, AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(signs, critical=True)
    )
    return _pem(builder.sign(key, hashes.SHA256()), key)


def name_in(certificate: bytes) -> str:
    """The name (CN) in a certificate in PEM."""
    found = x509.load_pem_x509_certificate(certificate).subject
    return str(found.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


def end_of(certificate: bytes) -> datetime:
    """The end of a certificate's life, in UTC."""
    return x509.load_pem_x509_certificate(certificate).not_valid_after_utc


def _builder(
    name: str, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, now: datetime, days: int
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(_named(name))
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _SKEW)
        .not_valid_after(now + timedelta(days=days))
    )


def _named(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> Issued:
    secret = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    return Issued(certificate.public_bytes(serialization.Encoding.PEM), secret)
