"""Run a procedure on an open station: rehearse it, report its progress, read its results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Generic, Literal, TypedDict, TypeVar, Unpack

from torquebench.bench.mounting_record import MountingRecord
from torquebench.bench.roles import Mounting, Side
from torquebench.calibration import Profile
from torquebench.errors import BenchError, InputError, RecordError
from torquebench.message import Message
from torquebench.procedures import FrictionSettings, Plan, rehearse
from torquebench.procedures.standard_check import check_zero
from torquebench.procedures.turning.profile import TurningProfile
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import Registry
from torquebench.records.signatures import operator_name
from torquebench.station import RunRecord, Station

Result = TypeVar("Result")
Evaluated = TypeVar("Evaluated")
Outcome = TypeVar("Outcome")
REST_S = 1.0
"""Interval over which an unloaded standard is read, s; a read-out states its clock in it."""
RunProfile = Profile | TurningProfile | FrictionSettings
OnPause = Callable[[Station], Literal["resume", "abort"]]


class RunOptions(TypedDict, total=False):
    """Options of every measured run.

    Attributes
    ----------
    operator : str
        Who measures; by default `operator_name`.
    mounting : MountingRecord or None
        Entered data about the mounting.
    metadata : mapping
        Further metadata of the run.
    progress : Progress
        Receives one stage.
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

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (self.record,))


@dataclass(frozen=True)
class Measured(Generic[Result]):
    """Measured data of a procedure, the record of its run, and the profile of a `RunKind`."""

    result: Result
    record: RunRecord
    profile: Any = None


def standard_at_rest(station: Station, side: Side, mounting: Mounting) -> float | None:
    """Return the torque of an unloaded standard, N·m; None if it isn't mounted.

    Raises
    ------
    BenchError
        The standard shows a torque without load.
    SignalFault
        The standard has no signal.
    """
    description, acquisition = station.description, station.acquisition
    standard = description.standard(mounting)
    drives = station.drivers.drives.values()
    mounted = station.drivers.operator.mounted()
    if standard is None or mounted != mounting or any(drive.state().enabled for drive in drives):
        return None
    channel = acquisition.channel_of_standard(side)
    start_s = station.clock.now()
    station.clock.wait(REST_S)
    window = acquisition.window(channel.name, start_s, start_s + REST_S)
    zero_nm = channel.signal_nm(float(window[channel.column].mean()))
    check_zero(description, side, standard, zero_nm)
    return zero_nm


@dataclass(frozen=True)
class RunKind(Generic[Result, Evaluated, Outcome]):
    """A kind of run: its plan, and how its result is evaluated, registered and described.

    `plan` takes devices, side, profile and the arguments of `measure`. `evaluate` uses the measured
    data, the run's record and the registry only. `register` is one transaction, which can be
    repeated without duplicates; it is `run_only` where the registry keeps no more than the run.
    `describe` returns a sentence about the result.
    """

    kind: str
    title: Callable[[Side], str]
    plan: Callable[..., Plan[Result]]
    evaluate: Callable[[Registry, Measured[Result], Progress], Evaluated]
    register: Callable[[Registry, Measured[Result], Evaluated], Outcome]
    describe: Callable[[Outcome], Message]

    def measure(
        self,
        station: Station,
        side: Side,
        profile: RunProfile,
        *arguments: Any,
        settings: Mapping[str, Any] = MappingProxyType({}),
        rehearsed: Callable[[], Plan[Any]] | None = None,
        **options: Unpack[RunOptions],
    ) -> Measured[Result]:
        """Rehearse and run the plan; side and profile are stored in the record. See `measure`."""
        options["metadata"] = {**run_metadata(side, profile), **options.get("metadata", {})}
        measured = measure(
            station,
            lambda: self.plan(station.devices, side, profile, *arguments, **settings),
            rehearsed=rehearsed,
            kind=self.kind.format(side=side),
            title=self.title(side),
            **options,
        )
        return Measured(measured.result, measured.record, profile)

    def evaluate_and_register(
        self,
        registry: Registry,
        measured: Measured[Result],
        progress: Progress = NO_PROGRESS,
        evaluated: Evaluated | None = None,
    ) -> Outcome:
        """Evaluate a measured run, if it isn't yet, and register it.

        Raises
        ------
        RecordError
            The registry or the disk fails; `finish_recorded_run` completes the run later.
        """
        with finished_later(measured.record.run_id, progress) as report_retry:
            if evaluated is None:
                evaluate = partial(self.evaluate, registry, measured, progress)
                evaluated = registry.patiently(evaluate, told=report_retry)
            register = partial(self.register, registry, measured, evaluated)
            return registry.patiently(register, told=report_retry)


def run_only(_registry: Registry, _measured: Measured[Any], evaluated: Evaluated) -> Evaluated:
    """Return the evaluation of a run of which the station enters the run and nothing more."""
    return evaluated


@contextmanager
def finished_later(run_id: str, progress: Progress) -> Iterator[Callable[[str], None]]:
    """Yield a function that reports retries; a failure says how the measured run is finished later.

    Raises
    ------
    RecordError
        The registry or the disk fails.
    """
    try:
        yield lambda _error: progress.start("The registry doesn't answer; trying again")
    except (RecordError, InputError, OSError) as error:
        raise RecordError(
            Message(
                "run {run} is measured and sealed, but its result isn't registered: {reason}",
                run_id,
                getattr(error, "found", error),
            ),
            "a writable registry and disk",
            Message(
                "correct this, then run `torquebench records finish {run}`: nothing is "
                "measured again",
                run_id,
            ),
        ) from error


def run_metadata(side: Side, profile: RunProfile) -> dict[str, str]:
    """Return a run's fields in the registry, beside those of its start document."""
    if isinstance(profile, FrictionSettings):
        return {"side": side}
    return {"side": side, "profile_name": profile.name, "profile_sha256": profile.sha256}


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
    """Rehearse a plan, and execute it as a run of its own.

    `rehearsed` returns the plan without steps that need real recordings, if it has any; `files`
    returns further files of the run, see `Station.run`.
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
