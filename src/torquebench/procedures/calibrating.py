"""Calibration and verification of one module against the mounted standard."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.devices import BenchDevices
from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData, Placement, Plausibility, Profile, Step
from torquebench.errors import BenchError
from torquebench.procedures.adaptive import load_adaptively
from torquebench.procedures.guarding import loading_limits
from torquebench.procedures.resuming import Resumption
from torquebench.procedures.setup import Plan, Setup, measured_in, start_metadata
from torquebench.procedures.staircase import Row, load_staircase
from torquebench.procedures.standard_check import StandardCheck


@dataclass(frozen=True)
class StaircaseResult:
    """Measured data of a calibration or a verification.

    Parameters
    ----------
    data : CalibrationData
        The recorded points in measuring order.
    unsettled : int
        Number of points whose reading still drifted; they are marked in the run.
    standard_serial : str
        Serial number of the standard that was mounted.
    placement : Placement or None
        Number of points of an adaptive calibration, and the reason for its end.
    """

    data: CalibrationData
    unsettled: int
    standard_serial: str
    placement: Placement | None = None


@dataclass
class _Table:
    """Collector of the rows of a run."""

    steps: list[Step] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    placement: Placement | None = None

    def add(self, step: Step, row: Row) -> None:
        self.steps.append(step)
        self.rows.append(row)

    def result(self, devices: BenchDevices, side: Side, standard_serial: str) -> StaircaseResult:
        """Return the measured points in the order of the profile's steps."""
        # A repeated point replaces the damaged one in its series.
        order = sorted(
            range(len(self.steps)), key=lambda n: (self.steps[n].series, self.steps[n].index)
        )
        self.steps = [self.steps[number] for number in order]
        self.rows = [self.rows[number] for number in order]
        unsettled = sum(not row["settled"] for row in self.rows)
        data = self.data(devices, side)
        return StaircaseResult(data, unsettled, standard_serial, self.placement)

    def data(self, devices: BenchDevices, side: Side) -> CalibrationData:
        """Return the points measured so far."""
        return calibration_of_rows(
            devices,
            side,
            self.rows,
            series=[step.series for step in self.steps],
            branch=[step.branch for step in self.steps],
            nominal_nm=[step.nominal_nm for step in self.steps],
            position_deg=np.array([step.position_deg for step in self.steps]),
        )


def calibration_of_rows(
    devices: BenchDevices,
    side: Side,
    rows: Sequence[Row],
    *,
    series: Sequence[int],
    branch: Sequence[int],
    nominal_nm: Sequence[float],
    position_deg: np.ndarray[Any, Any] | None = None,
) -> CalibrationData:
    """Return the points of a calibration measured today, from the fields of its steady values."""
    module = devices.context.description.module(side)

    def column(name: str) -> np.ndarray[Any, Any]:
        return np.array([row[name] for row in rows], dtype=np.float64)

    def optional(name: str) -> np.ndarray[Any, Any] | None:
        return column(name) if all(name in row for row in rows) else None

    return CalibrationData(
        reading_nm=column("reading_nm"),
        standard_nm=column("standard_nm"),
        series=np.array(series),
        branch=np.array(branch),
        range_nm=float(module.range_nm),
        side=side,
        transducer_serial=module.transducer.serial,
        counter_identity=devices.context.drivers.counter.clock_identity,
        nominal_nm=np.array(nominal_nm),
        position_deg=position_deg,
        speed_rpm=None if module.encoder is None else column("speed_rpm"),
        temperature_c=column("temperature_c"),
        time_s=column("time_s"),
        zero_nm=optional("zero_nm"),
        standard_error_nm=column("reading_standard_error_nm"),
        true_torque_nm=optional("true_torque_nm"),
        standard_temperature_c=optional("standard_temperature_c"),
        measured_on=datetime.now(UTC).date(),
        tared=True,
    ).zeroed_each_series()


def calibrate(
    devices: BenchDevices,
    side: Side,
    profile: Profile,
    resumption: Resumption | None = None,
    before: ActiveChain | None = None,
) -> Plan[StaircaseResult]:
    """Calibrate one module against the calibrator: zero, preload and the profile's staircase.

    With an adaptive profile, points that the model places follow. The opposite module is locked.
    The bench is left without torque and with the drives off, however the plan ends.

    Parameters
    ----------
    side : {"input", "output"}
    profile : Profile
        Profile that defines the steps over the module's range.
    resumption : Resumption, optional
        Continuation of an interrupted calibration by this profile; its earlier points are part of
        the result.
    before : ActiveChain, optional
        The model in use so far: the standard is compared with it before the series.

    Raises
    ------
    LimitError
        A step exceeds the drive's torque limit; nothing has moved yet.
    BenchError
        Standard and module differ by too much at rest, at a preload or at the first steps.
    """
    steps: Sequence[Step] = profile.staircase(_range_nm(devices, side))
    table = _Table()
    if resumption is not None:
        steps = resumption.steps
        for step, row in resumption.earlier:
            table.add(step, row)
    setup = Setup("calibration", side, "calibrator", "locked")
    standard = devices.context.description.calibrator
    check = StandardCheck(devices, side, standard, profile.plausibility, before)
    return (yield from _staircase(devices, setup, profile, steps, "calibrate", table, check))


def verify(
    devices: BenchDevices, side: Side, profile: Profile, steps: Sequence[Step]
) -> Plan[StaircaseResult]:
    """Verify one module against the verification standard at fresh points off the grid.

    Parameters
    ----------
    side : {"input", "output"}
    profile : Profile
        Such as the packaged profile "verification": ten groups of 50 random points.
    steps : sequence of Step
        The profile's steps with the drawn points, so that a rehearsal and the following run have
        the same points.

    Returns
    -------
    StaircaseResult
        Points whose `series` is the number of the group.
    """
    setup = Setup("verification", side, "verification_standard", "locked")
    standard = devices.context.description.verification_standard
    # no model is compared, because finding errors is the purpose of a verification
    check = StandardCheck(devices, side, standard, Plausibility())
    return (yield from _staircase(devices, setup, profile, steps, "verify", _Table(), check))


def _staircase(
    devices: BenchDevices,
    setup: Setup,
    profile: Profile,
    steps: Sequence[Step],
    plan_name: Literal["calibrate", "verify"],
    table: _Table,
    check: StandardCheck,
) -> Plan[StaircaseResult]:
    """Load the steps of a profile with everything around them, and return the table."""
    range_nm = _range_nm(devices, setup.side)
    points = sum(step.recorded for step in steps)
    if profile.adaptive is not None:
        points = profile.adaptive.points  # at most
    known = {
        "name": profile.name,
        "title": profile.title,
        "source": profile.source,
        "verified": profile.verified,
        "sha256": profile.sha256,
        "settings": profile.model_dump(mode="json"),
    }
    metadata = start_metadata(devices, plan_name, points, setup.side, profile=known)

    def load_by_model() -> Plan[None]:
        """Load the adaptive steps after the profile's coarse ones."""
        coarse = [step for step in profile.staircase(range_nm) if step.recorded]
        known = max((step.series for step in table.steps), default=0)
        table.placement = yield from load_adaptively(
            devices,
            setup,
            profile,
            steps,
            table.add,
            lambda: table.data(devices, setup.side),
            template=coarse[-1].model_copy(update={"series": max(known, coarse[-1].series)}),
            even=len(coarse),
            earlier=len(table.rows),
            check=check,
        )

    largest_nm = max(abs(step.nominal_nm) for step in steps)
    if profile.adaptive is not None:  # every round reverses at full scale
        largest_nm = range_nm
    limits = loading_limits(devices, setup.side, largest_nm)
    measuring = (
        load_staircase(devices, setup, steps, table.add, check=check)
        if profile.adaptive is None
        else load_by_model()
    )
    serial = yield from measured_in(setup, devices, measuring, metadata, limits)
    if not table.rows:
        raise BenchError("a staircase that recorded no point", "at least one point")
    return table.result(devices, setup.side, serial)


def _range_nm(devices: BenchDevices, side: Side) -> float:
    return float(devices.context.description.module(side).range_nm)
