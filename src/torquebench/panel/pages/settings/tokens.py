"""Access tokens of programs: list, create, revoke."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from torquebench.panel.components.controls import Choice, Field, button
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import box, empty, note, panel, table, words
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import ROLES, Client

__all__ = ["TokensView"]


class TokensView:
    """Programs that may use the API; an administrator's."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text

    def build(self) -> None:
        """Make the view's elements."""
        text = self._text
        self._made = box("div", role="status")
        self._list = box("div")
        with panel(text("tokens.add")), box("div", "stack"):
            words("p", text("tokens.explained"), "muted")
            self._name = Field(
                text("tokens.name"), hint=text("tokens.name_hint"), maxlength="64",
                autocomplete="off",
            )  # fmt: skip
            roles: dict[str, str] = {role: text.core(role) for role in ROLES}
            self._role = Choice(text("users.role"), roles, "operator")
            with box("div", "line"):
                button(text("tokens.add"), self._add, "primary", picture="key")
        self._show()

    def _show(self) -> None:
        text, visitor = self._text, self._visitor
        clients = [each for each in visitor.service.clients.list(visitor.looker)
                   if each.revoked is None]  # fmt: skip
        self._list.clear()
        with self._list, panel(text("settings.tokens")):
            if not clients:
                empty(text("tokens.none"), "key_off")
                return
            rows = [
                (
                    each.name,
                    text.core(each.role),
                    datetime.fromisoformat(each.created),
                    each.created_by,
                )
                for each in clients
            ]
            headings = ("tokens.name", "users.role", "users.created", "tokens.by")
            table(
                text("settings.tokens"),
                [(text(key), False) for key in headings],
                rows,
                on_row=lambda place: self._ask_revoke(clients[place]),
                open_label=text("tokens.revoke"),
            )

    def _add(self) -> None:
        visitor, text = self._visitor, self._text
        made: list[str] = []
        role: Any = self._role.value

        def add() -> None:
            made.append(visitor.service.clients.add(visitor.actor, self._name.value, role)[1])

        if not visitor.attempt(add):
            return
        self._made.clear()
        with self._made, note(text("tokens.shown_once", name=self._name.value), "good"):
            words("code", made[0])
        self._name.set("")
        self._show()

    def _ask_revoke(self, client: Client) -> None:
        text, visitor = self._text, self._visitor

        def act(_: str) -> bool:
            clients = visitor.service.clients
            gone = visitor.attempt(lambda: clients.revoke(visitor.actor, client.client_id))
            if gone:
                self._made.clear()
                self._show()
            return gone

        ask(
            text,
            text("tokens.revoke"),
            text("tokens.revoke_explained", name=client.name),
            act,
            danger=True,
        )
