"""Ripple of the torque in torque-angle loops: its influence, and the unaffected samples."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from torquebench.message import Message
from torquebench.reducers.loops.branches import Recording
from torquebench.reducers.loops.results import LoopFeatures
from torquebench.reducers.preparation import levels_of, moving_mean, turning_points
from torquebench.reducers.quantities import Finding

Floats = NDArray[np.float64]
LOADED = 0.3
"""Share of the largest torque above which ripple is searched; below it, backlash causes jumps."""
LINE_SHARE = 0.5
"""Smallest share of the ripple in the fast changes of torque and angle."""
SLOWEST = 20.0
FASTEST = 2.2
OVERTONE = 0.1
"""Share of the ripple's power from which on an overtone has peaks of its own."""
RESOLVED = 6.0
"""Fewest samples in a period that resolve a ripple's peaks."""
LEFT = 0.15
"""Standard uncertainty of the bias of the outermost samples, as a share of the ripple's influence,
where the torque is measured beyond a flange that swings with it: on four of five simulated benches,
with 12 to 21 samples a period, the backlash was too small by 0.13 to 0.24; on the fifth the
ripple's influence was below the noise.
"""
LEFT_AT_REDUCER = 0.05
"""The same where the torque is measured at the reducer: on the same four benches the backlash was
too small by 0.01 to 0.04 and the loss by 0.02 to 0.08.
"""
LEFT_UNRESOLVED = 0.5
"""Share that is left of a faster ripple, whose peaks aren't resolved.
"""


@dataclass(frozen=True)
class Ripple:
    """A ripple of the torque that turns the loading back and forth.

    Parameters
    ----------
    period : float
        Period of the ripple's fastest strong harmonic, in samples.
    amplitude_nm : float
        Half of peak to peak, N·m.
    """

    period: float
    amplitude_nm: float

    @property
    def averaged(self) -> int:
        """Number of samples that may be averaged without losing the ripple's peaks."""
        return max(1, round(self.period / 8.0))


@dataclass(frozen=True)
class RippleLeft:
    """Standard uncertainties of a ripple's remaining influence."""

    backlash_rad: float = 0.0
    lost_motion_rad: float = 0.0
    energy_j: float = 0.0


NOTHING_LEFT = RippleLeft()


def without_ripple(
    recording: Recording, resolution_rad: float = 0.0
) -> tuple[Recording, Ripple | None]:
    """Leave only the outermost samples of a record whose torque ripples, position by position.

    A position whose torque doesn't ripple keeps its samples. The returned ripple is the fastest of
    all positions.
    """
    parts: list[tuple[Floats, Floats, NDArray[np.intp]]] = []
    fastest: Ripple | None = None
    for rows in recording.positions():
        torque, angle = recording.torque[rows], (recording.angle - recording.subtracted)[rows]
        ripple = None if levels_of(torque) else find_ripple(torque, angle)
        if ripple is not None:
            torque, angle, left = outermost(torque, angle, ripple, resolution_rad)
            rows = rows[left]
            if fastest is None or ripple.period < fastest.period:
                fastest = ripple
        parts.append((torque, angle, rows))
    if fastest is None:
        return recording, None
    torques, angles, rows = (np.concatenate(column) for column in zip(*parts, strict=True))
    return recording.at(rows).changed(torques, angles), fastest


def effect_of_ripple(
    ripple: Ripple,
    steady: Sequence[LoopFeatures],
    rippling: Sequence[LoopFeatures],
    *,
    at_reducer: bool,
) -> tuple[RippleLeft, Finding]:
    """Return the uncertainty that ripple leaves in a loop's results, and a remark about it.

    Loops whose branches were read at new largest angles only (`steady`) are compared with loops by
    all samples (`rippling`). A share of their difference is the uncertainty; the share is smaller
    if the torque was measured at the reducer.
    """
    left = LEFT_AT_REDUCER if at_reducer else LEFT
    if ripple.period < RESOLVED:
        left = LEFT_UNRESOLVED

    def change(value: Callable[[LoopFeatures], float]) -> float:
        """Return by how much the mean of a loop's value differs between steady and rippling."""
        means = [float(np.mean([value(loop) for loop in loops])) for loops in (steady, rippling)]
        return abs(means[0] - means[1])

    energy = change(lambda each: each.energy.value)
    hidden = energy / max(float(np.mean([abs(each.energy.value) for each in steady])), 1e-300)
    remedy = "load with less ripple to avoid this correction"
    if ripple.period < RESOLVED:
        remedy = Message("sample faster: at least {count:g} samples a period", RESOLVED)
    uncertain = RippleLeft(
        left * change(lambda each: each.backlash.value),
        left * change(lambda each: each.lost_motion.value),
        left * energy,
    )
    return uncertain, Finding(
        "torque ripple",
        Message(
            "the torque ripples by ±{amplitude_nm:.3g} N·m with {period:.3g} samples "
            "a period, which narrows a loop as a vibration does ({hidden:.2g} % of "
            "its energy); branches are read where the angle exceeds all earlier "
            "angles, where ripple has no effect",
            ripple.amplitude_nm,
            ripple.period,
            100.0 * hidden,
        ),
        remedy,
    )


def find_ripple(torque: Floats, angle: Floats) -> Ripple | None:
    """Return the ripple of a record in the order of measurement, if torque and angle have one.

    A ripple is a line with overtones in the spectra of both, which holds most of the changes that
    are faster than a twentieth of the record.
    """
    largest = float(np.max(np.abs(torque)))
    stretches = []
    for start, stop in pairwise(turning_points(torque).tolist()):
        sign = np.sign(torque[stop] - torque[start])
        inside = np.flatnonzero(sign * torque[start:stop] > LOADED * largest)
        if inside.size >= 64:
            stretches.append(slice(start + inside[0], start + inside[-1] + 1))
    lines = [line for line in (_line(torque[part], angle[part]) for part in stretches) if line]
    if 2 * len(lines) <= len(stretches):
        return None
    period = float(np.median([line.period for line in lines]))
    return Ripple(period, float(np.median([line.amplitude_nm for line in lines])))


def _line(torque: Floats, angle: Floats) -> Ripple | None:
    """Return period and amplitude of a ripple in torque and angle; None without one."""
    quick, moved = _quick(torque), _quick(angle)
    window = np.hanning(quick.size)
    power, both = (np.abs(np.fft.rfft(values * window)) ** 2 for values in (quick, moved))
    first, last = int(SLOWEST), int(quick.size / FASTEST)
    if last <= first + 2:
        return None
    peak = first + int(np.argmax(power[first:last]))
    # The strongest line may be an overtone, amplified by the bench's own resonance.
    best = max((peak, peak / 2.0, peak / 3.0), key=lambda base: _harmonics(power, base).sum())
    lines = _harmonics(power, best)
    if min(lines.sum(), _harmonics(both, best).sum()) < LINE_SHARE:
        return None
    strong = 1.0 + np.flatnonzero(lines > OVERTONE)[-1]
    amplitude = float(np.sqrt(2.0 * lines.sum()) * quick.std())
    return Ripple(quick.size / (best * float(strong)), amplitude)


def _harmonics(power: Floats, base: float) -> Floats:
    """Return the shares of a line and its next two harmonics in a power spectrum."""
    shares = []
    for number in (1, 2, 3):
        half = 2.0 + 0.05 * base
        line = slice(max(1, int(number * base - half)), int(number * base + half) + 2)
        shares.append(float(power[line].sum() / power.sum()))
    return np.array(shares)


def _quick(values: Floats) -> Floats:
    """Return a signal's deviation from its mean over a twentieth of its length."""
    width = max(5, int(values.size / SLOWEST)) | 1
    padded = np.pad(values, width // 2, mode="reflect", reflect_type="odd")
    return values - np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def outermost(
    torque: Floats, angle: Floats, ripple: Ripple, resolution_rad: float = 0.0
) -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Return the samples at which a branch exceeds all earlier angles, and their indices.

    A hysteresis with return-point memory is independent of an inner loop once the angle has passed
    the point where it began (Madelung's rules; Brokate and Sprekels, Hysteresis and Phase
    Transitions, 1996, section 2.2). So at the outermost angles, torque and angle are on the branch
    of a steady ramp, independent of the ripple in between.

    Parameters
    ----------
    torque, angle : array of float, shape (n,)
        Torque and angle in the order of measurement, at one position.
    ripple : Ripple
        Sets over how many samples torque and angle are averaged first.
    resolution_rad : float
        Step of the angle's counts. Both directions pass a step at its beginning: half of it is
        subtracted, so that it doesn't narrow the loop.

    Returns
    -------
    torque, angle : array of float, shape (m,)
        Averaged values.
    row : array of int, shape (m,)
        The samples that they belong to.

    Examples
    --------
    >>> torque = np.array([-9.0, -4.0, 1.0, -1.0, 4.0, 9.0, 4.0, -1.0, 1.0, -4.0, -9.0])
    >>> outermost(torque, torque / 100.0, Ripple(4.0, 1.0))[2].tolist()
    [0, 1, 2, 4, 5, 6, 7, 9, 10]
    """
    width = ripple.averaged
    rows, torques, angles = [], [], []
    turns = turning_points(torque).tolist()
    for start, stop in pairwise(turns):
        end = stop + 1 if stop == turns[-1] else stop
        load, twist = (_averaged(column[start:end], width) for column in (torque, angle))
        ahead = twist * np.sign(torque[stop] - torque[start])
        reached = np.maximum.accumulate(ahead)
        step = np.diff(reached, prepend=reached[0])
        new = np.append(True, step[1:] > 0.0)
        twist -= 0.5 * np.minimum(step, resolution_rad) * np.sign(torque[stop] - torque[start])
        rows.append(start + np.flatnonzero(new))
        torques.append(load[new])
        angles.append(twist[new])
    return np.concatenate(torques), np.concatenate(angles), np.concatenate(rows)


def _averaged(values: Floats, width: int) -> Floats:
    if width < 2 or values.size < 2 * width:
        return values.copy()
    return moving_mean(values, width)
