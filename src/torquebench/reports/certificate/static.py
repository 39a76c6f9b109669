"""The static evaluation of a calibration for its certificate."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration import (
    CalibrationData,
    CalibrationResults,
    Profile,
    SideBySide,
    StaticEvaluation,
    calibration_results,
    ladder_points,
)
from torquebench.chain import MeasuringChain
from torquebench.errors import InputError
from torquebench.reports.certificate.record import (
    Reference,
    StaticClass,
    StaticRow,
    StaticTable,
    ZeroHysteresisStatement,
)


def resolution_of(data: CalibrationData) -> float:
    """Return the default resolution of a chain's indication in N·m.

    A counter resolves far less than the noise, so the resolution is taken from the noise: twice the
    median standard error of a point's mean.
    """
    if data.standard_error_nm is None:
        return 0.0
    return 2.0 * float(np.median(data.standard_error_nm))


def static_tables(
    data: CalibrationData,
    profile: Profile,
    chain: MeasuringChain | None,
    reference: Reference,
    resolution_nm: float,
) -> tuple[tuple[StaticTable, ...], ZeroHysteresisStatement | None]:
    """Return the static evaluation by direction, raw and compensated, and the zero hysteresis.

    For an adaptive calibration, only the coarse series is evaluated, because only its steps are
    repeated.

    Parameters
    ----------
    data : CalibrationData
        Points with nominal torques.
    profile : Profile
        Profile of the calibration.
    chain : MeasuringChain or None
        If given, the compensated torque is evaluated, too.
    reference : Reference
        Reference standard, whose uncertainty enters.
    resolution_nm : float

    Returns
    -------
    tuple
        The tables and the zero hysteresis; empty and None where the steps don't allow an
        evaluation.
    """
    torque = None if chain is None else chain.torque(data.readings()).value_nm
    stepped = ladder_points(data, profile)
    if not np.any(stepped):
        return (), None
    try:
        results = calibration_results(
            data.subset(stepped),
            resolution_nm=resolution_nm,
            reference=reference.uncertainty(data.range_nm),
            torque_nm=None if torque is None else torque[stepped],
        )
    except InputError:  # a step or a series is missing, as the deviations state
        return (), None
    tables = []
    for direction in results.directions:
        for side, compensated in ((direction.before, False), (direction.after, True)):
            if side is not None:
                tables.append(_table(side, direction.direction, compensated, resolution_nm))
    return tuple(tables), zero_hysteresis_statement(results)


def zero_hysteresis_statement(results: CalibrationResults) -> ZeroHysteresisStatement | None:
    """Return the zero hysteresis of reversing cycles; None for other calibrations."""
    before, after = results.zero_before, results.zero_after
    if before is None:
        return None
    return ZeroHysteresisStatement(
        before.cycles,
        before.worst_nm,
        before.worst_percent_fs,
        None if after is None else after.worst_nm,
        None if after is None else after.worst_percent_fs,
    )


def _table(
    side: SideBySide, direction: int, compensated: bool, resolution_nm: float
) -> StaticTable:
    evaluation = side.evaluation
    classes: list[StaticClass] = []
    if side.classification is not None:
        # From the best class to the worst; a worse class is listed only if its range begins at a
        # smaller torque.
        for accuracy_class, start in sorted(side.classification.starts_nm.items()):
            if start is not None and (not classes or start < classes[-1].from_nm):
                classes.append(StaticClass(accuracy_class, start))
    return StaticTable(
        direction=direction,
        compensated=compensated,
        rows=tuple(_rows(side)),
        degree=side.interpolation.degree,
        resolution_nm=resolution_nm,
        zero_residual=evaluation.zero_residual_percent,
        classes=tuple(classes),
        missing=tuple(_missing(evaluation)),
    )


def _rows(side: SideBySide) -> Iterator[StaticRow]:
    columns = side.columns
    for row, torque in enumerate(side.evaluation.torque_nm):
        yield StaticRow(
            torque_nm=float(torque),
            indication=_at(columns["f_q"], row),
            repeatability=_at(columns["b′"], row),
            reproducibility=_at(columns["b"], row),
            interpolation=_at(columns["f_a"], row),
            reversibility=_at(columns["h"], row),
            expanded=float(side.expanded_percent[row]),
            interval=float(side.interval_percent[row]),
        )


def _at(values: NDArray[np.float64] | None, row: int) -> float | None:
    return None if values is None or np.isnan(values[row]) else float(values[row])


def _missing(evaluation: StaticEvaluation) -> Iterator[str]:
    """Yield the symbols of quantities that a class limits but that weren't measured."""
    for symbol, value in (
        ("b′", evaluation.repeatability_percent),
        ("b", evaluation.reproducibility_range_percent),
        ("f₀", evaluation.zero_residual_percent),
    ):
        if value is None:
            yield symbol
