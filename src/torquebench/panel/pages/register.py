"""Register the pages, their static files and the forms for signing in and out."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from typing import Annotated
from urllib.parse import quote, urlencode

from fastapi import Form, Request
from fastapi.responses import RedirectResponse, Response
from nicegui import app, ui

from torquebench.errors import TorquebenchError
from torquebench.panel.pages.page import PAGES, Page
from torquebench.panel.pages.sign_in import no_such_page, safe_target, sign_in_page
from torquebench.panel.pages.visitor import SESSION_COOKIE, address_of, visitor_of
from torquebench.panel.service import BenchService, LockedOutError, SignInError

STATIC = Path(__file__).parents[1] / "static"
Entry = Annotated[str, Form(max_length=200)]
LONGEST_NAME = 64
KEPT_S = 30.0
"""For how long the server keeps a page with a lost connection, s; afterwards it is reloaded, and
typed text is lost.
"""


def import_pages() -> None:
    """Import every module of this package: a page registers itself."""
    folder = Path(__file__).parent
    for module in walk_packages([str(folder)], f"{__package__}."):
        import_module(module.name)


def register_pages(service: BenchService) -> dict[str, str]:
    """Add every page to NiceGUI's application.

    Parameters
    ----------
    service : BenchService
        The open bench.

    Returns
    -------
    dict of str to str
        Session tokens of the open pages, by the pages' identifiers; kept up to date.
    """
    opened: dict[str, str] = {}
    app.add_static_files("/panel/static", STATIC)
    _forms(service)

    @app.get("/sign-in", include_in_schema=False)
    async def sign_in(request: Request) -> Response:
        return sign_in_page(service, request)

    @app.exception_handler(404)
    async def not_found(request: Request, _error: Exception) -> Response:
        return no_such_page(request)

    for page in PAGES.values():
        _add(service, page, opened)
    return opened


def _add(service: BenchService, page: Page, opened: dict[str, str]) -> None:
    @ui.page(page.path, reconnect_timeout=KEPT_S)
    def show(request: Request) -> Response | None:
        visitor = visitor_of(service, request)
        if visitor is None:
            return RedirectResponse(f"/sign-in?next={quote(address_of(request))}", status_code=303)
        client = ui.context.client
        opened[client.id] = visitor.token
        client.on_delete(lambda: opened.pop(client.id, None))
        page.build(visitor)
        return None


def _address(request: Request) -> str:
    return request.client.host if request.client is not None else ""


def _signed_in(request: Request, token: str) -> Response:
    target = safe_target(request.query_params.get("next", "/"))
    answer = RedirectResponse(target, status_code=303)
    answer.set_cookie(
        SESSION_COOKIE,
        token,
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return answer


def _refused(request: Request, name: str, reason: str, error: TorquebenchError | None) -> Response:
    """Redirect to the form with the reason of a refusal and the entered name."""
    found = {
        "reason": reason,
        "name": name[:LONGEST_NAME],
        "next": safe_target(request.query_params.get("next", "/")),
    }
    if isinstance(error, LockedOutError):
        found |= {"reason": "locked", "seconds": str(round(error.wait_s + 0.5))}
    return RedirectResponse(f"/sign-in?{urlencode(found)}", status_code=303)


def _forms(service: BenchService) -> None:
    @app.post("/panel/sign-in", include_in_schema=False)
    def sign_in(request: Request, name: Entry, password: Entry) -> Response:
        try:
            token = service.people.sign_in(name, password, _address(request))
        except TorquebenchError as error:
            return _refused(request, name, "wrong", error)
        return _signed_in(request, token)

    @app.post("/panel/set-up", include_in_schema=False)
    def set_up(
        request: Request, code: Entry, name: Entry, password: Entry, repeat: Entry
    ) -> Response:
        if password != repeat:
            return _refused(request, name, "differ", None)
        try:
            token = service.people.set_up(code, name, password, _address(request))
        except SignInError as error:
            return _refused(request, name, "bad_code", error)
        except TorquebenchError as error:
            return _refused(request, name, "weak", error)
        return _signed_in(request, token)

    @app.post("/panel/sign-out", include_in_schema=False)
    def sign_out(request: Request) -> Response:
        service.people.sign_out(request.cookies.get(SESSION_COOKIE, ""))
        answer = RedirectResponse("/sign-in", status_code=303)
        answer.delete_cookie(SESSION_COOKIE)
        return answer
