"""Structured effects of a torque chain: reversal step, hysteresis, ripple, local bumps.

Each kind is a dictionary of candidate shapes, of which a chain shows one or none (local bumps: up
to three); `averaging` weighs the candidates by their evidence. All scales are fractions of full
scale and orders of magnitude from mechanics, not values of one chain.

Where the shapes come from
    step        Coulomb friction of bearings and seals reverses with the torque; tanh(u/w) and
                u/(w + |u|) are the two usual regularisations (E. Pennestrì et al., Nonlinear
                Dynamics 83 (2016) 1785-1801).
    loop        hysteresis xʳ(1 − x)^q, which closes at full scale where a major loop turns; r = 0
                leaves a remanence at zero, q = r = 1 is Rayleigh's parabola. The sign is that of
                the torque (a lag); the same sign in both directions is a rare candidate.
    ripple      engagement of splines and teeth: a sine of unknown period whose amplitude and
                frequency may change linearly over the range (columns c, s, u c, u s), and which
                may stretch with the load, as teeth wind up: the phase is that of u + d u|u|. Where
                the torques are close enough together, a variant that grows from zero as √|u| is
                half as likely: without load teeth engage smoothly.
    wave        ripple whose amplitude and phase drift over the range, as of an engagement that
                changes with the load: a sine under each of six overlapping windows. Searched only
                where the torques are close enough together.
    bump        one local engagement error.
    offset      an error of the zero beyond what the main form describes.
    skew        the deviation of a loop from all those shapes: smooth, closed at full scale, equal
                in both directions or not. With little noise no formula fits a real loop, and its
                residuals would be identified as zero drift.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.hybrid.averaging import Candidates
from torquebench.compensation.state import storable
from torquebench.units import TURN

__all__ = [
    "KINDS",
    "WAVE_COLUMNS",
    "Dictionary",
    "Effect",
    "EffectPoints",
    "effects_sum",
    "lies_on_step",
    "make_dictionary",
    "smallest_torque",
]

_LOOP_SHAPES = np.array([(r, q) for r in (0.0, 0.5, 1.0, 2.0) for q in (0.6, 1.0, 2.0)])
_STEP_WIDTHS = np.array([0.004, 0.01, 0.025])
_SMALL_TORQUE = 0.5 * float(_STEP_WIDTHS[1])
"""Share of full scale below which torques lie on the slope of a reversal step."""
_STEP_RATIO = 1.35
"""Ratio of neighbouring widths of the reversal step, where torques distinguish them."""
_LEAST_TORQUE = 1e-3  # of full scale: smaller readings count as zero
_WIDEST_BUMP = 0.12
_FREQUENCY_STEP = 1.0 / 6.0  # cycles per full scale: a phase error of a twelfth of a cycle at ±FS
_LOOP_SHARES = (0.6, 0.11)
"""Loops whose sign is the torque's, and loops of the same sign in both directions."""
_SIDELESS = 5e-4
_SAME_LEVEL = 0.003
_SCALES = {
    "loop": (1e-4, 4e-4, 3e-3),
    "step": (1.5e-4, 6e-4, 4e-3),
    "ripple": (1.5e-4,),
    "bump": (1e-4, 4e-4, 3e-3),
    "offset": (3e-4, 3e-3),
    "wave": (0.7e-4, 2e-4),
    "skew": (2e-5, 1e-4),
}
KINDS = tuple(_SCALES)
"""Kinds of effects, in the order of the first search."""
_COPIES = {"bump": 3}
_STEP_SHIFT = 0.15
_CLOSE_STEPS = 2  # bearings that reverse one after the other
_STRETCHES = (-0.2, 0.2)
_STRETCHED_SHARE = 0.2  # prior probability of each, relative to ripple that doesn't stretch
_FEWEST_TO_STRETCH = 3.0  # cycles per full scale
_GROWN = 1.3  # amplitude at full scale of ripple that grows from zero
_GROWING_SHARE = 0.5  # prior probability relative to ripple that doesn't grow
_SLOPE_SHARE = 0.3  # change of amplitude and phase from zero to full scale
_WAVE_CENTRES = np.linspace(-1.0, 1.0, 6)
WAVE_COLUMNS = 2 * _WAVE_CENTRES.size
"""Columns of one wave: a cosine and a sine under each window."""
_WAVE_REACH = 0.24  # standard deviation of the windows
_FEWEST_LEVELS_FOR_WAVES = 16
_LOOP_DIFFERENCE = 0.2  # relative difference of the loops of both directions
_SKEW_WAVES = 4  # half waves over a direction; the first is constant


@dataclass(frozen=True)
class EffectPoints:
    """Points at which effects are evaluated.

    Attributes
    ----------
    u : float64 array of shape (n,)
        Reading / full scale.
    branch : float64 array of shape (n,)
        +1 up, −1 down, 0 unknown.
    elapsed : float64 array of shape (clocks, n)
        Time since the zero was taken, as a fraction of the calibration, by each possible reading
        of the path; no rows where it isn't known or doesn't matter.
    """

    u: FloatArray
    branch: FloatArray
    elapsed: FloatArray


@storable
@dataclass(frozen=True)
class Dictionary:
    """Candidate shapes of all effects.

    Attributes
    ----------
    step_widths : float64 array
        Widths of the reversal step.
    loop_shapes : float64 array of shape (k, 2)
        Exponents r and q of hysteresis loops.
    frequencies : float64 array
        Cycles of ripple per full scale.
    stretches : float64 array
        Of the same ripples.
    wave_frequencies : float64 array
        The same for waves; empty where the torques are too few.
    bump_centres, bump_widths : float64 array of shape (b,)
        Local bumps.
    growing : float64 array
        1 for each ripple that grows from zero with the load, 0 for the others; empty for none, as
        in models stored by earlier versions.
    step_shift : float
        Largest distance of a reversal from zero, as a share of the step's width; 0 for one step at
        zero.
    """

    step_widths: FloatArray
    loop_shapes: FloatArray
    frequencies: FloatArray
    stretches: FloatArray
    wave_frequencies: FloatArray
    bump_centres: FloatArray
    bump_widths: FloatArray
    growing: FloatArray = field(default_factory=lambda: np.zeros(0))
    step_shift: float = 0.0

    def limited_to(self, kept: dict[str, NDArray[np.intp]]) -> Dictionary:
        """Return the dictionary with some ripples, bumps and waves only."""
        ripple, bump, wave = (kept.get(name, slice(None)) for name in ("ripple", "bump", "wave"))
        return Dictionary(
            self.step_widths,
            self.loop_shapes,
            self.frequencies[ripple],
            self.stretches[ripple],
            self.wave_frequencies[wave],
            self.bump_centres[bump],
            self.bump_widths[bump],
            self.growing[ripple],
            self.step_shift,
        )


@dataclass(frozen=True)
class Effect:
    """One kind of effect with its prior; the columns are as in `averaging.Candidates`."""

    name: str
    columns: FloatArray
    scales: FloatArray
    log_prior: FloatArray
    log_absent: float
    copies: int = 1

    @property
    def turns(self) -> bool:
        """Whether it changes its sign with the branch."""
        return self.name in ("loop", "skew")

    def limited_to(self, kept: NDArray[np.intp]) -> Effect:
        """Return some of the candidates, each as probable as before."""
        return replace(self, columns=self.columns[kept], log_prior=self.log_prior[kept])

    def whitened(self, columns: FloatArray) -> Candidates:
        """Return the candidates on whitened columns."""
        return Candidates(columns, self.scales, self.log_prior, self.log_absent, self.copies)


def count_levels(u: FloatArray) -> int:
    """Return how many different torques were measured in the direction that has more of them.

    Examples
    --------
    >>> count_levels(np.array([0.5, 1.0, 0.501, -0.2, -0.4, -0.6]))
    3
    """
    sides = (np.sort(u[u > 0]), np.sort(-u[u < 0]))
    steps = [int(np.count_nonzero(np.diff(side) > _SAME_LEVEL)) for side in sides]
    return max(step + min(side.size, 1) for step, side in zip(steps, sides, strict=True))


def lies_on_step(torque: FloatArray) -> bool:
    """Return whether torques (shares of full scale) are on the slope of a reversal step.

    Examples
    --------
    >>> lies_on_step(np.array([0.02, 0.001, 0.5])), lies_on_step(np.array([0.02, 0.0, 0.5]))
    (True, False)
    """
    return smallest_torque(torque) <= _SMALL_TORQUE


def smallest_torque(u: FloatArray) -> float:
    """Return the smallest torque other than zero, as a share of full scale.

    Examples
    --------
    >>> smallest_torque(np.array([0.02, -0.01, 0.00003, 0.5]))
    0.01
    """
    size = np.abs(u)
    return float(np.min(size, where=size >= _LEAST_TORQUE, initial=1.0))


def _step_widths(smallest: float) -> FloatArray:
    """Return widths of the reversal step, closely spaced only where torques lie on its slope."""
    if smallest > _SMALL_TORQUE:
        return _STEP_WIDTHS
    narrowest, widest = min(smallest, float(_STEP_WIDTHS[0])), float(_STEP_WIDTHS[-1])
    count = 1 + int(np.ceil(np.log(widest / narrowest) / np.log(_STEP_RATIO)))
    return np.asarray(np.geomspace(narrowest, widest, count))


def make_dictionary(levels: int, smallest: float = 1.0, *, on_step: bool = False) -> Dictionary:
    """Choose candidate shapes that a calibration with this number of torques can distinguish.

    Ripple is searched up to one and a half times the highest frequency that evenly spaced torques
    resolve: at twice that frequency it would be zero at all of them.

    Parameters
    ----------
    levels : int
        Number of torques per direction.
    smallest : float
        Smallest torque other than zero, as a share of full scale: at 0.5 % and below, the reversal
        step's width is searched in small steps.
    on_step : bool
        Whether torques are on the step's slope, from which position and number of steps follow.

    Returns
    -------
    dictionary : Dictionary

    Examples
    --------
    >>> make_dictionary(13).bump_widths.min()
    np.float64(0.04)
    >>> make_dictionary(13).frequencies.max() < 13
    np.True_
    """
    narrowest = float(np.clip(0.52 / max(levels, 1), 0.02, 0.06))
    count = round(np.log(_WIDEST_BUMP / narrowest) / np.log(1.75)) + 1
    widths = np.geomspace(narrowest, _WIDEST_BUMP, count)
    centres = [np.arange(-1.0, 1.0 + 1e-9, 0.8 * width) for width in widths]
    highest = float(np.clip(0.75 * levels, 3.0, 25.0))
    frequencies = np.arange(1.5, highest, _FREQUENCY_STEP)
    several = frequencies[frequencies >= _FEWEST_TO_STRETCH]
    ripples = np.concatenate([frequencies, np.tile(several, len(_STRETCHES))])
    stretches = np.concatenate([np.zeros(frequencies.size), np.repeat(_STRETCHES, several.size)])
    close_set = levels >= _FEWEST_LEVELS_FOR_WAVES
    envelopes = 2 if close_set else 1
    return Dictionary(
        _step_widths(smallest),
        _LOOP_SHAPES,
        np.tile(ripples, envelopes),
        np.tile(stretches, envelopes),
        # at least three cycles per full scale, and spaced three times as far: windows aren't sharp
        frequencies[9::3] if close_set else np.zeros(0),
        np.concatenate(centres),
        np.repeat(widths, [centre.size for centre in centres]),
        np.repeat([0.0, 1.0][:envelopes], ripples.size),
        _STEP_SHIFT if on_step else 0.0,
    )


def at_zero_time(u: FloatArray, branch: FloatArray) -> EffectPoints:
    """Return points of a chain whose zero was just taken."""
    return EffectPoints(u, branch, np.zeros((0, u.size)))


def step_columns(points: EffectPoints, widths: FloatArray, shift: float) -> FloatArray:
    """Return reversal steps, shape (2 k, 1, n), or (2 k, 2, n) where they may be shifted.

    Columns of a candidate: the step, and its change if the reversal isn't exactly at zero.
    """
    x = points.u / widths[:, None]
    smooth, rational = np.tanh(x), x / (1.0 + np.abs(x))
    steps = np.concatenate([smooth, rational])
    if shift == 0.0:
        return steps[:, None, :]
    slopes = np.concatenate([1.0 - smooth**2, (1.0 - np.abs(rational)) ** 2])
    return np.stack([steps, shift * slopes], axis=1)


def loop_columns(points: EffectPoints, shapes: FloatArray) -> FloatArray:
    """Return hysteresis loops, shape (2 k, 2, n).

    Columns of a candidate: the loop, and its difference between the directions (which vanishes at
    zero, where one direction passes into the other).
    """
    # A reading of zero has no direction: noise would decide on it.
    x, side = np.minimum(np.abs(points.u), 1.0), np.tanh(points.u / _SIDELESS)
    shape = np.array([_loop_shape(x, r, q) for r, q in shapes])
    closed = np.array([_loop_shape(x, max(r, 1.0), q) for r, q in shapes])
    odd, difference = points.branch * side * shape, _LOOP_DIFFERENCE * points.branch * closed
    even = points.branch * shape
    return np.concatenate(
        [np.stack([odd, difference], axis=1), np.stack([even, np.zeros_like(even)], axis=1)]
    )


def _ripple_sines(
    points: EffectPoints, dictionary: Dictionary
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return cosines and sines of all ripples, shape (k, n), and their linear change, (n,)."""
    way = points.u + dictionary.stretches[:, None] * points.u * np.abs(points.u)
    angle = TURN * dictionary.frequencies[:, None] * way
    cosine, sine = np.cos(angle), np.sin(angle)
    if np.any(dictionary.growing):
        grown = _GROWN * np.sqrt(np.abs(points.u))
        envelope = np.where(dictionary.growing[:, None] > 0.0, grown, 1.0)
        cosine, sine = envelope * cosine, envelope * sine
    return cosine, sine, _SLOPE_SHARE * points.u


def ripple_columns(points: EffectPoints, dictionary: Dictionary) -> FloatArray:
    """Return ripple with linear change of amplitude and frequency, shape (k, 4, n)."""
    cosine, sine, slope = _ripple_sines(points, dictionary)
    return np.stack([cosine, sine, slope * cosine, slope * sine], axis=1)


def _wave_sines(
    points: EffectPoints, frequencies: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return cosines and sines of all waves, shape (k, n), and the windows, shape (6, n)."""
    angle = TURN * frequencies[:, None] * points.u
    distance = (points.u[None, :] - _WAVE_CENTRES[:, None]) / _WAVE_REACH
    return np.cos(angle), np.sin(angle), np.exp(-0.5 * distance**2)


def wave_columns(points: EffectPoints, frequencies: FloatArray) -> FloatArray:
    """Return windowed sines, shape (k, 12, n)."""
    cosine, sine, window = _wave_sines(points, frequencies)
    return np.concatenate([cosine[:, None, :] * window, sine[:, None, :] * window], axis=1)


def bump_columns(points: EffectPoints, centres: FloatArray, widths: FloatArray) -> FloatArray:
    """Return local bumps, shape (b, 1, n)."""
    distance = (points.u[None, :] - centres[:, None]) / widths[:, None]
    return np.exp(-0.5 * distance**2)[:, None, :]


def skew_columns(points: EffectPoints) -> FloatArray:
    """Return smooth loops, shape (1, 7, n): some with the torque's sign, some with the same sign.

    The latter vanish at zero, where one direction passes into the other.
    """
    x, side = np.minimum(np.abs(points.u), 1.0), np.tanh(points.u / _SIDELESS)
    order = np.arange(_SKEW_WAVES)[:, None]
    course = points.branch * (1.0 - x) * np.cos(np.pi * order * x) / (1.0 + order)
    return np.concatenate([side * course, 2.0 * x * course[:-1]])[None]


def _plain_columns(points: EffectPoints, dictionary: Dictionary) -> dict[str, FloatArray]:
    """Return the columns of all kinds but ripple and waves."""
    return {
        "loop": loop_columns(points, dictionary.loop_shapes),
        "step": step_columns(points, dictionary.step_widths, dictionary.step_shift),
        "bump": bump_columns(points, dictionary.bump_centres, dictionary.bump_widths),
        "offset": np.ones((1, 1, points.u.size)),
        "skew": skew_columns(points),
    }


def all_columns(points: EffectPoints, dictionary: Dictionary) -> dict[str, FloatArray]:
    """Return the columns of every kind of effect."""
    return _plain_columns(points, dictionary) | {
        "ripple": ripple_columns(points, dictionary),
        "wave": wave_columns(points, dictionary.wave_frequencies),
    }


def effects_sum(
    points: EffectPoints, dictionary: Dictionary, means: dict[str, FloatArray]
) -> FloatArray:
    """Return the sum of all columns times their coefficients, shape (n,).

    Ripple and waves may have hundreds of candidates: their products with the slope and the windows
    are formed after the sum over the candidates.

    Parameters
    ----------
    points : EffectPoints
    dictionary : Dictionary
    means : dict of str to float64 array of shape (J, q)
        Coefficients of each kind's columns as in `all_columns`.
    """
    total = np.zeros(points.u.size)
    for kind, columns in _plain_columns(points, dictionary).items():
        total += means[kind].reshape(-1) @ columns.reshape(-1, points.u.size)
    cosine, sine, slope = _ripple_sines(points, dictionary)
    even, odd = means["ripple"][:, 0::2].T @ cosine, means["ripple"][:, 1::2].T @ sine
    total += even[0] + odd[0] + slope * (even[1] + odd[1])
    cosine, sine, window = _wave_sines(points, dictionary.wave_frequencies)
    even, odd = np.hsplit(means["wave"], 2)
    total += np.sum(window * (even.T @ cosine + odd.T @ sine), axis=0)
    return total


def make_effects(
    points: EffectPoints, dictionary: Dictionary, prior_scale: float = 1.0
) -> list[Effect]:
    """Evaluate the dictionary at calibration points and give every candidate its prior.

    Parameters
    ----------
    points : EffectPoints
        Calibration points.
    dictionary : Dictionary
        Candidate shapes.
    prior_scale : float, default 1
        Factor on all prior amplitudes, for data that aren't in a chain's usual proportions.

    Returns
    -------
    effects : list of Effect
        Loop, step, ripple, bumps, offset, waves where there are candidates, skew.
    """
    columns = all_columns(points, dictionary)
    loops = len(dictionary.loop_shapes)
    loop_prior = np.log(np.repeat(np.array(_LOOP_SHARES) / loops, loops))
    stretched = np.where(dictionary.stretches == 0.0, 1.0, _STRETCHED_SHARE)
    grows = np.where(dictionary.growing > 0.0, _GROWING_SHARE, 1.0)
    ripple_prior = stretched * grows / dictionary.frequencies
    priors = {
        "loop": (loop_prior, float(np.log(1.0 - sum(_LOOP_SHARES)))),
        "step": _prior(np.ones(len(columns["step"])), 0.2),
        "ripple": _prior(ripple_prior, 0.4),
        "bump": _prior(dictionary.bump_widths, 0.4),
        "offset": _prior(np.ones(1), 0.75),
        "wave": _prior(1.0 / dictionary.wave_frequencies, 0.6),
        "skew": _prior(np.ones(1), 0.4),
    }
    copies = _COPIES | {"step": _CLOSE_STEPS if dictionary.step_shift > 0.0 else 1}
    return [
        Effect(
            name,
            columns[name],
            prior_scale * np.array(_SCALES[name]),
            *priors[name],
            copies=copies.get(name, 1),
        )
        for name in KINDS
        if len(columns[name])
    ]


def _prior(weights: FloatArray, absent: float) -> tuple[FloatArray, float]:
    return np.log((1.0 - absent) * weights / weights.sum()), float(np.log(absent))


def _loop_shape(x: FloatArray, r: float, q: float) -> FloatArray:
    """Return xʳ(1 − x)^q, scaled to a maximum of one."""
    if r == 0.0:
        return np.asarray((1.0 - x) ** q)
    widest = r / (r + q)
    return np.asarray((x / widest) ** r * ((1.0 - x) / (1.0 - widest)) ** q)


def path_clocks(u: FloatArray, branch: FloatArray, series: FloatArray) -> FloatArray:
    """Read the time of calibration points off their place on the path.

    A series runs from zero to full scale and back, or through both directions, clockwise first. One
    clock starts again in each series and direction, where a zero may have been taken; the other
    runs through all of them.

    Parameters
    ----------
    u, branch, series : float64 array of shape (n,)
        Reading / full scale, branch, number of the series.

    Returns
    -------
    elapsed : float64 array of shape (2, n), (1, n) or (0, n)
        From 0 to 1; empty when a branch is unknown, one row when both clocks are the same.

    Examples
    --------
    >>> path_clocks(np.array([0.5, 1.0, 0.5]), np.array([1.0, 1.0, -1.0]), np.zeros(3))
    array([[0.25, 0.5 , 0.75]])
    """
    if np.any(branch == 0.0):
        return np.zeros((0, u.size))
    x = np.minimum(np.abs(u), 1.0)
    leg = np.where(branch > 0, 0.5 * x, 1.0 - 0.5 * x)
    # Readings next to zero scatter to both sides: they don't form a direction of their own.
    sided = x > 0.02
    keys = 2 * np.unique(series, return_inverse=True)[1] + (u < 0)
    present = np.unique(keys[sided])
    lone = ~np.isin(keys, present)
    keys[lone] = keys[lone] ^ 1
    rank = np.searchsorted(present, keys).astype(np.float64)
    groups = float(max(present.size, 1))
    if groups == 1.0:
        return leg[None, :]
    return np.array([leg, (rank + leg) / groups])
