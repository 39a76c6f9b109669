"""The wizard's step of models: curves before and after, the compared table, the recommended one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from torquebench.panel.components.charts import COLOURS, Chart, Line
from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import box, note, panel, table, words
from torquebench.panel.pages.calibrate.another_fit import AnotherFit, titled, training_chart
from torquebench.reports.errors_table import number

if TYPE_CHECKING:
    from torquebench.panel.pages.calibrate.page import CalibratePage

__all__ = ["ModelsStep"]


class ModelsStep:
    """Fitted models beside the raw reading, and all kinds compared by cross-validation."""

    def __init__(self, page: CalibratePage) -> None:
        self._page, self._text = page, page.text

    def build(self) -> None:
        """Make the step's elements."""
        text, workflow = self._text, self._page.workflow
        assert workflow.calibrate is not None
        assert workflow.calibrate.result is not None
        details = workflow.calibrate.result.details
        with panel(text("models.before_after")):
            words("p", text.core(workflow.calibrate.result.headline))
            Chart(
                text("models.curves_label"),
                text("measure.standard_axis"),
                text("measure.error_axis"),
                self._curves(details),
                tall=True,
            )
        with panel(text("models.compared")), box("div", "stack"):
            self._comparison()
        training_chart(text, workflow.models)
        if self._page.visitor.has_role("metrologist"):
            AnotherFit(self._page).build()

    def refresh(self) -> None:
        """Nothing grows here: the job's panel says how far it is."""

    def _curves(self, details: Mapping[str, Any]) -> list[Line]:
        points = details["points"]
        standard = points["standard_nm"]
        order = sorted(range(len(standard)), key=standard.__getitem__)
        x = [standard[place] for place in order]
        lines = [
            Line(
                self._text("live.line_raw"),
                x,
                [points["reading_nm"][place] - standard[place] for place in order],
                "--series-raw",
                points=True,
            )
        ]
        for colour, model in zip(COLOURS, self._page.workflow.models.values(), strict=False):
            torque = model["torque_nm"]
            y = [torque[place] - standard[place] for place in order]
            lines.append(Line(titled(self._text, model), x, y, colour, points=True, symbol="rect"))
        return lines

    def _comparison(self) -> None:
        text, workflow = self._text, self._page.workflow
        compare = workflow.compare
        if compare is None or (compare.result is None and not compare.open):
            words("p", text("models.compare_explained"), "muted")
            button(text("models.compare"), self._compare, "primary", picture="leaderboard")
            return
        if compare.result is None:
            return
        found = compare.result.details
        note(text.core(found["sentence"]), "good")
        scores = sorted(found["scores"], key=lambda score: score["worst_nm"])
        rows = [
            (
                text.core(score["title"]),
                number(score["worst_nm"]),
                number(score["worst_percent_fs"]),
                number(score["rms_nm"]),
                f"{score['effective_parameters']:.1f}",
                text("models.fitted") if score["name"] in workflow.models else "",
            )
            for score in scores
        ]
        headings = (("model", False), ("worst", True), ("worst_percent", True), ("rms", True),
                    ("parameters", True), ("state", False))  # fmt: skip
        columns = [(text(f"models.{key}"), numbers) for key, numbers in headings]
        best = next(
            (place for place, score in enumerate(scores) if score["name"] == found["best"]),
            None,
        )
        table(text("models.compared"), columns, rows, best=best)
        words("p", text("models.cross_validated"), "small muted")
        if found["best"] not in workflow.models and self._page.visitor.has_role("metrologist"):
            button(text("models.fit"), self._fit, "primary", picture="add_chart")

    def _compare(self) -> None:
        self._page.start("compare-models", {"calibration_id": self._page.workflow.calibration_id})

    def _fit(self) -> None:
        workflow = self._page.workflow
        request = {"calibration_id": workflow.calibration_id, "model": workflow.best_compared}
        self._page.start("fit", request)
