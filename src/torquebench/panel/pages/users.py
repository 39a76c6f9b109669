"""The view of people: accounts and roles for administrators, the own password for everyone."""

from __future__ import annotations

from typing import Any

from torquebench.panel.components.controls import Choice, Field, button
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import box, panel, refilled, table
from torquebench.panel.pages.view import View
from torquebench.panel.service import ROLES, User
from torquebench.panel.text import Text

__all__ = ["UsersView", "role_choice"]


COLUMNS = ("name", "role", "state", "created", "system_users", "password_set")


class UsersView(View):
    """The view of accounts, and of the user's password."""

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
                old = Field(text("users.old"), kind="password")
                new = Field(text("users.new"), kind="new-password", hint=text("users.rule"))

            def change() -> None:
                people = self._visitor.service.people
                self._visitor.act(
                    people.change_password, old.value, new.value,
                    success=text("users.changed"), then=lambda: _empty(old, new),
                )  # fmt: skip

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
                ", ".join(user.system_users),
                user.password_set,
            )
            for user in users
        ]
        with refilled(self._list), panel(text("users.accounts")):
            table(
                text("users.accounts"),
                [(text(f"users.{key}"), False) for key in COLUMNS],
                rows,
                on_row=lambda place: self._edit(users[place]),
                open_label=text("users.edit"),
            )

    def _add(self) -> None:
        text, visitor = self._text, self._visitor
        with panel(text("users.add")), box("div", "stack"):
            with box("div", "columns"):
                name = Field(text("users.name"), autocomplete="off", maxlength="64")
                password = Field(
                    text("users.first_password"), kind="new-password", hint=text("users.rule")
                )
            role = role_choice(text)

            def added() -> None:
                _empty(name, password)
                self._show()

            def add() -> None:
                visitor.act(
                    visitor.service.people.add_user, name.value, role.value, password.value,
                    success=text("users.added", name=name.value), then=added,
                )  # fmt: skip

            with box("div", "line"):
                button(text("users.add"), add, "primary", picture="person_add")

    def _edit(self, user: User) -> None:
        text = self._text
        with refilled(self._edited), panel(user.name), box("div", "stack"):
            role = role_choice(text, user.role)
            with box("div", "line"):
                button(text("users.save"), lambda: self._change(user, role=role.value), "primary")
                button(
                    text("users.deactivate" if user.active else "users.activate"),
                    lambda: self._change(user, active=not user.active),
                )
                button(text("users.reset"), lambda: self._reset(user))
                button(text("users.unlock"), lambda: self._change(user, unlock=True))
                button(text("users.link"), lambda: self._link(user))
                button(text("frame.close"), self._edited.clear, "quiet")

    def _change(self, user: User, **values: Any) -> bool:
        people, said = self._visitor.service.people, self._text("users.saved", name=user.name)
        return self._visitor.act(
            people.change_user, user.name, success=said, then=self._changed, **values
        )

    def _changed(self) -> None:
        self._edited.clear()
        self._show()

    def _link(self, user: User) -> None:
        text = self._text
        ask(
            text,
            text("users.link"),
            text("users.link_explained", name=user.name),
            lambda users: self._change(user, linked=users.split(",")),
            field=text("users.system_users"),
            value=", ".join(user.system_users),
        )

    def _reset(self, user: User) -> None:
        text = self._text
        ask(
            text,
            text("users.reset"),
            text("users.reset_explained", name=user.name),
            lambda password: self._change(user, password=password),
            field=text("users.new"),
            kind="new-password",
        )


def role_choice(text: Text, role: str = "operator") -> Choice:
    """Add a choice among the roles."""
    roles: dict[str, str] = {name: text.core(name) for name in ROLES}
    return Choice(text("users.role"), roles, role)


def _empty(*fields: Field) -> None:
    for field in fields:
        field.set("")
