"""Access tokens of programs: list, create, revoke."""

from __future__ import annotations

from datetime import datetime

from torquebench.panel.components.controls import Field, button
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import (
    box,
    empty,
    headings,
    note,
    panel,
    refilled,
    table,
    words,
)
from torquebench.panel.pages.users import role_choice
from torquebench.panel.pages.view import View
from torquebench.panel.service import Actor, Client


class TokensView(View):
    """The view of programs that may use the API, for administrators."""

    def build(self) -> None:
        """Make the view's elements."""
        text = self._text
        self._made = box("div", role="status")
        self._list = box("div")
        with panel(text("Make a token")), box("div", "stack"):
            words(
                "p",
                text(
                    "A program that uses the API signs in by a token. Its role says what it may do."
                ),
                "muted",
            )
            words("a", text("What the API offers"), href="/docs", target="_blank")
            self._name = Field(
                text("Program"),
                hint=text("1 to 64 of A-Z, a-z, 0-9, dots, hyphens and underscores"),
                maxlength="64",
                autocomplete="off",
            )
            self._role = role_choice(text)
            with box("div", "line"):
                button(text("Make a token"), self._add, "primary", picture="key")
        self._show()

    def _show(self) -> None:
        text, visitor = self._text, self._visitor
        listed = visitor.service.clients.list(visitor.looker)
        clients = [client for client in listed if client.revoked is None]
        with refilled(self._list), panel(text("Tokens")):
            if not clients:
                empty(text("No program has a token."), "key_off")
                return
            rows = [
                (
                    client.name,
                    text(client.role),
                    datetime.fromisoformat(client.created),
                    client.created_by,
                )
                for client in clients
            ]
            table(
                text("Tokens"),
                headings(text, "Program", "Role", "Since", "Made by"),
                rows,
                on_row=lambda place: self._ask_revoke(clients[place]),
                open_label=text("Revoke"),
            )

    def _add(self) -> None:
        visitor, text = self._visitor, self._text
        name, role = self._name.value, self._role.value

        def add(actor: Actor) -> None:
            # the choice contains only roles
            _, token = visitor.service.clients.add(actor, name, role)  # type: ignore[arg-type]
            said = text("The token of {name}. Copy it now: it isn't shown again.", name=name)
            with refilled(self._made), note(said, "good"):
                words("code", token)
            self._name.set("")

        visitor.act(add, then=self._show)

    def _ask_revoke(self, client: Client) -> None:
        text, visitor = self._text, self._visitor

        def revoked() -> None:
            self._made.clear()
            self._show()

        ask(
            text,
            text("Revoke"),
            text(
                "The token of {name} counts no longer, from now on and for good.", name=client.name
            ),
            lambda _: visitor.act(visitor.service.clients.revoke, client.client_id, then=revoked),
            danger=True,
        )
