"""The bench's contributions to the uncertainty of a reducer test, and its corrections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.chain_effects import chain_effects
from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES, Side
from torquebench.campaign.reducers.twist import TwistCompliance
from torquebench.chain import Readings, Rotation, Torque, TorqueParts
from torquebench.message import Message
from torquebench.procedures.reducers.running_table import RunningRecording
from torquebench.reducers import Tare, TorqueUncertainty, fit_tare
from torquebench.units import TURN

FloatArray = NDArray[np.float64]

UNCOMPENSATED_SHARE = 0.005
"""Half width of the error of a chain without compensation, as a share of full scale: the 0.5 %
reported for such benches (Measurement and Control, 2022, introduction).
"""
REPEATABILITY_SHARE = 2e-4
"""Standard deviation of a chain's torque after load changes, as a share of full scale: data sheets
of such transducers state 0.01-0.03 %. It doesn't change while the load stays, so that only repeats
average it; if there are repeats, their spread is used instead.
"""

LARGE = 0.5
"""Share of a loading's largest torque above which the torque counts as large."""


@dataclass(frozen=True)
class Bench:
    """Data of the bench for an evaluation.

    Parameters
    ----------
    twists : mapping of side to TwistCompliance
        Twist between each encoder and its flange; missing if unknown.
    tares : mapping of side to Tare
        Empty run of each side; missing without one.
    """

    description: BenchDescription
    twists: dict[Side, TwistCompliance]
    tares: dict[Side, Tare]


def uncompensated_uncertainty_nm(bench: Bench, side: Side) -> float:
    """Return the standard uncertainty of a torque without compensation, N·m."""
    range_nm = bench.description.module(side).range_nm
    return float(UNCOMPENSATED_SHARE * range_nm / np.sqrt(3.0))


def bench_remarks(bench: Bench, compensated: dict[Side, bool], sides: Sequence[Side]) -> list[str]:
    """Return remarks on torques that aren't compensated."""
    return [
        Message(
            "the {side} torque is not compensated: its uncertainty is the "
            "{uncompensated_percent:.1f} % of {range_nm:g} N·m, as published for such "
            "chains",
            side,
            100.0 * UNCOMPENSATED_SHARE,
            bench.description.module(side).range_nm,
        )
        for side in sides
        if not compensated[side]
    ]


def resolution_rad(bench: Bench, side: Side) -> float:
    """Return the angle of one count of an encoder."""
    return TURN / bench.description.needed_encoder(side).counts_per_revolution


def temperature_remarks(temperature_c: float) -> list[str]:
    """Return a remark on the reducer's temperature, if it was measured."""
    return (
        [Message("reducer at {value:.1f} °C", temperature_c)] if np.isfinite(temperature_c) else []
    )


def finite_temperature(temperature_c: FloatArray) -> FloatArray | None:
    """Return the temperatures if all of them were measured, else None."""
    return temperature_c if np.isfinite(temperature_c).all() else None


def tare_remarks(bench: Bench, running: RunningRecording) -> list[str]:
    """Return remarks on whether an empty run was subtracted, or what replaces it."""
    corrected = {
        side: stated
        for side, stated in running.stated.items()
        if stated is not None and np.any(stated.added("bearing drag") != 0.0)
    }
    if bench.tares:
        remarks = ["the reading of an empty run is subtracted"]
        largest = {
            side: float(np.max(np.abs([bench.tares[side].at(s).torque_nm for s in speeds])))
            for side, speeds in running.speed_rpm.items()
            if side in corrected
        }
        return remarks + [
            Message(
                "the empty run differs from the correction of the {side} measuring chain "
                "by up to {value:.2g} N·m",
                side,
                value,
            )
            for side, value in largest.items()
        ]
    if corrected.keys() >= running.stated.keys():
        return [
            "the measuring chain corrects zero over speed and bearing drag: no empty run is needed"
        ]
    return [
        "no empty run: zero over speed and the drag of the bench's bearings are contained "
        "in the torque and in its uncertainty"
    ]


def drift_remarks(running: RunningRecording) -> list[str]:
    """Return a remark on the number of points that hadn't settled."""
    if not running.unsettled:
        return []
    return [
        Message("{count} of {total} points still drifted", running.unsettled, running.repeat.size)
    ]


def root_mean_square(values: FloatArray) -> float:
    """Return the root mean square; 0 for an empty array."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0


# -- empty run ------------------------------------------------------------------------------


def tares_of(recording: RunningRecording, ratio: float) -> dict[Side, Tare]:
    """Fit the readings of both shafts in the empty run.

    Parameters
    ----------
    recording : RunningRecording
        Recording of an empty run.
    ratio : float
        Input turns for one output turn, negative where reversed.
    """
    speed: dict[Side, FloatArray] = {
        "input": recording.nominal_rpm,
        "output": recording.nominal_rpm / ratio,
    }
    return {
        side: fit_tare(
            speed[side],
            recording.torque_nm[side],
            repeat=recording.repeat,
            zero_nm=recording.zero_uncertainty_nm[side],
            stated=recording.stated[side],
        )
        for side in SIDES
    }


def without_tare(
    bench: Bench,
    torque_nm: FloatArray,
    speed_rpm: FloatArray,
    side: Side,
    known: tuple[TorqueUncertainty, ...],
) -> tuple[FloatArray, tuple[TorqueUncertainty, ...]]:
    """Return torques less the side's empty run, and their `known` uncertainties with its own."""
    tare = bench.tares.get(side)
    if tare is None:
        return torque_nm, known
    drags = [tare.at(float(speed)) for speed in speed_rpm]
    uncertainties = tuple(
        replace(
            own,
            zero_nm=hypot(own.zero_nm, tare.zero_nm),
            mounting_nm=hypot(own.mounting_nm, drag.scatter_nm, drag.transfer_nm),
        )
        for own, drag in zip(known, drags, strict=True)
    )
    return torque_nm - np.array([drag.torque_nm for drag in drags]), uncertainties


# -- torque of a running test ---------------------------------------------------------------


def torque_uncertainty(
    bench: Bench, recording: RunningRecording, side: Side
) -> tuple[TorqueUncertainty, ...]:
    """Return the uncertainty of a side's torque at each point, without the scatter of the repeats.

    It consists of the measuring chain's components at the point, grouped by what shares their
    errors (`TorqueParts`), without the errors that an empty run cancels.
    """
    zeros, stated = recording.zero_uncertainty_nm[side], recording.stated[side]
    tare = bench.tares.get(side)
    torque, speed = recording.torque_nm[side], np.abs(recording.speed_rpm[side])
    if stated is None:
        return (_without_chain(bench, side, zeros, tared=tare is not None),) * torque.size
    if tare is not None:
        stated = tare.left(stated, recording.speed_rpm[side])
    parts = TorqueParts.of(stated)
    turns = speed > 0.0
    columns = (
        parts.scale_nm / np.maximum(np.abs(torque), 1e-9),
        np.sqrt(zeros**2 + parts.zero_nm**2 + np.where(turns, 0.0, parts.shift_nm) ** 2),
        parts.curve_nm,
        np.where(turns, parts.shift_nm, 0.0) / np.where(turns, speed, 1.0),
        parts.mounting_nm,
        parts.loading_nm,
        np.hypot(parts.scatter_nm, parts.noise_nm),
    )
    return tuple(TorqueUncertainty(*row) for row in np.stack(columns, 1).tolist())


def _without_chain(bench: Bench, side: Side, zero_nm: float, *, tared: bool) -> TorqueUncertainty:
    """Return the published error limit of an uncompensated chain, and those of rotation."""
    module = bench.description.module(side)
    uncertainty = TorqueUncertainty(
        zero_nm=zero_nm,
        model_nm=uncompensated_uncertainty_nm(bench, side),
        repeatability_nm=REPEATABILITY_SHARE * module.range_nm,
    )
    if tared:
        return uncertainty
    turning = Readings(np.zeros(1), speed_rpm=_RPM)
    components = [
        component
        for effect in chain_effects(bench.description, side)
        if isinstance(effect, Rotation)
        for component in effect.components(turning, turning.reading_nm)
    ]
    parts = TorqueParts.of(Torque(turning.reading_nm, tuple(components)))
    return replace(
        uncertainty,
        speed_nm_per_rpm=float(parts.shift_nm[0]) / _RPM,
        mounting_nm=float(parts.mounting_nm[0]),
    )


_RPM = 1000.0
"""Speed at which the effect of rotation is evaluated; its zero error is proportional to the
speed."""


def torque_of_loading(parts: TorqueParts, torque_nm: FloatArray) -> TorqueUncertainty:
    """Return the uncertainty of the large torques of one slow loading: only noise averages out.

    Parameters
    ----------
    torque_nm : float64[n]
        Torques of the loading, N·m.
    """
    size = np.abs(torque_nm)
    large = np.flatnonzero(size > LARGE * np.max(size))
    mine = parts.at(large)
    return TorqueUncertainty(
        relative=root_mean_square(mine.scale_nm / size[large]),
        zero_nm=root_mean_square(np.hypot(mine.zero_nm, mine.shift_nm)),
        model_nm=root_mean_square(mine.curve_nm),
        mounting_nm=root_mean_square(mine.mounting_nm),
        loading_nm=root_mean_square(mine.loading_nm),
        repeatability_nm=root_mean_square(mine.scatter_nm),
    )
