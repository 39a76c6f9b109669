"""The user of an open page, with language and theme."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any, TypeVar

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import Scope

from torquebench.errors import RecordError, TorquebenchError
from torquebench.operations import Role, allows
from torquebench.panel.components.elements import in_thread, note
from torquebench.panel.components.messages import Messages
from torquebench.panel.service import Actor, BenchService, NotSignedInError
from torquebench.panel.text import Text, choose_language

SESSION_COOKIE = "torquebench_session"
LANGUAGE_COOKIE = "torquebench_language"
LOOK_COOKIE = "torquebench_look"
LOOKS = ("light", "dark")
Value = TypeVar("Value")


@dataclass
class Visitor:
    """An open page's user, language, theme and messages.

    Attributes
    ----------
    service : BenchService
    token : str
        Token of the session.
    text : Text
    look : str
        Theme: "light", "dark", or empty for the device's setting.
    address : str
        Path and query of the page.
    query : mapping of str to str
        Query parameters of the page's URL, and the named parts of its path.
    shown_jobs : set of str
        Jobs that the page itself displays.
    messages : Messages
        The page's messages; set by the frame.
    """

    service: BenchService
    token: str
    text: Text
    look: str
    address: str = "/"
    query: Mapping[str, str] = field(default_factory=dict)
    shown_jobs: set[str] = field(default_factory=set)
    messages: Messages = None  # type: ignore[assignment]  # set by the frame

    @property
    def actor(self) -> Actor:
        """The user as the actor of an action, which keeps the session alive."""
        return self.service.people.actor(self.token)

    @property
    def looker(self) -> Actor:
        """The user without keeping the session alive, for repainting."""
        return self.service.people.actor(self.token, touch=False)

    @property
    def commands(self) -> bool:
        """Whether this session holds the command lease."""
        return self.service.lease.holds(self.looker)

    def has_role(self, role: Role) -> bool:
        """Whether the user's role includes a role."""
        return allows(self.looker.role, role)

    def not_allowed(self) -> None:
        """Show that the user's role doesn't allow this part of the page."""
        role = self.text(self.looker.role)
        note(self.text("Your role ({role}) may view this but not change it.", role=role), "warn")

    def attempt(
        self,
        action: Callable[[], Any],
        success: str = "",
        then: Callable[[], Any] = lambda: None,
    ) -> bool:
        """Run an action; show a refusal, or show success and call `then`; return the success."""
        try:
            action()
        except TorquebenchError as error:
            self.messages.problem(error)
            return False
        if success:
            self.messages.good(success)
        then()
        return True

    def act(
        self,
        action: Callable[..., Any],
        *arguments: Any,
        success: str = "",
        then: Callable[[], Any] = lambda: None,
        **options: Any,
    ) -> bool:
        """Attempt an action of the service as this user."""
        return self.attempt(lambda: action(self.actor, *arguments, **options), success, then)

    def start(
        self,
        kind: str,
        request: Mapping[str, Any],
        then: Callable[[], Any] = lambda: None,
        **confirmed: Any,
    ) -> bool:
        """Attempt to start an operation as a job."""
        return self.act(self.service.start, kind, request, then=then, **confirmed)

    async def attempt_aside(self, action: Callable[[], Value]) -> Value | None:
        """Run an action on another thread and return its value; show a refusal and return None."""
        try:
            value = await in_thread(action)
        except TorquebenchError as error:
            self.messages.problem(error)
        except OSError as error:
            self.messages.problem(RecordError(str(error)))
        else:
            return value
        return None


def profile_titles(visitor: Visitor) -> dict[str, str]:
    """Return the title of each profile by name."""
    return {
        item.name: visitor.text(str(item.document.get("title") or item.name))
        for item in visitor.service.settings.items("profiles")
    }


def session_of(scope: Scope) -> str:
    """Return the session token in a connection's cookie; empty without one."""
    try:
        cookie = SimpleCookie(Headers(scope=scope).get("cookie", "")).get(SESSION_COOKIE)
    except CookieError:
        return ""
    return "" if cookie is None else cookie.value


def text_of(request: Request) -> Text:
    """Return the texts in the language of the user's choice or of the browser."""
    wanted = request.cookies.get(LANGUAGE_COOKIE)
    return Text(choose_language(wanted, request.headers.get("accept-language")))


def look_of(request: Request) -> str:
    """Return the user's theme; empty for the device's setting."""
    wanted = request.cookies.get(LOOK_COOKIE, "")
    return wanted if wanted in LOOKS else ""


def visitor_of(service: BenchService, request: Request) -> Visitor | None:
    """Return the visitor of a page; None if not signed in."""
    token = request.cookies.get(SESSION_COOKIE, "")
    try:
        service.people.actor(token, touch=False)
    except NotSignedInError:
        return None
    query = dict(request.query_params) | request.path_params
    return Visitor(service, token, text_of(request), look_of(request), address_of(request), query)


def address_of(request: Request) -> str:
    """Return path and query of a page."""
    url = request.url
    return f"{url.path}?{url.query}" if url.query else url.path
