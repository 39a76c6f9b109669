"""Identify the effects of temperature, rotation and acceleration as tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torquebench.chain.effect import Effect
from torquebench.chain.effects import Inertia, MeasuredRotation, MeasuredTemperature, Zero
from torquebench.chain.grid import numbers
from torquebench.chain.identification.basis import (
    Block,
    Circumstances,
    blocks,
    direction,
    running_in_columns,
)
from torquebench.chain.identification.evidence import Normal, Posterior, explore, gain
from torquebench.chain.identification.records import (
    EmptyRun,
    TurningCalibration,
    Zeros,
    related_to_one_zero,
    stretches,
    usual_points,
)
from torquebench.chain.identification.ripple import identify_ripple, without_ripple
from torquebench.chain.readings import FloatArray, Readings
from torquebench.compensation import CompensationModel, features, make_model
from torquebench.compensation.curve_uncertainty import student_widening
from torquebench.errors import InputError
from torquebench.message import Message

_UNIT = 1e-4
"""Unit of the columns' weights, as a share of full scale."""
_NOISE, _NOISE_SPREAD = 1.0, 1.5
LEAST_KELVIN = 4.0
"""Smallest range of temperatures that identifies zero or span, K."""
_LEAST_SPEEDS = 4
_LEAST_RAD_S2 = 1.0
_LEAST_LOAD = 0.2
_FEWEST_POINTS = 8
_BEND = 0.045
"""Prior size of local bumps over temperature, as a share of the linear part over 20 K."""
_OUTLIER = 5.0
_RUNNING_IN_GAIN = 6.0
_LEAST_EXTENSION_K = 10.0
_NODE_K = 2.0
_SPEED_NODES = 48
_STILL = 0.001
_FEWEST_IN_BIN = 20
_MOST_ROWS = 20_000
"""Largest number of rows in a run; samples of longer runs are averaged in groups."""


@dataclass(frozen=True)
class Identified:
    """Identified effects of one chain.

    Parameters
    ----------
    effects : tuple of Effect
        Measured temperature, rotation and inertia, as far as the data identify them.
    corrected_nm : float64 array of shape (n,)
        Readings of the calibration, converted to standstill and to its temperature.
    series : int array of shape (n,)
        Number of the group of consecutive points under the same conditions, in the order of time.
    remarks : tuple of str
        Effects that weren't identified, and the runs that would identify them.
    """

    effects: tuple[Effect, ...]
    corrected_nm: FloatArray
    series: NDArray[np.int64]
    remarks: tuple[str, ...]


def identify(
    calibration: TurningCalibration, runs: Sequence[EmptyRun], range_nm: float
) -> Identified:
    """Identify temperature, rotation and inertia of a chain.

    Parameters
    ----------
    calibration : TurningCalibration
        Points at standstill, and optionally at other temperatures and against a turning reference.
    runs : sequence of EmptyRun
        Empty if the calibration alone identifies the temperature's effects.
    range_nm : float
        Full scale, N·m.

    Raises
    ------
    InputError
        Empty runs without information, or incompatible with the calibration.
    """
    ripple = identify_ripple(runs)
    related, runs, zeros = related_to_one_zero(calibration, runs)
    data = _Data.of(related, without_ripple(ripple, runs), range_nm)
    remarks = list(data.gaps())
    lengths_s = [float(run.time_s[-1] - run.time_s[0]) for run in runs]
    used = [block for block in blocks(lengths_s) if block.group == "" or block.group in data.groups]
    if not data.groups:
        return Identified(
            (),
            calibration.reading_nm,
            stretches(calibration.speed_rpm, calibration.temperature_c),
            tuple(remarks),
        )
    fitted = _Fit.of(data, used)
    effects = (*_effects(fitted), *([] if ripple is None else [ripple]))
    corrected = _corrected(related, effects)
    if zeros is not None:
        usual_nm, zero = _zero(fitted, zeros, _remanence(related, corrected))
        corrected = corrected - usual_nm
        effects = (*effects, *zero)
    return Identified(
        effects,
        corrected,
        stretches(calibration.speed_rpm, calibration.temperature_c),
        tuple(remarks),
    )


def _corrected(calibration: TurningCalibration, effects: Sequence[Effect]) -> FloatArray:
    """Return a calibration's readings corrected by effects, long after running-in."""
    readings = Readings(
        calibration.reading_nm,
        speed_rpm=calibration.speed_rpm,
        temperature_c=calibration.temperature_c,
        zero_temperature_c=calibration.zero_temperature_c,
        acceleration_rad_s2=0.0,
        time_s=np.full(calibration.reading_nm.size, np.inf),  # long after running-in
        window_s=np.inf,
    )
    torque = calibration.reading_nm
    for effect in effects:
        for part in effect.components(readings, torque):
            torque = torque + part.value_nm
    return torque


@dataclass(frozen=True, eq=False)
class _Data:
    """Rows of calibration and empty runs in units of the fit, and the identified effects."""

    range_nm: float
    calibrated_c: float
    largest_rpm: float
    largest_rad_s2: float
    limits_rpm: tuple[float, float]
    limits_c: tuple[float, float]
    groups: frozenset[str]
    points: Circumstances
    target: FloatArray
    runs: tuple[tuple[Circumstances, FloatArray], ...]
    words: str
    window_s: float = 0.0
    point_noise: float | None = None
    """Standard error of the calibration's points, share of full scale, if known."""
    additional: Callable[[FloatArray], FloatArray] = np.zeros_like
    """Additional torque by the static curve at readings of unknown branch, N·m."""

    @classmethod
    def of(
        cls, calibration: TurningCalibration, runs: Sequence[EmptyRun], range_nm: float
    ) -> _Data:
        """Convert and combine the rows of calibration and runs."""
        warm = calibration.temperature_c
        warmth = [run.temperature_c for run in runs]
        if warm is None and runs and np.ptp(np.concatenate(warmth)) >= LEAST_KELVIN:
            raise InputError(
                "a calibration without temperature_c, and empty runs at several temperatures",
                "the temperature of every point, so that the runs can be related to it",
                "add the column, or give empty runs at the calibration's temperature only",
            )
        temperatures = np.concatenate([*warmth, *([] if warm is None else [warm])] or [np.zeros(1)])
        if warm is None:
            warm = np.full(calibration.reading_nm.size, float(np.mean(temperatures)))
        near = usual_points(calibration.speed_rpm, warm)
        calibrated_c = float(np.mean(warm[near]))
        speeds = np.concatenate([calibration.speed_rpm, *(run.speed_rpm for run in runs)])
        largest_rpm = max(float(np.max(np.abs(speeds))), 1.0)
        accelerations = [np.abs(run.acceleration) for run in runs]
        # the accelerations at the ends of ramps are derived from the speed and aren't those of the
        # drive
        largest_rad_s2 = float(np.quantile(np.concatenate(accelerations), 0.995)) if runs else 0.0
        share = calibration.standard_nm / range_nm
        curve = _static_curve(calibration, near, range_nm)
        static_nm = _additional_at(curve, calibration.standard_nm, calibration.branch)
        data = cls(
            range_nm,
            calibrated_c,
            largest_rpm,
            largest_rad_s2,
            (float(np.min(speeds)), float(np.max(speeds))),
            (float(np.min(temperatures)), float(np.max(temperatures))),
            frozenset(),
            Circumstances.of(
                share.size,
                share=share,
                branch=calibration.branch,
                speed=calibration.speed_rpm / largest_rpm,
                turning=direction(calibration.speed_rpm),
                warmth_k=warm - calibrated_c,
                zeroed_k=0.0
                if calibration.zero_temperature_c is None
                else calibration.zero_temperature_c - calibrated_c,
                time_s=np.full(share.size, np.inf),
            ),
            (calibration.reading_nm - calibration.standard_nm + static_nm) / (_UNIT * range_nm),
            (),
            _words(calibration, runs),
            float(np.median(np.concatenate([np.diff(run.time_s) for run in runs])))
            if runs
            else 0.0,
            _point_noise(calibration, range_nm),
            lambda reading_nm: _additional(curve, reading_nm, np.zeros(reading_nm.size)),
        )
        data = replace(data, runs=tuple(data._run(run, n) for n, run in enumerate(runs, 1)))
        return replace(data, groups=data._identified(warm, calibration, runs))

    def _run(self, run: EmptyRun, number: int) -> tuple[Circumstances, FloatArray]:
        """Return an empty run's circumstances and its readings in the unit of the fit."""
        rows = Circumstances.of(
            len(run),
            speed=run.speed_rpm / self.largest_rpm,
            turning=direction(run.speed_rpm),
            warmth_k=run.temperature_c - self.calibrated_c,
            acceleration=run.acceleration / max(self.largest_rad_s2, 1e-9),
            time_s=run.time_s,
            run=number,
            since=run.time_s - run.time_s[0],
        )
        return rows, run.reading_nm / (_UNIT * self.range_nm)

    def _identified(
        self, warm: FloatArray, calibration: TurningCalibration, runs: Sequence[EmptyRun]
    ) -> frozenset[str]:
        """Return the names of the functions that the measured conditions suffice to identify."""
        groups = set()
        if self.limits_c[1] - self.limits_c[0] >= LEAST_KELVIN:
            groups.add("zero")
        loaded = np.abs(calibration.standard_nm) > _LEAST_LOAD * self.range_nm
        if loaded.any() and np.ptp(warm[loaded]) >= LEAST_KELVIN:
            groups.add("span")
        driven = [run.speed_rpm for run in runs] or [calibration.speed_rpm]
        turning = np.concatenate([direction(speed_rpm) for speed_rpm in driven])
        speeds = [speed_rpm[direction(speed_rpm) != 0] for speed_rpm in driven]
        shares = np.unique(
            np.round(20.0 * np.concatenate([*speeds, np.zeros(0)]) / self.largest_rpm)
        )
        if shares.size >= _LEAST_SPEEDS:
            groups.add("odd")
            if {-1.0, 1.0} <= set(turning.tolist()):
                groups.add("even")
            turned = loaded & (direction(calibration.speed_rpm) != 0)
            if turned.any():
                groups |= {"load", "speed span"} if "even" in groups else {"load"}
        if runs and self.largest_rad_s2 >= _LEAST_RAD_S2:
            groups.add("inertia")
        return frozenset(groups)

    def gaps(self) -> list[str]:
        """Return the effects that weren't identified, and the runs that would identify them."""
        has_runs = bool(self.runs)
        descriptions = {
            "zero": Message(
                "zero over temperature: all data lie within {least_kelvin:g} K; an empty "
                "run at another temperature would identify it",
                LEAST_KELVIN,
            ),
            "span": "span over temperature: a series at another temperature would identify it",
            "odd": "zero and drag over speed: an empty run over all working speeds, in "
            "both directions, would identify it",
            "even": "zero shift separate from drag: the empty run has one direction "
            "only; torques in the other direction are refused until both are measured",
            "load": "drag over load: series against a rotating reference would identify it",
            "inertia": "inertia: an empty run with ramps would identify it",
        }
        if not self.groups and has_runs:
            raise InputError(
                "empty runs at one speed, one temperature and without a ramp",
                Message("different speeds, or temperatures {least_kelvin:g} K apart", LEAST_KELVIN),
                "record the empty run over all working speeds, or repeat it warm and cold",
            )
        if not self.groups and not np.any(self.points.turning):
            return []
        missing = [name for name in descriptions if name not in self.groups]
        if "odd" in missing:
            missing = [name for name in missing if name not in ("even", "load")]
        return [Message("not identified: {what}", descriptions[name]) for name in missing]


def _point_noise(calibration: TurningCalibration, range_nm: float) -> float | None:
    """Return the noise of a point, share of the range; None if unknown."""
    error = calibration.standard_error_nm
    if error is None or not np.isfinite(error).all():
        return None
    return float(np.sqrt(np.mean(np.square(error)))) / range_nm


def _words(calibration: TurningCalibration, runs: Sequence[EmptyRun]) -> str:
    """Return the provenance of the effects in words."""
    points = Message("{size} points of the calibration", calibration.reading_nm.size)
    if not runs:
        return points
    names = ", ".join(run.source for run in runs)
    return Message(
        "empty run{value} {names}; {points}", "s" if len(runs) > 1 else "", names, points
    )


def _static_curve(
    calibration: TurningCalibration, near: NDArray[np.bool_], range_nm: float
) -> CompensationModel:
    """Return a static curve from the points at standstill and at one temperature."""
    rows = near if np.sum(near) >= _FEWEST_POINTS else np.ones(near.size, dtype=bool)
    if np.sum(rows) < _FEWEST_POINTS:
        raise InputError(
            Message("{count} points", int(np.sum(rows))),
            Message("at least {fewest_points} for a chain that turns", _FEWEST_POINTS),
        )
    model = make_model("hybrid", range_nm=range_nm)
    X = features(calibration.reading_nm[rows], calibration.branch[rows], 0.0)
    return model.fit(X, calibration.standard_nm[rows])


def _additional(curve: CompensationModel, reading_nm: FloatArray, branch: FloatArray) -> FloatArray:
    """Return what the curve adds to readings, N·m; outside its range, as at the range's end."""
    inside = np.clip(reading_nm, curve.reading_low_nm_, curve.reading_high_nm_)
    return np.asarray(curve.predict(features(inside, branch, 0.0)) - inside)


def _additional_at(
    curve: CompensationModel, torque_nm: FloatArray, branch: FloatArray
) -> FloatArray:
    """Return the additional torque at true torques, N·m."""
    return _additional(curve, torque_nm - _additional(curve, torque_nm, branch), branch)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Posterior of all blocks, and functions of it."""

    data: _Data
    used: tuple[Block, ...]
    members: dict[str, NDArray[np.intp]]
    posterior: Posterior
    running_in_s: float
    left_over: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros(0))
    """Speed as a share of the largest speed, and the fit's residuals in the empty runs."""

    @classmethod
    def of(cls, data: _Data, used: Sequence[Block]) -> _Fit:
        """Fit, find outliers and correlated noise, and fit again."""
        points = Normal.of(_columns(used, data.points), data.target)
        together = int(np.ceil(max((len(rows) for rows, _ in data.runs), default=1) / _MOST_ROWS))
        runs = [_averaged(used, rows, target, together) for rows, target in data.runs]
        sizes = [block.columns(_at_rest(data.points)).shape[1] for block in used]
        centres, widths = _prior(used, 2 if runs else 1)
        first = explore(_groups(runs, points), sizes, centres, widths, doubtful=False)
        runs, slowness = _cleaned(runs, first)
        centres = _tied(
            centres, used, data, _Fit(data, tuple(used), _members(used, sizes), first, 0.0)
        )
        groups = _groups(runs, points, slowness)
        fitted = explore(groups, sizes, centres, widths, first.theta, doubtful=False)
        time_s = _running_in(runs, slowness, fitted, points, sizes, (centres, widths), data)
        if time_s:
            block = Block("running-in", "running-in", running_in_columns(time_s), 0.3)
            used, sizes = [*used, block], [*sizes, 3]
            runs = [(np.hstack([c, _columns([block], rows)]), t, rows) for c, t, rows in runs]
            points = Normal.of(_columns(used, data.points), data.target)
            groups = _groups(runs, points, slowness)
            at = len(used) - 1
            centres, widths = np.insert(centres, at, np.log(0.3)), np.insert(widths, at, 1.5)
            start = np.insert(fitted.theta, at, np.log(0.3))
        else:
            start = fitted.theta
        posterior = explore(groups, sizes, centres, widths, start)
        single = np.sqrt(together)  # converts residuals of group means to those of single samples
        left_over = (
            np.concatenate([np.zeros(0), *(np.abs(rows.speed) for _, _, rows in runs)]),
            np.concatenate([np.zeros(0), *(single * (t - c @ posterior.mean) for c, t, _ in runs)]),
        )
        return cls(data, tuple(used), _members(used, sizes), posterior, time_s, left_over)

    def function(self, group: str, at: Circumstances) -> tuple[FloatArray, FloatArray]:
        """Return value and standard uncertainty of a group of blocks, as shares of full scale."""
        own = [block for block in self.used if block.group == group]
        members = np.concatenate([self.members[block.name] for block in own])
        value, u = self.posterior.at(_columns(own, at), members)
        return _UNIT * value, _UNIT * u


_Run = tuple[FloatArray, FloatArray, Circumstances]


def _columns(used: Sequence[Block], rows: Circumstances) -> FloatArray:
    return np.concatenate([block.columns(rows) for block in used], axis=1)


def _averaged(
    used: Sequence[Block], rows: Circumstances, target: FloatArray, together: int
) -> _Run:
    """Return a run averaged over groups of samples, to limit its size."""
    if together == 1:
        return _columns(used, rows), target, rows
    count = target.size // together

    def means(values: FloatArray) -> FloatArray:
        return np.asarray(values.reshape(-1, together, *values.shape[1:]).mean(axis=1))

    parts = []
    for start in range(0, count, _MOST_ROWS // together):
        chunk = slice(start * together, min(start + _MOST_ROWS // together, count) * together)
        parts.append(means(_columns(used, rows.at(chunk))))
    complete = slice(0, count * together)
    mean = {name: means(getattr(rows, name)[complete]) for name in rows.__dataclass_fields__}
    return np.concatenate(parts), means(target[complete]), Circumstances(**mean)


def _at_rest(rows: Circumstances) -> Circumstances:
    """Return the circumstances at rest with the first row's share of the torque."""
    return Circumstances.of(1, share=float(rows.share[0]))


def _members(used: Sequence[Block], sizes: Sequence[int]) -> dict[str, NDArray[np.intp]]:
    """Return the columns of each block of coefficients, where blocks stand side by side."""
    ends = np.cumsum(sizes)
    return {
        block.name: np.arange(end - size, end)
        for block, size, end in zip(used, sizes, ends, strict=True)
    }


def _prior(used: Sequence[Block], groups: int) -> tuple[FloatArray, FloatArray]:
    """Return means and deviations of the logarithms of blocks' scales and of groups' noise."""
    centres = [np.log(block.scale) for block in used] + [np.log(_NOISE)] * groups
    widths = [block.spread for block in used] + [_NOISE_SPREAD] * groups
    return np.array(centres), np.array(widths)


def _groups(runs: Sequence[_Run], points: Normal, slowness: float = 1.0) -> list[Normal]:
    """Return the equations of all runs, with rows that are alike thinned out, and of the points."""
    if not runs:
        return [points]
    total = sum((Normal.of(c, t) for c, t, _ in runs[1:]), Normal.of(*runs[0][:2]))
    return [total.thinned(slowness), points]


def _cleaned(runs: list[_Run], fit: Posterior) -> tuple[list[_Run], float]:
    """Return the runs without outliers, and the autocorrelation time of their noise."""
    if not runs:
        return runs, 1.0
    residuals = [target - columns @ fit.mean for columns, target, _ in runs]
    noise = 1.4826 * float(np.median(np.abs(np.concatenate(residuals))))
    slowness = float(np.mean([_autocorrelation_time(residual) for residual in residuals]))
    kept = [np.flatnonzero(np.abs(residual) <= _OUTLIER * noise) for residual in residuals]
    cleaned = [
        (
            columns[rows],
            target[rows],
            at.at(rows),
        )
        for (columns, target, at), rows in zip(runs, kept, strict=True)
    ]
    return cleaned, slowness


def _autocorrelation_time(residual: FloatArray) -> float:
    """Return the integrated autocorrelation time in samples: 1 for white noise."""
    centred = residual - np.mean(residual)
    size = int(2 ** np.ceil(np.log2(2 * centred.size)))
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    correlation = np.fft.irfft(spectrum)[: centred.size]
    correlation = correlation / max(correlation[0], 1e-300)
    below = np.flatnonzero(correlation < 2.0 / np.sqrt(centred.size))
    end = int(below[0]) if below.size else centred.size
    return float(1.0 + 2.0 * np.sum(correlation[1:end]))


def _tied(centres: FloatArray, used: Sequence[Block], data: _Data, fit: _Fit) -> FloatArray:
    """Return centres with the prior size of temperature bumps in proportion to the fitted slope."""
    tied = centres.copy()
    low, high = (limit - data.calibrated_c for limit in data.limits_c)
    at = Circumstances.of(2, share=1.0, warmth_k=np.array([low, high]))
    for number, block in enumerate(used):
        if "bumps over temperature" in block.name and block.group in ("zero", "span"):
            value, _ = fit.function(block.group, at)
            over_20_k = abs(value[1] - value[0]) / _UNIT / (high - low) * 20.0
            tied[number] = np.log(max(_BEND * over_20_k, 0.02))
    return tied


def _running_in(
    runs: Sequence[_Run],
    slowness: float,
    fit: Posterior,
    points: Normal,
    sizes: Sequence[int],
    prior: tuple[FloatArray, FloatArray],
    data: _Data,
) -> float:
    """Return the time constant of a decaying drag, s; 0 if the runs show none."""
    if not runs or "odd" not in data.groups:
        return 0.0
    longest = max(float(np.max(rows.time_s)) for _, _, rows in runs)
    shortest = max(longest / 100.0, 1.0)
    together, target = (np.concatenate([run[which] for run in runs]) for which in (0, 1))
    total = Normal.of(together, target)
    beside = Normal(
        np.pad(points.matrix, (0, 3)), np.pad(points.vector, (0, 3)), points.square, points.rows
    )
    best, time_s = _RUNNING_IN_GAIN, 0.0
    for candidate in np.geomspace(shortest, longest, 8):
        columns = running_in_columns(candidate)
        more = np.concatenate([columns(rows) for _, _, rows in runs])
        wider = total.widened(together, more, target).thinned(slowness)
        gained = gain([wider, beside], [*sizes, 3], prior, fit, np.log(0.3))
        if gained > best:
            best, time_s = gained, float(candidate)
    return time_s


# --- tables ---


def _effects(fit: _Fit) -> tuple[Effect, ...]:
    """Return the effects for which the fit has terms."""
    effects: list[Effect] = []
    groups = fit.data.groups
    if groups & {"zero", "span"}:
        effects.append(_temperature(fit))
    if "odd" in groups:
        effects.append(_rotation(fit))
    if "inertia" in groups:
        effects.append(_inertia(fit))
    return tuple(effects)


def _remanence(calibration: TurningCalibration, corrected_nm: FloatArray) -> float:
    """Return half the difference of the zeros after both directions, N·m; 0 if it wasn't measured.

    It is calculated from unloaded points that follow a load, in both directions under the same
    conditions.
    """
    torque, unloaded = calibration.standard_nm, calibration.unloaded
    if unloaded is None:
        return 0.0
    stretch = stretches(calibration.speed_rpm, calibration.temperature_c)
    after = 1 + np.flatnonzero(unloaded[1:] & ~unloaded[:-1] & (np.diff(stretch) == 0))
    error_nm, before = (corrected_nm - torque)[after], torque[after - 1]
    differences = []
    for number in np.unique(stretch[after]):
        here = stretch[after] == number
        sides = [error_nm[here & (sign * before > 0.0)] for sign in (1.0, -1.0)]
        if all(side.size for side in sides):
            differences.append(np.mean(sides[0]) - np.mean(sides[1]))
    return 0.5 * float(np.sqrt(np.mean(np.square(differences)))) if differences else 0.0


def _zero(fit: _Fit, zeros: Zeros, remanence_nm: float) -> tuple[float, tuple[Zero, ...]]:
    """Return the mean zero relative to that of the points, N·m, and the scatter of zeros.

    Every loading changes the seating of the parts, and a zero follows one loading only. The zeros
    in the tables follow similar loads, but a zero in use may follow a load in either direction: the
    remanence is added.
    """
    data, fewest = fit.data, 3
    at = Circumstances.of(zeros.zero_nm.size, warmth_k=zeros.temperature_c - data.calibrated_c)
    change, _ = fit.function("zero", at) if "zero" in data.groups else (0.0, 0.0)
    residual = zeros.zero_nm - data.range_nm * change
    if residual.size < fewest:
        return float(np.mean(residual)), ()
    widening = student_widening(residual.size - 1.0) * np.sqrt(1.0 + 1.0 / residual.size)
    u = float(np.hypot(widening * np.std(residual, ddof=1), remanence_nm))
    return float(np.mean(residual)), (
        Zero(f"{residual.size} zeros of {data.words}", None, zero_nm=u),
    )


def _warm_nodes(data: _Data) -> FloatArray:
    """Return temperatures over the calibrated range and as far again on both sides, °C."""
    low, high = data.limits_c
    further = max(high - low, _LEAST_EXTENSION_K)
    return np.linspace(
        low - further, high + further, 1 + int(np.ceil((high - low + 2 * further) / _NODE_K))
    )


def _temperature(fit: _Fit) -> MeasuredTemperature:
    """Return the fitted functions of the temperature as an effect with tables."""
    data, range_nm = fit.data, fit.data.range_nm
    nodes = _warm_nodes(data)
    at = Circumstances.of(nodes.size, share=1.0, warmth_k=nodes - data.calibrated_c)
    nothing = np.zeros(nodes.size)
    zero, zero_u = fit.function("zero", at) if "zero" in data.groups else (nothing, nothing)
    span, span_u = fit.function("span", at) if "span" in data.groups else ((), ())
    return MeasuredTemperature(
        data.words,
        data.calibrated_c,
        *data.limits_c,
        numbers(nodes),
        numbers(range_nm * zero),
        numbers(range_nm * zero_u),
        numbers(span),
        numbers(span_u),
    )


def _rotation(fit: _Fit) -> MeasuredRotation:
    """Return the fitted functions of the speed as an effect with tables."""
    data, range_nm = fit.data, fit.data.range_nm
    warm = _warm_nodes(data)
    largest = 1.1 * data.largest_rpm
    speeds = np.concatenate([[0.0], np.geomspace(largest / 600.0, largest, _SPEED_NODES)])
    grid_n, grid_c = (grid.ravel() for grid in np.meshgrid(speeds, warm, indexing="ij"))
    at = Circumstances.of(
        grid_n.size,
        speed=grid_n / data.largest_rpm,
        turning=1.0,
        warmth_k=grid_c - data.calibrated_c,
    )

    def table(values: FloatArray) -> tuple[tuple[float, ...], ...]:
        return tuple(numbers(row) for row in values.reshape(speeds.size, -1))

    nothing = np.zeros(grid_n.size)
    odd, odd_u = fit.function("odd", at)
    even, even_u = fit.function("even", at) if "even" in data.groups else (nothing, nothing)
    rotation = MeasuredRotation(
        data.words,
        data.calibrated_c,
        *data.limits_rpm,
        *data.limits_c,
        numbers(speeds),
        numbers(warm),
        table(range_nm * even),
        table(range_nm * even_u),
        table(range_nm * odd),
        table(range_nm * odd_u),
    )
    noise = _noise(fit, speeds / data.largest_rpm)
    if noise.any():
        rotation = replace(rotation, noise_nm=numbers(range_nm * noise), window_s=data.window_s)
    along = Circumstances.of(speeds.size, share=1.0, speed=speeds / data.largest_rpm, turning=1.0)
    if "load" in data.groups:
        loads = np.linspace(0.0, 1.1, 12)
        grid_n, grid_x = (grid.ravel() for grid in np.meshgrid(speeds, loads, indexing="ij"))
        at = Circumstances.of(
            grid_n.size, share=grid_x, speed=grid_n / data.largest_rpm, turning=1.0
        )
        load, load_u = fit.function("load", at)
        rotation = replace(
            rotation,
            load_at_nm=numbers(range_nm * loads),
            load_nm=table(range_nm * load),
            load_uncertainty_nm=table(range_nm * load_u),
        )
    if "speed span" in data.groups:
        span, span_u = fit.function("speed span", along)
        rotation = replace(rotation, span=numbers(span), span_uncertainty=numbers(span_u))
    if fit.running_in_s:
        start, start_u = fit.function("running-in", along)
        rotation = replace(
            rotation,
            running_in_s=fit.running_in_s,
            running_in_nm=numbers(range_nm * start),
            running_in_uncertainty_nm=numbers(range_nm * start_u),
        )
    return rotation


def _noise(fit: _Fit, shares: FloatArray) -> FloatArray:
    """Return the scatter of single readings at speed, beyond that of the points, share of range.

    Points without a standard error are single readings, which scatter like those at standstill.
    """
    size, left = fit.left_over
    still = left[size <= _STILL]
    if still.size < _FEWEST_IN_BIN:
        return np.zeros(shares.size)
    middle = np.linspace(0.05, 0.95, 10)
    bins = [left[np.abs(size - centre) <= 0.05] for centre in middle]
    filled = [number for number, rows in enumerate(bins) if rows.size >= _FEWEST_IN_BIN]
    at_rest = float(np.mean(still**2))
    points = at_rest if fit.data.point_noise is None else (fit.data.point_noise / _UNIT) ** 2
    at = [0.0, *middle[filled]]
    more = [at_rest - points, *(float(np.mean(bins[k] ** 2)) - points for k in filled)]
    return np.asarray(_UNIT * np.sqrt(np.maximum(np.interp(shares, at, more), 0.0)))


def _inertia(fit: _Fit) -> Inertia:
    """Return the moment of inertia; its u contains the chain's curve at small torques.

    Empty runs show it without load, where backlash or a step at the reversal may add or remove a
    part of it. Whether this part also exists under load depends on its origin in the chain.
    """
    data = fit.data
    value, u = fit.function("inertia", Circumstances.of(1, acceleration=1.0))
    largest_nm = data.range_nm * float(value[0])
    ends = data.additional(np.array([-largest_nm, largest_nm]))
    by_load_nm = 0.5 * abs(float(ends[1] - ends[0])) / np.sqrt(3.0)
    own = float(np.hypot(data.range_nm * u[0], by_load_nm))
    most = data.largest_rad_s2
    return Inertia(data.words, largest_nm / most, own / most, most)
