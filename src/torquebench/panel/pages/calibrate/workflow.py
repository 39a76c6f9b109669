"""The state of a calibration between mounting the calibrator and its certificate.

It is read from the jobs on the server, so every page shows the same state.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from torquebench.panel.components.charts import COLOURS
from torquebench.panel.service import JobView

__all__ = ["STEPS", "CalibrationWorkflow", "Dismissed", "Step", "find_workflow"]

Step = Literal["prepare", "measure", "models", "verify", "sign", "certificate"]
STEPS: tuple[Step, ...] = get_args(Step)
MEASURING = ("calibrate", "resume-calibration")


@dataclass
class Dismissed:
    """Calibrations that were closed to begin another one."""

    job_ids: set[str] = field(default_factory=set)


@dataclass(frozen=True)
class CalibrationWorkflow:
    """One calibration's jobs, each the newest of its kind.

    Attributes
    ----------
    calibrate, compare, fit, verify, certificate : JobView or None
    fits : tuple of JobView
        All models fitted afterwards.
    """

    calibrate: JobView | None = None
    compare: JobView | None = None
    fits: tuple[JobView, ...] = ()
    verify: JobView | None = None
    certificate: JobView | None = None

    @property
    def calibration_id(self) -> int | None:
        """The registered calibration; None before it is measured."""
        result = None if self.calibrate is None else self.calibrate.result
        return None if result is None else result.calibration_id

    @property
    def reached(self) -> Step:
        """The furthest available step."""
        if self.calibrate is None:
            return "prepare"
        if self.calibration_id is None:
            return "measure"
        if self.certificate is not None:
            return "certificate"
        if self.verify is None:
            return "models"
        return "sign" if self.verify.result is not None else "verify"

    def done(self, step: Step, *, signed: bool) -> bool:
        """Whether a step was done, not only passed over."""
        if step == "verify":
            return self.verify is not None and self.verify.result is not None
        return step != "sign" or signed

    @property
    def models(self) -> dict[str, dict[str, Any]]:
        """Every fitted model by its name, with its registry number as `model_id`.

        A kind that is fitted again, such as the network with other parameters, gets a number after
        its name.
        """
        found: dict[str, dict[str, Any]] = {}
        for job in (self.calibrate, *reversed(self.fits)):
            if job is None or job.result is None:
                continue
            for name, model in job.result.details.get("models", {}).items():
                number = job.result.model_ids[name]
                if any(known["model_id"] == number for known in found.values()):
                    continue  # a resumed calibration includes its later fits
                key = f"{name} {number}" if name in found else name
                found[key] = {**model, "model_id": number}
        return dict(sorted(found.items(), key=lambda item: int(item[1]["model_id"])))

    @property
    def colours(self) -> dict[int, str]:
        """Colour of every model by its number: the same in all steps."""
        numbers = sorted(int(model["model_id"]) for model in self.models.values())
        return {number: COLOURS[place % len(COLOURS)] for place, number in enumerate(numbers)}

    @property
    def verified(self) -> dict[str, dict[str, Any]]:
        """The verification's results by the model's name; empty before it."""
        if self.verify is None or self.verify.result is None:
            return {}
        found = {each["model_id"]: each for each in self.verify.result.details["models"].values()}
        models = self.models.items()
        return {name: found[model["model_id"]] for name, model in models
                if model["model_id"] in found}  # fmt: skip

    @property
    def verified_best(self) -> str:
        """Name of the model with the smallest error in the verification; empty before it."""
        if self.verify is None or self.verify.result is None:
            return ""
        number = self.verify.result.model_ids.get(str(self.verify.result.details["best"]))
        models = self.models.items()
        return next((name for name, model in models if model["model_id"] == number), "")

    @property
    def best_compared(self) -> str:
        """Name of the model with the least error in the comparison; empty before it."""
        if self.compare is None or self.compare.result is None:
            return ""
        return str(self.compare.result.details["best"])


def find_workflow(jobs: list[JobView], dismissed: Dismissed) -> CalibrationWorkflow:
    """Return the newest calibration's workflow; an empty one if there is none.

    Parameters
    ----------
    jobs : list of JobView
        The newest first.
    dismissed : Dismissed
    """
    calibrate = next((job for job in jobs if job.kind in MEASURING), None)
    if calibrate is None or calibrate.job_id in dismissed.job_ids:
        return CalibrationWorkflow()
    number = None if calibrate.result is None else calibrate.result.calibration_id
    if number is None:
        return CalibrationWorkflow(calibrate)
    later = [job for job in jobs if job.request.get("calibration_id") == number]

    def newest(kind: str) -> JobView | None:
        return next((job for job in later if job.kind == kind), None)

    fits = tuple(job for job in later if job.kind == "fit")
    return CalibrationWorkflow(
        calibrate, newest("compare-models"), fits, newest("verify"), newest("certificate")
    )
