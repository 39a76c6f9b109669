"""The wizard's step of verification: fresh points in ten groups against the best standard."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torquebench.chain import not_in_u
from torquebench.panel.components.charts import Chart, Line, error_chart, limit_lines
from torquebench.panel.components.controls import Field, button, tolerance_field
from torquebench.panel.components.elements import box, headings, note, panel, table, words
from torquebench.panel.pages.calibrate.page import CalibratePage, StepView
from torquebench.panel.pages.mounting_form import MountingForm
from torquebench.reports.errors_table import number

__all__ = ["VerifyStep"]


class VerifyStep(StepView):
    """Start a verification, watch it, see its results."""

    def __init__(self, page: CalibratePage) -> None:
        super().__init__(page)
        self._count = -1
        self._growing: Chart | None = None

    def build(self) -> None:
        """Make the step's elements."""
        verify = self._page.workflow.verify
        if verify is None or (verify.result is None and not verify.open):
            self._beginning()
        elif verify.result is None:
            with panel(self._text("verify.growing")):
                self._growing = error_chart(self._text, "measure.errors_label")
        else:
            self._found(verify.result.details)

    def refresh(self) -> None:
        """Draw the points measured so far."""
        verify = self._page.workflow.verify
        if self._growing is None or verify is None or verify.points == self._count:
            return
        self._count = verify.points
        recorded = self._page.visitor.service.jobs.points(verify.job_id)
        points = [point.values for point in recorded if "error_nm" in point.values]
        x = [point["standard_nm"] for point in points]
        y = [point["error_nm"] for point in points]
        self._growing.show([Line(self._text("live.line_raw"), x, y, "--series-raw", points=True)])

    def _beginning(self) -> None:
        text = self._text
        with panel(text("verify.title")), box("div", "stack"):
            words("p", text("verify.explained"))
            groups = {"2": "2", "5": "5", "10": "10"}
            self._groups = Field(text("verify.groups"), "10", options=groups)
            self._tolerance = tolerance_field(text)
            self._mounting = MountingForm(self._page.visitor)
            button(text("verify.start"), self._begin, "primary", picture="play_arrow")

    def _begin(self) -> None:
        tolerance = self._tolerance.number()
        if tolerance is None:
            return
        request: dict[str, Any] = {
            "calibration_id": self._page.workflow.calibration_id,
            "groups": int(self._groups.value),
            "tolerance_percent_fs": tolerance,
            **self._mounting.request(),
        }
        self._page.start("verify", request)

    def _found(self, details: Mapping[str, Any]) -> None:
        text, models = self._text, details["models"]
        names = list(models)
        rows = []
        for name in names:
            model = models[name]
            single, averaged = model["result"]["against_standard"], model["result"]["averaged"]
            rows.append(
                (
                    text.core(model["title"]),
                    number(single["worst_nm"]),
                    number(single["worst_percent_fs"]),
                    number(averaged["worst_nm"]) if averaged else "—",
                    text.verdict(model["verdict"]),
                )
            )
        columns = headings(
            text,
            "models",
            "model worst worst_percent averaged verdict",
            "worst worst_percent averaged",
        )
        with panel(text("verify.found")), box("div", "stack"):
            table(text("verify.found"), columns, rows, best=names.index(details["best"]))
            if lacking := not_in_u(models[details["best"]]["not_in_u"]):
                note(text.core(lacking), "warn")
        limit = details["tolerance_percent_fs"] / 100.0 * details["range_nm"]
        with box("div", "columns"):
            with panel(text("verify.by_group")):
                self._by_group(self._page.workflow.verified)
            with panel(text("verify.by_torque")):
                lines = [
                    Line(text.core(model["title"]), details["standard_nm"],
                         model["error_nm"], self._colour(model), points=True)
                    for model in self._page.workflow.verified.values()
                ]  # fmt: skip
                ends = min(details["standard_nm"]), max(details["standard_nm"])
                lines.append(limit_lines(text("verify.tolerance"), *ends, -limit, limit))
                error_chart(text, "models.residuals_label", lines)

    def _colour(self, model: Mapping[str, Any]) -> str:
        return self._page.workflow.colours[int(model["model_id"])]

    def _by_group(self, models: Mapping[str, Any]) -> None:
        text = self._text
        lines = []
        count = 0
        for model in models.values():
            worst = [group["worst_nm"] for group in model["result"]["groups"]]
            count = max(count, len(worst))
            lines.append(Line(text.core(model["title"]), [], worst, self._colour(model)))
        names = [str(place) for place in range(1, count + 1)]
        Chart(
            text("verify.by_group_label"), text("verify.group"), text("verify.worst_axis"), lines,
            names=names,
        )  # fmt: skip
