"""Runs while a module turns, from the profile to the table: empty runs, turning calibrations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torquebench.atomic_write import atomic_write
from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData
from torquebench.campaign.measuring import OnPause, measure, operator_name
from torquebench.campaign.progress import NO_PROGRESS, Progress
from torquebench.errors import InputError
from torquebench.procedures import Plan, Rehearsal, rehearse
from torquebench.procedures.turning.calibrating import calibrate_turning
from torquebench.procedures.turning.empty import EmptySummary, EmptyTable, turn_empty
from torquebench.procedures.turning.profile import TurningProfile
from torquebench.records.csv_text import read_csv
from torquebench.records.tables import write_calibration_csv
from torquebench.station import Station

__all__ = ["TurningRun", "measure_turning", "read_begun", "rehearse_turning"]

COLUMNS = ("time_s", "reading_nm", "speed_rpm", "temperature_c")
_RESUMED_AFTER_S = 60.0
"""Time between the last row of an interrupted run and the first after it: nobody knows it."""


@dataclass(frozen=True)
class TurningRun:
    """A finished run.

    Parameters
    ----------
    run_id : str
    rows : int
        Of the table.
    bench_seconds : float
    """

    run_id: str
    rows: int
    bench_seconds: float


def rehearse_turning(
    station: Station, side: Side, profile: TurningProfile
) -> Rehearsal[EmptySummary] | Rehearsal[CalibrationData]:
    """Go through a run without moving anything; the time for waiting isn't in it."""
    if profile.kind == "calibration":
        return rehearse(station.devices, calibrate_turning(station.devices, side, profile))
    return rehearse(station.devices, turn_empty(station.devices, side, profile, EmptyTable(side)))


def measure_turning(
    station: Station,
    side: Side,
    profile: TurningProfile,
    target: Path,
    *,
    begun: EmptyTable | None = None,
    wait: bool = True,
    progress: Progress = NO_PROGRESS,
    on_pause: OnPause | None = None,
) -> TurningRun:
    """Run a profile and write its table; an empty run's after every complete series.

    Parameters
    ----------
    station : Station
    side : {"input", "output"}
    profile : TurningProfile
    target : pathlib.Path
        CSV file.
    begun : EmptyTable, optional
        Of an interrupted empty run, by `read_begun`.
    wait : bool
        Whether series wait for their temperature.
    progress, on_pause
        As everywhere.

    Raises
    ------
    LimitError, InterlockError
        Before anything moves.
    RunAbortedError
        Somebody ended the run; complete series are in the file.
    """
    metadata = {
        "side": side,
        "profile_name": profile.name,
        "profile_sha256": profile.sha256,
        "operator": operator_name(),
    }
    if profile.kind == "calibration":

        def loading() -> Plan[CalibrationData]:
            return calibrate_turning(station.devices, side, profile)

        points = measure(
            station,
            loading,
            rehearsed=loading,
            kind=f"turning-calibration-{side}",
            title=f"Calibrating the turning {side} module",
            metadata=metadata,
            progress=progress,
            on_pause=on_pause,
        )
        write_calibration_csv(target, points.result, {"profile": profile.name})
        record = points.record
        return TurningRun(record.run_id, len(points.result), record.bench_seconds)
    table = EmptyTable(side) if begun is None else begun

    def write(done: EmptyTable) -> None:
        _write(target, done, station, profile)

    begins_s = table.rows[-1, 0] + _RESUMED_AFTER_S if len(table.rows) else 0.0
    table.shift_s = begins_s - station.clock.now() if begins_s else 0.0
    found = measure(
        station,
        lambda: turn_empty(station.devices, side, profile, table, wait=wait, on_series=write),
        rehearsed=lambda: turn_empty(station.devices, side, profile, EmptyTable(side)),
        kind=f"empty-run-{side}",
        title=f"Empty run of the {side} module",
        metadata=metadata,
        progress=progress,
        on_pause=on_pause,
    )
    return TurningRun(found.record.run_id, len(table.rows), found.record.bench_seconds)


def _write(target: Path, table: EmptyTable, station: Station, profile: TurningProfile) -> None:
    module = station.description.module(table.side)
    remarks = {
        "simulated": str(station.devices.context.drivers.truth is not None).lower(),
        "side": table.side,
        "range_nm": f"{module.range_nm:g}",
        "transducer_serial": module.transducer.serial,
        "profile": profile.name,
        "profile_hash": profile.sha256,
        "series_done": f"{table.series_done} of {profile.series()}",
        "zero_hz": repr(table.zero_hz),
    }
    lines = [f"# {name} = {value}" for name, value in remarks.items()]
    lines.append(",".join(COLUMNS))
    lines += [
        f"{time_s:.6f},{reading_nm:.7g},{speed_rpm:.7g},{temperature_c:.6g}"
        for time_s, reading_nm, speed_rpm, temperature_c in table.rows.tolist()
    ]
    atomic_write(target, "\n".join(lines) + "\n")


def read_begun(
    path: Path, side: Side, profile: TurningProfile, transducer_serial: str
) -> EmptyTable:
    """Return the complete series of an interrupted empty run.

    Raises
    ------
    InputError
        Where the file is of another profile, side or transducer, or has nothing left to do.
    """
    table = read_csv(path)
    wanted = {
        "side": side,
        "profile_hash": profile.sha256,
        "transducer_serial": transducer_serial,
    }
    for name, value in wanted.items():
        if table.remarks.get(name) != value:
            raise InputError(
                f"{path}: {name} = {table.remarks.get(name, 'missing')}",
                f"{value}, to go on with this run",
                "give the side and the profile of the interrupted run",
            )
    done = int(table.remarks.get("series_done", "0").split()[0])
    if done >= profile.series():
        raise InputError(f"{path} is complete", "an interrupted run", "begin another file")
    rows: NDArray[np.float64] = np.column_stack([table.numbers(name) for name in COLUMNS])
    begun = EmptyTable(side)
    begun.begin_with(rows, done, float(table.remarks.get("zero_hz", "nan")))
    return begun
