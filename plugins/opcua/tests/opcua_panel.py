"""A panel's bench by OPC UA, with a certificate that is already in the registry."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

from asyncua import Client, ua
from asyncua.crypto import cert_gen
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from cryptography.x509.oid import ExtendedKeyUsageOID

from torquebench.panel.service import BenchService
from torquebench_opcua import OpcUaServer

PASSWORD = "correct horse battery"
APPLICATION = "urn:torquebench:test-client"


@dataclass(frozen=True)
class Served:
    """A served bench, and the folder of the clients' certificates."""

    service: BenchService
    server: OpcUaServer
    folder: Path

    async def certify(self) -> None:
        """Make the client's certificate."""
        await cert_gen.setup_self_signed_certificate(
            self.folder / "key.pem",
            self.folder / "client.der",
            APPLICATION,
            "localhost",
            [ExtendedKeyUsageOID.CLIENT_AUTH],
            {},
        )

    def trust(self) -> None:
        """Let the server trust the client's certificate."""
        content = (self.folder / "client.der").read_bytes()
        (self.server.store.trusted / "client.der").write_bytes(content)

    async def client(self, name: str, secret: str) -> Client:
        """Return a client that isn't connected yet."""
        client = Client(self.server.url)
        client.application_uri = APPLICATION
        client.set_user(name)
        client.set_password(secret)
        await client.set_security(
            SecurityPolicyBasic256Sha256,
            certificate=str(self.folder / "client.der"),
            private_key=str(self.folder / "key.pem"),
            server_certificate=str(self.server.store.certificate),
            mode=ua.MessageSecurityMode.SignAndEncrypt,
        )
        return client

    @contextlib.asynccontextmanager
    async def session(self, name: str = "Admin", secret: str = PASSWORD) -> AsyncIterator[Client]:
        """Yield a client with an open session."""
        async with await self.client(name, secret) as client:
            yield client
