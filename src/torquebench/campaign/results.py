"""Results of a campaign: plain values for tables, figures and reports."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration import (
    CalibrationData,
    Contradiction,
    ErrorSummary,
    ModelVerification,
)
from torquebench.compensation import Comparison, CompensationModel, NoiseFloor

if TYPE_CHECKING:
    from torquebench.procedures import FrictionSweep


@dataclass(frozen=True)
class DenseSweep:
    """Noise-free quasi-static readings of the simulated chain along a path of true torque.

    Attributes
    ----------
    true_torque_nm : float64[n]
        True torque at the reducer's flange in path order, N·m.
    reading_nm : float64[n]
        The chain's reading without noise at each torque, N·m.
    branch : int8[n]
        +1 where the magnitude of the torque grows, -1 where it falls.
    """

    true_torque_nm: NDArray[np.float64]
    reading_nm: NDArray[np.float64]
    branch: NDArray[np.int8]


@dataclass(frozen=True)
class CompensationResult:
    """Errors of one model (or none) on readings to which it wasn't fitted.

    Attributes
    ----------
    name : str
        Kind of the model as the registry of kinds names it; ``"raw"`` without compensation.
    title : str
        The kind in words, for tables and legends.
    recommended : bool
        Whether the campaign puts this model into use.
    model : CompensationModel or None
        The fitted model; None for ``"raw"``.
    fit_seconds : float
        Time that the fit took, s; 0 for ``"raw"``.
    torque_nm : float64[n]
        Torque at each reading of the verification, N·m.
    verification : ModelVerification
        Errors over the groups, against the standard and (simulated) against the truth.
    dense_torque_nm : float64[m] or None
        Torque along the dense noise-free sweep, N·m; None on a real bench.
    dense : ErrorSummary or None
        Errors of the dense sweep against the twin's true torque; None on a real bench.
    """

    name: str
    title: str
    recommended: bool
    model: CompensationModel | None
    fit_seconds: float
    torque_nm: NDArray[np.float64]
    verification: ModelVerification
    dense_torque_nm: NDArray[np.float64] | None = None
    dense: ErrorSummary | None = None


@dataclass(frozen=True)
class ModuleResult:
    """Calibration, compensation and verification of one module.

    Attributes
    ----------
    side : str
        ``"input"`` or ``"output"``.
    range_nm : float
        Full scale of the module, N·m.
    transducer_serial, counter_identity : str
        Transducer and counter for which the models are valid.
    profile_name, profile_hash : str
        The calibration profile and its SHA-256.
    calibration : CalibrationData
        The points that the models were fitted to.
    verification : CalibrationData
        Fresh points off the calibration's grid; `series` is the group, 1 to 10.
    raw : CompensationResult
        Errors without compensation.
    models : tuple of CompensationResult
        Errors with each model, the recommended one first.
    dense : DenseSweep or None
        Only on the simulated bench.
    run_ids : tuple of str
        Run folders that hold the raw data.
    """

    side: str
    range_nm: float
    transducer_serial: str
    counter_identity: str
    profile_name: str
    profile_hash: str
    calibration: CalibrationData
    verification: CalibrationData
    raw: CompensationResult
    models: tuple[CompensationResult, ...]
    dense: DenseSweep | None
    run_ids: tuple[str, ...]

    @property
    def recommended(self) -> CompensationResult:
        """The model that the campaign puts into use."""
        return next(result for result in self.models if result.recommended)


@dataclass(frozen=True)
class FitResult:
    """A model fitted to one table of a measuring chain, compared with alternatives.

    Attributes
    ----------
    source : str
        Name of the table.
    data : CalibrationData
        Points of the table.
    comparison : Comparison or None
        All candidates by cross-validation, if requested.
    noise : NoiseFloor or None
        Scatter of repeated points; None where no step was repeated.
    name, title : str
        Name of the fitted model, and its kind in words.
    model : CompensationModel
        Fitted to all points.
    raw, fitted : ErrorSummary
        Errors against the standard without compensation, and of the fit on its own points.
    remarks : tuple of str
        Warnings of the fit: outliers, averaged points.
    contradictions : tuple of Contradiction
        Contradictions of the points, because of which the model must not be used.
    """

    source: str
    data: CalibrationData
    comparison: Comparison | None
    noise: NoiseFloor | None
    name: str
    title: str
    model: CompensationModel
    raw: ErrorSummary
    fitted: ErrorSummary
    remarks: tuple[str, ...]
    contradictions: tuple[Contradiction, ...] = ()

    @property
    def cross_validated(self) -> dict[str, float]:
        """Errors of the model at held-out points, names with their unit; empty if not compared."""
        if self.comparison is None:
            return {}
        score = self.comparison.score(self.name)
        return {
            "cross_validated_worst_percent_fs": score.worst_percent_fs,
            "cross_validated_rms_percent_fs": score.rms_percent_fs,
        }


@dataclass(frozen=True)
class DemoResult:
    """Result of the demo: both modules calibrated, compensated, verified, and a reducer's friction.

    Attributes
    ----------
    bench_name : str
        Name in the bench description.
    simulated : bool
        Whether the bench is simulated; figures are labelled accordingly.
    preset, seed : str, int
        Preset and seed of the simulated bench.
    started : datetime
        Start in UTC.
    bench_seconds, elapsed_seconds : float
        Duration in the bench's time and in the user's, s.
    modules : tuple of ModuleResult
        Input, then output.
    friction : FrictionSweep or None
        No-load friction of the simulated standard reducer.
    friction_run_id : str
        Run folder of the friction sweep; empty without one.
    software_version : str
        Version of torquebench.
    """

    bench_name: str
    simulated: bool
    preset: str
    seed: int
    started: datetime
    bench_seconds: float
    elapsed_seconds: float
    modules: tuple[ModuleResult, ...]
    friction: FrictionSweep | None
    friction_run_id: str
    software_version: str
