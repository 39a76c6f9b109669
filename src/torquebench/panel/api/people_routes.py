"""Routes for people: sign-in, accounts, clients, and the log of actions."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request

from torquebench.panel.api.access import Caller, Service, Token, Watched, address_of
from torquebench.panel.api.models import (
    ClientBody,
    MadeClient,
    OpenedSession,
    PasswordBody,
    SetUpBody,
    SignInBody,
    UserBody,
    UserChangeBody,
    WhoAmI,
)
from torquebench.panel.service import Client, Event, PermissionDeniedError, User
from torquebench.panel.service.access.actors import require

router = APIRouter(tags=["people"])

UserName = Annotated[str, Path(min_length=1, max_length=128)]


@router.post("/setup")
def set_up(service: Service, request: Request, body: SetUpBody) -> OpenedSession:
    """Create the first administrator with the code on the server's console, and open a session."""
    token = service.people.set_up(body.code, body.name, body.password, address_of(request))
    return OpenedSession(token=token)


@router.post("/session")
def sign_in(service: Service, request: Request, body: SignInBody) -> OpenedSession:
    """Open a session of a person; too many wrong passwords cause a pause."""
    return OpenedSession(
        token=service.people.sign_in(body.name, body.password, address_of(request))
    )


@router.get("/session")
def who_am_i(service: Service, caller: Caller) -> WhoAmI:
    """Return the owner of this token."""
    return WhoAmI(
        name=caller.name,
        role=caller.role,
        kind=caller.kind,
        commands=service.lease.holds(caller),
    )


@router.delete("/session", status_code=204)
def sign_out(service: Service, caller: Caller, token: Token) -> None:
    """End the session of this token; a client's token is revoked instead."""
    if caller.kind != "person":
        raise PermissionDeniedError("a client has no session", "a person's token", "revoke it")
    service.lease.give_back(caller)
    service.people.sign_out(token)


@router.put("/password", status_code=204)
def change_password(service: Service, caller: Caller, request: Request, body: PasswordBody) -> None:
    """Change the caller's password; the person's other sessions end."""
    service.people.change_password(caller, body.old, body.new, address_of(request))


@router.get("/users")
def users(service: Service, caller: Caller) -> list[User]:
    """Return all accounts; for administrators."""
    return service.people.users(caller)


@router.post("/users", status_code=201)
def add_user(service: Service, caller: Caller, body: UserBody) -> User:
    """Add an account; for administrators."""
    return service.people.add_user(caller, body.name, body.role, body.password)


@router.patch("/users/{name}")
def change_user(service: Service, caller: Caller, name: UserName, body: UserChangeBody) -> User:
    """Change an account and end its sessions, or end the pause after wrong passwords."""
    return service.people.change_user(
        caller,
        name,
        role=body.role,
        active=body.active,
        password=body.password,
        unlock=body.unlock,
        linked=body.system_users,
    )


@router.get("/people")
def people(service: Watched) -> list[str]:
    """Return the names of the laboratory's people, from whom the measuring person is chosen."""
    return list(service.laboratory_people())


@router.get("/clients")
def clients(service: Service, caller: Caller) -> list[Client]:
    """Return all clients, including revoked ones; for administrators."""
    return service.clients.list(caller)


@router.post("/clients", status_code=201)
def add_client(service: Service, caller: Caller, body: ClientBody) -> MadeClient:
    """Create a token for a program; it is returned only once."""
    client, token = service.clients.add(caller, body.name, body.role)
    return MadeClient(client=client, token=token)


@router.delete("/clients/{client_id}")
def revoke_client(
    service: Service, caller: Caller, client_id: Annotated[int, Path(ge=1, le=2**53)]
) -> Client:
    """Revoke a token; for administrators."""
    return service.clients.revoke(caller, client_id)


@router.get("/log")
def log(
    service: Service,
    caller: Caller,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    before: Annotated[int | None, Query(ge=1, le=2**53)] = None,
) -> list[Event]:
    """Return the actions in the panel, the newest first; for metrologists and above."""
    require(caller, "metrologist")
    return service.log(limit, before)
