"""The view of people: accounts and roles for administrators, the own password for everyone."""

from __future__ import annotations

from datetime import date
from typing import Any

from torquebench.operations import ROLES
from torquebench.panel.components.controls import Choice, Field, button
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import box, headings, panel, refilled, table
from torquebench.panel.pages.view import View
from torquebench.panel.service import User
from torquebench.panel.text import Text


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
        with panel(text("Your password")), box("div", "stack"):
            with box("div", "columns"):
                old = Field(text("Password now"), kind="password")
                new = Field(
                    text("New password"),
                    kind="new-password",
                    hint=text("At least 10 characters; a sentence is best."),
                )

            def change() -> None:
                people = self._visitor.service.people
                self._visitor.act(
                    people.change_password, old.value, new.value,
                    success=text("The password is changed; your other sessions have ended."),
                    then=lambda: _empty(old, new),
                )  # fmt: skip

            with box("div", "line"):
                button(text("Change the password"), change, "primary", picture="key")

    def _show(self) -> None:
        text = self._text
        users = self._visitor.service.people.users(self._visitor.looker)
        rows = [
            (
                user.name,
                text(user.role),
                text("active" if user.active else "not active"),
                date.fromisoformat(user.created[:10]),
                ", ".join(user.system_users),
                user.password_set[11:],
                date.fromisoformat(user.password_set[:10]) if user.password_set else "",
            )
            for user in users
        ]
        with refilled(self._list), panel(text("Accounts")):
            table(
                text("Accounts"),
                headings(
                    text,
                    "User name",
                    "Role",
                    "State",
                    "Since",
                    "Computer users",
                    "Password set by",
                    "Password set",
                ),
                rows,
                on_row=lambda place: self._edit(users[place]),
                open_label=text("Edit"),
            )

    def _add(self) -> None:
        text, visitor = self._text, self._visitor
        with panel(text("Add a person")), box("div", "stack"):
            with box("div", "columns"):
                name = Field(text("User name"), autocomplete="off", maxlength="64")
                password = Field(
                    text("First password"),
                    kind="new-password",
                    hint=text("At least 10 characters; a sentence is best."),
                )
            role = role_choice(text)

            def added() -> None:
                _empty(name, password)
                self._show()

            def add() -> None:
                visitor.act(
                    visitor.service.people.add_user, name.value, role.value, password.value,
                    success=text("{name} can sign in.", name=name.value), then=added,
                )  # fmt: skip

            with box("div", "line"):
                button(text("Add a person"), add, "primary", picture="person_add")

    def _edit(self, user: User) -> None:
        text = self._text
        with refilled(self._edited), panel(user.name), box("div", "stack"):
            role = role_choice(text, user.role)
            with box("div", "line"):
                button(
                    text("Save the role"), lambda: self._change(user, role=role.value), "primary"
                )
                button(
                    text("Deactivate" if user.active else "Activate"),
                    lambda: self._change(user, active=not user.active),
                )
                button(text("Set a new password"), lambda: self._reset(user))
                button(text("End the waiting time"), lambda: self._change(user, unlock=True))
                button(text("Link users of the computer"), lambda: self._link(user))
                button(text("Close"), self._edited.clear, "quiet")

    def _change(self, user: User, **values: Any) -> bool:
        people, said = (
            self._visitor.service.people,
            self._text("{name} is changed.", name=user.name),
        )
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
            text("Link users of the computer"),
            text(
                "Users of the operating system that are {name}, separated by commas: user "
                "or user@host. What they measure by commands counts as measured by {name}.",
                name=user.name,
            ),
            lambda users: self._change(user, linked=users.split(",")),
            field=text("Computer users"),
            value=", ".join(user.system_users),
        )

    def _reset(self, user: User) -> None:
        text = self._text
        ask(
            text,
            text("Set a new password"),
            text("{name} signs in with this password from now on.", name=user.name),
            lambda password: self._change(user, password=password),
            field=text("New password"),
            kind="new-password",
        )


def role_choice(text: Text, role: str = "operator") -> Choice:
    """Add a choice among the roles."""
    roles: dict[str, str] = {name: text(name) for name in ROLES}
    return Choice(text("Role"), roles, role)


def _empty(*fields: Field) -> None:
    for field in fields:
        field.set("")
