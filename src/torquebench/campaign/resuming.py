"""Resume a calibration that was interrupted by a crash, a power failure, an alarm or a person."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Unpack

from torquebench.bench.description import BenchDescription
from torquebench.bench.mounting_record import MountingRecord
from torquebench.bench.roles import Side
from torquebench.calibration import Profile, Step
from torquebench.campaign.calibrating import measure_calibration
from torquebench.campaign.fitting import ModelChoice
from torquebench.campaign.measuring import Measured, RunOptions
from torquebench.campaign.registering import registered_choices, registers_calibration
from torquebench.errors import InputError, ModelMismatchError, RecordError
from torquebench.message import Message
from torquebench.procedures import StaircaseResult
from torquebench.procedures.resuming import (
    Resumption,
    complete_series,
    preparation,
    steps_again,
    steps_from,
)
from torquebench.procedures.staircase import Row, describe_step
from torquebench.records import (
    Registry,
    RunFolder,
    RunSummary,
    followers,
    latest_unfinished_calibration,
)
from torquebench.station import Station
from torquebench.units import HOUR

INTERRUPTED = ("interrupted", "aborted", "failed")


@dataclass(frozen=True)
class InterruptedCalibration:
    """The record of an interrupted calibration.

    Parameters
    ----------
    run_ids : tuple of str
        The runs of the calibration in order, the interrupted run last.
    side : {"input", "output"}
    profile : Profile
        Profile in the record, options included.
    known : dict
        The start document: range, serials, counter, standard.
    metadata : dict
        Metadata of the interrupted run: bench description, models, mounting.
    steps : tuple of Step
        Steps of the whole calibration, or of the coarse series of an adaptive one.
    points : tuple of (Step, Row)
        All acknowledged points in measuring order, also of incomplete series; without the last
        point of a run that an alarm stopped, because the cause of the alarm may have disturbed it.
    interrupted : datetime.datetime
        Time of the last point, or of the run's start if there is none.
    lost_at_end : int
        Number of documents lost by damage after the last point.
    """

    run_ids: tuple[str, ...]
    side: Side
    profile: Profile
    known: dict[str, Any]
    metadata: dict[str, Any]
    steps: tuple[Step, ...]
    points: tuple[tuple[Step, Row], ...]
    interrupted: datetime
    lost_at_end: int = 0

    @property
    def bench(self) -> dict[str, Any]:
        """Description of the bench at the time of the run."""
        described: dict[str, Any] = self.metadata["bench"]
        return described

    @property
    def choices(self) -> tuple[list[ModelChoice], str | None]:
        """Models in the run's record, and the one to be put into use."""
        return registered_choices(self.metadata)

    @property
    def series(self) -> int:
        """Number of the series with which the calibration is resumed, by the profile's clause.

        The points of an adaptive calibration don't depend on later points, so that an incomplete
        series is kept. The calibration then continues with a new series, whose points are placed
        from all points so far. If every point was measured, the number is one after the last
        series.
        """
        every = sorted({step.series for step in self.steps if step.recorded})
        rest = self._rest(every)
        if not rest:
            rest = [1 + max(step.series for step, _ in self.points)]
            if self.profile.adaptive is None:  # only the end of the run is missing
                return rest[0]
        clause = self.profile.interruption
        if clause is None or clause.resume == "series":
            return rest[0]
        return _first_of_position(self.steps, min(rest[0], every[-1]))

    def _rest(self, every: Sequence[int]) -> list[int]:
        """Return the profile's series, beginning with the first incomplete one."""
        taken = self._taken
        last = max((series for series, _ in taken), default=0)
        through = {
            (step.series, step.index)
            for step in self.steps
            if step.recorded and (step.series < last or self._gone_through(step.series))
        }
        return list(every[len(complete_series(self.steps, taken | through)) :])

    def _gone_through(self, series: int) -> bool:
        """Return whether a series lacks only as many points at its end as damage may have lost."""
        own = [step.index for step in self.steps if step.recorded and step.series == series]
        taken = [number for number, index in enumerate(own) if (series, index) in self._taken]
        return bool(taken) and len(own) - 1 - taken[-1] <= self.lost_at_end

    @property
    def _taken(self) -> set[tuple[int, int]]:
        return {(step.series, step.index) for step, _ in self.points}

    @property
    def damaged(self) -> tuple[Step, ...]:
        """Points that were measured and whose record is damaged: only these are repeated."""
        first, taken = self.series, self._taken
        return tuple(
            step
            for step in self.steps
            if step.recorded and step.series < first and (step.series, step.index) not in taken
        )

    @property
    def remaining(self) -> tuple[Step, ...]:
        """Steps of the profile that are still to be loaded.

        These are the steps up to damaged points, then preloads, zero, and the rest of the profile.
        If the profile is complete, only preloads and zero remain, to be loaded before further
        points are placed.
        """
        first = self.series
        again = steps_again(self.steps, {(step.series, step.index) for step in self.damaged})
        if any(step.recorded and step.series == first for step in self.steps):
            return (*again, *steps_from(self.steps, first))
        if again and self.profile.adaptive is None:
            return again
        return (*again, *preparation(self.steps))

    @property
    def kept(self) -> tuple[tuple[Step, Row], ...]:
        """Points of the complete series before the one that is resumed."""
        first = self.series
        return tuple((step, row) for step, row in self.points if step.series < first)

    @property
    def repeated(self) -> int:
        """Number of acknowledged points that are measured again; their record is kept."""
        return len(self.points) - len(self.kept)


def find_interrupted(registry: Registry, name: str) -> RunSummary:
    """Return a run by its id, the beginning of its id, or "latest" (the newest unfinished one).

    An unfinished calibration was either interrupted and can be resumed, or was measured but not
    registered: see `campaign.finishing`.

    Raises
    ------
    InputError
        No run, or more than one, has this name.
    """
    if name == "latest":
        newest = latest_unfinished_calibration(registry)
        candidates = [] if newest is None else [newest]
    else:
        candidates = registry.runs_beginning(name, limit=2)
    if len(candidates) != 1:
        raise InputError(
            Message(
                "{name!r} names {found}", name, "more than one run" if candidates else "no run"
            ),
            "one interrupted calibration",
            "see `torquebench records list runs`",
        )
    return candidates[0]


def read_interrupted(registry: Registry, run: RunSummary) -> InterruptedCalibration:
    """Read back the points of an interrupted calibration.

    Raises
    ------
    InputError
        The run isn't an interrupted calibration, or its profile doesn't allow resuming.
    RecordError
        Its record was changed after it was sealed.
    """
    if run.status not in INTERRUPTED or not run.kind.startswith("calibrate-"):
        raise InputError(
            Message("run {run} is a {kind} run that is {status}", run.run_id, run.kind, run.status),
            "a calibration that was interrupted, aborted or failed",
            "wait until it ends, or calibrate again",
        )
    later = followers(registry, run)
    if later:
        raise InputError(
            Message("run {run} was resumed by run {other}", run.run_id, later[0].run_id),
            "a calibration that wasn't resumed yet",
            "resume the later run, or calibrate again",
        )
    if registry.discarded(run.run_id):
        raise InputError(
            Message("run {run} was discarded", run.run_id),
            "a calibration that wasn't discarded",
            "calibrate again",
        )
    return _read(registry, run)


def _read(registry: Registry, run: RunSummary) -> InterruptedCalibration:
    """Read back a run, regardless of what was recorded about it afterwards."""
    folder = RunFolder.open(run.folder)
    folder.verify()
    start = next((document for _, document in folder.documents("start")), None)
    taken = list(_points(folder))
    if run.status == "failed" and not _measured(folder):
        taken = taken[:-1]  # the cause of the alarm may have disturbed the last point
    before = _before(registry, folder)
    if start is None:
        raise InputError(
            Message("run {run} ended before it began", run.run_id),
            "a calibration that had begun",
            "calibrate again",
        )
    profile = _profile(run, start)
    steps = profile.staircase(float(start["range_nm"]))
    by_stamp = {(step.series, step.index): step for step in steps if step.recorded}
    points, last = [], datetime.fromtimestamp(float(start["time"]), UTC)
    for stamp, row, moment in taken:
        step = by_stamp.get(stamp)
        if step is None and profile.adaptive is not None:
            step = _placed(steps, stamp, row, float(start["range_nm"]))
        if step is None or step.nominal_nm != row.get("nominal_nm"):
            raise RecordError(
                Message(
                    "run {run}: series {series}, point {point} isn't in its profile",
                    run.run_id,
                    stamp[0],
                    stamp[1],
                ),
                "points of the profile",
                "calibrate again",
            )
        points.append((step, row))
        last = moment
    earlier = before.kept if before is not None else ()
    if before is not None:
        earlier = _shifted(earlier, float(taken[0][1]["time_s"]) if taken else 0.0)
    return InterruptedCalibration(
        run_ids=(*(before.run_ids if before is not None else ()), run.run_id),
        side="input" if start["side"] == "input" else "output",
        profile=profile,
        known=start,
        metadata=folder.metadata,
        steps=tuple(steps),
        points=(*earlier, *points),
        interrupted=last,
        lost_at_end=0 if folder.recovery is None else folder.recovery.lost_at_end,
    )


def resume_calibration(
    station: Station,
    interrupted: InterruptedCalibration,
    *,
    now: datetime | None = None,
    **options: Unpack[RunOptions],
) -> Measured[StaircaseResult]:
    """Repeat preloads and zero, and continue with the interrupted series, as a new run.

    The result holds the points of both runs; the new run's record names the old one.

    Parameters
    ----------
    now : datetime.datetime, optional
        The present moment, for the profile's clause.
    **options
        See `RunOptions`.

    Raises
    ------
    InputError
        The profile doesn't allow resuming, or not any more.
    ModelMismatchError
        The bench now has another transducer, counter, range or standard.
    """
    moment = now or datetime.now(UTC)
    _check_clause(interrupted, moment)
    _check_bench(station, interrupted)
    gap_s = max((moment - interrupted.interrupted).total_seconds(), 1.0)
    mounted = MountingRecord.of_run(interrupted.metadata)
    resumption = Resumption(
        interrupted.remaining,
        _shifted(interrupted.kept, station.clock.now() - gap_s),
    )
    options["metadata"] = {
        "resumes": list(interrupted.run_ids),
        "resumed_at_series": interrupted.series,
        "points_of_earlier_runs": len(interrupted.kept),
        "points_measured_again": interrupted.repeated,
        "damaged_points": [describe_step(step) for step in interrupted.damaged],
        **({} if mounted is None else mounted.metadata()),
        **registers_calibration(*interrupted.choices),
        **options.get("metadata", {}),
    }
    return measure_calibration(
        station, interrupted.side, interrupted.profile, resumption, **options
    )


def _check_clause(interrupted: InterruptedCalibration, now: datetime) -> None:
    """Refuse an interruption that the profile doesn't allow or that lasted too long."""
    profile = interrupted.profile
    clause = profile.interruption
    if clause is not None and clause.resume == "never":
        raise InputError(
            Message("profile {name} after an interruption", profile.name),
            "a calibration without interruption, as the profile requires",
            "calibrate again",
        )
    longest_h = clause.longest_h if clause is not None else 24.0
    passed_h = (now - interrupted.interrupted).total_seconds() / HOUR
    if passed_h > longest_h:
        raise InputError(
            Message("an interruption of {hours:.1f} h", passed_h),
            Message("at most {hours:g} h by the profile {name}", longest_h, profile.name),
            "calibrate again",
        )


def _check_bench(station: Station, interrupted: InterruptedCalibration) -> None:
    """Refuse a bench with another transducer, counter or standard than before the interruption."""
    description, recorded = station.description, interrupted.known
    module = description.module(interrupted.side)
    for what, there, here in (
        ("transducer", recorded["transducer_serial"], module.transducer.serial),
        ("counter", recorded["counter_identity"], station.drivers.counter.clock_identity),
        ("range in N·m", recorded["range_nm"], module.range_nm),
        ("standard", recorded.get("standard_serial"), description.calibrator.serial),
        *_standards(interrupted, description),
    ):
        if there != here:
            raise ModelMismatchError(
                Message(
                    "{what} {here} on this bench, {there} in run {run}",
                    what,
                    here,
                    there,
                    interrupted.run_ids[-1],
                ),
                "the same measuring chain and standard",
                "use the measuring chain with which it was started, or calibrate again",
            )


def _standards(
    interrupted: InterruptedCalibration, description: BenchDescription
) -> Iterator[tuple[str, Any, Any]]:
    """Yield each property of the standard with its value then and now, because U depends on it."""
    now = description.calibrator.model_dump(mode="json")
    for name, recorded in interrupted.bench["calibrator"].items():
        if name in now and name != "certificate":  # the certificate's file may have been moved
            yield f"standard's {name.replace('_', ' ')}", recorded, now[name]


def _before(registry: Registry, folder: RunFolder) -> InterruptedCalibration | None:
    """Return the run that a resuming run continued."""
    resumed = folder.metadata.get("resumes")
    return _read(registry, registry.run(str(resumed[-1]))) if resumed else None


def _measured(folder: RunFolder) -> bool:
    """Return whether a run's plan was completed, so that only a later step failed."""
    stops = [document for _, document in folder.documents("stop")]
    return bool(stops) and stops[-1].get("exit_status") == "success"


def _profile(run: RunSummary, start: dict[str, Any]) -> Profile:
    """Return the profile of an interrupted run; refuse one that has changed."""
    profile = Profile.model_validate(start["profile"]["settings"])
    if profile.sha256 != start["profile"]["sha256"]:
        raise RecordError(
            Message("the profile of run {run} has a different hash now", run.run_id),
            Message("SHA-256 {sha256}", start["profile"]["sha256"]),
            "use the version of torquebench that started it, or calibrate again",
        )
    return profile


def _points(folder: RunFolder) -> Sequence[tuple[tuple[int, int], Row, datetime]]:
    """Return step, values and time of every acknowledged point."""
    points = []
    for document in folder.points():
        row = {
            key.removeprefix("point-").partition("steady-")[2] or key.removeprefix("point-"): value
            for key, value in document["data"].items()
        }
        moment = datetime.fromtimestamp(float(document["time"]), UTC)
        points.append(((int(row["series"]), int(row["step"])), row, moment))
    return points


def _placed(
    steps: Sequence[Step], stamp: tuple[int, int], row: Row, range_nm: float
) -> Step | None:
    """Return the step of an adaptively placed point; None if it can't be rebuilt."""
    last = next(step for step in reversed(steps) if step.recorded)
    series, index = stamp
    if "nominal_nm" not in row:  # written by version 0.1.0
        return None
    nominal_nm, branch = float(row["nominal_nm"]), int(row["branch"])
    if series <= last.series or abs(nominal_nm) > range_nm or branch not in (1, -1):
        return None
    place = {"series": series, "index": index, "nominal_nm": nominal_nm, "branch": branch}
    return last.model_copy(update=place)


def _shifted(points: Sequence[tuple[Step, Row]], last_s: float) -> tuple[tuple[Step, Row], ...]:
    """Shift bench times so that the last point was measured at a given time."""
    if not points:
        return ()
    shift_s = last_s - float(points[-1][1]["time_s"])
    return tuple((step, {**row, "time_s": row["time_s"] + shift_s}) for step, row in points)


def _first_of_position(steps: Sequence[Step], series: int) -> int:
    """Return the number of the first series in the mounting position of a series."""
    position = 0
    positions: dict[int, int] = {}
    for step in steps:
        position += step.change != "none"
        if step.recorded:
            positions.setdefault(step.series, position)
    return min(first for first, where in positions.items() if where == positions[series])
