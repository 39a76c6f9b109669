"""A bench at a real MQTT broker: lost brokers, killed processes, passwords and certificates."""

import datetime
import ipaddress
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import httpx
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from plugins.sparkplug.tests.mosquitto import PATIENCE_S, Seen, broker, host
from plugins.sparkplug.tests.scripted_bench import ScriptedBench
from tests.system.command_line import run, started

from torquebench_sparkplug.metrics import METRICS, NODE, milliseconds
from torquebench_sparkplug.session import ALIASES

LOGGED = ("allow_anonymous true", "log_type all")
DOCS = Path(__file__).parents[1] / "docs" / "sparkplug.md"


def speeds(seen: list[Seen], *, historical: bool | None = None) -> list[tuple[float, int]]:
    """Return value and time of every input speed that a host received in data messages."""
    alias = ALIASES["input", "Speed/Value"][0]
    found = [m for each in seen if each.kind == "DDATA" for m in each.payload.metrics]
    return [
        (each.double_value, each.timestamp)
        for each in found
        if each.alias == alias and historical in (None, each.is_historical)
    ]


def wait(condition: Any) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_frozen_and_killed_broker_costs_no_value_and_repeats_none(tmp_path: Path) -> None:
    bench = ScriptedBench()
    asked = {"primary_host": "scada", "interval_s": 0.2, "keep_alive_s": 60}
    with broker(tmp_path, *LOGGED) as server, host(server.port, "scada") as scada:
        with bench.publisher(tmp_path, server.url, **asked):
            scada.until_kind("DBIRTH", "output")
            bench.counting = True
            scada.until(lambda each: bool([v for v, _ in speeds([each]) if v]))
            bench.counting = False
            wait(lambda: _confirmed(server.log()))
            server.freeze()
            frozen = bench.counted
            bench.counting = True
            wait(lambda: bench.counted >= frozen + 3)  # sent, and read by nobody
            server.kill()
            wait(lambda: bench.counted >= frozen + 7)
            bench.counting = False
            last = bench.counted
            server.start()
            scada.connected()
            scada.until(lambda each: last in {v for v, _ in speeds([each])})
            bench.put("output", "Speed/Value", 1.5)
            scada.until_kind("DDATA", "output")
        scada.until_kind("NDEATH")
    told = speeds(scada.seen)
    assert sorted(set(told)) == sorted(told)
    assert {value for value, _ in told} >= {*map(float, range(1, last + 1))}
    kept = [value for value, _ in speeds(scada.seen, historical=True)]
    assert kept == sorted(kept)
    assert set(kept) >= {*map(float, range(frozen + 1, last + 1))}
    assert any("changes are kept" in note for note in bench.notes)


def _confirmed(log: str) -> bool:
    return log.rfind("Sending UNSUBACK") > log.rfind("Received PUBLISH from tb") >= 0


def test_values_wait_for_a_broker_over_a_restart_of_the_panel(tmp_path: Path) -> None:
    bench = ScriptedBench(counting=True)
    with broker(tmp_path) as server:
        server.kill()
        with bench.publisher(tmp_path, server.url):
            wait(lambda: bench.counted >= 5)
        kept = bench.counted
        server.start()
        with host(server.port) as scada, bench.publisher(tmp_path, server.url):
            scada.until(lambda each: any(v >= kept for v, _ in speeds([each], historical=True)))
            old = [value for value, _ in speeds(scada.seen, historical=True)]
            assert old[:kept] == [*map(float, range(1, kept + 1))]
    assert len([note for note in bench.notes if "no connection" in note]) == 1  # said once


def test_a_full_buffer_says_how_much_is_lost(tmp_path: Path) -> None:
    bench = ScriptedBench()
    bench.put(NODE, "Bench/Name", "x" * 40_000)
    with broker(tmp_path) as server:
        server.kill()
        with bench.publisher(tmp_path, server.url, buffer_mb=0.1):
            for number in range(5):
                bench.put(NODE, "Bench/Name", f"{number}" * 40_000)
                bench.taken()
        server.start()
        with host(server.port) as scada, bench.publisher(tmp_path, server.url, buffer_mb=0.1):
            birth = scada.until_kind("NBIRTH")
            assert birth.metric("Buffer/Lost").long_value >= 2
            assert birth.metric("Buffer/Waiting").long_value >= 1


def test_a_retained_or_unreadable_command_does_nothing(tmp_path: Path) -> None:
    bench = ScriptedBench()
    with broker(tmp_path) as server, host(server.port) as scada:
        scada.command("spBv1.0/Hall 3/NCMD/Bench 7", "Node Control/Rebirth", True, retain=True)
        with bench.publisher(tmp_path, server.url) as node:
            scada.until_kind("DBIRTH", "output")
            scada.client.publish(node.topics.of("DCMD", "output"), b"")
            refused = ALIASES[NODE, "Commands/Refused"][0]
            scada.until(
                lambda each: (
                    each.kind == "NDATA"
                    and any(m.alias == refused and m.long_value == 1 for m in each.payload.metrics)
                )
            )
        assert len(scada.seen_of("NBIRTH")) == 1


def _certificates(folder: Path) -> None:
    """Create a certificate authority and a broker's certificate that it has signed."""
    now = datetime.datetime.now(datetime.UTC)
    keys = {name: ec.generate_private_key(ec.SECP256R1()) for name in ("ca", "broker")}
    names = {name: x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)]) for name in keys}
    uses = ("content_commitment", "key_encipherment", "data_encipherment", "key_agreement")
    unused = dict.fromkeys((*uses, "encipher_only", "decipher_only"), False)
    for name, key in keys.items():
        signs = {"key_cert_sign": name == "ca", "crl_sign": name == "ca"}
        made = (
            x509.CertificateBuilder()
            .subject_name(names[name])
            .issuer_name(names["ca"])
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - datetime.timedelta(days=1))
            .not_valid_after(now + datetime.timedelta(days=1))
            .add_extension(x509.BasicConstraints(name == "ca", None), critical=True)
            .add_extension(
                x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]),
                critical=False,
            )
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(keys["ca"].public_key()), False
            )
            .add_extension(
                x509.KeyUsage(digital_signature=True, **signs, **unused),
                critical=True,
            )
            .sign(keys["ca"], hashes.SHA256())
        )
        pem = serialization.Encoding.PEM
        (folder / f"{name}.pem").write_bytes(made.public_bytes(pem))
        private = serialization.PrivateFormat.PKCS8
        secret = key.private_bytes(pem, private, serialization.NoEncryption())
        (folder / f"{name}.key").write_bytes(secret)


# paho leaves the socket of a failed handshake to the garbage collector.
@pytest.mark.filterwarnings("ignore:unclosed <ssl.SSLSocket:ResourceWarning")
def test_tls_and_a_password(tmp_path: Path) -> None:
    _certificates(tmp_path)
    users = tmp_path / "users"
    users.write_text("bench7:geheim\n")
    run_passwd(users)
    secret = tmp_path / "secret"
    secret.write_text("geheim\n")
    secret.chmod(0o600)
    options = (
        f"cafile {tmp_path}/ca.pem",
        f"certfile {tmp_path}/broker.pem",
        f"keyfile {tmp_path}/broker.key",
        "allow_anonymous false",
        f"password_file {users}",
    )
    bench = ScriptedBench()
    with broker(tmp_path, *options) as server:
        url = server.url.replace("mqtt:", "mqtts:")
        trusted = {"tls": {"ca_file": tmp_path / "ca.pem"}, "user": "bench7"}
        known = trusted | {"password_file": secret}
        with bench.publisher(tmp_path, url, **known):
            wait(lambda: "connected to" in "".join(bench.notes))
        with bench.publisher(tmp_path, url, **trusted):  # without the password
            wait(lambda: "Not authorized" in bench.notes[-1])
        with bench.publisher(tmp_path, url):  # without the authority
            wait(lambda: "certificate verify failed" in bench.notes[-1].lower())


def run_passwd(users: Path) -> None:
    """Hash the passwords of a file for mosquitto."""
    subprocess.run(["mosquitto_passwd", "-U", str(users)], check=True)


def test_the_panel_publishes_its_bench_and_its_death(tmp_path: Path) -> None:
    with broker(tmp_path) as server, host(server.port) as scada:
        text = f'group_id = "Hall"\nbrokers = ["{server.url}"]\ninterval_s = 0.2\n'
        (tmp_path / "sparkplug.toml").write_text(text)
        options = ("panel", "--port", "0", "--data", "data", "--sparkplug", "sparkplug.toml")
        with started(*options, cwd=tmp_path) as panel:
            birth = scada.until(lambda each: each.kind == "NBIRTH", 240.0)
            output = scada.until_kind("DBIRTH", "output")
            alias = output.metric("Torque/Value").alias
            scada.until(
                lambda each: (
                    each.kind == "DDATA" and alias in {m.alias for m in each.payload.metrics}
                )
            )
            scada.command(f"spBv1.0/Hall/NCMD/{birth.topic.split('/')[3]}", "Bench/Name", True)
            scada.until_kind("NDATA")
            panel.send_signal(signal.SIGKILL)
            panel.wait()
            death = scada.until_kind("NDEATH")
        assert birth.metric("Bench/Simulated").boolean_value
        assert birth.metric("Bench/State").string_value in ("idle", "no samples")
        assert {metric.name for metric in output.payload.metrics} == {
            spec.name for spec in METRICS["output"]
        }
        assert output.metric("Torque/Range").double_value == 2000.0
        assert output.metric("Compensation/In use").boolean_value is False
        assert output.metric("Torque/Expanded uncertainty").is_null
        assert death.metric("bdSeq").long_value == birth.metric("bdSeq").long_value == 0
        with started(*options, cwd=tmp_path) as panel:
            again = scada.until(lambda each: each.kind == "NBIRTH", 240.0)
            assert again.metric("bdSeq").long_value == 1
            assert panel.stdout is not None
            url = panel.stdout.readline().split()[-1]
            wait(lambda: _answers(url))
            panel.send_signal(signal.SIGTERM)
            scada.until_kind("NDEATH")
            _, said = panel.communicate(timeout=120)
        assert panel.returncode == 0
        assert "Sparkplug: connected to" in said


def _answers(url: str) -> bool:
    try:
        return httpx.get(url, follow_redirects=True).status_code == 200
    except httpx.TransportError:
        return False


def test_wrong_settings_are_refused_before_the_bench_is_opened(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text('group_id = "a/b"\nbrokers = ["mqtt://127.0.0.1"]\n')
    refused = run("panel", "--sparkplug", "s.toml", "--data", "data", cwd=tmp_path)
    assert refused.returncode == 2
    assert "group_id" in refused.stderr
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("device", [NODE, "input"])
def test_the_reference_lists_every_metric(device: str) -> None:
    page = DOCS.read_text(encoding="utf-8")
    for spec in METRICS[device]:
        kind = "".join(part.capitalize() for part in spec.datatype.name.split("_"))
        assert f"| `{spec.name}` | {kind} | {spec.unit} | {spec.text} |" in page


def test_a_day_ends_at_midnight() -> None:
    moment = datetime.datetime(2026, 11, 23, 12, tzinfo=datetime.UTC)
    assert milliseconds(moment) - milliseconds(moment.date()) == -(12 * 3_600_000 - 1)
