"""Reconnections to the OPC UA server: how its memory grows.

`python -m plugins.opcua.benchmark` starts the panel with its OPC UA server on the simulated bench
and connects, signs in, reads, subscribes and disconnects again and again. Aim: over 10,000
reconnections the memory of the server's process grows by less than 5 %.
"""

from __future__ import annotations

import argparse
import asyncio
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import httpx
import psutil
from asyncua import Client, ua
from asyncua.crypto import cert_gen
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography.x509.oid import ExtendedKeyUsageOID

APPLICATION = "urn:torquebench:reconnecting"
WARM = 500
"""Reconnections before memory is measured: caches fill, and the allocator reaches its size."""
WARM_S = 150.0
"""Shortest time before memory is measured, s: live windows last 120 s, recordings start 60 s
back."""
PASSWORD = "correct horse battery"


class Heard:
    """Receives notifications and ignores them."""

    def datachange_notification(self, _node: object, _value: object, _data: object) -> None:
        """Ignore a notification."""


async def reconnect(url: str, folder: Path, server: Path, token: str) -> None:
    """Connect, sign in, read, subscribe, disconnect."""
    client = Client(url)
    client.application_uri = APPLICATION
    client.set_user("reconnecting")
    client.set_password(token)
    await client.set_security(
        SecurityPolicyBasic256Sha256,
        certificate=str(folder / "client.der"),
        private_key=str(folder / "client.pem"),
        server_certificate=str(server),
        mode=ua.MessageSecurityMode.SignAndEncrypt,
    )
    async with client:
        node = client.get_node(ua.NodeId("output.RawTorque", 1))
        await node.read_data_value(raise_on_bad_status=False)
        subscription = await client.create_subscription(100, Heard())
        await subscription.subscribe_data_change(node)


def started(folder: Path) -> tuple[subprocess.Popen[str], str, str]:
    """Start a panel; return its process, the address of its OPC UA server and a client's token."""
    words = ["panel", "--port", "0", "--data", "data", "--opcua", "opc.tcp://127.0.0.1:0"]
    process = subprocess.Popen(
        [sys.executable, "-m", "torquebench", *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    said = ""
    while "code" not in said:
        line = process.stdout.readline()
        assert line, "the panel ended before it served"
        said += line
    found = re.search(r"OPC UA: (\S+)\nPanel: (\S+)\n.*code (\S+)", said)
    assert found is not None, said
    url, panel, code = found.groups()
    with httpx.Client(base_url=f"{panel}/api/v1", timeout=60.0) as http:
        person = {"code": code, "name": "Admin", "password": PASSWORD}
        session = http.post("/setup", json=person).json()["token"]
        made = http.post(
            "/clients",
            json={"name": "reconnecting", "role": "operator"},
            headers={"Authorization": f"Bearer {session}"},
        )
        return process, url, str(made.json()["token"])


async def certified(folder: Path) -> None:
    """Create the client's certificate, and make the server trust it."""
    await cert_gen.setup_self_signed_certificate(
        folder / "client.pem",
        folder / "client.der",
        APPLICATION,
        "localhost",
        [ExtendedKeyUsageOID.CLIENT_AUTH],
        {},
    )
    trusted = folder / "data" / "opcua" / "trusted"
    (trusted / "client.der").write_bytes((folder / "client.der").read_bytes())


async def measure(process: psutil.Process, url: str, folder: Path, token: str, count: int) -> float:
    """Reconnect `count` times, print the server's memory, and return its growth in %."""
    await certified(folder)
    server = folder / "data" / "opcua" / "certificate.der"
    started_s, warm = time.monotonic(), 0
    while warm < WARM or time.monotonic() - started_s < WARM_S:
        await reconnect(url, folder, server, token)
        warm += 1
    first, started_s = process.memory_info().rss, time.monotonic()
    print(f"after {warm} to warm up: {first / 2**20:.1f} MiB", flush=True)
    step = max(1, count // 10)
    for number in range(1, count + 1):
        await reconnect(url, folder, server, token)
        if number % step == 0:
            size = process.memory_info().rss
            each_ms = 1000.0 * (time.monotonic() - started_s) / number
            print(
                f"{number:6d} reconnections: {size / 2**20:.1f} MiB, "
                f"{100.0 * (size / first - 1.0):+.2f} %, {each_ms:.0f} ms each",
                flush=True,
            )
    return float(100.0 * (process.memory_info().rss / first - 1.0))


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    count = parser.parse_args().count
    with tempfile.TemporaryDirectory(prefix="torquebench-") as scratch:
        folder = Path(scratch)
        process, url, token = started(folder)
        try:
            growth = asyncio.run(measure(psutil.Process(process.pid), url, folder, token, count))
        finally:
            process.terminate()
            process.wait(60)
    print(f"{count} reconnections: memory {growth:+.2f} % (aim: below +5 %)")


if __name__ == "__main__":
    main()
