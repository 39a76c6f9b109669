"""Errors as problem details (RFC 9457)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fastapi import FastAPI, Request
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from pydantic import BaseModel, Field, create_model
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import Route

from torquebench.errors import (
    BenchError,
    InputError,
    InterlockError,
    LimitError,
    ModelMismatchError,
    RecordError,
    SignalFault,
    TorquebenchError,
)
from torquebench.panel.service import (
    BusyError,
    LeaseError,
    LockedOutError,
    NameTakenError,
    NotFoundError,
    NotSignedInError,
    PermissionDeniedError,
    SignInError,
)
from torquebench.validation import as_input_error

MEDIA_TYPE = "application/problem+json"

_STATUS: tuple[tuple[type[TorquebenchError], int, str], ...] = (
    (LockedOutError, 429, "Too many attempts"),
    (NotSignedInError, 401, "Not signed in"),
    (SignInError, 401, "Not signed in"),
    (PermissionDeniedError, 403, "Not allowed"),
    (NotFoundError, 404, "Not found"),
    (LeaseError, 409, "Another session commands"),
    (BusyError, 409, "Busy"),
    (InterlockError, 409, "The bench's state doesn't allow it"),
    (LimitError, 422, "Beyond a limit"),
    (NameTakenError, 409, "Taken"),
    (InputError, 422, "Unusable input"),
    (ModelMismatchError, 409, "A model of another chain"),
    (RecordError, 409, "The records don't allow it"),
    (SignalFault, 503, "No signal"),
    (BenchError, 503, "The bench failed"),
)


class ProblemDetails(BaseModel):
    """The reason of a refusal: found, allowed and remedy."""

    type: str = Field(description="A name for programs, such as torquebench:LeaseError.")
    title: str
    status: int
    detail: str = Field(description="What was found.")
    allowed: str = ""
    remedy: str = ""


def _described(words: str) -> dict[str, Any]:
    return {
        "description": words,
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/ProblemDetails"}}},
    }


PROBLEMS: dict[int | str, dict[str, Any]] = {
    400: _described("The request can't be read."),
    401: _described("No valid token."),
    403: _described("The role doesn't allow it."),
    404: _described("Nothing has this identifier."),
    409: _described(
        "The state of the bench or records doesn't allow it, or another session has the "
        "command lease."
    ),
    413: _described("The body is too large."),
    422: _described("A value is invalid or beyond a limit."),
    429: _described("Too many wrong passwords; Retry-After says how long to wait."),
    503: _described("The bench doesn't respond."),
}
"""Error answers that every operation may return."""


def problem_response(
    status: int,
    title: str,
    detail: str,
    *,
    kind: str = "about:blank",
    allowed: str = "",
    remedy: str = "",
    headers: dict[str, str] | None = None,
) -> JSONResponse:
    """Return problem details as a response."""
    content = ProblemDetails(
        type=kind, title=title, status=status, detail=detail, allowed=allowed, remedy=remedy
    )
    return JSONResponse(content.model_dump(), status, headers, MEDIA_TYPE)


def _refused(_request: Request, error: Exception) -> Response:
    assert isinstance(error, TorquebenchError)
    status, title = next(
        ((status, title) for kind, status, title in _STATUS if isinstance(error, kind)),
        (409, "Refused"),
    )
    headers: dict[str, str] = {}
    if status == 401:
        headers["WWW-Authenticate"] = "Bearer"
    if isinstance(error, LockedOutError):
        headers["Retry-After"] = f"{error.wait_s:.0f}"
    return problem_response(
        status,
        title,
        error.found,
        kind=f"torquebench:{type(error).__name__}",
        allowed=error.allowed,
        remedy=error.remedy,
        headers=headers,
    )


def _invalid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    place = error.errors()[0]["loc"][0]
    details: list[Any] = [
        {**each, "loc": each["loc"][1:]} for each in error.errors() if each["loc"][0] == place
    ]
    return _refused(
        request, as_input_error(details, str(place), _model_of(request.scope.get("route"), place))
    )


def _model_of(route: object, place: str) -> type[BaseModel] | None:
    """Return the model of a request's body, query or path."""
    if not isinstance(route, APIRoute):
        return None
    if place == "body":
        body = route.body_field.field_info.annotation if route.body_field is not None else None
        return body if isinstance(body, type) and issubclass(body, BaseModel) else None
    fields = (f for each in _dependants(route.dependant) for f in getattr(each, f"{place}_params"))
    given: Any = {each.alias: (each.field_info.annotation, each.field_info) for each in fields}
    return create_model(place, **given)


def _dependants(top: Dependant) -> Iterator[Dependant]:
    yield top
    for below in top.dependencies:
        yield from _dependants(below)


def _http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers) if error.headers else {}
    if error.status_code == 405:
        headers["Allow"] = ", ".join(_methods(request))
    return problem_response(
        error.status_code, str(error.detail), str(error.detail), headers=headers
    )


def _methods(request: Request) -> list[str]:
    """Return all methods of a path; the router itself lists only those of the first route."""
    path = request.scope["path"].removeprefix(request.scope.get("root_path", ""))
    routes = [each for each in request.app.routes if isinstance(each, Route)]
    found = [each for each in routes if each.path_regex.match(path)]
    fewest = min((len(each.param_convertors) for each in found), default=0)
    best = [each for each in found if len(each.param_convertors) == fewest]
    return sorted({method for each in best for method in each.methods or ()})


def _unforeseen(_request: Request, error: Exception) -> Response:
    """Respond with an internal error; its details are printed on the server's console only."""
    return problem_response(
        500, "Unforeseen", type(error).__name__, remedy="report it with the server's output"
    )


def add_handlers(app: FastAPI) -> None:
    """Add handlers that return every error as problem details."""
    app.add_exception_handler(TorquebenchError, _refused)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(Exception, _unforeseen)
