"""Deviations of a calibration from its profile, each with the clause that it breaks."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date, datetime
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration.data import CalibrationData
from torquebench.calibration.profile import (
    Consequence,
    Profile,
    available_profiles,
    load_profile,
)
from torquebench.calibration.series import DIRECTIONS, own_steps, tare
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.units import minus_signs

DeviationKind = Literal[
    "missing_series",
    "missing_step",
    "step_off",
    "zero_return",
    "expired_reference",
    "temperature_drift",
    "unsettled",
    "changed_record",
]

_WORDS = {**DIRECTIONS, 0: "through both directions"}


@dataclass(frozen=True)
class ReferenceStandard:
    """The reference standard of a calibration, as stated in its certificate.

    Parameters
    ----------
    serial, certificate_number : str
        Serial number of the standard, and number of its certificate.
    due : datetime.date or None
        Last day on which its certificate is valid; None if not stated.
    """

    serial: str = ""
    certificate_number: str = ""
    due: date | None = None


@dataclass(frozen=True, eq=False)
class CalibrationRecord:
    """Points of a calibration with their conditions, for a certificate.

    Parameters
    ----------
    data : CalibrationData
        The points in measuring order.
    performed : datetime.datetime
        Time of the calibration, with time zone.
    reference : ReferenceStandard
        The reference standard of the points.
    unsettled : int
        Number of points that still drifted at the end of their waiting time.
    changes : tuple of str
        Changes of the record since it was sealed; empty if there are none.
    """

    data: CalibrationData
    performed: datetime
    reference: ReferenceStandard = ReferenceStandard()
    unsettled: int = 0
    changes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Deviation:
    """One deviation from a profile.

    Parameters
    ----------
    kind : str
        Its key in the profile's table ``[deviations]``.
    clause : str
        Key path of the profile's setting that is broken, such as
        ``"loading.step_tolerance_percent"``.
    found, allowed : str
        Deviating and allowed value, with unit.
    consequence : {"refuse", "state"}
        Whether a certificate is refused or states the deviation.
    """

    kind: DeviationKind
    clause: str
    found: str
    allowed: str
    consequence: Consequence

    def __str__(self) -> str:
        return Message(
            "{found}; allowed: {allowed} (clause {clause})", self.found, self.allowed, self.clause
        )


@dataclass(frozen=True)
class _Expected:
    clause: str
    position_deg: float
    sign: int
    decreasing: bool


def find_deviations(record: CalibrationRecord, profile: Profile) -> tuple[Deviation, ...]:
    """Return every deviation of a calibration from its profile, in the profile's order.

    Parameters
    ----------
    record : CalibrationRecord
        The calibration; see `assign_nominal` for a table without nominal torques.
    profile : Profile
        The profile to be followed.

    Returns
    -------
    tuple of Deviation
        Empty if the calibration followed the profile.

    Examples
    --------
    >>> from datetime import UTC
    >>> from torquebench.calibration.profile import load_profile
    >>> data = CalibrationData(
    ...     [5.0, 10.0], [5.0, 10.0], [1, 1], [1, 1], 10.0, temperature_c=[21.0, 22.5]
    ... )
    >>> record = CalibrationRecord(data, datetime(2025, 1, 31, tzinfo=UTC))
    >>> found = find_deviations(record, load_profile("rapid-in-situ"))
    >>> [(deviation.kind, deviation.clause, deviation.consequence) for deviation in found][-1]
    ('temperature_drift', 'environment.temperature_drift_k', 'state')
    """
    deviations = [
        *_missing(record.data, profile),
        *_steps_off(record.data, profile),
        *_zero_returns(record.data, profile),
        *_reference(record, profile),
        *_temperature(record.data, profile),
    ]
    if record.unsettled:
        deviations.append(
            _deviation(
                profile,
                "unsettled",
                "loading.settle_limit_s",
                Message(
                    "{count} of {total} points still drifted", record.unsettled, len(record.data)
                ),
                Message(
                    "settled within another {settle_limit_s:g} s", profile.loading.settle_limit_s
                ),
            )
        )
    deviations += [
        _deviation(
            profile,
            "changed_record",
            "deviations.changed_record",
            Message("changed record: {change}", change),
            "no change",
        )
        for change in record.changes
    ]
    return tuple(deviations)


def refuse_deviations(deviations: tuple[Deviation, ...]) -> None:
    """Raise if the profile refuses a certificate for one of these deviations.

    Raises
    ------
    RecordError
        A deviation is refused; the message states each of them with its clause.
    """
    refused = [deviation for deviation in deviations if deviation.consequence == "refuse"]
    if refused:
        raise RecordError(
            Message.joined(
                (Message("{found} (clause {clause})", each.found, each.clause) for each in refused),
                "; ",
            ),
            Message.joined(dict.fromkeys(each.allowed for each in refused), "; "),
            "calibrate again, or follow a profile whose table [deviations] states them instead",
        )


def check_steps(profile: Profile) -> None:
    """Refuse a profile of random torques, whose series can't be compared step by step.

    Raises
    ------
    InputError
        The profile has random torques; the message names the packaged profiles of steps.
    """
    if profile.loading.pattern != "random":
        return
    steps = [
        name
        for name in available_profiles()
        if load_profile(name).loading.pattern != profile.loading.pattern
    ]
    raise InputError(
        Message("profile {name} has no steps: it draws its torques at random", profile.name),
        Message("a profile of steps: {names}, or your own", ", ".join(steps)),
        "choose one of them, for an evaluation the nearest: deviations are named; random "
        "torques show the error of a model: torquebench verify MODEL TABLE",
    )


def assign_nominal(data: CalibrationData, profile: Profile) -> CalibrationData:
    """Return the data with the profile's nearest step as nominal torque of each point.

    Data with nominal torques are returned unchanged; steps that the profile doesn't have keep their
    own torque, see `own_steps`.

    Raises
    ------
    InputError
        If the profile has random points.

    Examples
    --------
    >>> from torquebench.calibration.profile import load_profile
    >>> data = CalibrationData([0.02, 2.01], [0.01, 2.004], [1, 1], [1, 1], 10.0)
    >>> assign_nominal(data, load_profile("staircase")).nominal_nm.tolist()
    [0.0, 2.0]
    """
    if data.nominal_nm is not None:
        return data
    check_steps(profile)
    steps = np.array(profile.loading.percents()) * data.range_nm / 100.0
    return own_steps(data, steps.tolist())


def ladder_points(data: CalibrationData, profile: Profile) -> NDArray[np.bool_]:
    """Return which points belong to series with the profile's steps, shape (n,).

    These are all points, except in the later series of an adaptive calibration.
    """
    if profile.adaptive is None or data.nominal_nm is None:
        return np.ones(len(data), dtype=np.bool_)
    steps = np.array([0.0, *profile.loading.percents()]) * data.range_nm / 100.0
    distance = np.min(np.abs(np.abs(data.nominal_nm)[:, None] - steps), axis=1)
    placed = data.series[distance > 1e-6 * data.range_nm]
    return np.asarray(~np.isin(data.series, placed))


def _deviation(
    profile: Profile,
    kind: DeviationKind,
    clause: str,
    found: str,
    allowed: str,
) -> Deviation:
    """Return a deviation with the consequence that the profile states for its kind."""
    setting = "missing_series" if kind == "missing_step" else kind
    consequence: Consequence = getattr(profile.deviations, setting)
    return Deviation(kind, clause, found, allowed, consequence)


def _expected(profile: Profile) -> Iterator[_Expected]:
    """Yield the series that a profile requires."""
    loading = profile.loading
    signs = [1 if name == "clockwise" else -1 for name in loading.directions]
    per_series = [0] if loading.pattern == "cycle" and len(signs) == 2 else signs
    for number, position in enumerate(profile.positions):
        for sign in per_series:
            for _ in range(loading.repeats):
                for place, shape in enumerate(position.series):
                    yield _Expected(
                        f"positions[{number}].series[{place}]",
                        position.position_deg,
                        sign,
                        shape == "up-down",
                    )


def _missing(data: CalibrationData, profile: Profile) -> Iterator[Deviation]:
    """Yield a deviation for each series or step that the profile requires and the data lack."""
    if profile.loading.pattern == "random":
        return
    left = _series_present(data)
    for expected in _expected(profile):
        candidates = left.get((expected.position_deg, expected.sign), [])
        words = Message(
            "{words} at {position_deg:g}°", _WORDS[expected.sign], expected.position_deg
        )
        if not candidates:
            yield _deviation(
                profile,
                "missing_series",
                expected.clause,
                Message("no series {words}", words),
                "a series of increasing and decreasing torque"
                if expected.decreasing
                else "a series of increasing torque",
            )
            continue
        fitting = [n for n, step in enumerate(candidates) if step[1] == expected.decreasing]
        member, decreasing = candidates.pop(fitting[0] if fitting else 0)
        if expected.decreasing and not decreasing:
            yield _deviation(
                profile,
                "missing_series",
                expected.clause,
                Message(
                    "series {series} {words} has no decreasing torque",
                    data.series[member[0]],
                    words,
                ),
                "increasing and decreasing torque",
            )
        yield from _missing_steps(data, profile, member, expected, decreasing)


def _series_present(
    data: CalibrationData,
) -> dict[tuple[float, int], list[tuple[NDArray[np.intp], bool]]]:
    """Return the series of the data by position and direction, in measuring order.

    A series with points in both directions has the direction 0; its part of each direction counts
    as a series of that direction, too.
    """
    position = np.zeros(len(data)) if data.position_deg is None else data.position_deg
    direction = data.loading_direction()
    present: dict[tuple[float, int], list[tuple[NDArray[np.intp], bool]]] = {}
    for number in dict.fromkeys(data.series.tolist()):
        member = np.flatnonzero(data.series == number)
        signs = set(direction[member].tolist()) - {0}
        parts = {sign: member[np.isin(direction[member], (0, sign))] for sign in signs}
        if len(signs) != 1:
            parts[0] = member
        for sign, rows in parts.items():
            loaded = ~data.unloaded[rows]
            decreasing = bool(np.any(loaded & (data.branch[rows] < 0)))
            present.setdefault((float(position[member[0]]), sign), []).append((rows, decreasing))
    return present


def _missing_steps(
    data: CalibrationData,
    profile: Profile,
    member: NDArray[np.intp],
    expected: _Expected,
    decreasing: bool,
) -> Iterator[Deviation]:
    """Yield a deviation for the steps that a series lacks."""
    if data.nominal_nm is None:
        return
    loading = profile.loading
    tolerance = 1e-6 * data.range_nm
    rising = np.array(loading.percents()) * data.range_nm / 100.0
    wanted = [(1, rising)]
    if expected.decreasing and decreasing:
        wanted.append((-1, rising[:-1]))
    signs = (1, -1) if expected.sign == 0 else (expected.sign,)
    nominal, branch = data.nominal_nm[member], data.branch[member]
    lacking: list[str] = []
    for sign in signs:
        for side, steps in wanted:
            present = sign * nominal[branch == side]
            gaps = [step for step in steps if not np.any(np.abs(present - step) <= tolerance)]
            arrow = "↑" if side > 0 else "↓"
            lacking += [minus_signs(f"{sign * step:.6g} N·m {arrow}") for step in gaps]
    if lacking:
        key = "steps_percent" if loading.steps_percent else "step_percent"
        more = Message(" and {count} more", len(lacking) - 4) if len(lacking) > 4 else ""
        yield _deviation(
            profile,
            "missing_step",
            f"loading.{key}",
            Message(
                "series {series} lacks {lacking}{more}",
                data.series[member[0]],
                ", ".join(lacking[:4]),
                more,
            ),
            "every step in every series",
        )


def _steps_off(data: CalibrationData, profile: Profile) -> Iterator[Deviation]:
    """Yield a deviation for each series with steps too far from their nominal torque."""
    tolerance = profile.loading.step_tolerance_percent
    if tolerance is None or data.nominal_nm is None:
        return
    loaded = ~data.unloaded
    off = np.zeros(len(data))
    nominal = data.nominal_nm[loaded]
    of_range = profile.loading.step_tolerance_of == "range"
    scale = data.range_nm if of_range else np.abs(nominal)
    off[loaded] = 100.0 * np.abs(data.standard_nm[loaded] - nominal) / scale
    unit = "% of full scale" if of_range else "%"
    for number in dict.fromkeys(data.series[off > tolerance].tolist()):
        member = np.flatnonzero((data.series == number) & (off > tolerance))
        worst = member[np.argmax(off[member])]
        more = Message(" ({size} more steps deviate)", member.size - 1) if member.size > 1 else ""
        yield _deviation(
            profile,
            "step_off",
            "loading.step_tolerance_percent",
            Message(
                "the step {nominal_nm:.6g} N·m of series {number} was loaded with "
                "{standard_nm:.6g} N·m, deviation {off:.2g} {unit}{more}",
                data.nominal_nm[worst],
                number,
                data.standard_nm[worst],
                off[worst],
                unit,
                more,
            ),
            Message("a deviation of at most {tolerance:g} {unit}", tolerance, unit),
        )


def _zero_returns(data: CalibrationData, profile: Profile) -> Iterator[Deviation]:
    """Yield a deviation for each series without a zero at its end, or with one too far off."""
    loading, limit = profile.loading, profile.zero.return_limit_percent
    returned = data.unloaded & (data.branch < 0)
    if loading.zero_return:
        for number in dict.fromkeys(data.series.tolist()):
            if not np.any(returned & (data.series == number)):
                yield _deviation(
                    profile,
                    "zero_return",
                    "loading.zero_return",
                    Message("series {number} has no zero after it", number),
                    "a zero after every series",
                )
    if limit is None or not np.any(returned):
        return
    reading = tare(data).data.reading_nm
    share = 100.0 * np.abs(reading) / data.range_nm
    for number in dict.fromkeys(data.series[returned & (share > limit)].tolist()):
        member = np.flatnonzero(returned & (data.series == number))
        worst = member[np.argmax(share[member])]
        yield _deviation(
            profile,
            "zero_return",
            "zero.return_limit_percent",
            Message(
                "the zero after series {number} returned to {reading_nm:.4g} N·m, "
                "{share:.2g} % of full scale",
                number,
                reading[worst],
                share[worst],
            ),
            Message("at most {limit:g} % of full scale", limit),
        )


def _reference(record: CalibrationRecord, profile: Profile) -> Iterator[Deviation]:
    """Yield a deviation if the standard's certificate wasn't valid on the day."""
    reference, performed = record.reference, record.performed.date()
    if not profile.reference.in_date:
        return
    name = reference.serial or "the standard"
    if reference.due is None:
        if not record.data.simulated:
            yield _deviation(
                profile,
                "expired_reference",
                "reference.in_date",
                Message("the due date of the certificate of {name} isn't stated", name),
                Message("a certificate that is valid on {performed}", performed.isoformat()),
            )
    elif performed > reference.due:
        number = f" {reference.certificate_number}" if reference.certificate_number else ""
        yield _deviation(
            profile,
            "expired_reference",
            "reference.in_date",
            Message(
                "the certificate{number} of {name} expired on {due}",
                number,
                name,
                reference.due.isoformat(),
            ),
            Message("a certificate that is valid on {performed}", performed.isoformat()),
        )


def _temperature(data: CalibrationData, profile: Profile) -> Iterator[Deviation]:
    """Yield a deviation if the temperature drifted too far during the calibration."""
    if data.temperature_c is None:
        return
    drift = float(np.ptp(data.temperature_c))
    limit = profile.environment.temperature_drift_k
    if drift > limit:
        low, high = float(data.temperature_c.min()), float(data.temperature_c.max())
        yield _deviation(
            profile,
            "temperature_drift",
            "environment.temperature_drift_k",
            Message(
                "the temperature drifted by {drift:.2g} K ({low:.1f} °C to {high:.1f} °C)",
                drift,
                low,
                high,
            ),
            Message("at most {limit:g} K", limit),
        )
