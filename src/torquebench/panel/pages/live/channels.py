"""The dialogs of the live page that choose channels and scales, and compute channels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol

from pydantic import ValidationError

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.panel.components.controls import Choice, Field, button, typed_number
from torquebench.panel.components.dialogs import foot, sheet
from torquebench.panel.components.elements import box, headings, refilled, table, words
from torquebench.panel.pages.records.column_titles import column_title
from torquebench.panel.service import (
    FORMULA_NAMES,
    RESULT_UNITS,
    BandLayout,
    ComputedChannel,
    LiveLayout,
    LoopLayout,
    Scale,
)
from torquebench.panel.text import Text, Texts
from torquebench.units import unit_of_name
from torquebench.validation import words_of

CHARTS = 3
SCALES: Texts = {
    "automatic": "Automatic",
    "range": "The bench's range",
    "fixed": "Fixed limits",
}
EXAMPLE_TITLES: Texts = {
    "efficiency": "Efficiency",
    "power": "Output power",
    "ratio": "Speed ratio",
    "loss": "Power loss",
}
EXAMPLES: Mapping[str, tuple[str, str]] = {
    "efficiency": (
        "output_torque * output_speed / (input_torque * input_speed)",
        "%",
    ),
    "power": ("output_torque * output_speed", "W"),
    "ratio": ("input_speed / output_speed", "1"),
    "loss": ("input_torque * input_speed - output_torque * output_speed", "W"),
}


class Chart(Protocol):
    """The chart whose signals are chosen."""

    text: Text
    layout: LiveLayout

    def keep(self, layout: LiveLayout) -> None:
        """Store a layout and show it."""

    def title(self, name: str) -> str:
        """Return a signal's title."""


def open_channels(chart: Chart) -> None:
    """Ask for the signals of the present view."""
    text, layout = chart.text, chart.layout
    forms = {"time": _time_form, "xy": _loop_form, "digits": _digits_form}
    with sheet(text("Channels and scales")) as dialog:
        read = forms[layout.view](chart)
        wrong = words("div", "", "bad-text", role="alert")

        def apply() -> None:
            changed = _attempt(text, wrong, lambda: _changed(layout, read()))
            if changed is not None:
                chart.keep(changed)
                dialog.close()

        def usual() -> None:
            chart.keep(LiveLayout(view=layout.view, span=layout.span, computed=layout.computed))
            dialog.close()

        with box("div", "line end"):
            button(text("Restore the default"), usual, "quiet")
            button(text("Close"), dialog.close, "quiet")
            button(text("Apply"), apply, "primary")


def _changed(layout: LiveLayout, part: Mapping[str, Any]) -> LiveLayout:
    return LiveLayout.model_validate(layout.model_dump() | dict(part))


def _attempt(text: Text, wrong: Any, make: Callable[[], Any]) -> Any:
    """Return what is made; None after showing why it can't be."""
    try:
        return make()
    except ValidationError as error:
        wrong.set_text(text(words_of(error.errors()[0])))
    except InputError as error:
        wrong.set_text(text.refusal_line(error))
    return None


def _titles(chart: Chart) -> dict[str, str]:
    """Return title and unit of every signal."""
    return {
        name: ", ".join(part for part in (chart.title(name), signal.unit) if part not in ("", "1"))
        for name, signal in chart.layout.signals.items()
    }


def _time_form(chart: Chart) -> Callable[[], Mapping[str, Any]]:
    text, layout = chart.text, chart.layout
    bands = (*layout.bands, *(BandLayout() for _ in range(CHARTS)))[:CHARTS]
    places = {str(place): text("Chart {number}", number=place) for place in (1, 2, 3)}
    chosen = {name: str(k) for k, band in enumerate(bands, 1) for name in band.signals}
    with box("div", "columns narrow"):
        fields = {
            name: Field(
                chart.title(name),
                chosen.get(name, ""),
                unit=signal.unit,
                options={"": text("Not shown")} | places,
            )
            for name, signal in layout.signals.items()
        }
    scales = []
    for k, band in enumerate(bands, 1):
        words("h3", text("Scale of chart {number}", number=k))
        fixed = band.scale.kind == "fixed"
        with box("div", "columns narrow"):
            kinds = {key: text(title) for key, title in SCALES.items()}
            kind = Field(text("Left scale"), band.scale.kind, options=kinds)
            low = Field(text("Lower limit"), f"{band.scale.low:g}" if fixed else "")
            high = Field(text("Upper limit"), f"{band.scale.high:g}" if fixed else "")
        scales.append((kind, low, high))
    return lambda: {
        "bands": [
            BandLayout(
                signals=tuple(name for name, field in fields.items() if field.value == str(k)),
                scale=_scale(kind.value, low.value, high.value),
            )
            for k, (kind, low, high) in enumerate(scales, 1)
        ]
    }


def _loop_form(chart: Chart) -> Callable[[], Mapping[str, Any]]:
    text, xy, titles = chart.text, chart.layout.xy, _titles(chart)
    x = Field(text("Horizontal"), xy.x, options=titles)
    y = Choice(text("Vertical"), titles, xy.signals, several=True)
    return lambda: {
        "xy": LoopLayout(x=x.value, signals=tuple(name for name in titles if name in y.values))
    }


def _digits_form(chart: Chart) -> Callable[[], Mapping[str, Any]]:
    titles = _titles(chart)
    numbers = Choice(
        chart.text("Shown as large numbers"), titles, chart.layout.digits, several=True
    )
    return lambda: {"digits": tuple(name for name in titles if name in numbers.values)}


def _scale(kind: str, low: str, high: str) -> Scale:
    if kind != "fixed":
        return Scale(kind=kind)  # type: ignore[arg-type]  # one of the options
    try:
        ends = typed_number(low), typed_number(high)
    except ValueError:
        raise InputError(
            Message("ends {low!r} and {high!r}", low, high), "two numbers in the unit of the scale"
        ) from None
    return Scale(kind="fixed", low=ends[0], high=ends[1])


def open_computed(chart: Chart) -> None:
    """Show the computed channels, and ask for another one."""
    text = chart.text

    def fill(example: str) -> None:
        if example in EXAMPLES:
            title.set(text(EXAMPLE_TITLES[example]))
            formula.set(EXAMPLES[example][0])
            unit.set(EXAMPLES[example][1])

    def add() -> None:
        def make() -> LiveLayout:
            channel = ComputedChannel(title=title.value, formula=formula.value, unit=unit.value)
            return chart.layout.including(channel)

        changed = _attempt(text, wrong, make)
        if changed is not None:
            wrong.set_text("")
            chart.keep(changed)
            show()

    def remove(channel: ComputedChannel) -> None:
        chart.keep(chart.layout.without(channel))
        show()

    def show() -> None:
        with refilled(made):
            for channel in chart.layout.computed:
                with box("div", "spread"):
                    with box("div"):
                        words("b", channel.title)
                        words("span", f" = {channel.formula}, {channel.unit}")
                    button(
                        text("Remove"), partial(remove, channel), "quiet small",
                        picture="delete",
                    )  # fmt: skip

    with sheet(text("Computed channels")) as dialog:
        words(
            "p",
            text(
                "A formula computes with torques in N·m, speeds in rad/s, angles in rad "
                "and temperatures in K from 0 °C, from the mean values of each row. Its "
                "unit is checked; the value is shown in the unit that you choose."
            ),
        )
        made = box("div", "stack")
        examples = {"": text("Own formula")} | {
            key: text(title) for key, title in EXAMPLE_TITLES.items()
        }
        with box("div", "columns narrow"):
            Field(text("Example"), "", options=examples, on_change=fill)
            title = Field(text("Name"), maxlength="40", autocomplete="off")
            unit = Field(
                text("Unit of the result"), "1", options={key: key for key in RESULT_UNITS}
            )
        formula = Field(text("Formula"), maxlength="200", autocomplete="off", spellcheck="false")
        wrong = words("div", "", "bad-text", role="alert")
        with box("details"):
            words(
                "summary",
                text(
                    "Names that a formula may use (also ratio, Nm, W, kW, rpm, deg, rad, s, K, "
                    "abs, sqrt, min, max)"
                ),
            )
            with box("div", "stack"):
                table(
                    text(
                        "Names that a formula may use (also ratio, Nm, W, kW, rpm, deg, rad, s, K, "
                        "abs, sqrt, min, max)"
                    ),
                    headings(text, "Name", "Signal", "Unit"),
                    [
                        (name, column_title(text, signal), unit_of_name(signal))
                        for name, signal in FORMULA_NAMES.items()
                    ],
                )
        with foot(text, dialog):
            button(text("Add"), add, "primary")
    show()
