"""The compensation that is active on one side, applied to live samples."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.samples import CompensatedSamples
from torquebench.compensation import (
    FEATURES,
    CompensationModel,
    HistoryCompensator,
    features,
)
from torquebench.compensation.table import CompensationTable, compile_table
from torquebench.errors import InputError

__all__ = ["AcceptedCounter", "ActiveCompensation"]

STATE = frozenset({"speed_rpm", "temperature_c"})
"""Features that change while a compensation is active: no table holds for all of them."""

_GAP_STEPS = 3.0  # windows: fewer missing ones can't hide a reversal that matters


@dataclass(frozen=True)
class AcceptedCounter:
    """Another counter whose models are accepted with the present one, at a price in uncertainty.

    Two timebases that differ by a relative d make the same edges differ by d·f in frequency. The
    torque that this looks like is d·f/s with the sensitivity s, which is d·(f₀/s + T): it shifts
    the zero, as long as none was measured with the present counter, and the gain. Nobody knows d
    but for its limit, so its distribution is rectangular (GUM 4.3.7).

    Parameters
    ----------
    identity : str
        Counter and clock that the model was made with.
    tolerance_ppm : float
        Largest relative difference of the two timebases, 1e-6: the sum of both tolerances.

    Raises
    ------
    InputError
        The tolerance isn't above 0 and at most 1000 ppm.

    Examples
    --------
    >>> accepted = AcceptedCounter("PXI-1/oscillator-1", tolerance_ppm=100.0)
    >>> accepted.standard_uncertainty_nm(np.array([0.0, 2000.0]), zero_nm=4000.0).round(3).tolist()
    [0.231, 0.346]
    """

    identity: str
    tolerance_ppm: float = 100.0

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance_ppm <= 1000.0:
            raise InputError(
                f"timebases that differ by {self.tolerance_ppm:g} ppm",
                "above 0 and at most 1000 ppm",
                "state the sum of both clocks' tolerances",
            )

    def standard_uncertainty_nm(
        self, torque_nm: NDArray[np.float64], zero_nm: float
    ) -> NDArray[np.float64]:
        """Return the standard uncertainty (k = 1) that it adds, N·m.

        Parameters
        ----------
        torque_nm : float64 array
        zero_nm : float
            The zero's frequency over the sensitivity, N·m.
        """
        limit = self.tolerance_ppm * 1e-6 * (zero_nm + np.abs(torque_nm))
        return np.asarray(limit / np.sqrt(3.0))


@dataclass(frozen=True, eq=False)
class ActiveCompensation:
    """A fitted model in use, with what it is called in the registry.

    Where the model tells the branches of a hysteresis loop apart, the branch of a live reading
    follows from the readings before it: every block moves the plays of a `HistoryCompensator`.
    After the start, a gap or a fault the past is unknown, and the uncertainty says so until the
    readings have turned round often enough. Blocks are to be handed over once and in order.

    Attributes
    ----------
    table : CompensationTable or None
        The model compiled once, within 1e-6 of full scale: what live windows are compensated by.
        None where the model looks at speed or temperature or can't be followed by a table; then
        the model itself is asked, which takes milliseconds a block.
    accepted : AcceptedCounter or None
        Set where the model was made with another counter, whose uncertainty is added.
    zero_nm : float
        The zero's frequency over the sensitivity of the transducer, N·m.
    history : HistoryCompensator or None
        Place in the loop; None without a table or for a model that doesn't look at the branch.
    """

    model: CompensationModel
    model_id: str
    kind: str
    accepted: AcceptedCounter | None = None
    zero_nm: float = 0.0
    table: CompensationTable | None = field(init=False)
    history: HistoryCompensator | None = field(init=False)
    _clock: _StreamClock = field(init=False)

    def __post_init__(self) -> None:
        aware = "branch" in self.model.used_features and self._columns > FEATURES.index("branch")
        table = _compiled(self.model, aware)
        object.__setattr__(self, "table", table)
        history = HistoryCompensator(table) if aware and table is not None else None
        object.__setattr__(self, "history", history)
        object.__setattr__(self, "_clock", _StreamClock())

    @property
    def _columns(self) -> int:
        """How many of the known columns the model was fitted to."""
        return int(self.model.n_features_in_)

    def warm_up(self) -> None:
        """Compile what the first block would have to wait for; the past stays unknown."""
        self.samples(np.zeros(1), 0.0, 20.0)
        self.forget()

    def forget(self) -> None:
        """Take the past as unknown."""
        self._clock.last_s = np.nan
        if self.history is not None:
            self.history.forget()

    def value(
        self, reading_nm: float, speed_rpm: float, temperature_c: float
    ) -> tuple[float, float]:
        """Compensated torque and the model's standard uncertainty of one reading, N·m.

        The reading is where the stream stands, such as the mean of its last windows.

        Raises
        ------
        InputError
            The reading lies outside the calibrated range.
        """
        if self.history is not None and self._inside(np.array([reading_nm]))[0]:
            live = self.history.peek(reading_nm)
            return float(live.torque_nm[0]), float(live.standard_uncertainty_nm[0])
        X = features([reading_nm], 0, 0, speed_rpm, temperature_c)
        torque, uncertainty = self.model.predict(X[:, : self._columns], return_std=True)
        return float(torque[0]), float(self.widened(torque, uncertainty)[0])

    def rectified_nm(
        self, reading_nm: NDArray[np.float64], speed_rpm: float, temperature_c: float
    ) -> float:
        """Return what a ripple adds to the torque of the mean reading by the curve's bend, N·m.

        The mean torque of readings less the torque of their mean, in the middle of the loop; 0
        where one of them is outside the calibrated range.

        Parameters
        ----------
        reading_nm : float64 array of shape (n,)
            Windows over whole periods of the ripple.
        speed_rpm, temperature_c : float
            Over the same time.
        """
        if not self._inside(reading_nm).all():
            return 0.0
        both = np.append(reading_nm, reading_nm.mean())
        X = features(both, 0, 0, speed_rpm, temperature_c)
        torque = self.model.predict(X[:, : self._columns])
        return float(torque[:-1].mean() - torque[-1])

    def widened(
        self, torque_nm: NDArray[np.float64], uncertainty_nm: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return standard uncertainties with what another counter's clock may have changed, N·m."""
        if self.accepted is None:
            return uncertainty_nm
        added = self.accepted.standard_uncertainty_nm(torque_nm, self.zero_nm)
        return np.asarray(np.hypot(uncertainty_nm, added))

    def samples(
        self,
        reading_nm: NDArray[np.float64],
        speed_rpm: float,
        temperature_c: float,
        time_s: NDArray[np.float64] | None = None,
    ) -> CompensatedSamples:
        """Compensate windows; those with a fault or out of range get no number.

        Parameters
        ----------
        reading_nm : float64 array of shape (n,)
            Next readings of the stream; NaN where a window has a fault.
        speed_rpm, temperature_c : float
            Over the block.
        time_s : float64 array of shape (n,), optional
            Their times, by which a gap after the block before is seen.
        """
        inside = self._inside(reading_nm)
        torque = np.full(reading_nm.shape, np.nan)
        uncertainty = np.full(reading_nm.shape, np.nan)
        if self.history is not None:
            if time_s is not None and self._clock.has_gap(time_s):
                self.history.forget()
            self._follow(self.history, reading_nm, inside, torque, uncertainty)
        elif self.table is not None:
            accepted = reading_nm[inside]
            torque[inside] = self.table.torque(accepted)
            uncertainty[inside] = self.table.standard_uncertainty(accepted)
        elif inside.any():
            X = features(reading_nm[inside], 0, 0, speed_rpm, temperature_c)
            try:
                torque[inside], uncertainty[inside] = self.model.predict(
                    X[:, : self._columns], return_std=True
                )
            except InputError:  # a speed or temperature that the model refuses
                torque[inside] = uncertainty[inside] = np.nan
        return CompensatedSamples(torque, self.widened(torque, uncertainty))

    def _inside(self, reading_nm: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.asarray(
            (reading_nm >= self.model.reading_low_nm_) & (reading_nm <= self.model.reading_high_nm_)
        )

    @staticmethod
    def _follow(
        history: HistoryCompensator,
        reading_nm: NDArray[np.float64],
        inside: NDArray[np.bool_],
        torque: NDArray[np.float64],
        uncertainty: NDArray[np.float64],
    ) -> None:
        """Move along the readings, forgetting the past wherever one is missing."""
        finite = np.isfinite(reading_nm)
        runs = [slice(0, reading_nm.size)]
        if not finite.all():
            cuts = np.flatnonzero(np.diff(finite)) + 1
            ends = np.concatenate(([0], cuts, [reading_nm.size]))
            runs = [slice(start, stop) for start, stop in pairwise(ends.tolist())]
        for run in runs:
            if run.stop == run.start:
                continue
            if not finite[run.start]:
                history.forget()
                continue
            live = history.push(reading_nm[run])
            kept = inside[run]
            torque[run][kept] = live.torque_nm[kept]
            uncertainty[run][kept] = live.standard_uncertainty_nm[kept]


class _StreamClock:
    """Time of a stream's last window."""

    def __init__(self) -> None:
        self.last_s = np.nan

    def has_gap(self, time_s: NDArray[np.float64]) -> bool:
        """Say whether windows are missing since the last block; without one before, no."""
        if time_s.size == 0:
            return False
        before, self.last_s = self.last_s, float(time_s[-1])
        step = float(time_s[1] - time_s[0]) if time_s.size > 1 else float(time_s[0]) - before
        return bool(time_s[0] - before > _GAP_STEPS * step)


def _compiled(model: CompensationModel, branch_aware: bool) -> CompensationTable | None:
    if STATE.intersection(model.used_features):
        return None
    try:
        return compile_table(model, branches=branch_aware)
    except InputError:  # a curve that jumps
        return None
