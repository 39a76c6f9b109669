"""The compensation that is active on one side, applied to live samples."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.samples import CompensatedSamples
from torquebench.compensation import CompensationModel, features
from torquebench.compensation.table import CompensationTable, compile_table
from torquebench.errors import InputError

__all__ = ["ActiveCompensation"]

STATE = frozenset({"speed_rpm", "temperature_c"})
"""Features that change while a compensation is active: no table holds for all of them."""


@dataclass(frozen=True, eq=False)
class ActiveCompensation:
    """A fitted model in use, with what it is called in the registry.

    Live readings have no known branch (0), so a model with hysteresis states its middle and the
    wider uncertainty that goes with it.

    Attributes
    ----------
    table : CompensationTable or None
        The model compiled once, within 1e-6 of full scale: what live windows are compensated by.
        None where the model looks at speed or temperature or can't be followed by a table; then
        the model itself is asked, which takes milliseconds a block.
    """

    model: CompensationModel
    model_id: str
    kind: str
    table: CompensationTable | None = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "table", _compiled(self.model))

    @property
    def _columns(self) -> int:
        """How many of the known columns the model was fitted to."""
        return int(self.model.n_features_in_)

    def value(
        self, reading_nm: float, speed_rpm: float, temperature_c: float
    ) -> tuple[float, float]:
        """Compensated torque and the model's standard uncertainty of one reading, N·m.

        Raises
        ------
        InputError
            The reading lies outside the calibrated range.
        """
        X = features([reading_nm], 0, 0, speed_rpm, temperature_c)
        torque, uncertainty = self.model.predict(X[:, : self._columns], return_std=True)
        return float(torque[0]), float(uncertainty[0])

    def samples(
        self, reading_nm: NDArray[np.float64], speed_rpm: float, temperature_c: float
    ) -> CompensatedSamples:
        """Compensate windows; those with a fault or out of range get no number."""
        inside = (reading_nm >= self.model.reading_low_nm_) & (
            reading_nm <= self.model.reading_high_nm_
        )
        torque = np.full(reading_nm.shape, np.nan)
        uncertainty = np.full(reading_nm.shape, np.nan)
        if self.table is not None:
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
        return CompensatedSamples(torque, uncertainty)


def _compiled(model: CompensationModel) -> CompensationTable | None:
    if STATE.intersection(model.used_features):
        return None
    try:
        return compile_table(model, branches=False)
    except InputError:  # a curve that jumps
        return None
