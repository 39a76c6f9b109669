"""Verification of models with fresh points of the bench, which are drawn anew each time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Unpack

import numpy as np

from torquebench.bench.roles import Side
from torquebench.calibration import RAW, Profile, VerificationResult
from torquebench.calibration import verify as compare_with_models
from torquebench.campaign.bench_chains import used_chain
from torquebench.campaign.measuring import Measured, RunKind, RunOptions
from torquebench.chain import MeasuringChain
from torquebench.message import Message
from torquebench.procedures import StaircaseResult, verify
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import REGISTERS, ModelEntry, Registry, RunFolder
from torquebench.records.signatures import operator_name
from torquebench.station import Station, enter_run


@dataclass(frozen=True, eq=False)
class VerifiedModels:
    """Fresh points of a verification, and the models that were compared with them.

    `chains` have the bench's limits.
    """

    measured: Measured[StaircaseResult]
    models: Mapping[str, ModelEntry]
    chains: Mapping[str, MeasuringChain]
    result: VerificationResult


def verify_on_bench(
    station: Station,
    side: Side,
    profile: Profile,
    models: Mapping[str, ModelEntry],
    seed: int | None = None,
    **options: Unpack[RunOptions],
) -> VerifiedModels:
    """Measure fresh points, compare models with them, and register the results.

    Parameters
    ----------
    side : {"input", "output"}
    profile : Profile
        Profile of random torques.
    models : mapping of str to ModelEntry
        Models of this module, by name.
    seed : int, optional
        Seed of the points; random by default.
    **options
        See `RunOptions`.
    """
    registry = station.registry
    for entry in models.values():
        entry.check_file()  # before anything moves
    seed = int(np.random.default_rng().integers(2**32)) if seed is None else seed
    numbers = {name: entry.model_id for name, entry in models.items()}
    options["metadata"] = {**(options.get("metadata") or {}), REGISTERS: {"models": numbers}}
    measured = measure_verification(station, side, profile, seed, **options)
    progress = options.get("progress", NO_PROGRESS)
    return VERIFICATION.evaluate_and_register(registry, measured, progress)


def measure_verification(
    station: Station, side: Side, profile: Profile, seed: int, **options: Unpack[RunOptions]
) -> Measured[StaircaseResult]:
    """Verify one module against the verification standard at points drawn by `seed`."""
    options["metadata"] = {"seed": seed, **options.get("metadata", {})}
    rng = np.random.default_rng(seed)
    steps = profile.staircase(station.description.module(side).range_nm, rng)
    return VERIFICATION.measure(station, side, profile, steps, **options)


def _evaluate(
    registry: Registry, measured: Measured[StaircaseResult], _progress: Progress
) -> VerifiedModels:
    """Compare the points with the models that the run's record names."""
    data, metadata = measured.result.data, measured.record.metadata
    numbers: Mapping[str, int] = metadata[REGISTERS]["models"]
    models = {name: registry.model(int(number)) for name, number in numbers.items()}
    chains = {name: used_chain(entry, metadata, data) for name, entry in models.items()}
    return VerifiedModels(measured, models, chains, compare_with_models(data, chains))


def _register(
    registry: Registry, measured: Measured[StaircaseResult], verified: VerifiedModels
) -> VerifiedModels:
    """Enter the errors of each model and of the raw reading, unless the run has entries."""
    record, folder = measured.record, RunFolder(measured.record.folder)
    with registry.writing():
        enter_run(registry, folder)
        for name, entry in verified.models.items():
            if any(
                verification.run_id == record.run_id
                for verification in registry.verifications(entry.model_id)
            ):
                continue
            registry.add_verification(
                entry.model_id,
                replace(verified.result, models=tuple(map(verified.result.of, (RAW, name)))),
                run_id=record.run_id,
                performed=datetime.fromisoformat(folder.manifest["sealed"]),
                measured_by=str(record.metadata.get("operator") or operator_name()),
            )
    return verified


VERIFICATION = RunKind(
    "verify-{side}",
    lambda side: Message("Verifying the {side} module", side),
    verify,
    _evaluate,
    _register,
    lambda verified: Message(
        "run {run_id} is registered as a verification", verified.measured.record.run_id
    ),
)
