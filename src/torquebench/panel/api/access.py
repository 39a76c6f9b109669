"""Identify the caller of an operation by token: a client, or a person with a session.

Tokens are looked up in memory, so these dependencies need no thread.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, TypeAlias

from fastapi import Depends, Request
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.requests import HTTPConnection

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.panel.service import Actor, BenchService, NotSignedInError

_bearer = HTTPBearer(
    auto_error=False,
    scheme_name="bearer",
    description="A client's token (tb_…), or the token of a session that `POST /session` opened.",
)


async def service_of(request: Request) -> BenchService:
    """Return the bench that this application serves."""
    service: BenchService = request.app.state.service
    return service


def caller_of(service: BenchService, token: str, *, touch: bool = True) -> Actor:
    """Return the owner of a token.

    Raises
    ------
    NotSignedInError
        The token is unknown, revoked or expired.
    """
    return service.clients.find(token) or service.people.actor(token, touch=touch)


def address_of(request: Request) -> str:
    """Return the address of a request's sender."""
    return request.client.host if request.client else "unknown"


async def known_query(connection: HTTPConnection) -> None:
    """Refuse unknown query parameters, most of which are typing mistakes."""
    route = connection.scope.get("route")
    if not isinstance(route, APIRoute):
        return
    known = set(_queries(route.dependant))
    unknown = sorted(set(connection.query_params) - known)
    if unknown:
        raise InputError(
            Message(
                "unknown query parameters: {unknown}", ", ".join(each[:40] for each in unknown[:5])
            ),
            Message("only {known}", ", ".join(sorted(known))) if known else "none",
        )


def _queries(dependant: Dependant) -> Iterator[str]:
    for each in dependant.query_params:
        yield each.alias
    for part in dependant.dependencies:
        yield from _queries(part)


async def _token(
    credentials: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)],
) -> str:
    if credentials is None:
        raise NotSignedInError(
            "no token", "Authorization: Bearer …", "ask an administrator for a client's token"
        )
    return credentials.credentials


Token: TypeAlias = Annotated[str, Depends(_token)]
Service: TypeAlias = Annotated[BenchService, Depends(service_of)]


async def _caller(service: Service, token: Token) -> Actor:
    return caller_of(service, token)


Caller: TypeAlias = Annotated[Actor, Depends(_caller)]


async def _watched(service: Service, caller: Caller) -> BenchService:
    del caller  # every signed-in caller may read
    return service


Watched: TypeAlias = Annotated[BenchService, Depends(_watched)]
"""The bench, for signed-in callers."""
