"""Addresses of OPC UA servers."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import urlparse

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["Endpoint"]

DEFAULT_PORT = 4840


@dataclass(frozen=True)
class Endpoint:
    """An address such as ``opc.tcp://bench-4:4840``."""

    host: str
    port: int

    @classmethod
    def parse(cls, url: str) -> Endpoint:
        """Return the endpoint of a URL.

        Raises
        ------
        InputError
            The URL isn't an OPC UA address.

        Examples
        --------
        >>> Endpoint.parse("opc.tcp://127.0.0.1:4840").port
        4840
        """
        try:
            parts = urlparse(url)
            port = DEFAULT_PORT if parts.port is None else parts.port
        except ValueError:
            parts, port = urlparse(""), -1
        if parts.scheme != "opc.tcp" or not parts.hostname or parts.path.strip("/"):
            raise InputError(
                Message("OPC UA address {url!r}", url),
                "opc.tcp://HOST:PORT",
                "as in opc.tcp://127.0.0.1:4840",
            )
        return cls(parts.hostname, port)

    def url(self, port: int) -> str:
        """Return the URL with the port at which the server listens."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"opc.tcp://{host}:{port}"
