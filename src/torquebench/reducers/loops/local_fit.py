"""Local straight lines through a branch of a loop, with windows as wide as the data allow."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["LocalFit", "LocalLines"]

Floats = NDArray[np.float64]
GROWTH = 1.5
CONFIDENCE = 2.5
"""Standard errors within which fits of neighbouring windows must agree."""
BEND = 4.0
"""A window with this multiple of the narrower one's variance contains a bend, not more noise."""


@dataclass(frozen=True, eq=False)
class LocalFit:
    """Values of local lines.

    Parameters
    ----------
    value, slope, standard_error : array of float, shape (n,)
        At each place; the slope per unit of the abscissa.
    """

    value: Floats
    slope: Floats
    standard_error: Floats


class LocalLines:
    """Local linear regression of a branch: angle against torque.

    The window at each place grows from the least number of samples as long as all fits so far
    agree within their standard errors (intersection of confidence intervals: Goldenshluger and
    Nemirovski, Mathematical Methods of Statistics 6 (1997) 135), so that backlash isn't smeared
    and straight parts are averaged. Sums are accumulated once, so a fit costs no pass over the
    data.

    Parameters
    ----------
    abscissa, value : array of float, shape (n,)
        In any order.
    least_samples : int
        In each window.
    largest_half_width : float
        Of a window, in the abscissa's unit; wider only where it holds too few samples.

    Examples
    --------
    >>> torque = np.linspace(-10.0, 10.0, 2001)
    >>> angle = np.where(torque < 0.0, torque, torque + 1.0)  # a jump of 1 at zero
    >>> fit = LocalLines(torque, angle, 8, 1.0).at([-0.1, 0.1, 5.0])
    >>> fit.value.round(6).tolist(), fit.slope.round(6).tolist()
    ([-0.1, 1.1, 6.0], [1.0, 1.0, 1.0])
    """

    def __init__(
        self, abscissa: Floats, value: Floats, least_samples: int, largest_half_width: float
    ) -> None:
        if abscissa.size < least_samples:
            raise InputError(
                Message("{size} samples in a branch of a loop", abscissa.size),
                Message("at least {limit}", least_samples),
                "record more samples per loop",
            )
        order = np.argsort(abscissa, kind="stable")
        self._x = abscissa[order]
        self._y = value[order]
        self._least = least_samples
        self._widest = largest_half_width
        self._offset = float(value.mean())
        y = value[order] - self._offset
        # Noise from second differences, in which a bend doesn't count.
        rough = np.zeros_like(y)
        rough[1:-1] = np.diff(y, 2) ** 2 / 6.0
        sums = np.column_stack([np.ones_like(y), self._x, self._x**2, y, self._x * y, rough])
        self._sums = np.vstack([np.zeros(6), np.cumsum(sums, axis=0)])

    def at(self, places: ArrayLike) -> LocalFit:
        """Return the local lines at places, array of float, shape (n,)."""
        x = np.atleast_1d(np.asarray(places, dtype=np.float64))
        half = self._least_half_width(x)
        best = self._lines(x, half)
        low = best.value - CONFIDENCE * best.standard_error
        high = best.value + CONFIDENCE * best.standard_error
        open_ = half < self._widest
        while np.any(open_):
            half = np.where(open_, np.minimum(half * GROWTH, self._widest), half)
            wider = self._lines(x, half)
            low = np.maximum(low, wider.value - CONFIDENCE * wider.standard_error)
            high = np.minimum(high, wider.value + CONFIDENCE * wider.standard_error)
            agree = open_ & (low <= high)
            best = LocalFit(
                np.where(agree, wider.value, best.value),
                np.where(agree, wider.slope, best.slope),
                np.where(agree, wider.standard_error, best.standard_error),
            )
            open_ = agree & (half < self._widest)
        return best

    def curved_at(self, places: ArrayLike) -> LocalFit:
        """Return local parabolas at places: the same choice of windows, without bias by a bend.

        For the few places at which a loop is evaluated; slower than `at`.
        """
        x = np.atleast_1d(np.asarray(places, dtype=np.float64))
        half = self._least_half_width(x)
        found = [self._curved(place, least) for place, least in zip(x, half, strict=True)]
        value, slope, error, _ = zip(*found, strict=True)
        return LocalFit(np.array(value), np.array(slope), np.array(error))

    def _curved(self, place: float, half: float) -> tuple[float, float, float, float]:
        best = self._parabola(place, half)
        low, high = -np.inf, np.inf
        while True:
            reach = CONFIDENCE * best[2]
            low, high = max(low, best[0] - reach), min(high, best[0] + reach)
            if half >= self._widest:
                return best
            half = min(half * GROWTH, self._widest)
            wider = self._parabola(place, half)
            if wider[3] > BEND * best[3]:
                return best
            reach = CONFIDENCE * wider[2]
            if max(low, wider[0] - reach) > min(high, wider[0] + reach):
                return best
            best = wider

    def _parabola(self, place: float, half: float) -> tuple[float, float, float, float]:
        left = int(np.searchsorted(self._x, place - half, side="left"))
        right = int(np.searchsorted(self._x, place + half, side="right"))
        x = (self._x[left:right] - place) / half
        y = self._y[left:right]
        basis = np.column_stack([np.ones_like(x), x, x**2])
        inverse = np.linalg.pinv(basis)
        value, slope, _ = inverse @ y
        rough = float(np.sum(np.diff(y, 2) ** 2)) / 6.0 / max(y.size - 2, 1)
        error = float(np.sqrt(rough * np.sum(inverse[0] ** 2)))
        return float(value), float(slope / half), error, rough

    def _least_half_width(self, places: Floats) -> Floats:
        """Return the smallest half width around each place that contains enough samples."""
        size, need = self._x.size, self._least
        middle = np.searchsorted(self._x, places)
        starts = np.clip(middle[:, None] - np.arange(need + 1), 0, size - need)
        first, last = self._x[starts], self._x[starts + need - 1]
        reach = np.maximum(np.abs(places[:, None] - first), np.abs(last - places[:, None]))
        scale = max(float(np.ptp(self._x)), 1e-300)
        return np.asarray(reach.min(axis=1) * (1 + 1e-12) + 1e-12 * scale)

    def _lines(self, x: Floats, half: Floats) -> LocalFit:
        left = np.searchsorted(self._x, x - half, side="left")
        right = np.searchsorted(self._x, x + half, side="right")
        n, sx, sxx, sy, sxy, rough = (self._sums[right] - self._sums[left]).T
        mean_x, mean_y = sx / n, sy / n
        spread = np.maximum(sxx / n - mean_x**2, 0.0)
        flat = spread <= 1e-18 * max(float(np.max(np.abs(self._x))), 1e-300) ** 2
        slope = np.where(flat, 0.0, (sxy / n - mean_x * mean_y) / np.where(flat, 1.0, spread))
        variance = np.maximum(rough, 0.0) / np.maximum(n - 2, 1)
        leverage = 1.0 / n + np.where(
            flat, 0.0, (x - mean_x) ** 2 / (n * np.where(flat, 1.0, spread))
        )
        return LocalFit(
            value=mean_y + slope * (x - mean_x) + self._offset,
            slope=slope,
            standard_error=np.sqrt(variance * leverage),
        )
