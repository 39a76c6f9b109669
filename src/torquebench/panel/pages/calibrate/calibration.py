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
from torquebench.panel.text import Texts
from torquebench.reports.errors_table import number as number_text

Step = Literal["models", "verify", "sign", "certificate"]
STEPS: tuple[Step, ...] = get_args(Step)
STEP_TITLES: Texts = {
    "models": "Models",
    "verify": "Verify",
    "sign": "Sign off",
    "certificate": "Certificate",
}
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
            with box("div", "line"):
                self._steps = box("ol", "steps", aria_label=self.text("Steps of a calibration"))
                self._next = box("div")
            self._job = JobPanel(self.visitor)
            self._content = box("div", "stack")
            with self._content:
                words("p", self.text("Reading the records …"), "muted", role="status")

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
                empty(self.text("There is no such page."), "search_off")
            return
        self.found = found
        if self.step is None:
            self.step = found.first_step
        self.render()

    async def after_signing(self) -> None:
        """Go to the step of the certificate, and confirm the signature."""
        self.step = "certificate"
        await self._read()
        self.visitor.messages.good(
            self.text("Signed. The readings are compensated by the chosen model from now on.")
        )

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
                    button(text(STEP_TITLES[step]), partial(self.show, step), "quiet")
        with refilled(self._next):
            self._next_step(found, self.step)
        views = {"models": _models, "verify": _verify, "sign": _sign, "certificate": _certificate}
        with refilled(self._content):
            with part(text):
                views[self.step](self, found)
            self._navigation(self.step)

    def _facts(self, found: _Calibration) -> None:
        """Show the calibration that a signature signs."""
        text, entry, module = self.text, found.detail.calibration, found.module
        side = text.title(module.side)
        facts: list[tuple[str, str | datetime]] = [
            (text("Transducer"), entry.transducer_serial),
            (text("Performed"), entry.performed),
            (text("By"), entry.measured_by or "—"),
            (text("Points"), str(entry.points)),
            (text("Run"), module.run_id),
            ("SHA-256", found.detail.signed_sha256),
        ]
        with panel(side + text(", ") + f"{module.range_nm:g} N·m", "in-two"):
            pairs(facts)

    def _next_step(self, found: _Calibration, step: Step) -> None:
        place = STEPS.index(step) + 1
        if place < len(STEPS):
            kind = "primary" if found.done(step) and step != "sign" else ""
            button(self.text("Next step"), lambda: self.show(STEPS[place]), kind,
                   picture="arrow_forward")  # fmt: skip

    def _navigation(self, step: Step) -> None:
        place = STEPS.index(step)
        with box("div", "line"):
            if place:
                button(self.text("Back"), lambda: self.show(STEPS[place - 1]),
                       picture="arrow_back")  # fmt: skip
            again = self.text("Begin another calibration")
            button(again, lambda: ui.navigate.to("/calibrate"), "quiet", picture="restart_alt")

    def start(self, name: str, request: Mapping[str, Any]) -> None:
        """Start an operation on this calibration."""
        self.visitor.start(name, {"calibration": self.number, **request})
        self.refresh()


# -- models ---------------------------------------------------------------------------------


def _models(page: _CalibrationPage, found: _Calibration) -> None:
    text, module = page.text, found.module
    with panel(text("Before and after")), box("div", "stack"):
        show_blocks(text, [*residuals(module), errors_of_models(module)])
        with box("details", open_=page.torque_unfolded) as fold:
            # The end of a job rebuilds the page; parts that the reader has opened stay open.
            fold.on(
                "toggle",
                lambda event: setattr(page, "torque_unfolded", bool(event.args)),
                js_handler="(event) => emit(event.target.open)",
            )
            words("summary", text("Additional torque"))
            with box("div", "stack"):
                show_blocks(text, [additional_torque(module), *training(module)])
    with panel(text("Models compared")), box("div", "stack"):
        _comparison(page, found)
    if page.visitor.has_role("metrologist"):
        _another_fit(page)


def _comparison(page: _CalibrationPage, found: _Calibration) -> None:
    text, compared = page.text, page.compared
    if compared is None:
        words(
            "p",
            text(
                "Every kind of model is fitted repeatedly with points left out, and its "
                "errors are computed at those points. This takes some minutes; the bench "
                "isn't moved."
            ),
            "muted",
        )
        button(
            text("Compare all models"), lambda: page.start("records compare-models", {}), "primary",
            picture="leaderboard",
        )  # fmt: skip
        return
    note(text(compared.headline), "good")
    show_page_sections(page, compared)
    names = {model.name for model in found.module.models}
    if compared.best not in names and page.visitor.has_role("metrologist"):
        button(
            text("Fit the recommended model"),
            lambda: page.start("records fit-model", {"model": compared.best}),
            "primary",
            picture="add_chart",
        )


def show_page_sections(page: _CalibrationPage, result: ComparedModels) -> None:
    """Show the tables of a result within another panel."""
    for section in result.page().sections:
        show_blocks(page.text, section.blocks)


def _another_fit(page: _CalibrationPage) -> None:
    """Add the form for fitting another model."""
    operation, text = find_operation("records fit-model"), page.text
    with panel(), box("details"):
        words("summary", text(operation.summary))
        with box("div", "stack"):
            form = OperationForm(
                page.visitor, operation, {"calibration": page.number}, ("calibration",)
            )

            async def fit() -> None:
                await begin(page.visitor, operation, form)
                page.refresh()

            with box("div", "line"):
                button(text("Fit this model"), fit, picture="add_chart")


# -- verify ---------------------------------------------------------------------------------


def _verify(page: _CalibrationPage, found: _Calibration) -> None:
    text, verified = page.text, found.verified
    if verified is not None:
        note(
            text(verified.headline),
            verdict_kind(verified.verdict),
            title=text.verdict(verified.verdict),
        )
        remarks(text, verified.remarks)
        show_page(text, verified.page())
    operation = find_operation("verification")
    given = {"side": found.module.side, "calibration": page.number, "points": 20}
    title = text("Verification") if verified is None else text("Verify again")
    with panel(title), box("div", "stack"):
        words(
            "p",
            text(
                "The verification standard takes the calibrator's place. Fresh points "
                "between the calibration's steps show the error of each model."
            ),
        )
        form = OperationForm(page.visitor, operation, given, ("side", "calibration", "models"))

        async def start() -> None:
            await begin(page.visitor, operation, form)
            page.refresh()

        button(text("Start verification"), start, "primary" if verified is None else "",
               picture="play_arrow")  # fmt: skip


# -- sign -----------------------------------------------------------------------------------


def _sign(page: _CalibrationPage, found: _Calibration) -> None:
    text, visitor, module = page.text, page.visitor, found.module
    entry = found.detail.calibration
    with panel(text("Sign off and put into use")), box("div", "stack"):
        words(
            "p",
            text(
                "With your password you confirm that this calibration followed the "
                "procedure. The chosen model compensates the readings from then on."
            ),
        )
        for review in found.detail.reviews:
            kind = "good" if review.accepted else "bad"
            with note(review.remark or text("reviewed"), kind, title=review.checked_by):
                moment(review.checked)
        if found.verified is None:
            note(text("This calibration isn't verified yet."), "warn")
        else:
            _verdicts(page, found.verified)
        if not visitor.has_role("metrologist"):
            visitor.not_allowed()
            return
        if entry.measured_by == visitor.looker.label:
            note(
                text(
                    "You measured this calibration yourself, so somebody else has to sign it: "
                    "a metrologist, signed in at this or another screen."
                ),
                "warn",
            )
            return
        if not module.models:
            note(text("No model is fitted yet: go back and fit one."), "warn")
            return
        _signature(page, found)


def _verdicts(page: _CalibrationPage, verified: VerifiedModule) -> None:
    """List the verdict of each model at the fresh points."""
    text = page.text
    words(
        "h3",
        text(
            "Verdict at fresh points, tolerance {tolerance} % FS",
            tolerance=f"{verified.tolerance_percent_fs:g}",
        ),
    )
    with box("ul", "stack"):
        for model in verified.models[1:]:
            worst = model.errors.against_standard
            with box("li", "line"):
                tag(text.verdict(model.verdict), verdict_kind(model.verdict),
                    verdict_icon(model.verdict))  # fmt: skip
                words("span", text(model.name))
                said = text(
                    "worst {worst} N·m ({percent} % FS)",
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
            text(model.title),
            text("recommended") if model is first
            else text("best in the verification") if model.model_id == best
            else text("model {number}", number=model.model_id),
        )
        for model in module.models
    }  # fmt: skip
    chosen = Choice(text("Model to be used"), options, str(first.model_id))
    contradictions = {each.found: each for model in module.models for each in model.contradictions}
    for each in contradictions.values():
        found_words, allowed, cause = map(text, (each.found, each.allowed, each.cause))
        note(
            f"{found_words} ({allowed}). {cause}",
            "warn",
            title=text("This calibration contradicts itself"),
        )
    _preview_button(page, lambda: {"languages": (text.language,), "model_id": int(chosen.value)})
    remark = Field(
        text("Why the model is used nevertheless, for the record" if contradictions else "Remark"),
        maxlength="500",
    )

    async def sign() -> None:
        number = int(chosen.value)
        despite = bool(module.model(number).contradictions)
        remark.wrong(
            text("Say why, or find the cause and calibrate again.")
            if despite and not remark.value.strip()
            else ""
        )
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
                "reason": said or text("signed off on the panel"),
                "despite_contradictions": despite,
            }
            service.perform(actor, "records use", use, password=given)

        with signing(page, password):
            await in_thread(put_into_use)
            await page.after_signing()

    password = Field(text("Your password"), kind="password", on_enter=sign)
    with box("div", "line"):
        button(text("Sign and put into use"), sign, "primary", picture="draw")


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
    with panel(text("Certificate")), box("div", "stack"):
        for entry in found.detail.certificates:
            words("p", text("Certificate {number} is issued.", number=entry.number))
            certificate_buttons(visitor, entry.number, tuple(entry.files))
        if not visitor.has_role("metrologist"):
            visitor.not_allowed()
            return
        if found.detail.certificates:
            with box("details"):
                words("summary", text("Issue another certificate"))
                with box("div", "stack"):
                    _issue(page)
        else:
            _issue(page)


def _issue(page: _CalibrationPage) -> None:
    """Add the form that issues a certificate."""
    text, visitor = page.text, page.visitor
    words(
        "p",
        text(
            "The certificate states calibration, verification and uncertainties. "
            "Issuing it needs your password again."
        ),
    )
    languages = Choice(text("Languages"), LANGUAGES, (text.language,), several=True)
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

    password = Field(text("Your password"), kind="password", on_enter=issue)
    with box("div", "line"):
        button(text("Issue the certificate"), issue, "primary", picture="workspace_premium")
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
                label = text(
                    "Page {number} of {of} of the certificate's draft",
                    number=number,
                    of=len(pages or ()),
                )
                box("img", src=f"data:image/png;base64,{data}", alt=label)

    with box("div", "line"):
        button(text("Preview the certificate"), show, picture="preview")
    place = box("div", "stack")


@page("calibration", "/calibrations/{number}")
def calibration_page(visitor: Visitor) -> None:
    """Build the page of a calibration."""
    number = visitor.query["number"]
    if not number.isdecimal():
        with frame(visitor, "calibrate"):
            empty(visitor.text("There is no such page."), "search_off")
        return
    shown = _CalibrationPage(visitor, int(number))
    title = f"{visitor.text('Calibration')} {number}"
    with frame(visitor, "calibrate", shown.refresh, title):
        shown.build()
