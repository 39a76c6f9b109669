"""Fit, compare, load, apply and save compensations."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from torquebench.calibration import CalibrationData
from torquebench.campaign.chains import mounting_effect, reference_effect
from torquebench.campaign.fitting import (
    COMPARED_COLUMNS,
    described_model,
    fit_table,
    model_title,
    table_metrics,
)
from torquebench.chain import MeasuringChain, Readings, Torque
from torquebench.compensation import (
    RECOMMENDED,
    Comparison,
    CompensationModel,
    StoredModel,
    branch_values,
    check_kind,
    save_model,
)
from torquebench.compensation import compare as compare_models
from torquebench.compensation import load_model as load_stored
from torquebench.errors import InputError
from torquebench.html_table import html_table
from torquebench.message import Message
from torquebench.notebook.frames import (
    Columns,
    arrow_table,
    in_python,
    mapping_of,
    read_calibration,
    with_columns,
)
from torquebench.tables import ADDED_COLUMNS, ReadingsTable, TableColumns, table_of_arrow
from torquebench.uncertainty import CertifiedUncertainty

Outliers = Literal["downweight", "refuse", "keep"]


class FitWarning(UserWarning):
    """A warning about a fit."""


@dataclass(frozen=True, eq=False, repr=False)
class Compensation:
    """A fitted compensation with its measuring chain.

    Parameters
    ----------
    stored : StoredModel
        The model and its origin.
    calibration : CalibrationData or None
        The points to which it was fitted; None for a compensation from a file.
    """

    stored: StoredModel
    calibration: CalibrationData | None = None

    @property
    def model(self) -> CompensationModel:
        """The model itself, a scikit-learn estimator."""
        return self.stored.model

    @cached_property
    def chain(self) -> MeasuringChain:
        """The measuring chain, which computes torque, uncertainty and budget from readings."""
        return MeasuringChain.of(self.stored)

    def apply(
        self,
        readings: Any,
        *,
        columns: Columns | None = None,
        zero_age_h: float | None = None,
        zero_temperature_c: float | None = None,
    ) -> Any:
        """Return readings with torque, additional torque and expanded uncertainty (k = 2).

        Parameters
        ----------
        readings : path, pandas, polars or pyarrow frame, or mapping of str to column
            A table with the column ``reading_nm``; optional columns are ``branch``, ``speed_rpm``,
            ``temperature_c`` and ``standard_error_nm``. With ``time_s`` it is one record in time
            order, as for `torquebench apply`, and acceleration and branch follow from neighbouring
            rows. All columns are kept.
        columns : mapping of str to str, optional
            Headers with other names; see `read_calibration`.
        zero_age_h, zero_temperature_c : float, optional
            Time since the zero was taken, and the transducer's temperature then.

        Returns
        -------
        frame
            A frame of the same kind with the additional columns ``torque_nm``,
            ``additional_torque_nm`` and ``expanded_uncertainty_nm``; Arrow for a path or a mapping.
        """
        table = arrow_table(readings)
        try:
            named = table_of_arrow(table, "the table")
            found = ReadingsTable.of(
                named, TableColumns(named, ("reading_nm",), mapping_of(columns))
            )
            known = found.readings(zero_age_h=zero_age_h, zero_temperature_c=zero_temperature_c)
            torque = self.chain.torque(known, found.place)
        except InputError as problem:
            raise in_python(problem) from None
        values = (
            torque.value_nm,
            torque.value_nm - known.reading_nm,
            torque.expanded_uncertainty_nm,
        )
        kept = table if isinstance(readings, str | Path | Mapping) else readings
        return with_columns(kept, dict(zip(ADDED_COLUMNS, values, strict=True)))

    def torque(
        self,
        reading_nm: ArrayLike,
        *,
        branch: ArrayLike | None = None,
        speed_rpm: ArrayLike | None = None,
        temperature_c: ArrayLike | None = None,
    ) -> Torque:
        """Return torque, uncertainty and budget of readings.

        Parameters
        ----------
        reading_nm : array of shape (n,) or float
            Readings in N·m, clockwise positive.
        branch : array of shape (n,) or scalar, optional
            "up" where |torque| increases, "down" where it decreases.
        speed_rpm, temperature_c : array of shape (n,) or float, optional
        """
        try:
            reading = np.atleast_1d(np.asarray(reading_nm, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise _no_readings(reading_nm) from error
        if reading.ndim != 1:
            raise _no_readings(reading_nm)

        def each(values: ArrayLike | None) -> Any:
            if values is None:
                return None
            return np.broadcast_to(np.asarray(values, dtype=np.float64), reading.shape)

        sides = None if branch is None else branch_values(branch)
        return self.chain.torque(
            Readings(
                reading,
                branch=each(sides),
                speed_rpm=each(speed_rpm),
                temperature_c=each(temperature_c),
            )
        )

    def save(self, path: str | Path) -> Path:
        """Write the model file for commands, bench and `load_model`."""
        return save_model(path, self.stored)

    def __repr__(self) -> str:
        made = self.stored.provenance
        words = [model_title(self.model.kind, self.model.kind_parameters), f"{made.range_nm:g} N·m"]
        words += [f"transducer {made.transducer_serial}"] * bool(made.transducer_serial)
        words += ["contradicts its calibration"] * bool(made.contradictions)
        return f"Compensation({', '.join(words)})"

    def _repr_html_(self) -> str:
        made = self.stored.provenance
        rows = [(name, f"{value:.4g}") for name, value in made.metrics.items()]
        rows += [("contradiction", each) for each in made.contradictions]
        rows += [("not in U", each) for each in self.chain.missing()]
        return html_table(repr(self), (), rows)


def fit(
    calibration: Any,
    model: str = RECOMMENDED,
    *,
    reference: str = "",
    outliers: Outliers = "downweight",
) -> Compensation:
    """Fit a compensation to a calibration.

    Parameters
    ----------
    calibration : CalibrationData, or what `read_calibration` takes
    model : str
        Kind of model; by default the recommended one.
    reference : str, optional
        U (k = 2) of the reference standard in %, such as ``"0.02 of range"`` or ``"0.02 of
        torque"``, instead of the table's; it enters every U.
    outliers : {"downweight", "refuse", "keep"}
        Treatment of outliers, which warnings name in any case.

    Raises
    ------
    InputError
        The model is unknown or refuses the points, or `reference` doesn't state to what its
        percentage refers.

    Warns
    -----
    FitWarning
        Points contradict each other, there are outliers, the model is worse than the raw reading,
        or the standard is unknown or another one than the table's.

    Examples
    --------
    >>> import torquebench as tb
    >>> up, down = np.arange(1.0, 11.0), np.arange(9.0, 0.0, -1.0)
    >>> reading = np.concatenate([up, down, -up, -down])
    >>> branch = (["up"] * 10 + ["down"] * 9) * 2
    >>> points = {"reading_nm": reading, "standard_nm": 1.01 * reading, "branch": branch}
    >>> calibration = tb.read_calibration(points, range_nm=10.0)
    >>> tb.fit(calibration, "polynomial-1", reference="0.02 of range")
    Compensation(polynomial, degree 1, 10 N·m)
    """
    data = _calibration(calibration)
    check_kind(model)
    stated = CertifiedUncertainty.of_words(reference, data.range_nm) if reference else None
    found = fit_table(data, "the calibration", model, outliers=outliers)
    remarks = [*found.remarks, *map(str, found.contradictions)]
    standard = reference_effect(data, stated, "the calibration", remarks.append)
    if not standard:
        remarks.append(Message("U of the reference standard isn't in U: state it as `reference`"))
    for remark in remarks:
        warnings.warn(remark, FitWarning, stacklevel=2)
    effects = (*standard, *mounting_effect(data))
    stored = described_model(found.model, data, table_metrics(found), effects, found.contradictions)
    return Compensation(stored, data)


def compare(
    calibration: Any,
    models: Sequence[str] | Mapping[str, CompensationModel] | None = None,
    *,
    folds: int = 10,
) -> Comparison:
    """Compare models by their errors at steps that they weren't fitted to.

    Parameters
    ----------
    calibration : CalibrationData, or what `read_calibration` takes
    models : sequence of str, or mapping of names to unfitted models, optional
        By default all kinds, which takes a while.
    folds : int, default 10
    """
    data = _calibration(calibration)
    if isinstance(models, str):
        models = (models,)
    return compare_models(
        data.features(COMPARED_COLUMNS),
        data.standard_nm,
        models,
        range_nm=data.range_nm,
        folds=folds,
    )


def load_model(path: str | Path) -> Compensation:
    """Read a model file that `fit`, `calibrate` or `Compensation.save` wrote.

    Raises
    ------
    InputError
        The file can't be read, or was changed.
    """
    return Compensation(load_stored(path))


def _no_readings(given: Any) -> InputError:
    return InputError(
        Message("readings as {name}", type(given).__name__),
        "a number, or an array of numbers, in N·m",
        "give a table to `apply`",
    )


def _calibration(source: Any) -> CalibrationData:
    return source if isinstance(source, CalibrationData) else read_calibration(source)
