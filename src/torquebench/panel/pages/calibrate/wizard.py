"""The calibration wizard: from mounting the calibrator to the certificate."""

from __future__ import annotations

from collections.abc import Mapping

from torquebench.panel.pages.calibrate.measure import MeasureStep, PrepareStep
from torquebench.panel.pages.calibrate.models import ModelsStep
from torquebench.panel.pages.calibrate.page import CalibratePage, StepView
from torquebench.panel.pages.calibrate.sign import CertificateStep, SignStep
from torquebench.panel.pages.calibrate.verify import VerifyStep
from torquebench.panel.pages.calibrate.workflow import Step
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.page import page
from torquebench.panel.pages.visitor import Visitor

__all__ = ["calibrate_page"]

STEPS: Mapping[Step, type[StepView]] = {
    "prepare": PrepareStep,
    "measure": MeasureStep,
    "models": ModelsStep,
    "verify": VerifyStep,
    "sign": SignStep,
    "certificate": CertificateStep,
}


@page("calibrate", "/calibrate", picture="tune", place=2)
def calibrate_page(visitor: Visitor) -> None:
    """Build the wizard's page."""
    page = CalibratePage(visitor, STEPS, visitor.query.get("step", ""))
    with frame(visitor, "calibrate", page.refresh):
        page.build()
