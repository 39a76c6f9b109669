"""The wizard's last steps: sign-off and activation, and the certificate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from torquebench.compensation import RECOMMENDED
from torquebench.errors import TorquebenchError
from torquebench.panel.components.controls import Choice, Field, button, tolerance_field
from torquebench.panel.components.elements import box, note, pairs, panel, tag, words
from torquebench.panel.components.verdicts import verdict_icon, verdict_kind
from torquebench.panel.pages.calibrate.another_fit import titled
from torquebench.panel.pages.calibrate.certificate_preview import CertificatePreview
from torquebench.panel.pages.calibrate.page import CalibratePage, StepView
from torquebench.panel.pages.downloads import certificate_buttons
from torquebench.records import CalibrationEntry
from torquebench.reports.errors_table import number

__all__ = ["CertificateStep", "SignStep"]

LANGUAGES = {"en": "English", "de": "Deutsch", "zh": "中文"}


class SignStep(StepView):
    """Choose the model to be used, sign with the password, put it into use."""

    def build(self) -> None:
        """Make the step's elements."""
        text, workflow, visitor = self._text, self._page.workflow, self._page.visitor
        with panel(text("sign.title")), box("div", "stack"):
            number = workflow.calibration_id
            assert number is not None
            words("p", text("sign.explained"))
            if workflow.verified:
                self._verdicts()
            else:
                note(text("sign.unverified"), "warn")
            CertificatePreview(self._page, self._asked).build()
            if not visitor.has_role("metrologist"):
                visitor.not_allowed()
                return
            detail = visitor.service.records.calibration(number)
            self._signed_sha256 = detail.signed_sha256
            self._identity(detail.calibration, detail.signed_sha256)
            if detail.calibration.measured_by == visitor.looker.label:
                note(text("sign.own"), "warn")
                return
            models = workflow.models
            if not models:
                note(text("sign.no_model"), "warn")
                return
            best = workflow.verified_best
            chosen = next((name for name in (RECOMMENDED, best) if name in models), "")
            options = {
                name: (
                    titled(text, model),
                    text("sign.recommended") if name == RECOMMENDED else
                    text("sign.best") if name == best else
                    text("sign.model", number=model["model_id"]),
                )
                for name, model in models.items()
            }  # fmt: skip
            self._model = Choice(text("sign.use"), options, chosen or next(iter(models)))
            for contradiction in self._contradictions():
                found, allowed, cause = (
                    text.core(contradiction[name]) for name in ("found", "allowed", "cause")
                )
                note(f"{found} ({allowed}). {cause}", "warn", title=text("sign.contradicts"))
            label = "sign.despite" if self._contradictions() else "sign.remark"
            self._remark = Field(text(label), maxlength="500")
            self._password = Field(text("sign.password"), kind="password", on_enter=self._sign)
            with box("div", "line"):
                button(text("sign.button"), self._sign, "primary", picture="draw")

    def _identity(self, calibration: CalibrationEntry, sha256: str) -> None:
        """State what is signed."""
        text = self._text
        words("h3", text("sign.what"))
        pairs(
            [
                (text("sign.calibration"), f"calibration-{calibration.calibration_id}"),
                (text("sign.performed"), calibration.performed),
                (text("sign.transducer"), calibration.transducer_serial),
                (text("sign.measured_by"), calibration.measured_by),
                (text("sign.run"), calibration.run_id or ""),
                ("SHA-256", sha256),
            ]
        )

    def _verdicts(self) -> None:
        """State how each model performs at the fresh points."""
        text, workflow = self._text, self._page.workflow
        assert workflow.verify is not None
        assert workflow.verify.result is not None
        tolerance = f"{workflow.verify.result.details['tolerance_percent_fs']:g}"
        words("h3", text("sign.verdicts", tolerance=tolerance))
        with box("ul", "stack"):
            for name, model in workflow.verified.items():
                worst = model["result"]["against_standard"]
                with box("li", "line"):
                    verdict = model["verdict"]
                    tag(text.verdict(verdict), verdict_kind(verdict), verdict_icon(verdict))
                    words("span", titled(text, workflow.models[name]))
                    said = text(
                        "sign.worst",
                        worst=number(worst["worst_nm"]),
                        percent=number(worst["worst_percent_fs"]),
                    )
                    words("span", said, "muted number")

    def _asked(self) -> Mapping[str, Any]:
        """Return the request for the preview of the certificate: the model chosen here."""
        models, chosen = self._page.workflow.models, getattr(self, "_model", None)
        name = chosen.value if chosen is not None else next(iter(models), "")
        asked: dict[str, Any] = {"languages": (self._text.language,)}
        if name in models:
            asked["model_id"] = models[name]["model_id"]
        verify = self._page.workflow.verify
        if verify is not None and verify.result is not None:
            asked["tolerance_percent_fs"] = verify.result.details["tolerance_percent_fs"]
        return asked

    def _contradictions(self, name: str | None = None) -> list[dict[str, str]]:
        """Return the calibration's contradictions, for one model or any, each once."""
        models = self._page.workflow.models
        chosen = models.values() if name is None else [models[name]]
        contradictions = (item for model in chosen for item in model["contradictions"])
        return list({item["found"]: item for item in contradictions}.values())

    def _sign(self) -> None:
        visitor, text, workflow = self._page.visitor, self._text, self._page.workflow
        number = workflow.calibration_id
        assert number is not None
        model_id = workflow.models[self._model.value]["model_id"]
        service, remark = visitor.service, self._remark.value
        despite = bool(self._contradictions(self._model.value))
        self._remark.wrong(text("sign.despite_missing") if despite and not remark.strip() else "")
        if despite and not remark.strip():
            return
        with signing(self._page, self._password):
            actor = visitor.actor
            service.jobs.command(actor)  # checked before anything is signed
            password, seen = self._password.value, self._signed_sha256
            service.sign_off(actor, number, password, accepted=True, remark=remark, sha256=seen)
            said = remark or text("sign.reason")
            service.activate(
                actor, model_id, said, despite_contradictions=despite, password=password
            )
            visitor.messages.good(text("sign.done"))
            self._page.show("certificate")


class CertificateStep(StepView):
    """Issue the certificate and fetch its files."""

    def build(self) -> None:
        """Make the step's elements."""
        text, visitor = self._text, self._page.visitor
        certificate = self._page.workflow.certificate
        issued = certificate is not None and certificate.result is not None
        with panel(text("certificate.title")), box("div", "stack"):
            if issued:
                assert certificate is not None
                assert certificate.result is not None
                number = str(certificate.result.certificate)
                words("p", text("certificate.issued", number=number))
                certificate_buttons(visitor, number, certificate.result.details["files"])
                return
            if not visitor.has_role("metrologist"):
                visitor.not_allowed()
                return
            self._form()

    def _form(self) -> None:
        text = self._text
        words("p", text("certificate.explained"))
        self._languages = Choice(
            text("certificate.languages"), LANGUAGES, (text.language,), several=True
        )
        self._tolerance = tolerance_field(text)
        self._password = Field(text("sign.password"), kind="password", on_enter=self._issue)
        with box("div", "line"):
            button(text("certificate.button"), self._issue, "primary", picture="workspace_premium")
        CertificatePreview(self._page, self._request).build()

    def _request(self) -> dict[str, Any] | None:
        tolerance = self._tolerance.number()
        if tolerance is None:
            return None
        languages = tuple(name for name in LANGUAGES if name in self._languages.values)
        return {"languages": languages, "tolerance_percent_fs": tolerance}

    def _issue(self) -> None:
        options, service = self._request(), self._page.visitor.service
        if options is None:
            return
        request = {"calibration_id": self._page.workflow.calibration_id, **options}
        with signing(self._page, self._password):
            actor = self._page.visitor.actor
            service.issue_certificate(actor, request, self._password.value)
            self._page.refresh()


@contextmanager
def signing(page: CalibratePage, password: Field) -> Iterator[None]:
    """Act with a person's password; say beside its field why that was refused."""
    password.wrong("")
    try:
        yield
    except TorquebenchError as error:
        password.wrong(page.text.refusal_line(error))
        password.set("")
