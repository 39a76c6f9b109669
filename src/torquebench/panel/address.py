"""Where the panel listens, and where it refuses to."""

from __future__ import annotations

import ipaddress
import ssl
from dataclasses import dataclass
from pathlib import Path

from torquebench.errors import InputError

__all__ = ["Address"]


@dataclass(frozen=True)
class Address:
    """Where the panel listens.

    Parameters
    ----------
    host : str
        An address, or "localhost".
    port : int
        0 takes a free one.
    tls_cert, tls_key : path, optional
        Certificate chain and private key, PEM.
    insecure_network : bool
        Allow other machines to connect without TLS.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    tls_cert: Path | None = None
    tls_key: Path | None = None
    insecure_network: bool = False

    @property
    def secure(self) -> bool:
        """Whether connections are encrypted."""
        return self.tls_cert is not None

    @property
    def hosts(self) -> tuple[str, ...]:
        """Names that requests may call this server by; none where any may.

        On the loopback address only its own names: a page elsewhere whose name is made to point
        here gets no answer.
        """
        return (self.host, "localhost", "127.0.0.1", "::1") if _is_loopback(self.host) else ()

    def check(self) -> None:
        """Refuse to listen to a network in clear.

        Raises
        ------
        InputError
            Not the loopback address, and neither TLS nor the explicit option; or half of TLS.
        """
        if (self.tls_cert is None) != (self.tls_key is None):
            raise InputError(
                "a certificate without its key" if self.tls_cert else "a key without certificate",
                "both --tls-cert and --tls-key",
            )
        if self.tls_cert is not None and self.tls_key is not None:
            _check_certificate(self.tls_cert, self.tls_key)
        if not (self.secure or self.insecure_network or _is_loopback(self.host)):
            raise InputError(
                f"the panel on {self.host} without encryption",
                "the loopback address 127.0.0.1, or TLS",
                "give --tls-cert and --tls-key; --insecure-network only where nobody else listens",
            )

    def url(self, port: int) -> str:
        """Return what to open in a browser."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.secure else 'http'}://{host}:{port}"


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _check_certificate(certificate: Path, key: Path) -> None:
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise InputError(
            f"{certificate} and {key}: {error.strerror or error}",
            "a certificate chain and its private key in PEM, readable and without password",
        ) from error
