import datetime
import signal
import stat
from ipaddress import ip_address
from pathlib import Path

import httpx
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from tests.system.command_line import TIMEOUT_S, run
from tests.system.panel_api import administrator, serving

from torquebench.errors import InputError
from torquebench.panel.address import ANY_ADDRESS, Address


def _certificate(folder: Path) -> tuple[str, str]:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "bench")])
    now = datetime.datetime.now(datetime.UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now)
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(
            x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))]), False
        )
        .sign(key, hashes.SHA256())
    )
    chain, private = folder / "cert.pem", folder / "key.pem"
    chain.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    private.write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    return str(chain), str(private)


def test_a_network_in_clear_is_refused(tmp_path: Path) -> None:
    refused = run("panel", "--host", "0.0.0.0", "--port", "0", cwd=tmp_path)
    assert refused.returncode == 2
    assert "--tls-cert" in refused.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "bench.example"])
def test_only_the_loopback_address_is_served_in_clear(host: str) -> None:
    with pytest.raises(InputError, match="--tls-cert"):
        Address(host).check()
    Address(host, insecure_network=True).check()
    assert ANY_ADDRESS in Address(host, insecure_network=True).hosts


def test_a_network_in_clear_is_warned_of_and_answers_to_its_own_names_only(tmp_path: Path) -> None:
    options = ("--host", "0.0.0.0", "--insecure-network", "--host-name", "Bench-7.example")
    with serving(tmp_path, *options) as server:
        url = server.url.replace("0.0.0.0", "127.0.0.1")
        stop = {"X-Torquebench": "panel"}
        for name in ("127.0.0.1", "192.0.2.7", "localhost", "bench-7.example", "BENCH-7.example"):
            answer = httpx.get(
                f"{url}/sign-in", headers={"Host": f"{name}:8080"}, timeout=TIMEOUT_S
            )
            assert answer.status_code == 200
        for name in ("evil.example", "127.0.0.1.evil.example", "0x7f000001"):
            asked = httpx.post(
                f"{url}/panel/stop", headers=stop | {"Host": f"{name}:8080"}, timeout=TIMEOUT_S
            )
            assert asked.status_code == 403
        server.process.send_signal(signal.SIGTERM)
        said = " ".join("".join(server.process.communicate(timeout=240)).split())
    assert "without TLS everybody in this network can read passwords" in said


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "::1", "localhost"])
def test_the_loopback_address_answers_to_its_own_names_only(host: str) -> None:
    Address(host).check()
    assert set(Address(host).hosts) == {host, "localhost", "127.0.0.1", "::1"}


def test_half_or_broken_tls_is_refused(tmp_path: Path) -> None:
    chain, key = map(Path, _certificate(tmp_path))
    Address("0.0.0.0", tls_cert=chain, tls_key=key).check()
    with pytest.raises(InputError, match="--tls-key"):
        Address(tls_cert=chain).check()
    for broken in (Address(tls_cert=key, tls_key=chain), Address(tls_cert=chain, tls_key=chain)):
        with pytest.raises(InputError, match="PEM"):
            broken.check()


def test_a_request_to_terminate_ends_it_with_the_bench_unloaded(tmp_path: Path) -> None:
    with serving(tmp_path, fresh=True) as server:
        with administrator(server) as admin:
            started = admin.post("/operations/calibrate", json={"side": "output"})
            assert started.status_code == 202
            run_id = ""
            while not run_id:
                runs = admin.get("/runs").json()["runs"]
                run_id = runs[0]["run_id"] if runs else ""
        server.process.send_signal(signal.SIGTERM)
        _, said = server.process.communicate(timeout=240)
    assert server.process.returncode == 0
    assert "the bench is without torque" in said
    listed = run("records", "list", "--data", "data", cwd=tmp_path)
    assert "aborted" in listed.stdout
    secret = tmp_path / "data" / "panel-secret"
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600


def test_tls_serves_pages_and_api(tmp_path: Path) -> None:
    chain, key = _certificate(tmp_path)
    with serving(tmp_path, "--tls-cert", chain, "--tls-key", key) as server:
        assert server.url.startswith("https://")
        with administrator(server) as admin:
            answer = admin.get("/bench")
    assert answer.status_code == 200
    assert "max-age" in answer.headers["strict-transport-security"]


def test_a_second_panel_on_the_same_records_is_refused(tmp_path: Path) -> None:
    with serving(tmp_path) as server:
        refused = run("panel", "--port", "0", "--data", "data", cwd=tmp_path)
        assert refused.returncode == 2
        assert f"process {server.process.pid}" in " ".join(refused.stderr.split())
        with administrator(server) as admin:
            assert admin.get("/bench").json()["connection"] == "live"


@pytest.mark.parametrize("believed", [True, False])
def test_only_a_named_proxy_says_where_somebody_comes_from(tmp_path: Path, believed: bool) -> None:
    options = ("--behind-proxy", "127.0.0.1") if believed else ()
    with serving(tmp_path, "--fast", *options) as server, administrator(server) as admin:
        guess = {"name": "Admin", "password": "not the password"}

        def guessed(address: str) -> int:
            passed_on = {"X-Forwarded-For": address}
            return admin.post("/session", json=guess, headers=passed_on).status_code

        assert [guessed("192.0.2.1") for _ in range(6)] == [401] * 5 + [429]
        assert guessed("192.0.2.2") == (401 if believed else 429)
