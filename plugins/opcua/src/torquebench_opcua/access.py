"""Access control: trusted certificates, and the panel's accounts and clients.

A connection needs a trusted certificate and an account. Anonymous access is refused, and nothing
can be written except through methods, which the service authorises.
"""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import socket
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto import cert_gen
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPublicKey
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID

from torquebench.atomic_write import atomic_write, private_folder, require_private
from torquebench.errors import InputError, TorquebenchError
from torquebench.message import Message
from torquebench.panel.beside import ServedBench
from torquebench.panel.service import Actor

__all__ = ["Gate", "GuardedServer", "SignedIn", "Store", "caller"]

COMMON_URI = "urn:torquebench:bench"
"""Up to 0.2.0 every bench was this application."""
STRONG = "an RSA key of 2048 to 4096 bits"
VALID_DAYS = 5 * 365
MOST_REJECTED = 100
_ITEM_LOGGER = logging.getLogger("asyncua.server.monitored_item_service")
"""Parent of those of single subscriptions; as a mere name without logger it would keep them."""
_caller: ContextVar[Actor | None] = ContextVar("caller", default=None)


def _say_nothing(_text: str) -> None:
    """Ignore a message."""


class Store:
    """Certificates of a data directory, in its folder ``opcua``.

    ``certificate.der`` and ``key.pem`` belong to this server, which creates them at its first
    start. Certificates of clients lie in ``trusted``; an untrusted client is refused and its
    certificate stored in ``rejected``, from where an administrator may move it.
    """

    def __init__(self, data_dir: Path) -> None:
        self.folder = data_dir / "opcua"
        self.key = self.folder / "key.pem"
        self.certificate = self.folder / "certificate.der"
        self.trusted = self.folder / "trusted"
        self.rejected = self.folder / "rejected"

    def prepare(self, host: str, bench: str, note: Callable[[str], None] = _say_nothing) -> str:
        """Create missing key and certificate; return the application URI in the certificate.

        Parameters
        ----------
        host : str
            Host name or address at which the server listens.
        bench : str
            The bench's name, used as its serial number.
        note : callable
            Called with a message when the server has a new certificate that clients have to trust.

        Raises
        ------
        InputError
            The key file is readable by other users, or the certificate is expired, weak or without
            a URI.
        """
        for folder in (self.folder, self.trusted, self.rejected):
            private_folder(folder)
        if not self.key.is_file():
            self.certificate.unlink(missing_ok=True)
            key = cert_gen.dump_private_key_as_pem(cert_gen.generate_private_key())
            atomic_write(self.key, key, private=True)
        require_private(self.key)
        if self.certificate.is_file() and COMMON_URI in _uris(self._own()):
            self.certificate.unlink()
            note("new certificate, with an identity of this bench: clients have to trust it once")
        if not self.certificate.is_file():
            self._sign(host, bench)
        return self._checked(self._own())

    def _own(self) -> x509.Certificate:
        return _certificate(self.certificate.read_bytes())

    def _checked(self, own: x509.Certificate) -> str:
        remedy = "delete it, start again, and let clients trust the new one"
        if own.not_valid_after_utc < datetime.now(UTC):
            raise InputError(
                Message(
                    "{certificate} was valid until {not_valid_after_utc:%Y-%m-%d}",
                    self.certificate,
                    own.not_valid_after_utc,
                ),
                "a valid certificate",
                remedy,
            )
        if not strong(own):
            raise InputError(
                Message("{certificate} has a weak key", self.certificate), STRONG, remedy
            )
        if not _uris(own):
            raise InputError(
                Message("{certificate} names no application", self.certificate),
                "a certificate with the application's URI among its alternative names",
                remedy,
            )
        return _uris(own)[0]

    def _sign(self, host: str, bench: str) -> None:
        key: Any = load_pem_private_key(self.key.read_bytes(), None)
        machine = socket.gethostname()
        # of one machine and name there may be several benches, each with a key of its own
        number = x509.SubjectKeyIdentifier.from_public_key(key.public_key()).digest.hex()[:8]
        names = [
            x509.UniformResourceIdentifier(f"urn:{machine}:torquebench:{bench}:{number}"),
            *map(_name_of, (host, machine, "localhost")),
            *map(x509.IPAddress, _addresses(host, machine)),
        ]
        made = cert_gen.generate_self_signed_app_certificate(
            key,
            f"torquebench {bench}"[:64],
            {},
            list(dict.fromkeys(filter(None, names))),
            extended=[ExtendedKeyUsageOID.SERVER_AUTH],
            days=VALID_DAYS,
        )
        atomic_write(self.certificate, made.public_bytes(Encoding.DER))

    def trusts(self, certificate: bytes | None) -> bool:
        """Whether a client's certificate (DER) is trusted, currently valid and strong enough."""
        if not certificate:
            return False
        try:
            shown = x509.load_der_x509_certificate(certificate)
        except ValueError:
            return False
        early = shown.not_valid_before_utc - timedelta(minutes=5)
        if not (early <= datetime.now(UTC) <= shown.not_valid_after_utc and strong(shown)):
            return False
        for path in sorted(self.trusted.iterdir()):
            with contextlib.suppress(OSError, ValueError):
                if _certificate(path.read_bytes()) == shown:
                    return True
        return False

    def reject(self, certificate: bytes) -> None:
        """Store an untrusted certificate, so that an administrator can trust it later."""
        with contextlib.suppress(ValueError, OSError, TorquebenchError):
            shown = x509.load_der_x509_certificate(certificate)
            name = shown.fingerprint(hashes.SHA1()).hex()
            kept = sorted(self.rejected.iterdir(), key=lambda path: path.stat().st_mtime)
            for path in kept[: max(0, len(kept) - MOST_REJECTED + 1)]:
                path.unlink()
            atomic_write(self.rejected / f"{name}.der", certificate, private=True)


def strong(certificate: x509.Certificate) -> bool:
    """Whether Basic256Sha256 allows a certificate's key: RSA, 2048 to 4096 bits."""
    key = certificate.public_key()
    return isinstance(key, RSAPublicKey) and 2048 <= key.key_size <= 4096


def _certificate(content: bytes) -> x509.Certificate:
    if content.startswith(b"-----"):
        return x509.load_pem_x509_certificate(content)
    return x509.load_der_x509_certificate(content)


def _uris(certificate: x509.Certificate) -> list[str]:
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    except x509.ExtensionNotFound:
        return []
    return names.value.get_values_for_type(x509.UniformResourceIdentifier)


def _name_of(host: str) -> x509.GeneralName | None:
    """Return a host's name for the certificate; None if the server listens at all addresses."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return x509.DNSName(host)
    return None if address.is_unspecified else x509.IPAddress(address)


def _addresses(host: str, machine: str) -> list[ipaddress.IPv4Address | ipaddress.IPv6Address]:
    """Return the addresses at which clients reach a server that listens to all or to loopback."""
    found = [ipaddress.ip_address("127.0.0.1")]
    with contextlib.suppress(OSError):
        if _name_of(host) is None:
            for *_, address in socket.getaddrinfo(machine, None, type=socket.SOCK_STREAM):
                found.append(ipaddress.ip_address(str(address[0]).partition("%")[0]))
    return found


@dataclass
class SignedIn(User):
    """A session's user, with the actor in the service."""

    actor: Actor | None = None


class Gate:
    """Checks certificate, name and password of a new session."""

    def __init__(self, bench: ServedBench, store: Store) -> None:
        self._bench = bench
        self._store = store

    def get_user(
        self,
        iserver: InternalServer,  # noqa: ARG002 - asyncua's interface
        username: str | None = None,
        password: str | bytes | None = None,
        certificate: bytes | None = None,
    ) -> User | None:
        """Return the user of a session, or None if the session is refused.

        `certificate` is that of the secure channel; an open channel has none.
        """
        if not username or password is None or not self._store.trusts(certificate):
            return None
        secret = password.decode("utf-8", "replace") if isinstance(password, bytes) else password
        try:
            actor = self._bench.identify(username, secret, "opc.tcp")
        except TorquebenchError:
            return None
        return SignedIn(UserRole.User, actor.label, actor)

    async def validate(self, certificate: x509.Certificate, _description: Any) -> None:
        """Refuse a session of a client whose certificate is weak or isn't trusted."""
        content = certificate.public_bytes(Encoding.DER)
        if not strong(certificate):
            raise ServiceError(ua.StatusCodes.BadCertificatePolicyCheckFailed)
        if not self._store.trusts(content):
            self._store.reject(content)
            raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)


class GuardedServer(InternalServer):
    """Server whose methods know the user that called them."""

    def create_session(
        self, name: str, user: User | None = None, external: bool = False
    ) -> InternalSession:
        """Return a new session."""
        return _Session(
            self,
            self.aspace,
            self.subscription_service,
            name,
            user=user or User(role=UserRole.Anonymous),
            external=external,
        )

    @property
    def outside(self) -> list[InternalSession]:
        """Return the sessions of clients."""
        return list(self._external_sessions.values())


class _Session(InternalSession):
    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        token = _caller.set(getattr(self.user, "actor", None))
        try:
            return list(await super().call(params))
        finally:
            _caller.reset(token)

    async def create_subscription(
        self,
        params: ua.CreateSubscriptionParameters,
        callback: Callable[..., Any],
        request_callback: Callable[..., Any] | None = None,
    ) -> ua.CreateSubscriptionResult:
        made = await super().create_subscription(params, callback, request_callback)
        # asyncua names a logger after every subscription, and `logging` would keep it for ever
        logging.root.manager.loggerDict.pop(f"{_ITEM_LOGGER.name}.{made.SubscriptionId}", None)
        return made

    async def create_monitored_items(
        self, params: ua.CreateMonitoredItemsParameters
    ) -> list[ua.MonitoredItemCreateResult]:
        for each in params.ItemsToCreate or []:
            _check_filter(each.RequestedParameters.Filter)
        return list(await super().create_monitored_items(params))

    async def modify_monitored_items(
        self, params: ua.ModifyMonitoredItemsParameters
    ) -> list[ua.MonitoredItemModifyResult]:
        for each in params.ItemsToModify or []:
            _check_filter(each.RequestedParameters.Filter)
        return list(await super().modify_monitored_items(params))


def _check_filter(wanted: Any) -> None:
    """Refuse event fields on which asyncua would fail at the next event, for all clients."""
    if not isinstance(wanted, ua.EventFilter):
        return
    wanted.SelectClauses = wanted.SelectClauses or []
    for clause in wanted.SelectClauses:
        clause.BrowsePath = clause.BrowsePath or []  # a missing path is treated as an empty one
        known = clause.AttributeId in set(ua.AttributeIds)
        if not known or not all(step.Name for step in clause.BrowsePath):
            raise ServiceError(ua.StatusCodes.BadEventFilterInvalid)


def caller() -> Actor | None:
    """Return the caller of the running method."""
    return _caller.get()
