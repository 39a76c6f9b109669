"""Buttons, fields and choices: 36 px high (48 px for touch), with labels and errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from torquebench.panel.components.elements import box, icon, on_press, words
from torquebench.panel.text import Text

CHOSEN = "(event) => emit(event.target.value)"
TYPED = "(event) => { element.props.value = event.target.value; emit(event.target.value); }"
"""Stores typed text in the page's model, too, so that an update of the page keeps it.
"""


def typed_number(said: str) -> float:
    """Parse a typed number with a decimal point or comma.

    Raises
    ------
    ValueError
        The text isn't a number.

    Examples
    --------
    >>> typed_number(" 2,5 ")
    2.5
    """
    return float(said.strip().replace(",", "."))


def button(
    label: str,
    on_click: Callable[[], Any],
    kind: str = "",
    *,
    picture: str = "",
    disabled: bool = False,
    **attributes: Any,
) -> Any:
    """Make a button; `kind` is "primary", "danger", "quiet", "small" or several of them."""
    made = box("button", f"control {kind}".strip(), type="button", disabled=disabled, **attributes)
    with made:
        if picture:
            icon(picture)
        words("span", label)
    on_press(made, on_click)
    return made


def file_entry(label: str, endings: str, script: str, on_file: Callable[[Any], Any]) -> None:
    """Add an input for a file; `script` reads the file in the browser and emits its content."""
    name = words("label", label)
    entry = box("input", "control", type="file", accept=endings)
    name.props["for"] = entry.html_id
    entry.on("change", lambda event: on_file(event.args), js_handler=script)


def link_button(label: str, target: str) -> None:
    """Add a link that looks like a button."""
    with box("a", "control", href=target):
        words("span", label)


def set_disabled(control: Any, disabled: bool) -> None:
    """Disable or enable a control."""
    if disabled != bool(control.props.get("disabled")):
        if disabled:
            control.props["disabled"] = True
        else:
            control.props.pop("disabled", None)
        control.update()


class Field:
    """A labelled input; its value is kept on the server.

    Parameters
    ----------
    label : str
    value : str
    kind : str
        Type of the HTML input: "text", "password", "new-password", "number", "search", "date".
    unit, hint : str
        Texts after and below the input.
    options : mapping of str to str, optional
        Text of each value; makes a drop-down list instead of an input.
    lines : bool
        Whether the input has several lines.
    on_change : callable, optional
        Called with every new value.
    on_enter : callable, optional
        Called when Enter is pressed.
    attributes
        Attributes of the HTML element, such as `autocomplete`.
    """

    def __init__(
        self,
        label: str,
        value: str = "",
        *,
        kind: str = "text",
        unit: str = "",
        hint: str = "",
        options: Mapping[str, str] | None = None,
        lines: bool = False,
        disabled: bool = False,
        on_change: Callable[[str], Any] | None = None,
        on_enter: Callable[[], Any] | None = None,
        **attributes: Any,
    ) -> None:
        self.value = value
        self._on_change = on_change
        if kind.endswith("password"):
            attributes["autocomplete"] = kind if kind == "new-password" else "current-password"
        with box("div", "field") as self.frame:
            name = words("label", label)
            with box("div", "with-unit"):
                self.control = self._make(kind, options, lines, disabled, attributes)
                if unit:
                    words("span", unit)
            if hint:
                words("div", hint, "hint", id=f"hint-{self.control.id}")
                self.control.props["aria-describedby"] = f"hint-{self.control.id}"
            self._wrong = words("div", "", "wrong", role="alert")
        name.props["for"] = self.control.html_id
        if on_enter is not None:
            self.control.on("keydown.enter", lambda: on_enter(), [])

    def _make(
        self,
        kind: str,
        options: Mapping[str, str] | None,
        lines: bool,
        disabled: bool,
        attributes: Mapping[str, Any],
    ) -> Any:
        if options is not None:
            control = box("select", "control", disabled=disabled, **attributes)
            with control:
                for value, text in options.items():
                    words("option", text, value=value, selected=value == self.value)
            control.on("change", self._changed, js_handler=CHOSEN)
            return control
        tag = "textarea" if lines else "input"
        control = box(tag, "control", disabled=disabled, value=self.value, **attributes)
        if not lines:
            control.props["type"] = kind.removeprefix("new-")
        control.on("input", self._changed, js_handler=TYPED)
        return control

    def _changed(self, event: Any) -> Any:
        self.value = str(event.args)
        if self.control.tag != "select" or "value" in self.control.props:
            with self.control.props.suspend_updates():
                self.control.props["value"] = self.value
        if self._on_change is not None:
            return self._on_change(self.value)
        return None

    def set(self, value: str) -> None:
        """Replace the value."""
        self.value = value
        self.control.props["value"] = value

    def wrong(self, text: str) -> None:
        """Show an error of the value; an empty text removes it."""
        self._wrong.set_text(text)
        if text:
            self.control.props["aria-invalid"] = "true"
        else:
            self.control.props.pop("aria-invalid", None)
        self.control.update()


class NumberField(Field):
    """A labelled input of one number.

    Parameters
    ----------
    said : str
        Error to show if the value isn't a number.
    """

    def __init__(self, label: str, value: str, said: str, *, unit: str) -> None:
        super().__init__(label, value, unit=unit, inputmode="decimal")
        self._said = said

    def number(self) -> float | None:
        """Return the number, or show the error at the field and return None."""
        try:
            number = typed_number(self.value)
        except ValueError:
            self.wrong(self._said)
            return None
        self.wrong("")
        return number


def tolerance_field(text: Text) -> NumberField:
    """Add an input for a tolerance in % of full scale."""
    said = text("A number in % of full scale, such as 0.1.")
    return NumberField(text("Tolerance"), "0.1", said, unit="% FS")


class Choice:
    """A choice among a few visible options.

    Parameters
    ----------
    legend : str
    options : mapping of str to str or (str, str)
        Text of each value, or text and remark.
    value : str
    several : bool
        Whether several options may be selected; `values` contains them.
    on_change : callable, optional
        Called without arguments after a change.
    """

    def __init__(
        self,
        legend: str,
        options: Mapping[str, str] | Mapping[str, tuple[str, str]],
        value: str | tuple[str, ...] = "",
        *,
        several: bool = False,
        on_change: Callable[[], Any] | None = None,
    ) -> None:
        self.values = set(value) if isinstance(value, tuple) else {value} - {""}
        self._several = several
        self._on_change = on_change
        with box("fieldset", "field") as self.frame:
            words("legend", legend, "label")
            with box("div", "choices"):
                for name, said in options.items():
                    self._option(name, said)

    @property
    def value(self) -> str:
        """The selected value; empty without one."""
        return next(iter(self.values), "")

    def _option(self, name: str, said: str | tuple[str, str]) -> None:
        title, remark = (said, "") if isinstance(said, str) else said
        with box("label", "choice"):
            control = box(
                "input",
                type="checkbox" if self._several else "radio",
                name=f"choice-{self.frame.id}",
                value=name,
                checked=name in self.values,
            )
            with box("span"):
                words("div", title)
                if remark:
                    words("div", remark, "small")
        control.on(
            "change",
            lambda event: self._changed(name, bool(event.args)),
            js_handler="(event) => emit(event.target.checked)",
        )

    def _changed(self, name: str, chosen: bool) -> None:
        if not self._several:
            self.values = {name}
        elif chosen:
            self.values.add(name)
        else:
            self.values.discard(name)
        if self._on_change is not None:
            self._on_change()
