"""Compensation of a recorded stream of readings block by block, like the live one."""

from __future__ import annotations

import itertools
from dataclasses import fields, replace
from typing import Any

import numpy as np

from torquebench.chain.acceleration import LEARNED, AccelerationBySpeed
from torquebench.chain.measuring_chain import GAP_STEPS, MeasuringChain
from torquebench.chain.readings import FloatArray, Readings
from torquebench.chain.torque import Torque, joined

__all__ = ["RecordedStream", "rows_of"]


def rows_of(readings: Readings, rows: slice) -> Readings:
    """Return some of the readings."""

    def chosen(value: Any) -> Any:
        return value[rows] if isinstance(value, np.ndarray) and value.ndim else value

    return replace(
        readings, **{each.name: chosen(getattr(readings, each.name)) for each in fields(Readings)}
    )


class RecordedStream:
    """Compensates a record with times: blocks in order, each with the next one.

    The acceleration comes from the speed if it isn't given, and the place in the hysteresis loop
    from the readings before if no branch is given. Where readings are missing or times go back, the
    past is unknown. The result equals that of `ChainStream` for the same readings and
    accelerations, wherever the record is cut; but the torque by a dynamic filter, which is late in
    a live stream, belongs to the time of its row.

    Parameters
    ----------
    chain : MeasuringChain
    by_speed : AccelerationBySpeed, optional
        By the first block, if not given.

    Attributes
    ----------
    completed_last : Readings
        The last block with derived quantities.

    Examples
    --------
    >>> from torquebench.compensation import features, make_model
    >>> standard = np.linspace(-50.0, 50.0, 20)
    >>> model = make_model("polynomial").fit(features(standard), standard)
    >>> stream = RecordedStream(MeasuringChain(model))
    >>> block = Readings(np.array([1.0, 2.0]), time_s=np.array([0.0, 0.1]))
    >>> stream.torque(block, None).value_nm.round(9).tolist()
    [1.0, 2.0]
    """

    completed_last: Readings

    def __init__(self, chain: MeasuringChain, by_speed: AccelerationBySpeed | None = None) -> None:
        self.chain = chain
        self._rows, self._dynamics = chain.recorded()
        self._stream = self._rows.stream()
        self._by_speed = by_speed
        self._step_s: float | None = None
        self._before: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros(0))

    def torque(self, readings: Readings, following: Readings | None) -> Torque:
        """Return the torque of the next block; NaN where an effect refuses a reading.

        Parameters
        ----------
        readings : Readings
            With times.
        following : Readings or None
            The block after it: the slope of the speed at the end depends on it.
        """
        known = self.completed_last = self.completed(readings, following)
        if self._dynamics is not None:
            self._dynamics.prepare(known, following)
        if known.branch is not None:
            return self._rows.independent(known)
        assert known.time_s is not None
        step = np.diff(known.time_s)
        if self._step_s is None and step.size:
            self._step_s = float(np.median(step[:LEARNED]))
        cuts: list[int] = []
        if self._step_s is not None:
            cuts = (np.flatnonzero((step > GAP_STEPS * self._step_s) | (step < 0.0)) + 1).tolist()
        ends = [0, *cuts, len(known)]
        return joined(
            [
                self._stream.push(rows_of(known, slice(start, stop)), self._step_s)
                for start, stop in itertools.pairwise(ends)
            ]
        )

    def completed(self, readings: Readings, following: Readings | None) -> Readings:
        """Return the readings with the acceleration by their speed and the calibration's age."""
        readings = self.chain.dated(readings)
        time_s, speed = readings.time_s, readings.speed_rpm
        if (
            readings.acceleration_rad_s2 is not None
            or time_s is None
            or not isinstance(speed, np.ndarray)
        ):
            return readings
        if self._by_speed is None:
            self._by_speed = AccelerationBySpeed.of(time_s, speed)
        reach = self._by_speed.context
        after_s, after = np.zeros(0), np.zeros(0)
        if following is not None and following.time_s is not None:
            after_s, after = following.time_s[:reach], np.asarray(following.speed_rpm)[:reach]
        before_s, before = self._before
        slope, uncertainty = self._by_speed(
            np.concatenate([before_s, time_s, after_s]), np.concatenate([before, speed, after])
        )
        self._before = time_s[-reach:], speed[-reach:]
        own = slice(before.size, before.size + speed.size)
        return replace(
            readings,
            acceleration_rad_s2=slope[own],
            acceleration_uncertainty_rad_s2=uncertainty[own],
        )
