"""The server's own certificate, and which certificates of clients are accepted."""

import ipaddress
import os
import stat
from pathlib import Path

import pytest
from asyncua.crypto import cert_gen
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID

from torquebench.errors import InputError, RecordError
from torquebench_opcua.access import COMMON_URI, Store


def test_a_key_is_written_whole_and_its_owners_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    store = Store(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(RecordError, match="No space left"):
            store.prepare("localhost", "Bench-4")
    assert sorted(path.name for path in store.folder.iterdir()) == ["rejected", "trusted"]
    store.prepare("localhost", "Bench-4")
    assert stat.S_IMODE(store.key.stat().st_mode) == 0o600
    certificate = store.certificate.read_bytes()
    store.reject(certificate)
    (rejected,) = store.rejected.iterdir()
    assert rejected.read_bytes() == certificate
    assert stat.S_IMODE(rejected.stat().st_mode) == 0o600


def signed(
    uri: str, bits: int = 2048, key: rsa.RSAPrivateKey | None = None
) -> tuple[rsa.RSAPrivateKey, x509.Certificate]:
    key = key or rsa.generate_private_key(65537, bits)
    names: list[x509.GeneralName] = [x509.UniformResourceIdentifier(uri)] if uri else []
    names.append(x509.DNSName("127.0.0.1"))
    return key, cert_gen.generate_self_signed_app_certificate(
        key, "torquebench", {}, names, [ExtendedKeyUsageOID.SERVER_AUTH], 30
    )


def names_of(store: Store) -> x509.SubjectAlternativeName:
    own = x509.load_der_x509_certificate(store.certificate.read_bytes())
    return own.extensions.get_extension_for_class(x509.SubjectAlternativeName).value


def test_each_bench_is_an_application_of_its_own(tmp_path: Path) -> None:
    """A discovery server distinguishes benches with the same name on one computer by their URIs."""
    stores = [Store(tmp_path / name) for name in ("a", "b")]
    for store in stores:
        store.folder.parent.mkdir()
    first, second = (store.prepare("127.0.0.1", "Bench-4") for store in stores)
    assert first != second
    for store, uri in zip(stores, (first, second), strict=True):
        assert names_of(store).get_values_for_type(x509.UniformResourceIdentifier) == [uri]
        assert store.prepare("127.0.0.1", "Bench-5") == uri  # it stays what it was


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0", "::", "bench-4.plant"])
def test_the_certificate_names_addresses_as_addresses(host: str, tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.prepare(host, "Bench-4")
    hosts = names_of(store).get_values_for_type(x509.DNSName)
    addresses = names_of(store).get_values_for_type(x509.IPAddress)
    assert "localhost" in hosts
    assert ("bench-4.plant" in hosts) == (host == "bench-4.plant")
    assert ipaddress.ip_address("127.0.0.1") in addresses
    assert not any(each.is_unspecified for each in addresses)
    for each in hosts:
        with pytest.raises(ValueError, match="does not appear to be"):
            ipaddress.ip_address(each)


def test_a_certificate_of_0_2_0_is_replaced_and_its_key_kept(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.prepare("127.0.0.1", "Bench-4")
    key = load_pem_private_key(store.key.read_bytes(), None)
    assert isinstance(key, rsa.RSAPrivateKey)
    store.certificate.write_bytes(signed(COMMON_URI, key=key)[1].public_bytes(Encoding.DER))
    notes: list[str] = []
    uri = store.prepare("127.0.0.1", "Bench-4", notes.append)
    assert uri != COMMON_URI
    assert ["trust" in each for each in notes] == [True]
    assert load_pem_private_key(store.key.read_bytes(), None).private_numbers() == (
        key.private_numbers()
    )


@pytest.mark.parametrize(
    ("bits", "uri", "wrong"), [(1024, "urn:a:b", "weak key"), (2048, "", "names no application")]
)
def test_a_certificate_that_cannot_be_used_is_refused(
    bits: int, uri: str, wrong: str, tmp_path: Path
) -> None:
    store = Store(tmp_path)
    store.prepare("127.0.0.1", "Bench-4")
    key, certificate = signed(uri, bits)
    store.key.write_bytes(cert_gen.dump_private_key_as_pem(key))
    store.certificate.write_bytes(certificate.public_bytes(Encoding.DER))
    with pytest.raises(InputError, match=wrong):
        store.prepare("127.0.0.1", "Bench-4")


def test_only_a_strong_certificate_is_trusted_while_it_is_valid(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.prepare("127.0.0.1", "Bench-4")
    for bits, trusted in ((1024, False), (2048, True)):
        content = signed("urn:client", bits)[1].public_bytes(Encoding.DER)
        assert not store.trusts(content)
        (store.trusted / f"{bits}.der").write_bytes(content)
        assert store.trusts(content) == trusted
    assert not store.trusts(b"no certificate")
    assert not store.trusts(None)
