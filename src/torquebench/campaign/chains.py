"""Effects of a measuring chain as a person or a bench states them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import date
from typing import Any

import numpy as np

from torquebench.bench.chain_effects import chain_effects
from torquebench.bench.description import BenchDescription, stated_uncertainty
from torquebench.calibration import CalibrationData
from torquebench.chain import (
    Drift,
    Effect,
    MeasuringChain,
    Mounting,
    Reference,
    Temperature,
    Zero,
)
from torquebench.message import Message
from torquebench.uncertainty import CertifiedUncertainty

__all__ = [
    "bench_effects",
    "mounting_effect",
    "recorded_effects",
    "reference_effect",
    "stated_effects",
]


def reference_effect(
    certified: CertifiedUncertainty | None, record: str = "stated with the fit"
) -> tuple[Effect, ...]:
    """Return the effect of a reference standard; none if none is stated.

    Parameters
    ----------
    certified : CertifiedUncertainty or None
        U (k = 2) over the torque.
    record : str
        Where that comes from.
    """
    return () if certified is None else (Reference(record, certified),)


def stated_effects(
    chain: MeasuringChain,
    range_nm: float,
    *,
    reference: CertifiedUncertainty | None = None,
    span_percent_per_10k: float | None = None,
    zero_percent_per_10k: float | None = None,
    drift_percent_per_year: float | None = None,
    zero_nm: float | None = None,
) -> tuple[Effect, ...]:
    """Return effects with limits that a person states, in the place of those that a chain has.

    Parameters
    ----------
    chain : MeasuringChain
    range_nm : float
        Full scale, N·m.
    reference : CertifiedUncertainty, optional
        U (k = 2) of the standard over the torque.
    span_percent_per_10k, zero_percent_per_10k, drift_percent_per_year
        As on the command line; None keeps the chain's.
    zero_nm : float, optional
        Standard uncertainty of the zero, N·m.
    """
    known = {type(effect): effect for effect in chain.stored}
    record = "stated on the command line"
    effects = list(reference_effect(reference, record))
    if span_percent_per_10k is not None or zero_percent_per_10k is not None:
        warmth = known.get(Temperature)
        assert warmth is None or isinstance(warmth, Temperature)
        warmth = warmth or Temperature(record, 0.0, 0.0)
        if zero_percent_per_10k is not None:
            warmth = replace(warmth, zero_nm_per_k=1e-3 * zero_percent_per_10k * range_nm)
        if span_percent_per_10k is not None:
            warmth = replace(warmth, span_per_k=1e-3 * span_percent_per_10k)
        effects.append(replace(warmth, record=record))
    if drift_percent_per_year is not None:
        effects.append(Drift(record, drift_percent_per_year))
    if zero_nm is not None and Zero not in known:
        effects.append(Zero(record, 0.0))
    return tuple(effects)


def bench_effects(
    description: BenchDescription, data: CalibrationData, day: date | None = None
) -> tuple[Effect, ...]:
    """Return the effects of a calibration that was measured on a bench, on a day if it is known."""
    temperature, standard = data.temperature_c, data.standard_temperature_c
    return chain_effects(
        description,
        "input" if data.side == "input" else "output",
        None if temperature is None else float(np.mean(temperature)),
        day,
        () if standard is None else (float(np.min(standard)), float(np.max(standard))),
    )


def recorded_effects(metadata: Mapping[str, Any], data: CalibrationData) -> tuple[Effect, ...]:
    """Return the effects of a calibration as its run has recorded them.

    Parameters
    ----------
    metadata : mapping
        Of the run: the bench's description at the time, or the standard of an external calibration.
    data : CalibrationData
    """
    if "bench" in metadata:
        return bench_effects(BenchDescription.model_validate(metadata["bench"]), data)
    standard = metadata["standard"]
    certified = stated_uncertainty(standard, data.side, data.range_nm)
    record = Message(
        "certificate {certificate_number} of {serial}",
        standard["certificate_number"] or "unknown",
        standard["serial"],
    )
    return reference_effect(certified, record)


def mounting_effect(data: CalibrationData) -> tuple[Effect, ...]:
    """Return the reproducibility of mounting from several mounting positions; none without them.

    The span of each position is the slope of standard over reading through zero.
    """
    if data.position_deg is None or np.unique(data.position_deg).size < 2:
        return ()
    spans = [
        float(data.standard_nm[here] @ data.reading_nm[here])
        / float(data.reading_nm[here] @ data.reading_nm[here])
        for position in np.unique(data.position_deg)
        for here in (data.position_deg == position,)
    ]
    percent = 100.0 * float(np.std(spans, ddof=1))
    return (Mounting(f"{len(spans)} mounting positions of the calibration", percent),)
