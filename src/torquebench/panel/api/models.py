"""Request bodies, and responses that aren't values of the service."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from torquebench.chain.effects.switched_off import SWITCHES, Switch
from torquebench.operations import WHOLE, Flag, Role
from torquebench.panel.service import Client
from torquebench.panel.service.access.passwords import LONGEST, SHORTEST
from torquebench.panel.service.live.markers import LONGEST_NOTE

Text = Annotated[str, Field(max_length=500)]
Secret = Annotated[str, Field(min_length=1, max_length=256)]
NewSecret = Annotated[str, Field(min_length=SHORTEST, max_length=LONGEST)]
Name = Annotated[str, Field(min_length=1, max_length=128)]


class Body(BaseModel):
    """Request body: known fields only."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class SignInBody(Body):
    """Name and password of a person."""

    name: Name
    password: Secret


class SetUpBody(Body):
    """Name and password of the first administrator, and the code on the server's console."""

    name: Name
    password: NewSecret
    code: Annotated[str, Field(min_length=1, max_length=64)]


class OpenedSession(BaseModel):
    """The token of a session: send it as `Authorization: Bearer …`."""

    token: str


class WhoAmI(BaseModel):
    """Owner of a token."""

    name: str
    role: Role
    kind: Literal["person", "client"]
    commands: bool = Field(description="Whether this session commands the bench.")


class PasswordBody(Body):
    """The old and the new password of a person."""

    old: Secret
    new: NewSecret


class LeaseBody(Body):
    """How to take the command lease."""

    force: Flag = Field(
        default=False,
        description=("Take the lease over from its holder; for metrologists and above."),
    )


class MarkerBody(Body):
    """A note, at the present bench time or an earlier one."""

    note: Annotated[str, Field(min_length=1, max_length=LONGEST_NOTE)]
    bench_time_s: Annotated[float | None, Field(ge=0, le=1e9)] = None


class QueuePlaceBody(Body):
    """A place among the operations that wait, from 0."""

    place: Annotated[int, Field(ge=0, le=500), WHOLE]


class QueueStartBody(Body):
    """Options for starting the queue."""

    bench_clear: Flag = False
    keep_going: Annotated[
        Flag, Field(description="Whether the queue continues after a failed check.")
    ] = False


class StopBody(Body):
    """Reason of a stop."""

    reason: Annotated[str, Field(max_length=200)] = ""


class ReasonBody(Body):
    """Reason of an action."""

    reason: Text = ""


class AcknowledgeBody(Body):
    """Identifiers of the checked alarms."""

    alarm_ids: Annotated[
        list[Annotated[str, Field(max_length=64)]] | None,
        Field(max_length=1000, description="All active alarms, if omitted."),
    ] = None


class SwitchBody(ReasonBody):
    """Corrections that are switched off; all others are applied."""

    off: list[Switch] = Field(default=[], max_length=len(SWITCHES))


class AbortBody(ReasonBody):
    """Reason for aborting a job."""


class AnswerBody(Body):
    """Whether the person at the bench has done what the question requests."""

    done: Flag


class DocumentBody(Body):
    """A document of the settings."""

    document: dict[str, Any]
    reason: Text = ""
    version: Annotated[int, Field(ge=0, le=2**53), WHOLE] | None = None


class UserBody(Body):
    """A new account."""

    name: Name
    role: Role
    password: NewSecret


class UserChangeBody(Body):
    """Changes of an account."""

    role: Role | None = None
    active: Flag | None = None
    password: NewSecret | None = None
    unlock: Flag = False
    system_users: Annotated[
        list[Annotated[str, Field(max_length=320)]] | None,
        Field(max_length=20, description="Users of the operating system: user or user@host."),
    ] = None


class ClientBody(Body):
    """A new client."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    role: Role


class MadeClient(BaseModel):
    """A client and its token, which is never shown again."""

    client: Client
    token: str


class SignalValue(BaseModel):
    """The newest value of a signal, null before the first, and its age in s."""

    title: str
    unit: str
    value: float | None
    age_s: float | None
    stale: bool
    fault: str


class LiveRows(BaseModel):
    """Rows of live signals: mean, lowest and highest value within each row; null if missing."""

    sequence: int = Field(description="Use this number for `since` in the next request.")
    missed: int = Field(description="Rows that are no longer stored.")
    time_s: list[float]
    values: dict[str, list[float | None]]
    low: dict[str, list[float | None]]
    high: dict[str, list[float | None]]
