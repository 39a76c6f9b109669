"""One module from calibration to verified, registered models."""

from __future__ import annotations

from typing import Any

import numpy as np

from torquebench.bench.roles import Side
from torquebench.calibration import (
    RAW,
    ErrorSummary,
    summarise_errors,
)
from torquebench.campaign.calibrating import FinishedCalibration
from torquebench.campaign.fitting import model_title
from torquebench.campaign.results import CompensationResult, DenseSweep, ModuleResult
from torquebench.campaign.verifying import VerifiedModels
from torquebench.chain import MeasuringChain, Readings
from torquebench.station import Station

DENSE_POINTS_PER_BRANCH = 1001


def dense_sweep(station: Station, side: Side) -> DenseSweep | None:
    """Sweep the simulated chain densely and without noise; None on a real bench.

    The path goes up and down in both directions, as the calibration did.
    """
    truth = station.devices.context.drivers.truth
    if truth is None:
        return None
    range_nm = station.description.module(side).range_nm
    rising = np.linspace(0.0, range_nm, DENSE_POINTS_PER_BRANCH)
    loop = np.concatenate([rising, rising[-2::-1]])
    path = np.concatenate([loop, -loop[1:]])
    reading_nm, branch = truth.dense_sweep(side, path)
    return DenseSweep(path, reading_nm, branch)


def module_result(
    calibrated: FinishedCalibration,
    verified: VerifiedModels,
    recommended: str,
    dense: DenseSweep | None,
) -> ModuleResult:
    """Collect the errors of every model in the verification and in the dense sweep.

    Parameters
    ----------
    recommended : str
        Name of the model in use.
    """
    data, profile = verified.measured.result.data, calibrated.measured.profile
    chains = [verified.chains[fitted.name] for fitted in calibrated.fitted]
    rows = [
        (
            fitted.name,
            fitted.title,
            fitted.model,
            fitted.seconds,
            chain.torque(data.readings()).value_nm,
            chain,
        )
        for fitted, chain in zip(calibrated.fitted, chains, strict=True)
    ]
    raw, *models = (
        CompensationResult(
            name=name,
            title=title,
            recommended=model is not None and name == recommended,
            model=model,
            fit_seconds=seconds,
            torque_nm=torque_nm,
            verification=verified.result.of(name),
            **_errors_of_sweep(chain, dense, data.range_nm),
        )
        for name, title, model, seconds, torque_nm, chain in (
            (RAW, model_title(RAW), None, 0.0, data.reading_nm, None),
            *rows,
        )
    )
    return ModuleResult(
        side=data.side,
        range_nm=data.range_nm,
        transducer_serial=data.transducer_serial,
        counter_identity=data.counter_identity,
        profile_name=profile.name,
        profile_hash=profile.sha256,
        calibration=calibrated.measured.result.data,
        verification=data,
        raw=raw,
        models=tuple(sorted(models, key=lambda model: not model.recommended)),
        dense=dense,
        run_ids=(calibrated.measured.record.run_id, verified.measured.record.run_id),
    )


def _errors_of_sweep(
    chain: MeasuringChain | None, sweep: DenseSweep | None, range_nm: float
) -> dict[str, Any]:
    """Return a dense sweep's compensated torques and their errors by the twin's truth."""
    if sweep is None:
        return {}
    torque = sweep.reading_nm
    if chain is not None:
        steady = Readings(
            sweep.reading_nm,
            branch=np.asarray(sweep.branch, dtype=np.float64),
            speed_rpm=0.0,
            acceleration_rad_s2=0.0,
            temperature_c=CALIBRATION_TEMPERATURE_C,
            zero_temperature_c=CALIBRATION_TEMPERATURE_C,
        )
        torque = chain.torque(steady).value_nm
    errors: ErrorSummary = summarise_errors(torque, sweep.true_torque_nm, range_nm)
    return {"dense_torque_nm": torque, "dense": errors}


CALIBRATION_TEMPERATURE_C = 23.0
"""Temperature of the noise-free sweep."""
