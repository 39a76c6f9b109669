"""Parts of a chain's additional torque: columns of known shape with normal coefficients.

Everything is a fraction of full scale. A part has one amplitude, which multiplies the prior
standard deviations of all its coefficients, and up to two shape parameters. Amplitude and shape
parameters have log-normal priors: orders of magnitude from mechanics, not values of one chain.

Where the parts come from
    offset      an error of the zero.
    sides       difference of both directions in slope and curvature (equation 15 of the sources has
                constants for each direction).
    step        Coulomb friction of bearings and seals reverses with the torque; u/(wᵏ + |u|ᵏ)^(1/k)
                contains the usual regularisations of it (E. Pennestrì et al., Nonlinear Dynamics 83
                (2016) 1785-1801): k = 1 is rational, 2 algebraic, more is steeper.
    smooth      smooth deviation in each direction, zero without torque.
    loop, lag   hysteresis xᵖ(1 − x)^q, which closes at full scale, where a major loop turns: errors
                of one sign in both directions, and errors of the torque's sign; the latter also
                with a remanence 1 − x¹⁺ᵖ, which is there without torque.
    branch      smooth deviation of a loop of either sign from these shapes, and a loop that does
                not close at full scale, because it turned beyond.
    ripple      engagement of splines and teeth: a sine whose amplitude and phase drift over the
                range.
    rough       local errors of engagement (Matérn 5/2).
    drift       drift of the zero while the chain is calibrated: an error of the calibration, which
                isn't part of the curve.
    zero        what the other parts add without torque, taken off where readings count from a
                zero: a zeroed chain reads 0, and readings further than 5 % of full scale keep
                the curve that fits the points.

Smooth and rough parts are Gaussian processes, written as sums of sines over an interval that is
wider than the range (A. Solin, S. Särkkä, Statistics and Computing 30 (2020) 419-446).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.state import storable
from torquebench.units import TURN

SIDELESS = 2e-3
"""Readings closer to zero than this have no direction, because noise would decide on it."""


class Prior(NamedTuple):
    """Normal prior of a parameter's logarithm."""

    mean: float
    sd: float


def about(value: float, sd: float) -> Prior:
    """Return the prior of a parameter with a median and a relative spread."""
    return Prior(float(np.log(value)), sd)


@dataclass(frozen=True, eq=False)
class Points:
    """Points at which parts are evaluated.

    Attributes
    ----------
    u : float64 array of shape (n,)
        Reading / full scale.
    branch : float64 array of shape (n,)
        +1 up, −1 down, 0 unknown.
    elapsed : float64 array of shape (n,) or (0,)
        Time since the zero was taken, as a fraction of the calibration; empty for a curve, whose
        zero was just taken.
    known_side : float64 array of shape (n,) or (0,)
        Direction of the loading that each point belongs to, −1 to 1; if empty, it is the sign of
        the readings, and those close to zero have none.
    """

    u: FloatArray
    branch: FloatArray
    elapsed: FloatArray = field(default_factory=lambda: np.zeros(0))
    known_side: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def side(self) -> FloatArray:
        """Direction of the loading."""
        if self.known_side.size:
            return self.known_side
        return np.asarray(np.tanh(self.u / SIDELESS))

    def __len__(self) -> int:
        return int(self.u.size)


Columns = tuple[FloatArray, FloatArray | None]
"""Columns (n, k), and their derivatives by the logarithms of the shape parameters (n, k, s)."""
Scales = tuple[FloatArray, FloatArray]
"""Logarithms of the coefficients' relative prior standard deviations (k,), with their derivatives
by the logarithms of the shape parameters (k, s)."""


class Part:
    """One part of the curve: its columns at points, and the priors of its parameters."""

    amplitude: Prior
    shape: tuple[Prior, ...] = ()
    fixed: ClassVar[bool] = True
    """Whether the columns don't depend on the shape parameters."""

    def columns(self, points: Points, shape: FloatArray) -> Columns:
        """Return the columns at points."""
        raise NotImplementedError

    def scales(self, shape: FloatArray) -> Scales:
        """Return the relative prior scales of the coefficients, by default equal ones."""
        return np.zeros(self._width), np.zeros((self._width, shape.size))

    @cached_property
    def _width(self) -> int:
        """Number of columns."""
        middle = np.exp([prior.mean for prior in self.shape])
        return int(self.columns(_ORIGIN, middle)[0].shape[1])


_ORIGIN = Points(np.zeros(1), np.zeros(1))

FORM = ("1", "u", "|u|", "u²", "u|u|", "u³")
"""Columns of the physical form, equation 15 with constants of each direction, and a cubic."""
TRENDS: Mapping[str, Mapping[str, float]] = {
    "line": {"u": 5e-3},
    "quadratic": {"u": 5e-3, "u²": 5e-3},
    "cubic": {"u": 5e-3, "u²": 5e-3, "u³": 3e-3},
    "odd": {"u": 5e-3, "u|u|": 5e-3},
}
"""Columns of the trends, with the prior standard deviations of their coefficients."""


def form_columns(u: FloatArray, names: Sequence[str] = FORM) -> FloatArray:
    """Return columns of the physical form, shape (n, k).

    Examples
    --------
    >>> form_columns(np.array([-0.5]), ("u", "u|u|")).tolist()
    [[-0.5, -0.25]]
    """
    size = np.abs(u)
    columns = {"1": np.ones_like(u), "u": u, "|u|": size, "u²": u * u, "u|u|": u * size}
    return np.stack([u**3 if name == "u³" else columns[name] for name in names], axis=1)


@dataclass(frozen=True)
class FormPart(Part):
    """Columns of the physical form with one amplitude: an offset, or unequal directions."""

    names: tuple[str, ...]
    amplitude: Prior

    def columns(self, points: Points, shape: FloatArray) -> Columns:  # noqa: ARG002
        """Return the named columns."""
        return form_columns(points.u, self.names), None


class _Step(Part):
    amplitude = about(3e-4, 0.8)
    shape = (about(0.008, 0.7), about(2.0, 0.5))
    fixed: ClassVar[bool] = False

    def columns(self, points: Points, shape: FloatArray) -> Columns:
        """Sign of the torque, smoothed over a width with sharpness k; derivatives by ln of both."""
        width, k = shape
        z = np.maximum(np.abs(points.u) / width, 1e-12)
        power = z**k
        size = np.sign(points.u) * (1.0 + 1.0 / power) ** (-1.0 / k)
        by_width = -size / (1.0 + power)
        by_k = size * (np.log1p(power) / k - power * np.log(z) / (1.0 + power))
        return size[:, None], np.stack([by_width, by_k], axis=1)[:, None, :]


@dataclass(frozen=True)
class _Loop(Part):
    amplitude: Prior
    shape: tuple[Prior, ...] = (about(0.8, 0.6), about(0.5, 0.7))
    fixed: ClassVar[bool] = False
    lags: bool = False
    steepest: ClassVar[float] = 0.5  # smallest q: no table can follow a steeper end

    def columns(self, points: Points, shape: FloatArray) -> Columns:
        """Return the loop's columns at the points, and their derivatives by the two exponents."""
        p, q = shape[0], self.steepest + shape[1]
        x = np.clip(np.abs(points.u), 1e-9, 1.0 - 1e-9)
        rise = np.log(x * (p + q) / p)
        fall = np.log((1.0 - x) * (p + q) / q)
        side = points.side
        half = points.branch * (side if self.lags else np.abs(side)) * np.exp(p * rise + q * fall)
        slopes = np.stack([half * p * rise, half * shape[1] * fall], axis=1)
        if not self.lags:
            return half[:, None], slopes[:, None, :]
        # A remanence closes at full scale as well. It has the sign of the branch if the torque
        # reverses between the directions, and the sign of the direction if each is loaded by
        # itself.
        power = x ** (1.0 + p)
        remanence = side * (1.0 - power)
        by_p = np.stack([-side * p * power * np.log(x), np.zeros(x.size)], axis=1)
        branch = points.branch
        columns = np.stack([half, branch * remanence, remanence], axis=1)
        return columns, np.stack([slopes, branch[:, None] * by_p, by_p], axis=1)


def _sines(x: FloatArray, half_width: float, count: int) -> FloatArray:
    """Return the eigenfunctions of the interval ±half_width, shape (n, count)."""
    waves = _waves(half_width, count)
    return np.asarray(np.sin((x[:, None] + half_width) * waves) / np.sqrt(half_width))


def _waves(half_width: float, count: int) -> FloatArray:
    return np.asarray(np.pi * np.arange(1, count + 1) / (2.0 * half_width))


def _squared_exponential(waves: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
    """Return ½ log of the spectral density for unit variance, and its derivative by log length."""
    square = (waves * length) ** 2
    return 0.5 * (0.5 * np.log(TURN) + np.log(length) - 0.5 * square), 0.5 * (1.0 - square)


class _Smooth(Part):
    amplitude = about(2e-4, 1.0)
    shape = (about(0.35, 0.4),)
    half_width: ClassVar[float] = 0.9  # of the sines about the middle of a direction's range
    count: ClassVar[int] = 10

    def columns(self, points: Points, shape: FloatArray) -> Columns:  # noqa: ARG002
        """Return sine waves of each direction, which vanish at zero torque."""
        sides = (np.maximum(points.u, 0.0), np.maximum(-points.u, 0.0))
        blocks = [np.sqrt(x)[:, None] * _sines(x - 0.5, self.half_width, self.count) for x in sides]
        return np.hstack(blocks), None

    def scales(self, shape: FloatArray) -> Scales:
        """Return the waves' log scales by a length, and their slopes."""
        waves = np.tile(_waves(self.half_width, self.count), 2)
        value, slope = _squared_exponential(waves, shape[0])
        return value, slope[:, None]


class _Branch(Part):
    amplitude = about(5e-5, 0.8)
    shape = (about(0.35, 0.4),)
    half_width: ClassVar[float] = 1.5
    count: ClassVar[int] = 14
    open_share: ClassVar[float] = 0.3  # of the deviation that may remain open at full scale

    def columns(self, points: Points, shape: FloatArray) -> Columns:  # noqa: ARG002
        """Opposite on both branches: sines that close at full scale, and an open end by `x`."""
        x = np.minimum(np.abs(points.u), 1.0)
        closed = (1.0 - x)[:, None] * _sines(points.u, self.half_width, self.count)
        side = points.side[:, None]
        return points.branch[:, None] * np.hstack([closed, side * closed, x[:, None]]), None

    def scales(self, shape: FloatArray) -> Scales:
        """Return the waves' log scales by a length, and the constant's."""
        waves = np.tile(_waves(self.half_width, self.count), 2)
        value, slope = _squared_exponential(waves, shape[0])
        return np.append(value, np.log(self.open_share)), np.append(slope, 0.0)[:, None]


class _Rough(Part):
    amplitude = about(8e-5, 0.8)
    shape = (about(0.06, 0.5),)
    half_width: ClassVar[float] = 1.25

    def __init__(self, count: int) -> None:
        self.count = count

    def columns(self, points: Points, shape: FloatArray) -> Columns:  # noqa: ARG002
        return _sines(points.u, self.half_width, self.count), None

    def scales(self, shape: FloatArray) -> Scales:
        """Half the log spectral density of a Matérn 5/2 kernel, and its derivative by ln length."""
        length = shape[0]
        rate2 = 5.0 / length**2
        total = rate2 + _waves(self.half_width, self.count) ** 2
        density = np.log(400.0 * np.sqrt(5.0) / 3.0) - 5.0 * np.log(length) - 3.0 * np.log(total)
        return 0.5 * density, (0.5 * (6.0 * rate2 / total - 5.0))[:, None]


class _Ripple(Part):
    """A sine of unknown frequency (cycles a full scale) in windows that vary slowly."""

    amplitude = about(1.5e-4, 0.8)
    shape = (about(5.0, 0.5),)
    fixed: ClassVar[bool] = False
    half_width: ClassVar[float] = 2.2
    count: ClassVar[int] = 4
    reach: ClassVar[float] = 1.2  # of full scale: over this length amplitude and phase stay alike

    def columns(self, points: Points, shape: FloatArray) -> Columns:
        """Return a sine and a cosine over torque with slowly changing amplitudes."""
        windows = _sines(points.u, self.half_width, self.count)
        angle = (TURN * shape[0] * points.u)[:, None]
        even, odd = np.cos(angle) * windows, np.sin(angle) * windows
        slope = np.hstack([-angle * odd, angle * even])
        return np.hstack([even, odd]), slope[:, :, None]

    def scales(self, shape: FloatArray) -> Scales:  # noqa: ARG002
        waves = np.tile(_waves(self.half_width, self.count), 2)
        return _squared_exponential(waves, self.reach)[0], np.zeros((waves.size, 1))


class _Drift(Part):
    """Relaxation of the zero since it was taken; a steady drift with a long time constant.

    It only rises or only falls: a drift that returns couldn't be distinguished from a loop that is
    open at zero torque.
    """

    amplitude = about(1.3e-4, 1.0)
    shape = (about(0.5, 1.0),)  # time constant as a fraction of the calibration
    fixed: ClassVar[bool] = False

    def columns(self, points: Points, shape: FloatArray) -> Columns:
        """Share of an exponential relaxation, 1 at time 1; derivative by ln of its constant."""
        time = points.elapsed
        if not time.size:
            return np.zeros((len(points), 1)), np.zeros((len(points), 1, 1))
        rate = 1.0 / shape[0]
        whole = -np.expm1(-rate)
        relaxed = -np.expm1(-rate * time) / whole
        slope = (time * np.exp(-rate * time) - relaxed * np.exp(-rate)) / whole
        return relaxed[:, None], (-rate * slope)[:, None, None]


class _Zero(Part):
    width: ClassVar[float] = 0.02

    def columns(self, points: Points, shape: FloatArray) -> Columns:  # noqa: ARG002
        return np.exp(-((points.u / self.width) ** 2))[:, None], None


_LOOPS = {"loop": _Loop(about(1.5e-4, 1.0)), "lag": _Loop(about(1.2e-4, 1.0), lags=True)}


def catalogue(levels: int, *, with_loops: bool = True) -> dict[str, Part]:
    """Return all parts that a calibration may contain, by name.

    Parameters
    ----------
    levels : int
        Number of torques in the direction that has more of them: rough parts are resolved to half
        their distance.
    with_loops : bool
        Whether both rising and falling torque were measured: only then is a loop visible.
    """
    parts: dict[str, Part] = {
        "offset": FormPart(("1",), about(1e-4, 1.3)),
        "sides": FormPart(("|u|", "u²"), about(1e-3, 1.2)),
        "step": _Step(),
        "smooth": _Smooth(),
        "ripple": _Ripple(),
        "rough": _Rough(int(np.clip(2.5 * levels, 16, 80))),
        "drift": _Drift(),
    }
    return {**parts, **_LOOPS, "branch": _Branch()} if with_loops else parts


def unmeasured_loop(u: FloatArray) -> FloatArray:
    """Return the prior standard deviation of half a loop at readings u."""
    variance = np.zeros(u.size)
    for loop in _LOOPS.values():
        shape = np.exp([prior.mean for prior in loop.shape])
        size = np.exp(loop.amplitude.mean + loop.amplitude.sd**2)
        up, down = (loop.columns(Points(u, np.full(u.size, leg)), shape)[0] for leg in (1.0, -1.0))
        variance += np.sum((0.5 * size * (up - down)) ** 2, axis=1)
    return np.sqrt(variance)


@storable
@dataclass(frozen=True)
class Term:
    """A part of a fitted curve.

    Attributes
    ----------
    part : str
        Name in the catalogue.
    shape : float64 array
        Shape parameters; empty where the columns don't depend on any.
    coefficients : float64 array
        Coefficients of the part's columns.
    """

    part: str
    shape: FloatArray
    coefficients: FloatArray


_PARTS = {**catalogue(0), "zero": _Zero()}


def curve(form: FloatArray, terms: Sequence[Term], points: Points) -> FloatArray:
    """Return the additional torque of a physical form and further terms, shape (n,)."""
    total = form_columns(points.u) @ form
    for term in terms:
        part = _Rough(term.coefficients.size) if term.part == "rough" else _PARTS[term.part]
        total += part.columns(points, term.shape)[0] @ term.coefficients
    return np.asarray(total)
