"""Fit one more model to the calibration: its kind, the network's parameters, the points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torquebench.campaign.fitting import model_title
from torquebench.compensation import CANDIDATES, NetworkModel
from torquebench.panel.components.charts import Chart, Line
from torquebench.panel.components.controls import Choice, Field, button
from torquebench.panel.components.elements import box, panel, words
from torquebench.panel.pages.calibrate.page import CalibratePage
from torquebench.panel.text import Text

__all__ = ["AnotherFit", "titled", "training_chart"]

NUMBERS = {"hidden": int, "epochs": int, "learning_rate": float, "target_error_nm": float}
FIRST = NetworkModel(training="gradient-descent")
NETWORK = FIRST.name


class AnotherFit:
    """A form below the models, for metrologists."""

    def __init__(self, page: CalibratePage) -> None:
        self._page, self._text = page, page.text

    def build(self) -> None:
        """Make the form's elements."""
        text = self._text
        with panel(text("fit.title")), box("div", "stack"):
            kinds = {name: text.core(model_title(name)) for name in reversed(CANDIDATES)}
            self._kind = Field(
                text("models.model"), NETWORK, options=kinds, on_change=lambda _: self._show()
            )
            self._network = box("div", "stack")
            with self._network:
                self._parameters()
            self._rising = Choice(
                text("fit.points"),
                {"rising": (text("fit.rising_only"), text("fit.rising_said"))},
                several=True,
            )
            with box("div", "line"):
                button(text("fit.button"), self._fit, picture="add_chart")

    def _parameters(self) -> None:
        text = self._text
        words("p", text("fit.network_said"), "small muted")
        with box("div", "columns"):
            self._mapping = Field(
                text("fit.mapping"),
                FIRST.mapping,
                options={each: text(f"fit.{each}") for each in ("residual", "direct")},
            )
            starts = ("small-uniform", "nguyen-widrow")
            self._start = Field(
                text("fit.start"),
                FIRST.start,
                options={each: text(f"fit.{each.replace('-', '_')}") for each in starts},
            )
            self._numbers = {
                name: Field(
                    text(f"fit.{name}"),
                    "" if getattr(FIRST, name) is None else f"{getattr(FIRST, name):g}",
                    kind="number",
                    unit="N·m" if name.endswith("_nm") else "",
                    hint=text("fit.target_hint") if name.endswith("_nm") else "",
                    min="0",
                    step="1" if of is int else "any",
                )
                for name, of in NUMBERS.items()
            }

    def _show(self) -> None:
        self._network.set_visibility(self._kind.value == NETWORK)

    def _fit(self) -> None:
        request: dict[str, Any] = {
            "calibration_id": self._page.workflow.calibration_id,
            "model": self._kind.value,
            "rising_only": "rising" in self._rising.values,
        }
        if self._kind.value == NETWORK:
            given = {name: field.value for name, field in self._numbers.items() if field.value}
            request["network"] = {
                "mapping": self._mapping.value,
                "start": self._start.value,
                **{name: NUMBERS[name](float(value)) for name, value in given.items()},
            }
        self._page.start("fit", request)


def titled(text: Text, model: Mapping[str, Any]) -> str:
    """Return a model's title with the parameters that it was requested."""
    said = [f"{name} {value}" for name, value in model.get("parameters", {}).items()]
    if model.get("rising_only"):
        said.append(text("fit.rising_only"))
    title = text.core(model["title"])
    return f"{title} ({', '.join(said)})" if said else title


def training_chart(
    text: Text, models: Mapping[str, Mapping[str, Any]], colours: Mapping[int, str]
) -> None:
    """Show the training curve of every network, if there is one."""
    trained = [model for model in models.values() if model.get("training_curve")]
    if not trained:
        return
    with panel(text("fit.training")):
        lines = [
            Line(
                titled(text, model),
                model["training_curve"]["epoch"],
                model["training_curve"]["rms_nm"],
                colours[int(model["model_id"])],
            )
            for model in trained
        ]
        Chart(
            text("fit.training_label"),
            text("fit.epochs"),
            text("fit.rms"),
            lines,
            logarithmic=True,
        )
        for model in trained:
            curve = model["training_curve"]
            words(
                "p",
                text(
                    "fit.trained",
                    model=titled(text, model),
                    epochs=f"{curve['epoch'][-1]:g}",
                    rms=f"{curve['rms_nm'][-1]:.3g}",
                ),
                "small muted number",
            )
