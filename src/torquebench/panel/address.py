"""The panel's address, and the host names that it accepts."""

from __future__ import annotations

import ipaddress
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["ANY_ADDRESS", "Address"]

ANY_ADDRESS = "*"
"""Placeholder for any numeric address among the names of a server."""


@dataclass(frozen=True)
class Address:
    """Address of the panel.

    Parameters
    ----------
    host : str
        Address to listen on, or "localhost".
    port : int
        Port to listen on; 0 chooses a free one.
    tls_cert, tls_key : path, optional
        Certificate chain and private key, PEM.
    insecure_network : bool
        Allow other machines to connect without TLS.
    names : tuple of str
        Additional host names of this machine in its network.
    proxy : str
        Address of a trusted reverse proxy; empty without one.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    tls_cert: Path | None = None
    tls_key: Path | None = None
    insecure_network: bool = False
    names: tuple[str, ...] = ()
    proxy: str = ""

    @property
    def local(self) -> bool:
        """Whether only this machine can connect."""
        return _is_loopback(self.host)

    @property
    def secure(self) -> bool:
        """Whether connections are encrypted."""
        return self.tls_cert is not None

    @property
    def hosts(self) -> tuple[str, ...]:
        """Host names that requests may contain, and `ANY_ADDRESS`; empty if any name is accepted.

        A foreign name that resolves to this server gets no answer, against DNS rebinding. Numeric
        addresses can't be rebound, and with TLS a foreign name fails anyway.
        """
        if _is_loopback(self.host):
            named = (each.lower() for each in self.names)
            return (self.host, "localhost", "127.0.0.1", "::1", *named)
        if self.secure:
            return ()
        name = socket.gethostname().lower()
        short = name.partition(".")[0]
        own = (self.host.lower(), "localhost", name, short, f"{short}.local", *self.names)
        return (ANY_ADDRESS, *dict.fromkeys(each.lower() for each in own))

    def check(self) -> None:
        """Raise an error for an invalid address or an unencrypted network.

        Raises
        ------
        InputError
            The address isn't loopback, and neither TLS nor the explicit option is given;
            certificate or key is missing; or the proxy's address isn't numeric.
        """
        if self.proxy and not _is_address(self.proxy):
            raise InputError(
                Message("--behind-proxy {proxy}", self.proxy),
                "the proxy's numeric address, such as 127.0.0.1",
            )
        if (self.tls_cert is None) != (self.tls_key is None):
            raise InputError(
                "a certificate without its key" if self.tls_cert else "a key without certificate",
                "both --tls-cert and --tls-key",
            )
        if self.tls_cert is not None and self.tls_key is not None:
            _check_certificate(self.tls_cert, self.tls_key)
        if not (self.secure or self.insecure_network or _is_loopback(self.host)):
            raise InputError(
                Message("the panel on {host} without encryption", self.host),
                "the loopback address 127.0.0.1, or TLS",
                "give --tls-cert and --tls-key; --insecure-network only "
                "in a network without other users",
            )

    def url(self, port: int) -> str:
        """Return the URL for a browser."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.secure else 'http'}://{host}:{port}"


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    return _is_address(host) and ipaddress.ip_address(host).is_loopback


def _check_certificate(certificate: Path, key: Path) -> None:
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise InputError(
            Message(
                "{certificate} and {key}: {strerror}", certificate, key, error.strerror or error
            ),
            "a certificate chain and its private key in PEM, readable and without password",
        ) from error
