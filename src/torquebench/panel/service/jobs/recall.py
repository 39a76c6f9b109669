"""Registered calibrations, continued in the wizard as if they had just been made."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from torquebench.calibration import verify
from torquebench.campaign.bench_chains import used_chain
from torquebench.campaign.fitting import (
    CHOSEN_ELSEWHERE,
    FittedModel,
    ModelChoice,
    model_title,
)
from torquebench.campaign.resuming import find_interrupted, read_interrupted
from torquebench.chain import MeasuringChain, load_chain
from torquebench.compensation import make_model
from torquebench.errors import TorquebenchError
from torquebench.panel.service.access.actors import Actor
from torquebench.panel.service.jobs.calibrations import NETWORK, VerifyRequest
from torquebench.panel.service.jobs.results import (
    calibration_data,
    calibration_result,
    models_of,
    verification_result,
)
from torquebench.panel.service.jobs.runner import JobRunner
from torquebench.panel.service.jobs.values import JobResult, JobView
from torquebench.records import ModelEntry, Registry, RunFolder
from torquebench.reports.certificate import run_data
from torquebench.station import Station

__all__ = ["InterruptedView", "interrupted_calibration", "recall"]


@dataclass(frozen=True)
class InterruptedView:
    """A calibration that was begun and not finished.

    Parameters
    ----------
    run_id, side, profile : str
    interrupted : datetime.datetime
        When its last point was taken, UTC.
    points, kept, total : int
        Numbers of measured points, of points that are kept, and of all points.
    """

    run_id: str
    side: str
    profile: str
    interrupted: datetime
    points: int
    kept: int
    total: int


def interrupted_calibration(registry: Registry, run_id: str = "") -> InterruptedView | None:
    """Return a run that can be resumed; by default the newest calibration, if it is one.

    None if there is nothing to resume; an attempt to resume states the reason.
    """
    try:
        if not run_id:
            newest = next((run for run in registry.runs() if _calibrates(run.kind)), None)
            if newest is None:
                return None
            run_id = newest.run_id
        interrupted = read_interrupted(registry, find_interrupted(registry, run_id))
        kept = len(interrupted.kept)
    except TorquebenchError:
        return None
    return InterruptedView(
        run_id=run_id,
        side=interrupted.side,
        profile=interrupted.profile.title,
        interrupted=interrupted.interrupted,
        points=len(interrupted.points),
        kept=kept,
        total=sum(step.recorded for step in interrupted.steps),
    )


def _calibrates(kind: str) -> bool:
    return kind.startswith("calibrate-")


def recall(jobs: JobRunner, station: Station, actor: Actor, calibration_id: int) -> JobView:
    """List the jobs of a registered calibration as if they had just been done."""
    measured, verified = recalled(station, calibration_id)
    view = jobs.recall(actor, "calibrate", {"side": measured.details["side"]}, measured)
    if verified is not None:
        jobs.recall(actor, "verify", {"calibration_id": calibration_id}, verified)
    return view


def recalled(station: Station, calibration_id: int) -> tuple[JobResult, JobResult | None]:
    """Return the results of a registered calibration: its fit and its last verification.

    Raises
    ------
    RecordError
        It isn't registered, or its records were changed.
    """
    entry, data = calibration_data(station, calibration_id)
    entries = models_of(station, entry)
    loaded = {name: load_chain(model.check_file()) for name, model in entries.items()}
    fitted, numbers = [], {}
    for key, model in entries.items():
        name = loaded[key].model.name
        name = f"{name} {model.model_id}" if name in numbers else name
        numbers[name] = model.model_id
        fitted.append(_fitted(name, loaded[key], model))
    measured = calibration_result(entry, data, fitted, numbers)
    verifications = [
        (verification, key)
        for key, model in entries.items()
        for verification in station.registry.verifications(model.model_id)
        if verification.run_id is not None
    ]
    if not verifications:
        return measured, None
    last = max(
        (verification for verification, _ in verifications),
        key=lambda verification: verification.performed,
    )
    folder = RunFolder(station.registry.run(str(last.run_id)).folder)
    fresh = run_data(folder)
    judged = {
        key: used_chain(entries[key], folder.metadata, fresh)
        for verification, key in verifications
        if verification.run_id == last.run_id
    }
    verified = verification_result(
        folder.metadata,
        entry,
        judged,
        fresh,
        verify(fresh, judged),
        run_id=str(last.run_id),
        tolerance_percent_fs=VerifyRequest(calibration_id=calibration_id).tolerance_percent_fs,
    )
    return measured, verified


def _fitted(name: str, chain: MeasuringChain, entry: ModelEntry) -> FittedModel:
    model = chain.model
    title = model_title(model.kind, model.kind_parameters)
    choice = None
    if model.name == NETWORK:
        own, known = make_model(NETWORK).kind_parameters, model.kind_parameters
        asked = {
            key: value
            for key, value in known.items()
            if key not in CHOSEN_ELSEWHERE and value != own[key]
        }
        choice = ModelChoice(NETWORK, asked)
    return FittedModel(
        name,
        title,
        model,
        0.0,
        (),
        chain.stored,
        contradictions=entry.contradictions,
        choice=choice,
    )
