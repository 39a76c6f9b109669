"""Noise of a reading by its counter, and difference of the counter's timebase."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import ClassVar

import numpy as np

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import Readings
from torquebench.chain.torque import NOISE, Component
from torquebench.elementwise import Values, elementwise
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty import Distribution, Shared


@register("counter")
@dataclass(frozen=True)
class Counter(Effect):
    """White noise of a reading: quantisation and edge jitter; of a mean, its standard error.

    The scatter of the calibration's points already contains the standard error of their means: only
    the noise of a reading beyond it is added.

    Parameters
    ----------
    window_nm : float or None
        Standard uncertainty in one window of the bench, N·m, for single readings without a value of
        their own. None if unknown; then U doesn't contain it.
    steps_nm : float
        Standard error of the calibration's step means (median), N·m; 0 if it isn't known.
    """

    title: ClassVar[str] = "noise of single readings"
    needs: ClassVar[tuple[str, ...]] = ("counter_nm",)
    window_nm: float | None = field(default=None, metadata={"least": 0.0})
    steps_nm: float = field(default=0.0, metadata={"least": 0.0})

    def gaps(self) -> tuple[str, ...]:
        """Name the noise if it is unknown."""
        return (self.title,) if self.window_nm is None else ()

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the noise of each reading; for a steady mean without standard error, none."""
        steady = readings.window_s == np.inf
        number, (noise,) = elementwise(torque_nm, readings.counter_nm)
        unstated = 0.0 if steady else self.window_nm or 0.0
        noise = number.where(number.isnan(noise), unstated, noise)
        if self.steps_nm:
            noise = number.sqrt(number.maximum(noise * noise - self.steps_nm**2, 0.0))
        return (Component(NOISE, Shared.NOTHING, noise),)


@register("time base")
@dataclass(frozen=True)
class Timebase(Effect):
    """Difference between the present counter's clock and that of the calibration.

    Two timebases that differ by a relative d make the same edges differ by d·f in frequency. The
    apparent torque is d·f/s with the sensitivity s, which is d·(f₀/s + T): it shifts the gain and,
    unless a zero was measured with the present counter, the zero. Only a limit of d is known, so
    its distribution is rectangular (GUM 4.3.7).

    Parameters
    ----------
    identity : str
        Counter and clock that the chain was calibrated with.
    tolerance_ppm : float
        Largest relative difference of the two timebases, 1e-6: the sum of both tolerances.
    zero_nm : float
        The zero's frequency over the sensitivity, N·m.

    Raises
    ------
    InputError
        The tolerance isn't above 0 and at most 1000 ppm.

    Examples
    --------
    >>> timebase = Timebase("PXI-1/oscillator-1", "PXI-1/oscillator-1", 100.0, zero_nm=4000.0)
    >>> torque = np.array([0.0, 2000.0])
    >>> timebase.components(Readings(torque), torque)[0].uncertainty_nm.round(3).tolist()
    [0.231, 0.346]
    """

    title: ClassVar[str] = "time base"
    expected: ClassVar[bool] = False
    identity: str = ""
    tolerance_ppm: float = 100.0
    zero_nm: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance_ppm <= 1000.0:
            raise InputError(
                Message("timebases that differ by {tolerance_ppm:g} ppm", self.tolerance_ppm),
                "above 0 and at most 1000 ppm",
                "state the sum of both clocks' tolerances",
            )

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the effect of the difference of the clocks on zero and gain."""
        limit = self.tolerance_ppm * 1e-6 * (self.zero_nm + np.abs(torque_nm))
        return (
            Component(
                "time base",
                Shared.CALIBRATION,
                limit / sqrt(3.0),
                distribution=Distribution.RECTANGULAR,
            ),
        )
