"""People: accounts and roles for administrators, one's own password for everyone."""

from __future__ import annotations

from typing import Any

from torquebench.panel.components.controls import Choice, Field, button
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import box, panel, table
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import ROLES, User

__all__ = ["UsersView"]


class UsersView:
    """Accounts, as far as the user may see them."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text

    def build(self) -> None:
        """Make the view's elements."""
        self._own_password()
        if self._visitor.has_role("administrator"):
            self._edited = box("div")
            self._list = box("div")
            self._add()
            self._show()

    def _own_password(self) -> None:
        text = self._text
        with panel(text("users.own")), box("div", "stack"):
            with box("div", "columns"):
                old = Field(text("users.old"), kind="password", autocomplete="current-password")
                new = Field(
                    text("users.new"),
                    kind="password",
                    autocomplete="new-password",
                    hint=text("users.rule"),
                )

            def change() -> None:
                visitor = self._visitor
                if visitor.attempt(
                    lambda: visitor.service.people.change_password(
                        visitor.actor, old.value, new.value
                    ),
                    text("users.changed"),
                ):
                    old.set("")
                    new.set("")

            with box("div", "line"):
                button(text("users.change"), change, "primary", picture="key")

    def _show(self) -> None:
        text = self._text
        users = self._visitor.service.people.users(self._visitor.looker)
        rows = [
            (
                user.name,
                text.core(user.role),
                text("users.active" if user.active else "users.inactive"),
                user.created[:10],
            )
            for user in users
        ]
        self._list.clear()
        with self._list, panel(text("users.accounts")):
            table(
                text("users.accounts"),
                [(text(f"users.{key}"), False) for key in ("name", "role", "state", "created")],
                rows,
                on_row=lambda place: self._edit(users[place]),
                open_label=text("users.edit"),
            )

    def _roles(self) -> dict[str, str]:
        return {role: self._text.core(role) for role in ROLES}

    def _add(self) -> None:
        text, visitor = self._text, self._visitor
        with panel(text("users.add")), box("div", "stack"):
            with box("div", "columns"):
                name = Field(text("users.name"), autocomplete="off", maxlength="64")
                password = Field(
                    text("users.first_password"),
                    kind="password",
                    autocomplete="new-password",
                    hint=text("users.rule"),
                )
            role = Choice(text("users.role"), self._roles(), "operator")

            def add() -> None:
                people = visitor.service.people
                chosen: Any = role.value
                if visitor.attempt(
                    lambda: people.add_user(visitor.actor, name.value, chosen, password.value),
                    text("users.added", name=name.value),
                ):
                    name.set("")
                    password.set("")
                    self._show()

            with box("div", "line"):
                button(text("users.add"), add, "primary", picture="person_add")

    def _edit(self, user: User) -> None:
        text = self._text
        self._edited.clear()
        with self._edited, panel(user.name), box("div", "stack"):
            role = Choice(text("users.role"), self._roles(), user.role)
            with box("div", "line"):
                button(text("users.save"), lambda: self._change(user, role=role.value), "primary")
                button(
                    text("users.deactivate" if user.active else "users.activate"),
                    lambda: self._change(user, active=not user.active),
                )
                button(text("users.reset"), lambda: self._reset(user))
                button(text("users.unlock"), lambda: self._change(user, unlock=True))
                button(text("frame.close"), self._edited.clear, "quiet")

    def _change(self, user: User, **values: Any) -> None:
        visitor = self._visitor
        if visitor.attempt(
            lambda: visitor.service.people.change_user(visitor.actor, user.name, **values),
            self._text("users.saved", name=user.name),
        ):
            self._edited.clear()
            self._show()

    def _reset(self, user: User) -> None:
        text, visitor = self._text, self._visitor
        people = visitor.service.people

        def act(password: str) -> bool:
            return visitor.attempt(
                lambda: people.change_user(visitor.actor, user.name, password=password),
                text("users.saved", name=user.name),
            )

        ask(
            text,
            text("users.reset"),
            text("users.reset_explained", name=user.name),
            act,
            field=text("users.new"),
            kind="password",
            autocomplete="new-password",
        )
