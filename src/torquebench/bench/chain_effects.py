"""Effects and limits of a measuring chain, from the bench's description."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date

from torquebench.bench.description import BenchDescription, StandardDescription
from torquebench.bench.roles import SIDES, Side
from torquebench.chain import (
    Counter,
    Creep,
    Drift,
    Effect,
    Inertia,
    MeasuringChain,
    Reference,
    Rotation,
    Temperature,
    Zero,
)
from torquebench.compensation import StoredModel
from torquebench.errors import ModelMismatchError
from torquebench.message import Message
from torquebench.units import DAYS_PER_YEAR, HOURS_PER_DAY

PROBE_K = 0.5
"""Limit of the difference between a probe on a standard and the temperature of its transducer,
K."""


def chain_effects(
    description: BenchDescription,
    side: Side,
    calibrated_c: float | None = None,
    calibrated_on: date | None = None,
    standard_c: Sequence[float] = (),
) -> tuple[Effect, ...]:
    """Return the effects of a side's measuring chain that the description states.

    Parameters
    ----------
    side : {"input", "output"}
    calibrated_c : float, optional
        Mean temperature of the transducer during the calibration, °C; the middle of the bench's
        temperatures where none was measured.
    calibrated_on : datetime.date, optional
        Day of the calibration; the last day of the standard's certificate where it isn't known.
    standard_c : sequence of float
        Temperatures that the standard had in the calibration, °C; empty where none was measured.
    """
    module = description.module(side)
    transducer, conditions = module.transducer, description.conditions
    # data sheets state shares of the transducer's own nominal torque
    nominal = transducer.nominal_torque_nm
    low, high = conditions.temperature_low_c, conditions.temperature_high_c
    datasheet = f"description of transducer {transducer.serial}"
    effects: list[Effect] = [
        standard_effect(description, side, calibrated_on, standard_c),
        Temperature(
            datasheet,
            1e-3 * transducer.temperature_zero_percent_per_10k * nominal,
            1e-3 * transducer.temperature_span_percent_per_10k,
            0.5 * (low + high) if calibrated_c is None else calibrated_c,
            low,
            high,
        ),
        Rotation(
            datasheet,
            1e-2 * transducer.speed_zero_percent_per_1000rpm * nominal,
            1e-2 * module.bearing_drag_percent * module.range_nm,
            module.limits.speed_rpm,
        ),
        Counter(f"counter {description.counter.identity}", description.counter_nm(side)),
    ]
    if module.flange_inertia_kgm2 is not None:
        moment = module.flange_inertia_kgm2
        effects.append(
            Inertia(
                "description of the flange",
                moment,
                moment * module.flange_inertia_uncertainty_percent / 200.0,
                module.drive.speed_rate_rad_per_s2,
            )
        )
    if transducer.creep_percent is not None:
        effects.append(Creep(datasheet, transducer.creep_percent))
    drift = transducer.zero_drift_percent_per_h
    effects.append(
        Zero(
            datasheet, None if drift is None else 1e-2 * drift * nominal, conditions.zero_interval_h
        )
    )
    if transducer.drift_percent_per_year is not None:
        interval_h = HOURS_PER_DAY * conditions.calibration_interval_days
        effects.append(Drift(datasheet, transducer.drift_percent_per_year, interval_h))
    return tuple(effects)


def standard_effect(
    description: BenchDescription,
    side: Side,
    calibrated_on: date | None = None,
    standard_c: Sequence[float] = (),
    mounted: StandardDescription | None = None,
) -> Reference:
    """Return the effect of a standard: its certificate, and possible changes since then.

    If the standard's temperature wasn't measured, it lies between the limits of the bench. By
    default the standard is the calibrator.
    """
    standard, conditions = mounted or description.calibrator, description.conditions
    transducer = standard.transducer(side)
    reached = standard_c or (conditions.temperature_low_c, conditions.temperature_high_c)
    largest_k = max(abs(reached_c - standard.certificate_temperature_c) for reached_c in reached)
    if standard_c:
        largest_k += PROBE_K
    drift = transducer.drift_percent_per_year
    years = _years_since_certificate(standard, calibrated_on)
    return Reference(
        f"certificate {standard.certificate_number} of {standard.serial}",
        standard.uncertainty(side),
        1e-3 * transducer.temperature_span_percent_per_10k * largest_k,
        None if drift is None else 1e-2 * drift * years,
    )


def _years_since_certificate(standard: StandardDescription, day: date | None) -> float:
    """Return the age of a certificate in years; one year if its day isn't stated."""
    try:
        performed = date.fromisoformat(standard.certificate_date)
    except ValueError:  # "unknown", or a date as text
        return 1.0
    until = day or standard.certificate_due
    return 1.0 if until is None else max((until - performed).days, 0) / DAYS_PER_YEAR


def chain_on_bench(stored: StoredModel, description: BenchDescription) -> MeasuringChain:
    """Return a stored chain with the limits of the bench that has its transducer.

    Raises
    ------
    ModelMismatchError
        The bench has another transducer, or the file doesn't name one.
    """
    modules = {side: description.module(side) for side in SIDES}
    serial = stored.provenance.transducer_serial
    for side, module in modules.items():
        if serial and serial == module.transducer.serial:
            return with_stated_limits(MeasuringChain.of(stored), description, side)
    raise ModelMismatchError(
        Message("a model of transducer {serial!r}", serial),
        Message.joined(module.transducer.serial for module in modules.values()),
        "fit the model with --serial, or take the description of the bench that it is used on",
    )


def with_stated_limits(
    chain: MeasuringChain, description: BenchDescription, side: Side
) -> MeasuringChain:
    """Return a chain with the bench's limits for influences that its model has no record of.

    A model that was fitted to a table lacks the effects of the bench on which it is used; a model
    that was calibrated on the bench has them already. The bench's reference standard isn't added,
    because the chain wasn't calibrated against it.

    Parameters
    ----------
    side : {"input", "output"}
    """
    effects = chain_effects(description, side)
    return chain.with_limits(effect for effect in effects if not isinstance(effect, Reference))
