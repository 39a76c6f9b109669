"""Pages for people who aren't signed in, as plain HTML that costs the server little.

They work with password managers and without scripts, except for the stop button.
"""

from __future__ import annotations

import re
from html import escape
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import HTMLResponse

from torquebench.panel.pages.frame import LANGUAGE_TAGS, STOP, head_html, page_title
from torquebench.panel.pages.page import PAGES
from torquebench.panel.pages.visitor import LANGUAGE_COOKIE, look_of, text_of
from torquebench.panel.service import BenchService
from torquebench.panel.service.access.passwords import SHORTEST
from torquebench.panel.text import LANGUAGES, Text, Texts

REASONS: Texts = {
    "wrong": "Name and password don't belong together.",
    "locked": "Too many wrong passwords. Try again in {seconds} s.",
    "expired": "Your session has ended. Sign in again.",
    "differ": "The two passwords differ.",
    "bad_code": "This isn't the setup code that the terminal shows.",
    "weak": "Use a name of letters and digits, and a password of at least 10 characters without "
    "the name in it.",
}
ENTRIES: Texts = {
    "code": "Setup code",
    "name": "User name",
    "password": "Password",
    "repeat": "Password again",
}


def safe_target(target: str) -> str:
    """Return the path to open after signing in, always on this panel.

    Examples
    --------
    >>> safe_target("/calibrations/1?step=sign"), safe_target("//x.example"), safe_target("/x")
    ('/calibrations/1?step=sign', '/', '/')
    """
    path = target.partition("?")[0]
    patterns = (re.sub(r"{\w+}", r"[\\w.-]+", page.path) for page in PAGES.values())
    return target if any(re.fullmatch(pattern, path) for pattern in patterns) else "/"


def element(tag: str, *content: str, classes: str = "", **attributes: str | bool | None) -> str:
    """Return an HTML element with escaped attributes; its content must be HTML.

    Examples
    --------
    >>> element("p", "so", classes="muted", id="<", aria_label="A & B", hidden=True, lang=None)
    '<p class="muted" id="&lt;" aria-label="A &amp; B" hidden>so</p>'
    """
    said = f' class="{escape(classes)}"' if classes else ""
    for name, value in attributes.items():
        if value is None or value is False:
            continue
        key = name.rstrip("_").replace("_", "-")
        said += f" {key}" if value is True else f' {key}="{escape(str(value))}"'
    inside = "".join(content)
    return f"<{tag}{said}>" if tag == "input" else f"<{tag}{said}>{inside}</{tag}>"


def sign_in_page(service: BenchService, request: Request) -> HTMLResponse:
    """Return the page for signing in, or for the first account."""
    text = text_of(request)
    first = service.people.setup_code is not None
    title = text("First user" if first else "Sign in")
    target = safe_target(request.query_params.get("next", "/"))
    parts = [
        element("div", "torquebench", classes="product"),
        element("div", escape(text(service.snapshot().bench_name)), classes="muted"),
        element("h1", escape(title)),
    ]
    if first:
        parts.append(
            element(
                "p",
                escape(
                    text(
                        "Nobody can sign in yet. Create the administrator's account; the "
                        "administrator creates the others."
                    )
                ),
            )
        )
    reason = request.query_params.get("reason", "")
    if reason in REASONS:
        seconds = request.query_params.get("seconds", "")
        said = text(REASONS[reason], seconds=seconds if seconds.isdecimal() else "60")
        parts.append(element("p", escape(said), classes="note bad", role="alert"))
    name = request.query_params.get("name", "")[:64]
    entries = (
        [
            _entry(
                text,
                "code",
                "text",
                "off",
                text("It is in the terminal where the panel was started."),
            )
        ]
        if first
        else []
    )
    entries.append(_entry(text, "name", "text", "username", value=name))
    if first:
        least = str(SHORTEST)
        entries += [
            _entry(text, entry, "password", "new-password", minlength=least)
            for entry in ("password", "repeat")
        ]
    else:
        entries.append(_entry(text, "password", "password", "current-password"))
    button = text("Create the account" if first else "Sign in")
    entries.append(element("button", escape(button), classes="control primary", type="submit"))
    focus = 'name="code"' if first else 'name="password"' if name else 'name="name"'
    form = element(
        "form",
        *(entry.replace(focus, focus + " autofocus", 1) for entry in entries),
        classes="stack",
        method="post",
        action=f"/panel/{'set-up' if first else 'sign-in'}?next={quote(target)}",
    )
    parts += [
        form,
        _languages(text),
        element("div", classes="note bad", id="stop-result", role="alert", hidden=True),
        element("div", _stop_button(text), classes="line stop-line"),
    ]
    return _page(text, look_of(request), title, *parts)


def no_such_page(request: Request) -> HTMLResponse:
    """Return the page for unknown addresses."""
    text = text_of(request)
    title = text("There is no such page.")
    link = element("a", escape(text("To the live page")), href="/")
    content = [element("h1", escape(title)), element("p", link)]
    return _page(text, look_of(request), title, *content, status=404)


def _page(text: Text, look: str, title: str, *content: str, status: int = 200) -> HTMLResponse:
    panel = element("div", *content, classes="panel stack")
    language = LANGUAGE_TAGS[text.language]
    page = (
        f'<!DOCTYPE html><html lang="{language}"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(page_title(title))}</title>{head_html(text, look)}</head>"
        f'<body class="plain">{element("main", panel, classes="sign-in")}</body></html>'
    )
    return HTMLResponse(page, status, {"Cache-Control": "no-store"})


def _entry(
    text: Text, name: str, kind: str, autocomplete: str, hint: str = "", **attributes: str
) -> str:
    place = f"sign-in-{name}"
    parts = [
        element("label", escape(text(ENTRIES[name])), for_=place),
        element(
            "input",
            classes="control",
            type=kind,
            name=name,
            id=place,
            autocomplete=autocomplete,
            required=True,
            maxlength="200",
            aria_describedby=f"{place}-hint" if hint else None,
            **attributes,
        ),
    ]
    if hint:
        parts.append(element("div", escape(hint), classes="hint", id=f"{place}-hint"))
    return element("div", *parts, classes="field")


def _languages(text: Text) -> str:
    buttons = (
        element(
            "button",
            escape(name),
            classes="control",
            type="button",
            lang=language,
            data_choose=LANGUAGE_COOKIE,
            data_value=language,
            aria_pressed="true" if language == text.language else "false",
        )
        for language, name in LANGUAGES.items()
    )
    return element("div", *buttons, classes="line")


def _stop_button(text: Text) -> str:
    label = text("Stop the bench: zero torque, drives off (F8)")
    said = {name.replace("-", "_"): value for name, value in STOP.items()}
    return element(
        "button",
        escape(text("STOP")),
        classes="stop",
        aria_label=label,
        title=label,
        **said,
    )
