"""Transmission error over full output revolutions: peak to peak, orders, both directions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import Samples, count_step, outliers
from torquebench.reducers.quantities import (
    Finding,
    LimitedQuantity,
    ResultQuantity,
    budget,
)
from torquebench.reducers.transmission.revolution import Revolution, mean_revolution
from torquebench.reducers.transmission.runs import (
    Run,
    check_ratio,
    check_return,
    highest_supported,
    one_way,
    runs_of,
)
from torquebench.uncertainty import Budget, BudgetLine, Shared
from torquebench.units import ARCSEC, MINUTE, TURN

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

LARGEST_ORDERS = 8
"""Number of orders that a result lists."""
STRONG_SHARE = 0.01
"""Share of the peak to peak value from which on an order above the highest one is reported."""


@dataclass(frozen=True)
class AngleUncertainty:
    """Standard uncertainties (k = 1) of the encoders, rad.

    Parameters
    ----------
    output_rad : float
        Uncertainty from errors of the output encoder that repeat with the revolution, rad.
    input_rad : float
        Uncertainty from errors of the input encoder, at the input, rad; the ratio divides it.
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
    amplitude : Budget
        Amplitude (half of peak to peak) of this order, arcsec.
    phase_rad : float
        Angle of its first maximum times the order, −π to π.
    """

    order: float
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
        Standard error of that mean; NaN with one revolution.
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
        for direction in self.directions:
            short = direction.direction.replace("-", "_")
            rows.append(
                ResultQuantity(
                    f"transmission_error_{short}",
                    Message("transmission error, {direction}", direction.direction),
                    direction.peak_to_peak,
                    Message(
                        "{revolutions} revolution{value}",
                        direction.revolutions,
                        "" if direction.revolutions == 1 else "s",
                    ),
                )
            )
            rows += [
                ResultQuantity(
                    f"order_{order.order:g}_{short}",
                    Message("order {order:g}, {direction}", order.order, direction.direction),
                    order.amplitude,
                    "amplitude",
                )
                for order in direction.orders
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
    row: ArrayLike | None = None,
    keep_outliers: bool = False,
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
        Highest order per output revolution that is reported; three times the ratio by default, as
        far as the samples support it.
    row : array of int, shape (n,), optional
        Number of each sample in its file, for messages.
    keep_outliers : bool
        Evaluate single samples far from their neighbours with the others.

    Raises
    ------
    InputError
        Less than one output revolution in a direction (see `evaluate_swings`), fewer than 10
        samples per period of the highest order, a wrong ratio, an encoder that slips, swapped
        columns.

    Examples
    --------
    >>> turned = np.linspace(0.0, 2.0 * np.pi, 8001)
    >>> error = np.radians(20.0 / 3600.0) * np.sin(10.0 * turned)
    >>> found = evaluate_transmission_error(10.0 * turned, turned + error, 10.0)
    >>> round(found.peak_to_peak.value, 1), found.directions[0].orders[0].order
    (40.0, 10.0)
    """
    if not (np.isfinite(ratio) and abs(ratio) > 0.0):
        raise InputError(Message("ratio {ratio}", ratio), "input turns for one output turn, not 0")
    if highest_order is not None and not (np.isfinite(highest_order) and highest_order >= 1.0):
        raise InputError(
            Message("highest order {highest}", highest_order), "1 per output revolution or more"
        )
    samples = Samples.of(
        32,
        row=row,
        keep=keep_outliers,
        input_rad=input_angle_rad,
        output_rad=output_angle_rad,
        time_s=time_s,
    )
    samples = angles_screened(samples, ratio)
    input_rad, output_rad = samples["input_rad"], samples["output_rad"]
    check_ratio(input_rad, output_rad, ratio)
    steps = (count_step(output_rad), count_step(input_rad) / abs(ratio))
    runs = runs_of(input_rad, output_rad, ratio, float(np.hypot(*steps)))
    chosen: dict[str, Run] = {}
    for run in runs:
        best = chosen.get(run.direction)
        longer = best is None or np.ptp(run.angle_rad) > np.ptp(best.angle_rad)
        if run.turns >= 1 and longer:
            chosen[run.direction] = run
    if not chosen:
        longest = max(float(np.ptp(run.angle_rad)) for run in runs)
        raise InputError(
            Message("{longest:.4g} output revolutions in one direction", longest / TURN),
            "at least one whole output revolution in each direction",
            Message(
                "turn the input by {ratio:g} revolutions or more without a reversal", abs(ratio)
            ),
        )
    highest, findings = _highest(chosen, ratio, highest_order)
    stated = uncertainty or AngleUncertainty()
    directions, means = [], []
    for run in chosen.values():
        check_return(run, ratio)
        revolution = mean_revolution(run, highest)
        means.append(revolution)
        time = samples.columns.get("time_s")
        directions.append(_direction(run, revolution, ratio, stated, steps, highest, time))
    worst = max(directions, key=lambda each: each.peak_to_peak.value)
    return TransmissionErrorResult(
        ratio=float(ratio),
        highest_order=float(highest),
        directions=tuple(directions),
        peak_to_peak=worst.peak_to_peak,
        reversal_arcsec=_reversal(means, stated, ratio),
        findings=(*samples.findings, *findings, *_cut(means), *_findings(directions)),
    )


def angles_screened(samples: Samples, ratio: float) -> Samples:
    """Leave out samples at which one of the encoders is an outlier, seen in their difference."""
    error = samples["output_rad"] - samples["input_rad"] / ratio
    bad = _far_off(error, samples["input_rad"], 0.0)
    input_rad, output_rad = (samples[name][~bad] for name in ("input_rad", "output_rad"))
    step = count_step(output_rad) + count_step(input_rad) / abs(ratio)
    return samples.less({"angle": _far_off(error, samples["input_rad"], step)})


def _far_off(
    error: NDArray[np.float64], angle: NDArray[np.float64], step: float
) -> NDArray[np.bool_]:
    """Return which errors are far from their neighbours in a stretch without a reversal."""
    bad = np.zeros(error.size, dtype=np.bool_)
    for start, stop in one_way(angle):
        # Three samples at either end aren't judged: at a reversal the backlash makes a jump.
        bad[start + 3 : stop - 2] = outliers(error[start : stop + 1], step)[3:-3]
    return bad


def _highest(
    runs: dict[str, Run], ratio: float, stated: float | None
) -> tuple[float, list[Finding]]:
    """Return the highest order: the stated one, three times the ratio, or the supported one."""
    wanted = 3.0 * abs(ratio) if stated is None else stated
    supported = min(highest_supported(run) for run in runs.values())
    if supported >= wanted:
        return wanted, []
    if stated is None and supported >= max(abs(ratio), 3.0):
        supported = float(np.floor(supported))
        return supported, [
            Finding(
                "few samples",
                Message(
                    "orders up to {supported:g} are evaluated, instead of {wanted:g}: higher ones "
                    "have fewer than ten samples a period",
                    supported,
                    wanted,
                ),
                "turn more slowly or sample faster",
            )
        ]
    raise InputError(
        Message(
            "{samples:.3g} samples per period of the order {highest_order:g}",
            10.0 * supported / wanted,
            wanted,
        ),
        "at least 10",
        Message(
            "turn more slowly or sample faster, or limit the report to order {turn:.4g}",
            float(np.floor(supported)),
        ),
    )


def _direction(
    run: Run,
    revolution: Revolution,
    ratio: float,
    uncertainty: AngleUncertainty,
    steps: tuple[float, float],
    highest: float,
    time: NDArray[np.float64] | None,
) -> DirectionError:
    """Return the transmission error of one direction with its budget and largest orders."""
    resolutions = [_count_error(run, step, highest) for step in steps]
    resolution = float(np.linalg.norm(resolutions)) / ARCSEC
    encoders = float(np.hypot(uncertainty.output_rad, uncertainty.input_rad / ratio)) / ARCSEC
    peak_to_peak = budget(
        revolution.peak_to_peak_arcsec,
        "arcsec",
        [
            BudgetLine(
                "encoders",
                _between_peaks(revolution, uncertainty, ratio),
                shared=Shared.CALIBRATION,
            ),
            BudgetLine("noise", 2.0**0.5 * revolution.noise_arcsec, revolution.noise_freedom),
            BudgetLine("noise at the peaks", revolution.peak_noise_arcsec),
            BudgetLine("resolution", 2.0**0.5 * resolution),
        ],
    )
    largest = np.argsort(-revolution.amplitude_arcsec, kind="stable")[:LARGEST_ORDERS]
    orders = tuple(
        ErrorOrder(
            order=float(revolution.order[index]),
            amplitude=budget(
                float(revolution.amplitude_arcsec[index]),
                "arcsec",
                [
                    BudgetLine("encoders", encoders, shared=Shared.CALIBRATION),
                    BudgetLine(
                        "noise",
                        float(revolution.amplitude_error_arcsec[index]),
                        revolution.noise_freedom,
                    ),
                    BudgetLine("resolution", resolution / max(revolution.order.size, 1) ** 0.5),
                ],
            ),
            phase_rad=float(revolution.phase_rad[index]),
        )
        for index in largest
    )
    speed = float("nan")
    if time is not None:
        seconds = float(abs(time[run.rows][-1] - time[run.rows][0]))
        speed = float(np.ptp(run.angle_rad)) / TURN / seconds * MINUTE if seconds > 0 else speed
    return DirectionError(
        direction=run.direction,
        revolutions=revolution.revolutions,
        angle_rad=revolution.angle_rad,
        error_arcsec=revolution.error_arcsec,
        standard_error_arcsec=revolution.standard_error_arcsec,
        peak_to_peak=peak_to_peak,
        order=revolution.order,
        amplitude_arcsec=revolution.amplitude_arcsec,
        orders=orders,
        speed_rpm=speed,
    )


def _count_error(run: Run, step_rad: float, highest: float) -> float:
    """Return the standard uncertainty of the evaluated orders by an encoder's counts, rad.

    The low-pass filter averages the counts like noise, unless they beat slowly with the samples.
    """
    if step_rad == 0.0:
        return 0.0
    spacing = float(np.ptp(run.angle_rad)) / (run.angle_rad.size - 1)
    counts = spacing / step_rad
    slow = abs(counts - round(counts)) * TURN / spacing < 2.0 * highest
    if counts > 0.5 and slow:
        share = 1.0
    else:
        share = min(1.0, (2.0 * highest * max(spacing, step_rad) / TURN) ** 0.5)
    return float(step_rad / 12.0**0.5 * share)


def _between_peaks(revolution: Revolution, uncertainty: AngleUncertainty, ratio: float) -> float:
    """Return the effect of the encoders' errors on max − min, arcsec.

    An error with a period of one turn contributes 2·|sin(Δ/2)| of its standard uncertainty, Δ being
    the encoder's angle between both peaks. Other errors contribute √2 times their uncertainty.
    """
    places = revolution.angle_rad[
        [np.argmax(revolution.error_arcsec), np.argmin(revolution.error_arcsec)]
    ]
    distance = float(places[0] - places[1])
    parts = (uncertainty.output_rad, distance), (uncertainty.input_rad / ratio, distance * ratio)
    factors = [spread * max(2.0**0.5, 2.0 * abs(np.sin(0.5 * delta))) for spread, delta in parts]
    return float(np.hypot(*factors)) / ARCSEC


def _reversal(
    means: list[Revolution], uncertainty: AngleUncertainty, ratio: float
) -> Budget | None:
    """Return the difference of both directions' means; None for one direction."""
    if len(means) < 2:
        return None
    noise = [
        BudgetLine("noise", mean.noise_arcsec / (2.0 * mean.order.size) ** 0.5) for mean in means
    ]
    encoders = float(np.hypot(uncertainty.output_rad, uncertainty.input_rad / ratio)) / ARCSEC
    value = abs(means[0].mean_rad - means[1].mean_rad) / ARCSEC
    common = BudgetLine("encoders", 2.0**0.5 * encoders, shared=Shared.CALIBRATION)
    return budget(value, "arcsec", [*noise, common])


def _cut(means: list[Revolution]) -> list[Finding]:
    """Report a strong order above the highest one, which the peak to peak value leaves out."""
    worst = max(means, key=lambda each: each.cut_arcsec)
    noise = worst.noise_arcsec / max(worst.order.size, 1) ** 0.5
    if worst.cut_arcsec <= max(STRONG_SHARE * worst.peak_to_peak_arcsec, 5.0 * noise):
        return []
    return [
        Finding(
            "strong order left out",
            Message(
                "order {order:g}, above the highest evaluated one, has an amplitude of "
                "{amplitude:.4g} arcsec: the peak to peak value is that of the orders below",
                worst.cut_order,
                worst.cut_arcsec,
            ),
            "evaluate up to a higher order",
        )
    ]


def _findings(directions: list[DirectionError]) -> list[Finding]:
    """Report a missing direction and missing repeats."""
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
    if any(direction.revolutions == 1 for direction in directions):
        findings.append(
            Finding(
                "one revolution",
                "the repeatability of the error is unknown: the noise above the highest order is "
                "used",
                "measure two output revolutions or more",
            )
        )
    return findings
