"""The page of one calibration: its models, their verification, the signature, the certificate.

It is read from the registry, so its content stays available at this address.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import Any, Literal, get_args

from nicegui import background_tasks, ui

from torquebench.errors import TorquebenchError
from torquebench.operations import find_operation
from torquebench.operations.calibrating import (
    CalibratedModule,
    CalibrationResult,
    additional_torque,
    errors_of_models,
    residuals,
    training,
)
from torquebench.operations.checking import VerifiedModule
from torquebench.operations.models import ComparedModels
from torquebench.panel.components.controls import (
    Choice,
    Field,
    button,
    set_disabled,
    tolerance_field,
)
from torquebench.panel.components.elements import (
    box,
    empty,
    in_thread,
    moment,
    note,
    pairs,
    panel,
    refilled,
    tag,
    to_the_top,
    words,
)
from torquebench.panel.components.page_view import remarks, show_blocks, show_page
from torquebench.panel.components.verdicts import verdict_icon, verdict_kind
from torquebench.panel.pages.downloads import certificate_buttons
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.jobs.panel import JobPanel, problem_note
from torquebench.panel.pages.operations.form import OperationForm
from torquebench.panel.pages.operations.page import begin
from torquebench.panel.pages.page import page
from torquebench.panel.pages.view import part
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import CalibrationDetail, JobView
from torquebench.reports.errors_table import number as number_text

__all__ = ["calibration_page"]

Step = Literal["models", "verify", "sign", "certificate"]
STEPS: tuple[Step, ...] = get_args(Step)
JOBS: Mapping[Step, Sequence[str]] = {
    "models": ("records-compare-models", "records-fit-model", "calibrate", "resume"),
    "verify": ("verification",),
    "sign": (),
    "certificate": ("certificate",),
}
"""Operations whose jobs a step shows."""
LANGUAGES = {"en": "English", "de": "Deutsch", "zh": "中文"}


@dataclass(frozen=True)
class _Calibration:
    """A calibration's data from the records."""

    detail: CalibrationDetail
    module: CalibratedModule
    verified: VerifiedModule | None

    @property
    def signed(self) -> bool:
        """Whether a signed review has accepted it."""
        return any(
            review.accepted and review.signature is not None and review.signature.signed
            for review in self.detail.reviews
        )

    @property
    def first_step(self) -> Step:
        """The initial step of the page."""
        if self.verified is None:
            return "models"
        return "certificate" if self.signed else "sign"

    def done(self, step: Step) -> bool:
        """Whether a step was done."""
        if step == "models":
            return bool(self.module.models)
        if step == "verify":
            return self.verified is not None
        return self.signed if step == "sign" else bool(self.detail.certificates)


def made_by(job: JobView) -> list[int]:
    """Return the numbers of the calibrations that a job has made."""
    modules = job.result.modules if isinstance(job.result, CalibrationResult) else ()
    return [module.calibration_id for module in modules]


class _CalibrationPage:
    """The page of one calibration, which shows one step at a time."""

    def __init__(self, visitor: Visitor, number: int) -> None:
        self.visitor, self.text, self.number = visitor, visitor.text, number
        self.found: _Calibration | None = None
        self.compared: ComparedModels | None = None
        step = visitor.query.get("step", "")
        self.step: Step | None = next((each for each in STEPS if each == step), None)
        self.torque_unfolded = False
        self._ended = -1

    def build(self) -> None:
        """Make the page's elements."""
        with box("div", "stack"):
            self._head = box("div")
            self._steps = box("ol", "steps", aria_label=self.text("calibrate.steps"))
            self._job = JobPanel(self.visitor)
            self._content = box("div", "stack")
            with self._content:
                words("p", self.text("calibrate.reading"), "muted", role="status")

    def refresh(self) -> None:
        """Show the jobs of this calibration; read the records again when one has ended."""
        jobs = self.visitor.service.jobs
        recent = [job for job in jobs.recent() if self._concerns(job)]
        compared = next((job.result for job in recent if job.kind == JOBS["models"][0]), None)
        self.compared = compared if isinstance(compared, ComparedModels) else self.compared
        kinds = JOBS[self.step or "models"]
        job = next((each for each in recent if each.kind in kinds), None)
        self._job.refresh(job if job is not None and job.result is None else None)
        if job is not None and job.result is not None:
            self.visitor.shown_jobs.add(job.job_id)
        if jobs.ended != self._ended:
            self._ended = jobs.ended
            background_tasks.create(self._read(), name="calibration")

    def _concerns(self, job: JobView) -> bool:
        return self.number in (job.request.get("calibration"), *made_by(job))

    async def _read(self) -> None:
        """Read the records on another thread, and show them."""
        found = await self.visitor.attempt_aside(self._found)
        if self._content.is_deleted:
            return
        if found is None:
            with refilled(self._content):
                empty(self.text("frame.no_page"), "search_off")
            return
        self.found = found
        if self.step is None:
            self.step = found.first_step
        self.render()

    async def after_signing(self) -> None:
        """Go to the step of the certificate, and confirm the signature."""
        self.step = "certificate"
        await self._read()
        self.visitor.messages.good(self.text("sign.done"))

    def _found(self) -> _Calibration:
        records = self.visitor.service.records
        return _Calibration(
            records.calibration(self.number),
            records.module(self.number),
            records.verified(self.number),
        )

    def show(self, step: Step) -> None:
        """Go to a step; the browser's "back" then leads to the previous one."""
        if step != self.step:
            address = f"/calibrations/{self.number}?step="
            ui.navigate.history.replace(f"{address}{self.step}")
            ui.navigate.history.push(f"{address}{step}")
            to_the_top()
        self.step = step
        self.render()

    def render(self) -> None:
        """Show the present step."""
        found, text = self.found, self.text
        if found is None or self.step is None:
            return
        with refilled(self._head), part(text):
            self._facts(found)
        with refilled(self._steps):
            for step in STEPS:
                current = "step" if step == self.step else None
                with box("li", "done" if found.done(step) else "", aria_current=current):
                    button(text(f"calibrate.step_{step}"), partial(self.show, step), "quiet")
        views = {"models": _models, "verify": _verify, "sign": _sign, "certificate": _certificate}
        with refilled(self._content):
            with part(text):
                views[self.step](self, found)
            self._navigation(found)

    def _facts(self, found: _Calibration) -> None:
        """Show the calibration that a signature signs."""
        text, entry, module = self.text, found.detail.calibration, found.module
        side = text(f"side.{module.side}")
        facts: list[tuple[str, str | datetime]] = [
            (text("records.transducer"), entry.transducer_serial),
            (text("records.performed"), entry.performed),
            (text("records.operator"), entry.measured_by or "—"),
            (text("records.points"), str(entry.points)),
            (text("sign.run"), module.run_id),
            ("SHA-256", found.detail.signed_sha256),
        ]
        with panel(f"{side}, {module.range_nm:g} N·m", "in-two"):
            pairs(facts)

    def _navigation(self, found: _Calibration) -> None:
        assert self.step is not None
        place = STEPS.index(self.step)
        with box("div", "spread"):
            with box("div", "line"):
                if place:
                    button(self.text("calibrate.back"), lambda: self.show(STEPS[place - 1]),
                           picture="arrow_back")  # fmt: skip
                button(self.text("calibrate.again"), lambda: ui.navigate.to("/calibrate"), "quiet",
                       picture="restart_alt")  # fmt: skip
            if place + 1 < len(STEPS):
                kind = "primary" if found.done(self.step) and self.step != "sign" else ""
                button(self.text("calibrate.next"), lambda: self.show(STEPS[place + 1]), kind,
                       picture="arrow_forward")  # fmt: skip

    def start(self, name: str, request: Mapping[str, Any]) -> None:
        """Start an operation on this calibration."""
        self.visitor.start(name, {"calibration": self.number, **request})
        self.refresh()


# -- models ---------------------------------------------------------------------------------


def _models(page: _CalibrationPage, found: _Calibration) -> None:
    text, module = page.text, found.module
    with panel(text("models.before_after")), box("div", "stack"):
        show_blocks(text, [*residuals(module), errors_of_models(module)])
        with box("details", open_=page.torque_unfolded) as fold:
            # The end of a job rebuilds the page; parts that the reader has opened stay open.
            fold.on(
                "toggle",
                lambda event: setattr(page, "torque_unfolded", bool(event.args)),
                js_handler="(event) => emit(event.target.open)",
            )
            words("summary", text.core("Additional torque"))
            with box("div", "stack"):
                show_blocks(text, [additional_torque(module), *training(module)])
    with panel(text("models.compared")), box("div", "stack"):
        _comparison(page, found)
    if page.visitor.has_role("metrologist"):
        _another_fit(page)


def _comparison(page: _CalibrationPage, found: _Calibration) -> None:
    text, compared = page.text, page.compared
    if compared is None:
        words("p", text("models.compare_explained"), "muted")
        button(
            text("models.compare"), lambda: page.start("records compare-models", {}), "primary",
            picture="leaderboard",
        )  # fmt: skip
        return
    note(text.core(compared.headline), "good")
    show_page_sections(page, compared)
    names = {model.name for model in found.module.models}
    if compared.best not in names and page.visitor.has_role("metrologist"):
        button(
            text("models.fit"), lambda: page.start("records fit-model", {"model": compared.best}),
            "primary", picture="add_chart",
        )  # fmt: skip


def show_page_sections(page: _CalibrationPage, result: ComparedModels) -> None:
    """Show the tables of a result within another panel."""
    for section in result.page().sections:
        show_blocks(page.text, section.blocks)


def _another_fit(page: _CalibrationPage) -> None:
    """Add the form for fitting another model."""
    operation, text = find_operation("records fit-model"), page.text
    with panel(), box("details"):
        words("summary", text.core(operation.summary))
        with box("div", "stack"):
            form = OperationForm(
                page.visitor, operation, {"calibration": page.number}, ("calibration",)
            )

            async def fit() -> None:
                await begin(page.visitor, operation, form)
                page.refresh()

            with box("div", "line"):
                button(text("fit.button"), fit, picture="add_chart")


# -- verify ---------------------------------------------------------------------------------


def _verify(page: _CalibrationPage, found: _Calibration) -> None:
    text, verified = page.text, found.verified
    if verified is not None:
        note(
            text.core(verified.headline),
            verdict_kind(verified.verdict),
            title=text.verdict(verified.verdict),
        )
        remarks(text, verified.remarks)
        show_page(text, verified.page())
    operation = find_operation("verification")
    given = {"side": found.module.side, "calibration": page.number, "points": 20}
    title = text("verify.title") if verified is None else text.core("Verify again")
    with panel(title), box("div", "stack"):
        words("p", text("verify.explained"))
        form = OperationForm(page.visitor, operation, given, ("side", "calibration", "models"))

        async def start() -> None:
            await begin(page.visitor, operation, form)
            page.refresh()

        button(text("verify.start"), start, "primary" if verified is None else "",
               picture="play_arrow")  # fmt: skip


# -- sign -----------------------------------------------------------------------------------


def _sign(page: _CalibrationPage, found: _Calibration) -> None:
    text, visitor, module = page.text, page.visitor, found.module
    entry = found.detail.calibration
    with panel(text("sign.title")), box("div", "stack"):
        words("p", text("sign.explained"))
        for review in found.detail.reviews:
            kind = "good" if review.accepted else "bad"
            with note(review.remark or text.core("reviewed"), kind, title=review.checked_by):
                moment(review.checked)
        if found.verified is None:
            note(text("sign.unverified"), "warn")
        else:
            _verdicts(page, found.verified)
        if not visitor.has_role("metrologist"):
            visitor.not_allowed()
            return
        if entry.measured_by == visitor.looker.label:
            note(text("sign.own"), "warn")
            return
        if not module.models:
            note(text("sign.no_model"), "warn")
            return
        _signature(page, found)


def _verdicts(page: _CalibrationPage, verified: VerifiedModule) -> None:
    """List the verdict of each model at the fresh points."""
    text = page.text
    words("h3", text("sign.verdicts", tolerance=f"{verified.tolerance_percent_fs:g}"))
    with box("ul", "stack"):
        for model in verified.models[1:]:
            worst = model.errors.against_standard
            with box("li", "line"):
                tag(text.verdict(model.verdict), verdict_kind(model.verdict),
                    verdict_icon(model.verdict))  # fmt: skip
                words("span", text.core(model.name))
                said = text(
                    "sign.worst",
                    worst=number_text(worst.worst_nm),
                    percent=number_text(worst.worst_percent_fs),
                )
                words("span", said, "muted number")


def _signature(page: _CalibrationPage, found: _Calibration) -> None:
    text, visitor, module = page.text, page.visitor, found.module
    best = None if found.verified is None else found.verified.best.model_id
    first = module.models[0]
    options = {
        str(model.model_id): (
            text.core(model.title),
            text("sign.recommended") if model is first
            else text("sign.best") if model.model_id == best
            else text("sign.model", number=model.model_id),
        )
        for model in module.models
    }  # fmt: skip
    chosen = Choice(text("sign.use"), options, str(first.model_id))
    contradictions = {each.found: each for model in module.models for each in model.contradictions}
    for each in contradictions.values():
        found_words, allowed, cause = map(text.core, (each.found, each.allowed, each.cause))
        note(f"{found_words} ({allowed}). {cause}", "warn", title=text("sign.contradicts"))
    _preview_button(page, lambda: {"languages": (text.language,), "model_id": int(chosen.value)})
    remark = Field(text("sign.despite" if contradictions else "sign.remark"), maxlength="500")

    async def sign() -> None:
        number = int(chosen.value)
        despite = bool(module.model(number).contradictions)
        remark.wrong(text("sign.despite_missing") if despite and not remark.value.strip() else "")
        if despite and not remark.value.strip():
            return
        given, said = password.value, remark.value
        service, actor = visitor.service, visitor.actor

        def put_into_use() -> None:
            service.jobs.command(actor)  # check the lease before anything is signed
            review = {
                "record": f"calibration-{page.number}",
                "remark": said,
                "sha256": found.detail.signed_sha256,
            }
            service.perform(actor, "records review", review, password=given)
            use = {
                "model": number,
                "reason": said or text("sign.reason"),
                "despite_contradictions": despite,
            }
            service.perform(actor, "records use", use, password=given)

        with signing(page, password):
            await in_thread(put_into_use)
            await page.after_signing()

    password = Field(text("sign.password"), kind="password", on_enter=sign)
    with box("div", "line"):
        button(text("sign.button"), sign, "primary", picture="draw")


@contextmanager
def signing(page: _CalibrationPage, password: Field) -> Iterator[None]:
    """Perform a signed action; show a refusal of the password at its field."""
    password.wrong("")
    set_disabled(password.control, True)  # Enter signs once
    try:
        yield
    except TorquebenchError as error:
        password.wrong(page.text.refusal_line(error))
        password.set("")
    finally:
        if not password.control.is_deleted:  # the page may show another step by now
            set_disabled(password.control, False)


# -- certificate ----------------------------------------------------------------------------


def _certificate(page: _CalibrationPage, found: _Calibration) -> None:
    text, visitor = page.text, page.visitor
    with panel(text("certificate.title")), box("div", "stack"):
        for entry in found.detail.certificates:
            words("p", text("certificate.issued", number=entry.number))
            certificate_buttons(visitor, entry.number, tuple(entry.files))
        if not visitor.has_role("metrologist"):
            visitor.not_allowed()
            return
        words("p", text("certificate.explained"))
        languages = Choice(text("certificate.languages"), LANGUAGES, (text.language,), several=True)
        tolerance = tolerance_field(text)

        def request() -> dict[str, Any] | None:
            limit = tolerance.number()
            if limit is None:
                return None
            chosen = tuple(name for name in LANGUAGES if name in languages.values)
            return {"languages": chosen, "tolerance_percent_fs": limit}

        async def issue() -> None:
            asked = request()
            if asked is None:
                return
            with signing(page, password):
                await in_thread(
                    partial(
                        visitor.service.start,
                        visitor.actor,
                        "certificate",
                        {"calibration": page.number, **asked},
                        password=password.value,
                    )
                )
                page.refresh()

        password = Field(text("sign.password"), kind="password", on_enter=issue)
        with box("div", "line"):
            button(text("certificate.button"), issue, "primary", picture="workspace_premium")
        _preview_button(page, request)


def _preview_button(page: _CalibrationPage, asked: Any) -> None:
    """Add the button that shows a draft of the certificate."""
    text, service = page.text, page.visitor.service

    async def show() -> None:
        place.clear()
        options = asked()
        if options is None:
            return
        try:
            pages = await in_thread(service.certificate_preview, page.number, **options)
        except TorquebenchError as error:
            with place:
                problem_note(text, error)
            return
        with place, box("div", "certificate-pages"):
            for number, content in enumerate(pages or (), start=1):
                data = base64.b64encode(content).decode()
                label = text("certificate.page", number=number, of=len(pages or ()))
                box("img", src=f"data:image/png;base64,{data}", alt=label)

    with box("div", "line"):
        button(text("certificate.preview"), show, picture="preview")
    place = box("div", "stack")


@page("calibration", "/calibrations/{number}")
def calibration_page(visitor: Visitor) -> None:
    """Build the page of a calibration."""
    number = visitor.query["number"]
    if not number.isdecimal():
        with frame(visitor, "calibrate"):
            empty(visitor.text("frame.no_page"), "search_off")
        return
    shown = _CalibrationPage(visitor, int(number))
    title = f"{visitor.text.core('Calibration')} {number}"
    with frame(visitor, "calibrate", shown.refresh, title):
        shown.build()
