from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.x509.oid import ExtendedKeyUsageOID

from yahboomd_fleet.authority import Authority, Issued, end_of, make_authority, name_in

NOW = datetime(2030, 1, 1, tzinfo=UTC)


def read(issued: Issued) -> x509.Certificate:
    return x509.load_pem_x509_certificate(issued.certificate)


def usages(certificate: x509.Certificate) -> set[x509.ObjectIdentifier]:
    return set(certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)


def test_a_certificate_names_its_owner_lives_for_90_days_and_is_signed_by_the_authority() -> None:
    root = make_authority("farm", NOW)
    issued = Authority(root).issue("person.vera", (), NOW)
    assert name_in(issued.certificate) == "person.vera"
    assert end_of(issued.certificate) == NOW + timedelta(days=90)
    read(issued).verify_directly_issued_by(read(root))
    with pytest.raises(InvalidSignature):
        read(issued).verify_directly_issued_by(read(make_authority("farm", NOW)))


def test_only_a_certificate_with_hosts_serves_and_only_the_authority_signs() -> None:
    root = make_authority("farm", NOW)
    authority = Authority(root)
    person = read(authority.issue("person.vera", (), NOW))
    router = read(authority.issue("router", ("top.example", "fd00::1"), NOW))
    assert usages(person) == {ExtendedKeyUsageOID.CLIENT_AUTH}
    assert usages(router) == {ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH}
    names = router.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["top.example"]
    assert [str(each) for each in names.get_values_for_type(x509.IPAddress)] == ["fd00::1"]
    signs = {
        each.subject.rfc4514_string(): each.extensions.get_extension_for_class(
            x509.BasicConstraints
        ).value.ca
        for each in (person, router, read(root))
    }
    assert signs == {"CN=person.vera": False, "CN=router": False, "CN=robots of farm": True}
