"""Verification with the check standard: whether a module keeps its stated uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData, Profile
from torquebench.campaign.bench_chains import check_standard, used_chain
from torquebench.campaign.measuring import Measured, RunKind, RunOptions
from torquebench.chain import (
    Component,
    MeasuringChain,
    Readings,
    Reference,
    Shared,
    Torque,
    load_chain,
)
from torquebench.message import Message
from torquebench.procedures import StaircaseResult, verify
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import REGISTERS, CheckEntry, ModelEntry, Registry, RunFolder
from torquebench.station import Station, enter_run
from torquebench.uncertainty import Decision, Tolerance, Verdict, decide

CHECK_STANDARD = {
    "reference standard": "check standard",
    "temperature of standard": "temperature of check standard",
    "drift of standard": "drift of check standard",
}
"""Components of U by the standard that the points are compared with, and their names in a budget
that also has the calibration's standard.
"""


@dataclass(frozen=True, eq=False)
class JudgedPoints:
    """Points against a check standard or a verification standard.

    Attributes
    ----------
    torque : Torque
        Compensated torque, or the reading where no model is in use. Its U contains the standard, as
        the decisions concern the difference from it.
    decisions : tuple of Decision
        One decision for each point, with the guard band w = U.
    missing : tuple of str
        Influences that U doesn't contain.
    """

    torque: Torque
    decisions: tuple[Decision, ...]
    missing: tuple[str, ...]

    @property
    def verdict(self) -> Verdict:
        """The worst of the decisions."""
        return Verdict.worst(decision.verdict for decision in self.decisions)


@dataclass(frozen=True, eq=False)
class CheckResult:
    """Results of a check.

    Attributes
    ----------
    data : CalibrationData
        Its points.
    judged : JudgedPoints
        Torques with U of the chain and the check standard, and the decisions.
    model : ModelEntry or None
        The model in use.
    """

    data: CalibrationData
    judged: JudgedPoints
    model: ModelEntry | None
    run_id: str

    @property
    def error_nm(self) -> NDArray[np.float64]:
        """Torque minus standard, N·m."""
        return self.judged.torque.value_nm - self.data.standard_nm

    @property
    def expanded_uncertainty_nm(self) -> NDArray[np.float64]:
        """U (k = 2) of the errors, N·m: of the torque and the check standard."""
        return self.judged.torque.expanded_uncertainty_nm

    @property
    def verdict(self) -> Verdict:
        """The worst of the decisions."""
        return self.judged.verdict

    @property
    def worst_percent_fs(self) -> float:
        """The error of largest magnitude with its sign, % of full scale."""
        error = self.error_nm
        return 100.0 * float(error[int(np.argmax(np.abs(error)))]) / self.data.range_nm


def judge_check(
    data: CalibrationData,
    chain: MeasuringChain | None,
    *,
    standard: Reference | None,
    tolerance_percent_fs: float,
) -> JudgedPoints:
    """Return a decision for every point, with the compensated torque and its U.

    Parameters
    ----------
    chain : MeasuringChain or None
        Chain in use; None compares the reading itself.
    standard : Reference or None
        The check standard, as `check_standard` returns it; None if it isn't known.
    tolerance_percent_fs : float
        Largest error allowed, % of the range.
    """
    if chain is not None:
        torque = chain.torque(data.readings())
        missing = [*chain.missing()]
    else:
        missing = ["uncertainty of the uncompensated reading"]
        torque = Torque(data.reading_nm, ())
        if data.standard_error_nm is not None:
            scatter = Component("scatter", Shared.NOTHING, data.standard_error_nm)
            torque = torque.and_also(scatter)
    if standard is None:
        missing.append(CHECK_STANDARD["reference standard"])
    else:
        missing += [CHECK_STANDARD[name] for name in standard.gaps()]
        parts = standard.components(Readings(data.standard_nm), data.standard_nm)
        torque = torque.and_also(*(part._replace(name=CHECK_STANDARD[part.name]) for part in parts))
    tolerance = Tolerance(-tolerance_percent_fs, tolerance_percent_fs, "full scale")
    decisions = tuple(
        decide(float(error), float(u), tolerance, full_scale=data.range_nm)
        for error, u in zip(
            torque.value_nm - data.standard_nm, torque.expanded_uncertainty_nm, strict=True
        )
    )
    return JudgedPoints(torque, decisions, tuple(missing))


def check_module(
    station: Station,
    side: Side,
    profile: Profile,
    tolerance_percent_fs: float,
    **options: Unpack[RunOptions],
) -> CheckResult:
    """Check one module against the check standard, and register the verdict.

    Parameters
    ----------
    side : {"input", "output"}
    profile : Profile
        A few steps, such as the packaged profile "check".
    tolerance_percent_fs : float
        Largest error allowed, % of full scale.
    **options
        See `RunOptions`.

    Raises
    ------
    ModelMismatchError
        The module's model was made with another counter; nothing was moved.
    """
    registry, description = station.registry, station.description
    serial, counter = description.module(side).transducer.serial, station.drivers.counter
    entry = registry.patiently(lambda: registry.active_model(serial, counter.clock_identity))
    if entry is not None:  # up to the calibrated torque
        chain = load_chain(entry.check_file())
        profile = profile.within(
            100.0 * chain.model.calibrated_nm / description.module(side).range_nm
        )
    registers = {
        "tolerance_percent_fs": tolerance_percent_fs,
        "model_id": None if entry is None else entry.model_id,
    }
    options["metadata"] = {**options.get("metadata", {}), REGISTERS: registers}
    steps = profile.staircase(description.module(side).range_nm)
    measured = CHECK.measure(station, side, profile, steps, **options)
    progress = options.get("progress", NO_PROGRESS)
    return CHECK.evaluate_and_register(registry, measured, progress)


def _evaluate(
    registry: Registry, measured: Measured[StaircaseResult], _progress: Progress
) -> CheckResult:
    """Evaluate a check by the tolerance, the model and the standard in its run's record."""
    data, metadata = measured.result.data, measured.record.metadata
    settings = metadata[REGISTERS]
    entry = None if settings["model_id"] is None else registry.model(int(settings["model_id"]))
    judged = judge_check(
        data,
        None if entry is None else used_chain(entry, metadata, data),
        standard=check_standard(metadata, data),
        tolerance_percent_fs=float(settings["tolerance_percent_fs"]),
    )
    return CheckResult(data, judged, entry, measured.record.run_id)


def _register(
    registry: Registry, measured: Measured[StaircaseResult], result: CheckResult
) -> CheckResult:
    """Enter a check into the registry, unless that was done before an interruption."""
    settings = measured.record.metadata[REGISTERS]
    summary: dict[str, Any] = {
        "signed_worst_percent_fs": result.worst_percent_fs,
        "nominal_nm": result.data.nominal_nm,
        "error_nm": result.error_nm,
        "expanded_uncertainty_nm": result.expanded_uncertainty_nm,
        "verdicts": [decision.verdict for decision in result.judged.decisions],
        "decision_rule": result.judged.decisions[0].rule(),
        "not_in_u": result.judged.missing,
    }
    folder, serial = RunFolder(measured.record.folder), result.data.transducer_serial
    with registry.writing():
        enter_run(registry, folder)
        if any(check.run_id == result.run_id for check in registry.checks(serial)):
            return result
        registry.add_check(
            CheckEntry(
                transducer_serial=serial,
                performed=datetime.fromisoformat(folder.manifest["sealed"]),
                verdict=result.verdict.value,
                worst_percent_fs=abs(result.worst_percent_fs),
                tolerance_percent_fs=float(settings["tolerance_percent_fs"]),
                simulated=result.data.simulated,
                standard_serial=measured.result.standard_serial,
                model_id=None if result.model is None else result.model.model_id,
                run_id=result.run_id,
                measured_by=str(measured.record.metadata.get("operator", "")),
                summary=summary,
            )
        )
    return result


CHECK = RunKind(
    "check-{side}",
    lambda side: Message("Checking the {side} module", side),
    verify,
    _evaluate,
    _register,
    lambda result: Message(
        "run {run_id} is registered: {label}", result.run_id, result.verdict.label
    ),
)
