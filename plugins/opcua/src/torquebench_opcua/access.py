"""Access control: trusted certificates, and the panel's accounts and clients.

A connection needs both. Anonymous access is refused, and nothing can be written except through
methods, which the service authorises.
"""

from __future__ import annotations

import contextlib
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
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID

from torquebench.atomic_write import atomic_write, private_folder, require_private
from torquebench.errors import InputError, TorquebenchError
from torquebench.message import Message
from torquebench.panel.service import BenchService
from torquebench.panel.service.access.actors import Actor
from torquebench.panel.service.problems import NotSignedInError

__all__ = ["Gate", "GuardedServer", "Store", "caller"]

APPLICATION_URI = "urn:torquebench:bench"
VALID_DAYS = 5 * 365
MOST_REJECTED = 100
_ITEM_LOGGER = logging.getLogger("asyncua.server.monitored_item_service")
"""Parent of those of single subscriptions; as a mere name without logger it would keep them."""
_caller: ContextVar[Actor | None] = ContextVar("caller", default=None)


class Store:
    """Certificates of a data directory, in its folder ``opcua``.

    ``certificate.der`` and ``key.pem`` are this server's, made on the first start. Certificates of
    clients lie in ``trusted``; an untrusted client is refused and its certificate stored in
    ``rejected``, from where an administrator may move it.
    """

    def __init__(self, data_dir: Path) -> None:
        self.folder = data_dir / "opcua"
        self.key = self.folder / "key.pem"
        self.certificate = self.folder / "certificate.der"
        self.trusted = self.folder / "trusted"
        self.rejected = self.folder / "rejected"

    def prepare(self, host: str) -> None:
        """Create missing files, and refuse files that others can read or that have expired."""
        for folder in (self.folder, self.trusted, self.rejected):
            private_folder(folder)
        if not self.key.is_file():
            self.certificate.unlink(missing_ok=True)
            key = cert_gen.dump_private_key_as_pem(cert_gen.generate_private_key())
            atomic_write(self.key, key, private=True)
        require_private(self.key)
        if not self.certificate.is_file():
            self._sign(host)
        made = x509.load_der_x509_certificate(self.certificate.read_bytes())
        if made.not_valid_after_utc < datetime.now(UTC):
            raise InputError(
                Message(
                    "{certificate} was valid until {not_valid_after_utc:%Y-%m-%d}",
                    self.certificate,
                    made.not_valid_after_utc,
                ),
                "a valid certificate",
                "delete it, start again, and let clients trust the new one",
            )

    def _sign(self, host: str) -> None:
        from cryptography.hazmat.primitives.serialization import load_pem_private_key

        key: Any = load_pem_private_key(self.key.read_bytes(), None)
        names = dict.fromkeys((host, socket.gethostname(), "localhost"))
        alternative: list[x509.GeneralName] = [x509.UniformResourceIdentifier(APPLICATION_URI)]
        alternative += [x509.DNSName(each) for each in names]
        made = cert_gen.generate_self_signed_app_certificate(
            key,
            "torquebench",
            {},
            alternative,
            extended=[ExtendedKeyUsageOID.SERVER_AUTH],
            days=VALID_DAYS,
        )
        atomic_write(self.certificate, made.public_bytes(Encoding.DER))

    def trusts(self, certificate: bytes | None) -> bool:
        """Whether a client's certificate (DER) is trusted and valid now."""
        if not certificate:
            return False
        try:
            found = x509.load_der_x509_certificate(certificate)
        except ValueError:
            return False
        now = datetime.now(UTC)
        if (
            not found.not_valid_before_utc - timedelta(minutes=5)
            <= now
            <= found.not_valid_after_utc
        ):
            return False
        for path in sorted(self.trusted.iterdir()):
            with contextlib.suppress(OSError, ValueError):
                if _certificate(path.read_bytes()) == found:
                    return True
        return False

    def reject(self, certificate: bytes) -> None:
        """Store an untrusted certificate, so that an administrator can decide about it."""
        with contextlib.suppress(ValueError, OSError, TorquebenchError):
            found = x509.load_der_x509_certificate(certificate)
            name = found.fingerprint(hashes.SHA1()).hex()
            kept = sorted(self.rejected.iterdir(), key=lambda each: each.stat().st_mtime)
            for path in kept[: max(0, len(kept) - MOST_REJECTED + 1)]:
                path.unlink()
            atomic_write(self.rejected / f"{name}.der", certificate, private=True)


def _certificate(content: bytes) -> x509.Certificate:
    if content.startswith(b"-----"):
        return x509.load_pem_x509_certificate(content)
    return x509.load_der_x509_certificate(content)


@dataclass
class SignedIn(User):
    """A session's user, with the actor in the service."""

    actor: Actor | None = None


class Gate:
    """Checks certificate, name and password of a new session."""

    def __init__(self, service: BenchService, store: Store) -> None:
        self._service = service
        self._store = store

    def get_user(
        self,
        iserver: InternalServer,  # noqa: ARG002 - asyncua's interface
        username: str | None = None,
        password: str | bytes | None = None,
        certificate: bytes | None = None,
    ) -> User | None:
        """Return the user of a session, None where it is refused.

        `certificate` is that of the secure channel; an open channel has none.
        """
        if not username or password is None or not self._store.trusts(certificate):
            return None
        secret = password.decode("utf-8", "replace") if isinstance(password, bytes) else password
        try:
            actor = self._actor(username, secret)
        except TorquebenchError:
            return None
        return SignedIn(UserRole.User, actor.label, actor)

    def _actor(self, name: str, secret: str) -> Actor:
        """Return a client by its name and token, or a person by name and password."""
        client = self._service.clients.find(secret)
        if client is None:
            return self._service.people.identify(name, secret, "opc.tcp")
        if client.name != name:
            raise NotSignedInError("a token of another client", "its own name")
        return client

    async def validate(self, certificate: x509.Certificate, _description: Any) -> None:
        """Refuse a session of a client whose certificate isn't trusted."""
        content = certificate.public_bytes(Encoding.DER)
        if not self._store.trusts(content):
            self._store.reject(content)
            raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)


class GuardedServer(InternalServer):
    """Sessions whose methods know their caller."""

    def create_session(
        self, name: str, user: User | None = None, external: bool = False
    ) -> InternalSession:
        """Return a session."""
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
        """Sessions of clients."""
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
