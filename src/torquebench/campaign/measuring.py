"""Run a procedure on an open station: rehearse it, watch it, read its results."""

from __future__ import annotations

import getpass
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypedDict, TypeVar, Unpack

import numpy as np

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.drivers.base import Mounting, Side
from torquebench.bench.mounting_record import MountingRecord
from torquebench.calibration import Profile
from torquebench.campaign.fitting import entry_in_use
from torquebench.errors import BenchError, TorquebenchError
from torquebench.message import Message
from torquebench.procedures import (
    FrictionSettings,
    FrictionSweep,
    Plan,
    Rehearsal,
    StaircaseResult,
    calibrate,
    friction_sweep,
    rehearse,
    verify,
)
from torquebench.procedures.resuming import Resumption
from torquebench.procedures.standard_check import check_zero
from torquebench.procedures.turning.profile import TurningProfile
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.station import RunRecord, Station
from torquebench.station.matching import compensation_for

__all__ = [
    "Measured",
    "OnPause",
    "RunAbortedError",
    "RunOptions",
    "measure",
    "measure_calibration",
    "measure_check",
    "measure_friction",
    "measure_verification",
    "operator_name",
    "rehearse_calibration",
    "run_metadata",
    "standard_at_rest",
]

Result = TypeVar("Result")
REST_S = 1.0
"""Interval over which an unloaded standard is read, s: it tells the clock of a read-out."""
OnPause = Callable[[Station], Literal["resume", "abort"]]


class RunOptions(TypedDict, total=False):
    """Options of every measured run.

    Attributes
    ----------
    operator : str
        Who measures; by default `operator_name`.
    mounting : MountingRecord or None
        What was entered about the mounting.
    metadata : mapping
        Further metadata of the run.
    progress : Progress
        Told one stage.
    on_pause : callable or None
        Called on a pause, see `Station.run`.
    """

    operator: str
    mounting: MountingRecord | None
    metadata: Mapping[str, Any]
    progress: Progress
    on_pause: OnPause | None


class RunAbortedError(BenchError):
    """A run was ended on purpose; the bench is without torque and the record is sealed.

    Attributes
    ----------
    record : RunRecord
        The recorded run.
    """

    def __init__(self, record: RunRecord) -> None:
        self.record = record
        super().__init__(
            Message("the {kind} run was aborted ({reason})", record.kind, record.reason)
            if record.reason
            else Message("the {kind} run was aborted", record.kind)
        )

    def __reduce__(self) -> tuple[type, tuple[RunRecord]]:  # type: ignore[override]
        return (type(self), (self.record,))


@dataclass(frozen=True)
class Measured(Generic[Result]):
    """Measured data of a procedure, and the record of its run."""

    result: Result
    record: RunRecord


def rehearse_calibration(
    station: Station, side: Side, profile: Profile
) -> Rehearsal[StaircaseResult]:
    """Go through a calibration's plan without moving anything; see `procedures.rehearse`."""
    return rehearse(station.devices, calibrate(station.devices, side, profile))


def standard_at_rest(station: Station, side: Side, mounting: Mounting) -> float | None:
    """Return the unloaded torque of a standard, N·m; None if it isn't mounted.

    Raises
    ------
    BenchError
        It states a torque without load.
    SignalFault
        It has no signal.
    """
    description, acquisition = station.description, station.acquisition
    standard = description.standard(mounting)
    drives = station.drivers.drives.values()
    mounted = station.drivers.operator.mounted()
    if standard is None or mounted != mounting or any(each.state().enabled for each in drives):
        return None
    channel = acquisition.channel_of_standard(side)
    start_s = station.clock.now()
    station.clock.wait(REST_S)
    window = acquisition.window(channel.name, start_s, start_s + REST_S)
    zero_nm = channel.signal_nm(float(window[channel.column].mean()))
    check_zero(description, side, standard, zero_nm)
    return zero_nm


def measure_calibration(
    station: Station,
    side: Side,
    profile: Profile,
    resumption: Resumption | None = None,
    **options: Unpack[RunOptions],
) -> Measured[StaircaseResult]:
    """Calibrate one module against the calibrator, or continue with an interrupted calibration.

    Parameters
    ----------
    station : Station
    side : {"input", "output"}
    profile : Profile
    resumption : Resumption, optional
        Where to go on; see `campaign.resuming`.
    **options
        See `RunOptions`.

    Raises
    ------
    LimitError, InterlockError
        Before anything moves.
    RunAbortedError
        Somebody ended the run.
    SignalFault, BenchError
        The run failed; the bench is without torque.
    """
    before = _model_in_use(station, side)
    return measure(
        station,
        lambda: calibrate(station.devices, side, profile, resumption, before),
        kind=f"calibrate-{side}",
        title=Message("Calibrating the {side} module", side),
        **_stating(side, profile, options),
    )


def _model_in_use(station: Station, side: Side) -> ActiveChain | None:
    """Return the model that a module has had so far; None for none that can be read."""
    description, counter = station.description, station.drivers.counter.clock_identity
    serial = description.module(side).transducer.serial
    try:
        entry = station.registry.patiently(lambda: entry_in_use(station.registry, serial, counter))
        return (
            None
            if entry is None
            else compensation_for(station.registry, description, counter, side)
        )
    except TorquebenchError:
        return None


def measure_verification(
    station: Station,
    side: Side,
    profile: Profile,
    seed: int,
    **options: Unpack[RunOptions],
) -> Measured[StaircaseResult]:
    """Verify one module against the verification standard at points drawn by `seed`."""
    options["metadata"] = {"seed": seed, **options.get("metadata", {})}
    rng = np.random.default_rng(seed)
    steps = profile.staircase(station.description.module(side).range_nm, rng)
    return measure(
        station,
        lambda: verify(station.devices, side, profile, steps),
        kind=f"verify-{side}",
        title=Message("Verifying the {side} module", side),
        **_stating(side, profile, options),
    )


def measure_check(
    station: Station, side: Side, profile: Profile, **options: Unpack[RunOptions]
) -> Measured[StaircaseResult]:
    """Load a few steps of one module against the check standard."""
    steps = profile.staircase(station.description.module(side).range_nm)
    return measure(
        station,
        lambda: verify(station.devices, side, profile, steps),
        kind=f"check-{side}",
        title=Message("Checking the {side} module", side),
        **_stating(side, profile, options),
    )


def measure_friction(
    station: Station,
    settings: FrictionSettings | None = None,
    **options: Unpack[RunOptions],
) -> Measured[FrictionSweep]:
    """Sweep the input speed of the mounted reducer, output free, and read its friction."""
    options["metadata"] = {"side": "input", **options.get("metadata", {})}
    return measure(
        station,
        lambda: friction_sweep(station.devices, settings),
        kind="no-load-friction",
        title="No-load friction of the reducer",
        **options,
    )


def run_metadata(side: Side, profile: Profile | TurningProfile) -> dict[str, str]:
    """Return what the registry stores of a run beside its start document."""
    return {
        "side": side,
        "profile_name": profile.name,
        "profile_sha256": profile.sha256,
    }


def _stating(side: Side, profile: Profile, options: RunOptions) -> RunOptions:
    """Return options of a run with side and profile in its metadata."""
    metadata = {**run_metadata(side, profile), **options.get("metadata", {})}
    return {**options, "metadata": metadata}


def operator_name() -> str:
    """Return the person at this computer: by `$TORQUEBENCH_OPERATOR`, or the account."""
    if named := os.environ.get("TORQUEBENCH_OPERATOR"):
        return named
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # an account without a name
        return ""


def measure(
    station: Station,
    plan: Callable[[], Plan[Result]],
    *,
    rehearsed: Callable[[], Plan[Any]] | None = None,
    kind: str,
    title: str,
    files: Callable[[], Mapping[str, bytes]] = dict,
    **options: Unpack[RunOptions],
) -> Measured[Result]:
    """Rehearse a plan and execute it as a separate run.

    `rehearsed` makes the plan without the steps that need real recordings, where it has any;
    `files` returns further files of the run, see `Station.run`.
    """
    progress = options.get("progress", NO_PROGRESS)
    progress.start(title, rehearse(station.devices, (rehearsed or plan)()).steps or None)
    mounting = options.get("mounting")
    metadata = {
        "operator": options.get("operator") or operator_name(),
        **options.get("metadata", {}),
    }
    if mounting is not None and mounting.entered():
        metadata |= mounting.metadata()
    record = station.run(
        plan(),
        kind=kind,
        files=files,
        metadata=metadata,
        progress=progress,
        on_pause=options.get("on_pause"),
    )
    if record.exit_status != "success":
        raise RunAbortedError(record)
    progress.finish()
    return Measured(record.result, record)
