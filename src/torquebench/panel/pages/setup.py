"""The page that sets the panel up: first steps, bench, instruments, laboratory, people."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from torquebench.operations import find_operation
from torquebench.panel.components.elements import box, icon, panel, repeat, tag, words
from torquebench.panel.pages.frame import REFRESH_S, frame
from torquebench.panel.pages.operations.page import OperationPanel
from torquebench.panel.pages.page import page
from torquebench.panel.pages.users import UsersView
from torquebench.panel.pages.view import View, tabs
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.text import Texts
from torquebench.reports.certificate.laboratory import kept_letterhead

MOST_JOBS, MOST_CALIBRATIONS = 100, 10
"""Numbers of the newest jobs and calibrations that are looked at."""


TABS: Texts = {
    "steps": "First steps",
    "bench": "New bench",
    "instruments": "Instruments",
    "laboratory": "Laboratory and customer",
    "people": "People",
}
STEPS: Texts = {
    "bench": "Check the description of the bench",
    "instruments": "Check the instruments",
    "people": "Add a second person",
    "laboratory": "State the laboratory and its customer",
    "calibration": "Calibrate a module",
    "verification": "Verify the model",
    "signature": "Sign off",
    "certificate": "Issue the certificate",
}
EXPLAINED: Texts = {
    "bench": "Transducers, standard, limits. A new bench is described under New bench; the panel "
    "is then started with its file.",
    "instruments": "Connections, signals, drives and clocks, before anything turns. The simulated "
    "bench has none.",
    "people": "One person measures, another one signs: an operator and a metrologist.",
    "laboratory": "Certificates name both. The simulated bench needs none.",
    "calibration": "The calibrator is mounted and loaded step by step; models are fitted.",
    "verification": "Fresh points against the verification standard.",
    "signature": "The second person accepts the calibration with the password; it is then in use.",
    "certificate": "As PDF and as a digital certificate (DCC).",
}


class Step(NamedTuple):
    """A step until the first certificate, and where it is done."""

    name: str
    done: bool
    target: str


def first_steps(visitor: Visitor) -> list[Step]:
    """Return the steps until the first certificate of this bench."""
    service = visitor.service
    records, simulated = service.records, service.snapshot().simulated
    jobs: list[tuple[str, str]] = [(job.kind, job.state) for job in service.jobs.recent()]
    jobs += [(job.kind, job.state) for job in service.jobs.log.newest(MOST_JOBS)]
    checked = ("doctor", "done") in jobs
    numbers = [entry.calibration_id for entry in records.calibrations(limit=MOST_CALIBRATIONS)]
    verified = [number for number in numbers if records.verified(number) is not None]
    signed = any(
        review.accepted and review.signature is not None and review.signature.signed
        for number in verified
        for review in records.calibration(number).reviews
    )
    stated = kept_letterhead(service.station.registry.root).laboratory is not None
    newest = f"/calibrations/{(verified or numbers)[0]}?step=" if numbers else "/calibrate?step="
    certified = bool(records.certificates())
    return [
        Step("bench", True, "/settings?part=bench"),
        Step("instruments", simulated or checked or bool(numbers), "/setup?part=instruments"),
        Step("people", len(service.people.names()) > 1, "/setup?part=people"),
        Step("laboratory", stated or simulated, "/setup?part=laboratory"),
        Step("calibration", bool(numbers), "/calibrate"),
        Step("verification", bool(verified), f"{newest}verify"),
        Step("signature", signed or certified, f"{newest}sign"),
        Step("certificate", certified, f"{newest}certificate"),
    ]


class _Steps(View):
    """The steps until the first certificate, those that are done with a tick."""

    def build(self) -> None:
        text, steps = self._text, first_steps(self._visitor)
        done = sum(step.done for step in steps)
        current = next((step.name for step in steps if not step.done), "")
        with (
            panel(
                text(
                    "Until the first certificate: {done} of {all} steps are done",
                    done=done,
                    all=len(steps),
                )
            ),
            box("ol", "checklist"),
        ):
            for step in steps:
                with box(
                    "li",
                    "done" if step.done else "",
                    aria_current="step" if step.name == current else None,
                ):
                    icon("check_circle" if step.done else "radio_button_unchecked")
                    with box("div"):
                        words("a", text(STEPS[step.name]), href=step.target)
                        words("div", text(EXPLAINED[step.name]), "small muted")
                    tag(text("done" if step.done else "to do"),
                        "good" if step.done else "")  # fmt: skip


class _Operation(View):
    """An operation's form and result as a part of this page."""

    def __init__(
        self,
        visitor: Visitor,
        name: str,
        given: Callable[[Visitor], Mapping[str, Any]] = lambda _: {},
    ) -> None:
        super().__init__(visitor)
        self._operation, self._given = find_operation(name), given

    def build(self) -> None:
        if not self._visitor.has_role(self._operation.role):
            self._visitor.not_allowed()
            return
        words("h2", self._text(self._operation.summary))
        shown = OperationPanel(self._visitor, self._operation, self._given(self._visitor))
        shown.build()
        repeat(REFRESH_S, shown.refresh)


def _letterhead(visitor: Visitor) -> dict[str, Any]:
    """Return the stated laboratory and customer as values of the form."""
    kept = kept_letterhead(visitor.service.station.registry.root)
    laboratory = {} if kept.laboratory is None else kept.laboratory.model_dump(exclude={"people"})
    customer = {} if kept.customer is None else kept.customer.model_dump()
    return laboratory | {f"customer_{name}": value for name, value in customer.items()}


@page("setup", "/setup", "Set-up", picture="checklist", place=8)
def setup_page(visitor: Visitor) -> None:
    """Build the page that sets the panel up."""
    views: dict[str, Callable[[Visitor], View]] = {
        "steps": _Steps,
        "bench": partial(_Operation, name="bench new"),
        "instruments": partial(_Operation, name="doctor"),
        "laboratory": partial(_Operation, name="records laboratory", given=_letterhead),
        "people": UsersView,
    }
    with frame(visitor, "setup"):
        tabs(visitor, "setup", TABS, views)
