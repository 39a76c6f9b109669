"""Effects of a measuring chain that was calibrated on a bench, or with a recorded standard."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from torquebench.bench.chain_effects import chain_effects, standard_effect, with_stated_limits
from torquebench.bench.description import BenchDescription, StandardDescription, stated_uncertainty
from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData
from torquebench.chain import Effect, MeasuringChain, Reference, load_chain
from torquebench.message import Message
from torquebench.records import ModelEntry

__all__ = ["bench_effects", "check_standard", "recorded_effects", "referenced", "used_chain"]


def bench_effects(description: BenchDescription, data: CalibrationData) -> tuple[Effect, ...]:
    """Return the chain's effects after a calibration on a bench."""
    temperature = data.temperature_c
    return chain_effects(
        description,
        _side(data),
        None if temperature is None else float(np.mean(temperature)),
        data.measured_on,
        _standard_c(data),
    )


def recorded_effects(metadata: Mapping[str, Any], data: CalibrationData) -> tuple[Effect, ...]:
    """Return the chain's effects after a calibration, from the record of its run.

    Parameters
    ----------
    metadata : mapping
        Of the run: the bench's description at the time, or the standard of an external calibration.
    """
    if "bench" in metadata:
        return bench_effects(BenchDescription.model_validate(metadata["bench"]), data)
    return (_recorded_standard(metadata["standard"], data),)


def used_chain(
    entry: ModelEntry, metadata: Mapping[str, Any], data: CalibrationData
) -> MeasuringChain:
    """Return a model's chain with the limits of the bench of a run.

    Parameters
    ----------
    metadata : mapping
        Metadata of the run: the bench's description at the time.
    data : CalibrationData
        Points of the run.

    Raises
    ------
    RecordError
        The model's file is missing or was changed.
    """
    bench = BenchDescription.model_validate(metadata["bench"])
    return with_stated_limits(load_chain(entry.check_file()), bench, _side(data))


def _recorded_standard(standard: Mapping[str, Any], data: CalibrationData) -> Reference:
    """Return the effect of the standard of an external calibration."""
    certified = stated_uncertainty(standard, data.side, data.range_nm)
    record = Message(
        "certificate {certificate_number} of {serial}",
        standard["certificate_number"] or "unknown",
        standard["serial"],
    )
    limits = {name: standard.get(name) for name in Reference.LIMITS}
    return Reference(record, certified, **limits)


def referenced(
    data: CalibrationData, metadata: Mapping[str, Any], serial: str = ""
) -> CalibrationData:
    """Return points of a run with the standard that its metadata state, to be written as a table.

    Parameters
    ----------
    metadata : mapping
        Of the run: the bench's description at the time, or the standard of an external calibration.
    serial : str
        Serial number of the mounted standard; the calibrator's by default.
    """
    if "bench" not in metadata:
        standard = metadata.get("standard")
        known = None if standard is None else _recorded_standard(standard, data)
        return replace(data, reference=known)
    description = BenchDescription.model_validate(metadata["bench"])
    mounted = description.verification_standard
    effect = _mounted_standard(description, data, mounted if mounted.serial == serial else None)
    return replace(data, reference=effect)


def check_standard(metadata: Mapping[str, Any], data: CalibrationData) -> Reference:
    """Return the standard of a check or a verification as an effect.

    Parameters
    ----------
    metadata : mapping
        Metadata of the run: the bench's description at the time.
    data : CalibrationData
        Points of the run.
    """
    description = BenchDescription.model_validate(metadata["bench"])
    return _mounted_standard(description, data, description.verification_standard)


def _mounted_standard(
    description: BenchDescription, data: CalibrationData, mounted: StandardDescription | None
) -> Reference:
    return standard_effect(
        description, _side(data), data.measured_on, _standard_c(data), mounted=mounted
    )


def _side(data: CalibrationData) -> Side:
    return "input" if data.side == "input" else "output"


def _standard_c(data: CalibrationData) -> tuple[float, ...]:
    """Return the standard's lowest and highest temperature, °C; empty if it wasn't measured."""
    standard = data.standard_temperature_c
    return () if standard is None else (float(np.min(standard)), float(np.max(standard)))
