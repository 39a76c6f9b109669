"""Effects of a measuring chain that the bench's description states beside its calibration."""

from __future__ import annotations

from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import Side
from torquebench.chain import Counter, Drift, Effect, Reference, Rotation, Temperature, Zero

__all__ = ["CERTIFIED_FROM_SHARE", "chain_effects"]

CERTIFIED_FROM_SHARE = 0.02
"""Smallest certified torque of a reference standard, as a share of its range: the first of 50
steps. Below it the standard's uncertainty falls in proportion, because the standard is zeroed."""


def chain_effects(
    description: BenchDescription, side: Side, calibrated_c: float | None = None
) -> tuple[Effect, ...]:
    """Return the effects of a side's measuring chain that the description states.

    Parameters
    ----------
    description : BenchDescription
    side : {"input", "output"}
    calibrated_c : float, optional
        Mean temperature of the transducer during the calibration, °C; the middle of the bench's
        temperatures where none was measured.
    """
    module, standard = description.module(side), description.calibrator
    transducer, conditions = module.transducer, description.conditions
    # a data sheet states shares of the transducer's own nominal torque
    nominal = transducer.nominal_torque_nm
    low, high = conditions.temperature_low_c, conditions.temperature_high_c
    certified = standard.transducer(side).nominal_torque_nm
    datasheet = f"description of transducer {transducer.serial}"
    effects: list[Effect] = [
        Reference(
            f"certificate {standard.certificate_number} of {standard.serial}",
            1e-2 * standard.expanded_uncertainty_percent * certified,
            CERTIFIED_FROM_SHARE * certified,
        ),
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
    if transducer.zero_drift_percent_per_h is not None:
        drift = 1e-2 * transducer.zero_drift_percent_per_h * nominal
        effects.append(Zero(datasheet, drift, conditions.zero_interval_h))
    if transducer.drift_percent_per_year is not None:
        interval_h = 24.0 * conditions.calibration_interval_days
        effects.append(Drift(datasheet, transducer.drift_percent_per_year, interval_h))
    return tuple(effects)
