"""The settings file of Sparkplug: broker, names, intervals and size of the history."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, model_validator

from torquebench.atomic_write import require_private
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.validation import ConflictError, parse_toml, validated

__all__ = ["Broker", "Deadband", "SparkplugSettings", "Tls", "load_settings"]

PORTS = {"mqtt": 1883, "mqtts": 8883}
FORBIDDEN = "+#/"
Name = Annotated[str, Field(min_length=1, max_length=200)]
Step = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Deadband(BaseModel):
    """Smallest change of a value that is sent; 0 sends every change."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    torque_percent: Annotated[float, Field(ge=0, le=100, description="% of range")] = 0.01
    speed_rpm: Annotated[Step, Field(description="rpm")] = 0.1
    angle_deg: Annotated[Step, Field(description="°")] = 0.1
    temperature_k: Annotated[Step, Field(description="K")] = 0.1
    efficiency_percent: Annotated[Step, Field(description="%")] = 0.1


class Tls(BaseModel):
    """Certificates in PEM files, for brokers with `mqtts://`.

    Without `ca_file` the system's certificate authorities are trusted. `cert_file` and `key_file`
    identify this edge node to the broker.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    ca_file: Path | None = None
    cert_file: Path | None = None
    key_file: Path | None = None

    @model_validator(mode="after")
    def _both(self) -> Tls:
        if (self.cert_file is None) != (self.key_file is None):
            missing = "key_file" if self.key_file is None else "cert_file"
            raise ConflictError(missing, "nothing", "both cert_file and key_file, or neither")
        return self


class Broker:
    """Address of one broker.

    Examples
    --------
    >>> broker = Broker("mqtts://broker.example")
    >>> broker.host, broker.port, broker.secure
    ('broker.example', 8883, True)
    """

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in PORTS or not parts.hostname or parts.path not in ("", "/"):
            raise ValueError(
                Message("{url!r} isn't mqtt://host:port or mqtts://host:port", url[:80])
            )
        if parts.username or parts.password:
            raise ValueError("a password doesn't belong in an address: use user, password_file")
        self.url = url
        self.host = parts.hostname
        self.port = parts.port or PORTS[parts.scheme]
        self.secure = parts.scheme == "mqtts"

    @property
    def local(self) -> bool:
        """Whether the broker is on this computer."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


class SparkplugSettings(BaseModel):
    """The bench as an edge node of Sparkplug B.

    Its topics begin with `spBv1.0/<group_id>/`. `edge_node_id` is the bench's name where it isn't
    given. One broker is connected at a time; with several, the next one is tried when one is lost.
    With `primary_host`, data are stored as history until this host application is online.
    `password_file` contains the password alone, readable by its owner only. Paths are relative to
    this file. `insecure_network` allows `mqtt://` to other computers: password and values in clear.

    While no broker is connected, up to `buffer_mb` of changes are kept in the data directory; the
    oldest are dropped beyond that, and `Buffer/Lost` counts them. Pauses between attempts to
    connect grow from `reconnect_first_s` to `reconnect_longest_s`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    brokers: Annotated[tuple[str, ...], Field(min_length=1, max_length=16)]
    group_id: Name
    edge_node_id: Name | None = None
    primary_host: Name | None = None
    user: Name | None = None
    password_file: Path | None = None
    insecure_network: bool = False
    interval_s: Annotated[float, Field(ge=0.1, le=3600, description="s")] = 1.0
    keep_alive_s: Annotated[int, Field(ge=2, le=3600, description="s")] = 15
    reconnect_first_s: Annotated[float, Field(ge=0.1, le=600, description="s")] = 1.0
    reconnect_longest_s: Annotated[float, Field(ge=0.1, le=3600, description="s")] = 60.0
    buffer_mb: Annotated[float, Field(ge=0.1, le=10_000, description="MB")] = 64.0
    tls: Tls = Tls()
    deadband: Deadband = Deadband()

    @model_validator(mode="after")
    def _consistent(self) -> SparkplugSettings:
        for key in ("group_id", "edge_node_id", "primary_host"):
            _check_id(key, getattr(self, key))
        if self.group_id == "STATE":
            raise ConflictError("group_id", "'STATE'", "another name: this one is for hosts")
        for url in self.brokers:
            try:
                broker = Broker(url)
            except ValueError as error:
                allowed = "mqtt://host:port or mqtts://host:port"
                raise ConflictError("brokers", str(error), allowed) from error
            if not (broker.secure or broker.local or self.insecure_network):
                raise ConflictError(
                    "brokers",
                    Message("{url!r} without encryption", url),
                    "mqtts://, or a broker on this computer",
                    "use mqtts://; insecure_network = true only where nobody else listens",
                )
        if self.password_file is not None and self.user is None:
            raise ConflictError("user", "nothing", "a name where there is a password_file")
        if self.reconnect_longest_s < self.reconnect_first_s:
            raise ConflictError(
                "reconnect_longest_s",
                Message("{reconnect_longest_s:g} s", self.reconnect_longest_s),
                Message(
                    "at least reconnect_first_s, {reconnect_first_s:g} s", self.reconnect_first_s
                ),
            )
        return self

    def relative_to(self, folder: Path) -> SparkplugSettings:
        """Return the settings with their files as paths from a folder."""
        named = {k: v and folder / v for k, v in self.tls.model_dump().items()}
        password = self.password_file and folder / self.password_file
        return self.model_copy(update={"password_file": password, "tls": Tls(**named)})

    def named(self, bench: str) -> SparkplugSettings:
        """Return the settings with the bench's name as `edge_node_id` if none is set."""
        if self.edge_node_id is not None:
            return self
        plain = "".join("-" if c in FORBIDDEN or not c.isprintable() else c for c in bench)
        return self.model_copy(update={"edge_node_id": plain or "bench"})

    def password(self) -> str | None:
        """Read the password.

        Raises
        ------
        InputError
            The file can't be read, is empty, or is readable by other users.
        """
        path = self.password_file
        if path is None:
            return None
        if path.is_file():
            require_private(path)
        found = _read(path, "a readable file with the password").strip()
        if not found:
            raise InputError(
                Message("{origin} is empty", path), "the password", "write it into the file"
            )
        return found


def load_settings(path: Path) -> SparkplugSettings:
    """Read a settings file and check the files that it names.

    Raises
    ------
    InputError
        The file can't be read, is wrong, or names files that can't be used.
    """
    text = _read(path, "a readable settings file")
    found = validated(SparkplugSettings, parse_toml(text, str(path)), str(path))
    found = found.relative_to(path.parent)
    found.password()
    for key, file in found.tls.model_dump().items():
        if file is not None and not file.is_file():
            raise InputError(
                Message("{path}: tls.{key} = {file!r} doesn't exist", path, key, str(file)),
                "a PEM file",
            )
    return found


def _read(path: Path, wanted: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(
            Message("{path}: {strerror}", path, error.strerror or error), wanted
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(
            Message("{file}: not UTF-8 at byte {start}", path, error.start), "UTF-8 text"
        ) from error


def _check_id(key: str, value: str | None) -> None:
    if value is None:
        return
    wrong = [c for c in value if c in FORBIDDEN or not c.isprintable()]
    if wrong:
        raise ConflictError(key, f"{value!r}", "printable characters without +, # and /")
