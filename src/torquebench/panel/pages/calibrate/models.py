"""The wizard's step of models: curves before and after, the comparison, the recommendation."""

from __future__ import annotations

from torquebench.panel.components.charts import Line, error_chart
from torquebench.panel.components.controls import Choice, button
from torquebench.panel.components.elements import box, headings, note, panel, table, words
from torquebench.panel.pages.calibrate.another_fit import AnotherFit, titled, training_chart
from torquebench.panel.pages.calibrate.page import StepView
from torquebench.reports.errors_table import number

__all__ = ["ModelsStep"]


class ModelsStep(StepView):
    """Fitted models and the raw reading, and all kinds compared by cross-validation."""

    def build(self) -> None:
        """Make the step's elements."""
        text, workflow = self._text, self._page.workflow
        assert workflow.calibrate is not None
        assert workflow.calibrate.result is not None
        self._points = workflow.calibrate.result.details["points"]
        with panel(text("models.before_after")), box("div", "stack"):
            words("p", text.core(workflow.calibrate.result.headline))
            self._side_by_side()
            models = workflow.models
            titles = {name: titled(text, model) for name, model in models.items()}
            self._shown = Choice(
                text("models.shown"), titles, tuple(models), several=True, on_change=self._draw
            )
            with box("div", "columns"):
                with box("div"):
                    words("h3", text("models.curves"))
                    self._curves = error_chart(text, "models.curves_label", tall=True)
                with box("div"):
                    words("h3", text("models.residuals"))
                    self._residuals = error_chart(text, "models.residuals_label", tall=True)
            self._draw()
        with panel(text("models.compared")), box("div", "stack"):
            self._comparison()
        training_chart(text, workflow.models, workflow.colours)
        if self._page.visitor.has_role("metrologist"):
            AnotherFit(self._page).build()

    def _side_by_side(self) -> None:
        text = self._text
        rows = []
        for model in self._page.workflow.models.values():
            summary = model["summary"]
            parameters = [f"{name} {value}" for name, value in model["parameters"].items()]
            rows.append(
                (
                    text.core(model["title"]),
                    text("fit.rising_only") if model["rising_only"] else text("models.all_points"),
                    number(summary["worst_nm"]),
                    number(summary["worst_percent_fs"]),
                    number(summary["rms_nm"]),
                    ", ".join(parameters) or text("models.usual"),
                )
            )
        keys = "model fitted_to worst worst_percent rms settings"
        columns = headings(text, "models", keys, "worst worst_percent rms")
        table(text("models.before_after"), columns, rows)

    def _draw(self) -> None:
        """Draw the chosen models: their corrections and their residual errors."""
        workflow, points = self._page.workflow, self._points
        standard, reading = points["standard_nm"], points["reading_nm"]
        raw = [shown - true for shown, true in zip(reading, standard, strict=True)]
        curves = [Line(self._text("live.line_raw"), standard, raw, "--series-raw", points=True)]
        residuals = []
        for name, model in workflow.models.items():
            if name not in self._shown.values:
                continue
            torque, colour = model["torque_nm"], workflow.colours[int(model["model_id"])]
            title = titled(self._text, model)
            taken = [shown - left for shown, left in zip(reading, torque, strict=True)]
            left = [each - true for each, true in zip(torque, standard, strict=True)]
            curves.append(Line(title, standard, taken, colour))
            residuals.append(Line(title, standard, left, colour, points=True))
        self._curves.show(curves)
        self._residuals.show(residuals)

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
        keys = "model worst worst_percent rms parameters state"
        columns = headings(text, "models", keys, "worst worst_percent rms parameters")
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
