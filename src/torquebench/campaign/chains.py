"""Effects of a measuring chain that a person states or that its calibration shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from torquebench.calibration import CalibrationData
from torquebench.chain import (
    Counter,
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


def reference_effect(
    data: CalibrationData,
    certified: CertifiedUncertainty | None,
    source: str,
    remark: Callable[[str], object],
) -> tuple[Effect, ...]:
    """Return the effect of the reference standard of a table, if one is stated.

    Parameters
    ----------
    data : CalibrationData
        Points, whose own standard counts by default.
    certified : CertifiedUncertainty or None
        U (k = 2) over the torque that a person states instead.
    source : str
        Name of the table in messages.
    remark : callable
        Called with a sentence if the table states another standard.
    """
    if certified is None:
        return () if data.reference is None else (data.reference,)
    remark_another_standard(data, certified, source, remark)
    return (Reference(certified.record or "stated with the fit", certified),)


def remark_another_standard(
    data: CalibrationData,
    certified: CertifiedUncertainty,
    source: str,
    remark: Callable[[str], object],
) -> None:
    """Call `remark` with a sentence if a table's U of the standard isn't the stated one."""
    if data.reference is not None and data.reference.certified != certified:
        noted, described = (
            standard.largest_nm(data.range_nm) for standard in (data.reference.certified, certified)
        )
        remark(
            Message(
                "{source} states U of the standard up to {noted:.4g} N·m; the U that "
                "was entered, up to {given:.4g} N·m, is used instead",
                source,
                noted,
                described,
            )
        )


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
    """Return a chain's effects, with those that a person states in place of its own.

    Parameters
    ----------
    range_nm : float
        Full scale, N·m.
    reference : CertifiedUncertainty, optional
        U (k = 2) of the standard over the torque.
    span_percent_per_10k, zero_percent_per_10k, drift_percent_per_year
        Values of the command's options of these names; None keeps the chain's.
    zero_nm : float, optional
        Standard uncertainty of the zero, N·m.
    """
    record = "stated on the command line"
    effects: list[Effect] = (
        [] if reference is None else [Reference(reference.record or record, reference)]
    )
    if span_percent_per_10k is not None or zero_percent_per_10k is not None:
        warmth = chain.find(Temperature) or Temperature(record, None, None)
        if zero_percent_per_10k is not None:
            warmth = replace(warmth, zero_nm_per_k=1e-3 * zero_percent_per_10k * range_nm)
        if span_percent_per_10k is not None:
            warmth = replace(warmth, span_per_k=1e-3 * span_percent_per_10k)
        effects.append(replace(warmth, record=record))
    if drift_percent_per_year is not None:
        effects.append(Drift(record, drift_percent_per_year))
    if zero_nm is not None and chain.find(Zero) is None:
        effects.append(Zero(record, None))
    return tuple(effects)


def step_noise(data: CalibrationData, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects with the points' standard error, which their scatter contains."""
    if data.standard_error_nm is None:
        return tuple(effects)
    steps_nm = float(np.nanmedian(data.standard_error_nm))
    others = tuple(effect for effect in effects if not isinstance(effect, Counter))
    counter = next((effect for effect in effects if isinstance(effect, Counter)), None)
    known = counter or Counter("standard errors of the calibration's points")
    return (*others, replace(known, steps_nm=steps_nm))


def mounting_effect(data: CalibrationData) -> tuple[Effect, ...]:
    """Return the reproducibility of mounting, from several mounting positions; none without them.

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
