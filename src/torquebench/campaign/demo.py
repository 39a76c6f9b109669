"""The demo on an open station: both modules calibrated, fitted and verified, friction measured."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial

import numpy as np

from torquebench import __version__
from torquebench.bench.roles import SIDES, Side
from torquebench.calibration import Profile, load_profile
from torquebench.campaign.calibrating import (
    CALIBRATION,
    FinishedCalibration,
    FittedCalibration,
    calibration_fit,
    measure_calibration,
)
from torquebench.campaign.fitting import FittedModel, ModelChoice
from torquebench.campaign.measuring import Measured
from torquebench.campaign.modules import dense_sweep, module_result
from torquebench.campaign.registering import registers_calibration
from torquebench.campaign.results import DemoResult, ModuleResult
from torquebench.campaign.standard_reducer import FRICTION
from torquebench.campaign.verifying import VERIFICATION, measure_verification
from torquebench.chain import Readings
from torquebench.compensation import RECOMMENDED
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.procedures import FrictionSettings, StaircaseResult
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import REGISTERS, ModelEntry
from torquebench.station import Station

Fit = Callable[[], list[FittedModel]]
Begin = Callable[[Fit], Fit]


@dataclass(frozen=True)
class DemoSettings:
    """Settings of the demo.

    Parameters
    ----------
    calibration, verification : Profile
        By default the rapid calibration in place (50 points per direction, up and down) and three
        groups of 50 fresh points.
    friction : FrictionSettings or None
        By default 20 to 1200 rpm with three repeats; None omits the reducer.
    models : tuple of ModelChoice
        Models fitted in addition to the recommended one.
    seed : int
        Seed of the verification's random points.
    """

    calibration: Profile = field(default_factory=lambda: load_profile("rapid-in-situ"))
    verification: Profile = field(
        default_factory=lambda: load_profile("verification").with_options(groups=3)
    )
    friction: FrictionSettings | None = field(default_factory=FrictionSettings)
    models: tuple[ModelChoice, ...] = (
        ModelChoice("bayesian-network"),
        ModelChoice("published-network"),
        ModelChoice("polynomial-2"),
    )
    seed: int = 1

    def choices(self) -> list[ModelChoice]:
        """Return the models with the recommended one first."""
        recommended = [choice for choice in self.models if choice.name == RECOMMENDED]
        first = recommended or [ModelChoice(RECOMMENDED)]
        return first + [choice for choice in self.models if choice.name != RECOMMENDED]


def run_demo(
    station: Station,
    settings: DemoSettings | None = None,
    progress: Progress = NO_PROGRESS,
    *,
    begin: Begin = lambda function: function,
    verified: Callable[[ModuleResult], object] | None = None,
) -> DemoResult:
    """Zero, calibrate, fit and verify both modules, and sweep the friction of a mounted reducer.

    Runs, calibrations, models, their activation and verifications are registered.

    Parameters
    ----------
    progress : Progress
        Receives the stages.
    begin : callable
        Starts a fit in another process and returns a function that waits for its result; by
        default, fits run in this process when their result is needed.
    verified : callable, optional
        Called with the results of each module.
    """
    settings = settings or DemoSettings()
    started, clock_started = datetime.now(UTC), time.perf_counter()
    bench_started = station.clock.now()
    modules = _modules(station, settings, progress, begin, verified)
    friction = None
    if settings.friction is not None:
        station.activate_compensation("input", fitted=modules[0].recommended.model)
        measured = FRICTION.measure(station, "input", settings.friction, progress=progress)
        friction = FRICTION.evaluate_and_register(station.registry, measured, progress)
    description = station.description
    return DemoResult(
        bench_name=description.name,
        simulated=description.simulated,
        preset=str(description.simulation.get("preset", "")),
        seed=int(description.simulation.get("seed", 0)),
        started=started,
        bench_seconds=station.clock.now() - bench_started,
        elapsed_seconds=time.perf_counter() - clock_started,
        modules=tuple(modules),
        friction=None if friction is None else friction.sweep,
        friction_run_id="" if friction is None else friction.run_id,
        software_version=__version__,
    )


def _modules(
    station: Station,
    settings: DemoSettings,
    progress: Progress,
    begin: Begin,
    verified: Callable[[ModuleResult], object] | None,
) -> list[ModuleResult]:
    """Calibrate both modules, then mount the verification standard and verify them."""
    choices = settings.choices()
    recommended = choices[0].name
    metadata = registers_calibration(choices, recommended)
    profile, registry = settings.calibration, station.registry
    measured: list[Measured[StaircaseResult]] = []
    fits: list[Fit] = []
    for side in SIDES:
        item = measure_calibration(station, side, profile, metadata=metadata, progress=progress)
        measured.append(item)
        fitting = calibration_fit(registry, item, choices, progress)
        fits.append(begin(partial(_with_tables, fitting)))
    modules = []
    for side, item, fit in zip(SIDES, measured, fits, strict=True):
        progress.start(Message("Fitting the {side} module", side))
        fitted = fit()
        progress.finish()
        models = FittedCalibration(tuple(fitted), recommended)
        calibrated = CALIBRATION.evaluate_and_register(registry, item, progress, models)
        _require_plausible(calibrated.registered.models[recommended])
        modules.append(_verify(station, settings, side, calibrated, recommended, progress))
        if verified is not None:
            verified(modules[-1])
    return modules


def _with_tables(fit: Fit) -> list[FittedModel]:
    """Fit the models, and evaluate each chain once, so that its table is compiled here."""
    fitted = fit()
    for model in fitted:
        model.chain.compensated(Readings(np.zeros(1)))
    return fitted


def _require_plausible(entry: ModelEntry) -> None:
    """Refuse a model that isn't in use because its calibration contradicts itself."""
    if entry.contradictions:
        raise RecordError(
            Message(
                "model-{model_id} isn't in use, because its calibration contradicts "
                "itself: {contradictions}",
                entry.model_id,
                Message.joined(
                    (contradiction.found for contradiction in entry.contradictions), "; "
                ),
            ),
            "a plausible calibration",
            "find the cause and calibrate again",
        )


def _verify(
    station: Station,
    settings: DemoSettings,
    side: Side,
    calibrated: FinishedCalibration,
    recommended: str,
    progress: Progress,
) -> ModuleResult:
    """Verify one module on fresh points and enter the result."""
    models = calibrated.registered.models
    measured = measure_verification(
        station,
        side,
        settings.verification,
        settings.seed,
        metadata={REGISTERS: {"models": {name: entry.model_id for name, entry in models.items()}}},
        progress=progress,
    )
    verified = VERIFICATION.evaluate_and_register(station.registry, measured, progress)
    return module_result(calibrated, verified, recommended, dense_sweep(station, side))
