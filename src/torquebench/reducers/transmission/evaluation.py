"""Transmission error over full output revolutions: peak to peak, orders, both directions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import finite_columns
from torquebench.reducers.quantities import (
    Contribution,
    Finding,
    LimitedQuantity,
    ResultQuantity,
    budget,
)
from torquebench.reducers.transmission.curve import Revolution, mean_revolution
from torquebench.reducers.transmission.segments import (
    Run,
    check_ratio,
    check_sampling,
    check_slip,
    runs_of,
)
from torquebench.uncertainty import Budget, Shared
from torquebench.units import ARCSEC, MINUTE, TURN

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

__all__ = [
    "AngleUncertainty",
    "DirectionError",
    "ErrorOrder",
    "TransmissionErrorResult",
    "evaluate_transmission_error",
]

LARGEST_ORDERS = 8
"""Number of orders that a result lists."""


@dataclass(frozen=True)
class AngleUncertainty:
    """Standard uncertainties (k = 1) of the encoders, rad.

    Parameters
    ----------
    output_rad : float
        Of the output encoder: errors that repeat with the revolution.
    input_rad : float
        Of the input encoder, at the input; the ratio divides it.
    """

    output_rad: float = 0.0
    input_rad: float = 0.0


@dataclass(frozen=True)
class ErrorOrder:
    """One order of the transmission error.

    Parameters
    ----------
    order : float
        Periods per output revolution.
    input_order : float
        Periods per input revolution.
    amplitude : Budget
        Amplitude (half of peak to peak) of this order, arcsec.
    phase_rad : float
        Angle of its first maximum times the order, −π to π.
    """

    order: float
    input_order: float
    amplitude: Budget
    phase_rad: float


@dataclass(frozen=True, eq=False)
class DirectionError:
    """Transmission error in one direction of rotation.

    Parameters
    ----------
    direction : {"clockwise", "counter-clockwise"}
        Of the output.
    revolutions : int
        Whole output revolutions that were used.
    angle_rad : array of float, shape (n,)
        Output angle θ_o over one revolution at even steps, from 0.
    error_arcsec : array of float, shape (n,)
        Mean over the revolutions, mean removed, low-pass filtered in angle.
    standard_error_arcsec : array of float, shape (n,)
        Of that mean; NaN with one revolution.
    peak_to_peak : Budget
        ATE = max − min, arcsec.
    order, amplitude_arcsec : array of float, shape (m,)
        Whole spectrum up to the highest order.
    orders : tuple of ErrorOrder
        The largest ones, largest first.
    speed_rpm : float
        Mean output speed; NaN without times.
    """

    direction: Literal["clockwise", "counter-clockwise"]
    revolutions: int
    angle_rad: NDArray[np.float64]
    error_arcsec: NDArray[np.float64]
    standard_error_arcsec: NDArray[np.float64]
    peak_to_peak: Budget
    order: NDArray[np.float64]
    amplitude_arcsec: NDArray[np.float64]
    orders: tuple[ErrorOrder, ...]
    speed_rpm: float


@dataclass(frozen=True, eq=False)
class TransmissionErrorResult:
    """Transmission error of a reducer.

    Parameters
    ----------
    ratio, highest_order : float
        The values used: input turns for one output turn (negative if reversed), and the low-pass
        limit in periods per output revolution.
    directions : tuple of DirectionError
        One or both.
    peak_to_peak : Budget
        The larger of both directions, arcsec.
    reversal_arcsec : Budget or None
        Mean gap between both directions (lost motion of the unloaded reducer); None where only one
        was recorded. Meaningful only without zeroing in between.
    findings : tuple of Finding
    """

    ratio: float
    highest_order: float
    directions: tuple[DirectionError, ...]
    peak_to_peak: Budget
    reversal_arcsec: Budget | None
    findings: tuple[Finding, ...]

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        rule = Message("max − min, orders up to {highest_order:g}", self.highest_order)
        rows = [ResultQuantity("transmission_error", "transmission error", self.peak_to_peak, rule)]
        for each in self.directions:
            short = each.direction.replace("-", "_")
            rows.append(
                ResultQuantity(
                    f"transmission_error_{short}",
                    Message("transmission error, {direction}", each.direction),
                    each.peak_to_peak,
                    Message(
                        "{revolutions} revolution{value}",
                        each.revolutions,
                        "" if each.revolutions == 1 else "s",
                    ),
                )
            )
            rows += [
                ResultQuantity(
                    f"order_{order.order:g}_{short}",
                    Message("order {order:g}, {direction}", order.order, each.direction),
                    order.amplitude,
                    "amplitude",
                )
                for order in each.orders
            ]
        if self.reversal_arcsec is not None:
            rows.append(ResultQuantity("reversal", "gap at reversal", self.reversal_arcsec))
        return tuple(rows)

    def limited(self, limits: DataSheetLimits) -> Iterator[LimitedQuantity]:
        """Return the values that the data sheet limits; those without a limit may be left out."""
        only = self.quantities()[0]
        limit = limits.transmission_error_arcsec
        yield LimitedQuantity(only.key, only.title, only.estimate, upper=limit)


def evaluate_transmission_error(
    input_angle_rad: ArrayLike,
    output_angle_rad: ArrayLike,
    ratio: float,
    *,
    time_s: ArrayLike | None = None,
    highest_order: float | None = None,
    uncertainty: AngleUncertainty | None = None,
) -> TransmissionErrorResult:
    """Evaluate θ_o − θ_i/R over whole output revolutions, each direction by itself.

    The longest of several runs in one direction is used.

    Parameters
    ----------
    input_angle_rad, output_angle_rad : array of float, shape (n,)
        Both encoders at the same moments, unwrapped, rad; both directions one after another.
    ratio : float
        Input turns for one output turn; negative where the output turns against the input.
    time_s : array of float, shape (n,), optional
        Moments, for the speed only.
    highest_order : float, optional
        Highest order per output revolution that is reported; three times the ratio by default.
    uncertainty : AngleUncertainty, optional

    Raises
    ------
    InputError
        Less than one output revolution in a direction, fewer than 10 samples per period of the
        highest order, a wrong ratio, an encoder that slips, swapped columns, values not finite.

    Examples
    --------
    >>> turned = np.linspace(0.0, 2.0 * np.pi, 8001)
    >>> error = np.radians(20.0 / 3600.0) * np.sin(10.0 * turned)
    >>> found = evaluate_transmission_error(10.0 * turned, turned + error, 10.0)
    >>> round(found.peak_to_peak.value, 1), found.directions[0].orders[0].order
    (40.0, 10.0)
    """
    given, taken = finite_columns(
        32, input_angle_rad=input_angle_rad, output_angle_rad=output_angle_rad
    )
    time = None if time_s is None else finite_columns(given.size, time_s=time_s)[0]
    if not (np.isfinite(ratio) and abs(ratio) > 0.0):
        raise InputError(Message("ratio {ratio}", ratio), "input turns for one output turn, not 0")
    highest = 3.0 * abs(ratio) if highest_order is None else highest_order
    if not (np.isfinite(highest) and highest >= 1.0):
        raise InputError(
            Message("highest order {highest}", highest), "1 per output revolution or more"
        )
    check_ratio(given, taken, ratio)
    chosen: dict[str, Run] = {}
    for run in runs_of(given, taken, ratio):
        best = chosen.get(run.direction)
        if best is None or np.ptp(run.angle_rad) > np.ptp(best.angle_rad):
            chosen[run.direction] = run
    known = uncertainty or AngleUncertainty()
    directions, means = [], []
    for run in chosen.values():
        check_sampling(run, highest)
        check_slip(run, ratio)
        revolution = mean_revolution(run, highest)
        means.append(revolution)
        directions.append(_direction(run, revolution, ratio, known, time))
    worst = max(directions, key=lambda each: each.peak_to_peak.value)
    return TransmissionErrorResult(
        ratio=float(ratio),
        highest_order=float(highest),
        directions=tuple(directions),
        peak_to_peak=worst.peak_to_peak,
        reversal_arcsec=_reversal(means, known, ratio),
        findings=tuple(_findings(directions)),
    )


def _direction(
    run: Run,
    found: Revolution,
    ratio: float,
    known: AngleUncertainty,
    time: NDArray[np.float64] | None,
) -> DirectionError:
    encoders = float(np.hypot(known.output_rad, known.input_rad / ratio)) / ARCSEC
    peak_to_peak = budget(
        found.peak_to_peak_arcsec,
        "arcsec",
        [
            Contribution(
                "encoders", _between_peaks(found, known, ratio), shared=Shared.CALIBRATION
            ),
            Contribution("noise", 2.0**0.5 * found.noise_arcsec, found.noise_freedom),
            Contribution("noise at the peaks", found.peak_noise_arcsec),
        ],
    )
    largest = np.argsort(-found.amplitude_arcsec, kind="stable")[:LARGEST_ORDERS]
    orders = tuple(
        ErrorOrder(
            order=float(found.order[index]),
            input_order=float(found.order[index] / abs(ratio)),
            amplitude=budget(
                float(found.amplitude_arcsec[index]),
                "arcsec",
                [
                    Contribution("encoders", encoders, shared=Shared.CALIBRATION),
                    Contribution(
                        "noise", float(found.amplitude_error_arcsec[index]), found.noise_freedom
                    ),
                ],
            ),
            phase_rad=float(found.phase_rad[index]),
        )
        for index in largest
    )
    speed = float("nan")
    if time is not None:
        seconds = float(abs(time[run.rows][-1] - time[run.rows][0]))
        speed = float(np.ptp(run.angle_rad)) / TURN / seconds * MINUTE if seconds > 0 else speed
    return DirectionError(
        direction=run.direction,
        revolutions=found.revolutions,
        angle_rad=found.angle_rad,
        error_arcsec=found.error_arcsec,
        standard_error_arcsec=found.standard_error_arcsec,
        peak_to_peak=peak_to_peak,
        order=found.order,
        amplitude_arcsec=found.amplitude_arcsec,
        orders=orders,
        speed_rpm=speed,
    )


def _between_peaks(found: Revolution, known: AngleUncertainty, ratio: float) -> float:
    """Return the effect of the encoders' errors on max − min, arcsec.

    Errors with a period of one turn differ most between places half a turn of the encoder apart: by
    2·|sin(Δ/2)| of their standard uncertainty. Other errors contribute √2 of it.
    """
    places = found.angle_rad[[np.argmax(found.error_arcsec), np.argmin(found.error_arcsec)]]
    apart = float(places[0] - places[1])
    parts = (known.output_rad, apart), (known.input_rad / ratio, apart * ratio)
    factors = [each * max(2.0**0.5, 2.0 * abs(np.sin(0.5 * delta))) for each, delta in parts]
    return float(np.hypot(*factors)) / ARCSEC


def _reversal(means: list[Revolution], known: AngleUncertainty, ratio: float) -> Budget | None:
    if len(means) < 2:
        return None
    noise = [
        Contribution("noise", each.noise_arcsec / each.error_arcsec.size**0.5) for each in means
    ]
    encoders = float(np.hypot(known.output_rad, known.input_rad / ratio)) / ARCSEC
    value = abs(means[0].mean_rad - means[1].mean_rad) / ARCSEC
    common = Contribution("encoders", 2.0**0.5 * encoders, shared=Shared.CALIBRATION)
    return budget(value, "arcsec", [*noise, common])


def _findings(directions: list[DirectionError]) -> list[Finding]:
    findings = []
    if len(directions) == 1:
        findings.append(
            Finding(
                "one direction",
                Message(
                    "only {direction} was measured over a whole revolution", directions[0].direction
                ),
                "measure both directions in turn",
            )
        )
    if any(each.revolutions == 1 for each in directions):
        findings.append(
            Finding(
                "one revolution",
                "the repeatability of the error is unknown: the noise above the highest order is "
                "used",
                "measure two output revolutions or more",
            )
        )
    return findings
