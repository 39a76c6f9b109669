"""Signing in: a plain form, which works with password managers and without scripts."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from nicegui import ui
from starlette.requests import Request

from torquebench.panel.components.elements import box, note, words
from torquebench.panel.pages.frame import head, stop_button
from torquebench.panel.pages.menu import language_buttons
from torquebench.panel.pages.visitor import look_of, text_of
from torquebench.panel.service import BenchService
from torquebench.panel.text import Text

__all__ = ["safe_target", "sign_in_page"]

REASONS = ("wrong", "locked", "expired", "differ", "bad_code", "weak")
SHORTEST_PASSWORD = 10
FOCUS_FIRST_EMPTY = (
    "[...document.querySelectorAll('form input')].find((entry) => !entry.value)?.focus()"
)


def safe_target(target: str) -> str:
    """Return where to go after signing in: a path of this panel, whatever was asked.

    Examples
    --------
    >>> safe_target("/records"), safe_target("//elsewhere.example"), safe_target("https://x.example")
    ('/records', '/', '/')
    """
    known = ("/", "/calibrate", "/reducer", "/records", "/settings", "/alarms")
    return target if target in known else "/"


def sign_in_page(service: BenchService, request: Request) -> None:
    """Build the page that signs somebody in, or makes the first account."""
    text = text_of(request)
    first = service.people.setup_code is not None
    title = text("sign_in.first_title" if first else "sign_in.title")
    head(text, look_of(request), title)
    target = safe_target(request.query_params.get("next", "/"))
    with box("div", "sign-in"), box("div", "panel stack"):
        words("div", "torquebench", "product")
        words("div", text.core(service.snapshot().bench_name), "muted")
        words("h1", title)
        if first:
            words("p", text("sign_in.first_explained"))
        reason = request.query_params.get("reason", "")
        if reason in REASONS:
            seconds = request.query_params.get("seconds", "")
            said = text(f"sign_in.{reason}", seconds=seconds if seconds.isdecimal() else "60")
            note(said, "bad", live=True)
        action = "/panel/set-up" if first else "/panel/sign-in"
        with box("form", "stack", method="post", action=f"{action}?next={quote(target)}"):
            if first:
                _entry(text, "code", "text", "off", text("sign_in.code_hint"))
            name = request.query_params.get("name", "")[:64]
            _entry(text, "name", "text", "username", value=name)
            if first:
                for each in ("password", "repeat"):
                    _entry(text, each, "password", "new-password", minlength=SHORTEST_PASSWORD)
            else:
                _entry(text, "password", "password", "current-password")
            button = "sign_in.first_button" if first else "sign_in.button"
            words("button", text(button), "control primary", type="submit")
        language_buttons(text)
        words("div", "", "note bad", id="stop-result", role="alert", hidden="hidden")
        with box("div", "line stop-line"):
            stop_button(text)
    ui.run_javascript(FOCUS_FIRST_EMPTY)


def _entry(
    text: Text, name: str, kind: str, autocomplete: str, hint: str = "", **attributes: Any
) -> None:
    with box("div", "field"):
        words("label", text(f"sign_in.{name}"), for_=f"sign-in-{name}")
        entry = box(
            "input",
            "control",
            type=kind,
            name=name,
            id=f"sign-in-{name}",
            autocomplete=autocomplete,
            required="required",
            maxlength="200",
            **attributes,
        )
        if hint:
            words("div", hint, "hint", id=f"sign-in-{name}-hint")
            entry.props["aria-describedby"] = f"sign-in-{name}-hint"
