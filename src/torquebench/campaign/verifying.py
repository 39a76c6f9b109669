"""Models of a module against fresh points of the bench, which are drawn anew each time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from torquebench.bench.drivers.base import Side
from torquebench.bench.stated_limits import with_stated_limits
from torquebench.calibration import Profile, VerificationResult, verify
from torquebench.campaign.measuring import Measured, RunOptions, measure_verification
from torquebench.campaign.registering import register_verification, registered_patiently
from torquebench.chain import MeasuringChain, load_chain
from torquebench.procedures import StaircaseResult
from torquebench.progress import NO_PROGRESS
from torquebench.records import REGISTERS, ModelEntry
from torquebench.station import Station

__all__ = ["VerifiedModels", "verify_on_bench"]


@dataclass(frozen=True, eq=False)
class VerifiedModels:
    """Outcome of a verification on the bench.

    Parameters
    ----------
    measured : Measured
        The fresh points.
    chains : mapping of str to MeasuringChain
        By the name of the model; with the bench's limits.
    result : VerificationResult
        By which the points were drawn.
    """

    measured: Measured[StaircaseResult]
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
    """Measure fresh points, compare models with them and register the outcome.

    Parameters
    ----------
    station : Station
    side : {"input", "output"}
    profile : Profile
        Of random torques.
    models : mapping of str to ModelEntry
        Of this module, by name.
    seed : int, optional
        By default drawn anew.
    **options
        See `RunOptions`.
    """
    registry = station.registry
    chains = {
        name: with_stated_limits(load_chain(entry.check_file()), station.description, side)
        for name, entry in models.items()
    }
    seed = int(np.random.default_rng().integers(2**32)) if seed is None else seed
    numbers = {name: entry.model_id for name, entry in models.items()}
    options["metadata"] = {**(options.get("metadata") or {}), REGISTERS: {"models": numbers}}
    measured = measure_verification(station, side, profile, seed, **options)
    result = verify(measured.result.data, chains)
    registered_patiently(
        registry,
        measured.record.run_id,
        lambda: register_verification(registry, models, result, measured.record),
        options.get("progress", NO_PROGRESS),
    )
    return VerifiedModels(measured, chains, result)
