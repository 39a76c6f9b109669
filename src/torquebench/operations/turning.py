"""Runs with a rotating module by turning profiles; each writes a table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from torquebench.atomic_write import private_folder
from torquebench.bench.roles import Side
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import WHOLE, Flag, Name, Operation, Request, field
from torquebench.operations.place import Place
from torquebench.operations.preview import Preview, plan_preview
from torquebench.operations.result import Result
from torquebench.progress import Progress
from torquebench.units import TURN

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.procedures.turning.profile import TurningProfile


class TurnRequest(Request):
    """Rotate a module with nothing mounted or against the calibrator, and write the table.

    Profiles:

    - empty-run; empty-run-temperatures (waits for each); empty-run-warm-up (uses the bench's own
      warming)
    - identification (inertia)
    - turning-calibration; turning-verification (random torques and speeds, for `verify`)
    - dynamics (steps and sines of torque against the calibrator at rest, for `evaluate dynamics`)

    A pause waits at the next point. An aborted run keeps its complete series (a calibration's
    speeds) in the table; `--resume` of the command measures the others.
    """

    basic = ("side", "profile", "wait")

    side: Annotated[Side, field("Which module.", title="Module", argument=True)]
    profile: Annotated[
        Name, field("A profile's name; a command takes a .toml, too.", examples=("empty-run",))
    ] = "empty-run"
    wait: Annotated[Flag, field("Wait for temperatures.")] = True
    seed: Annotated[
        Annotated[int, Field(ge=0, le=2**32 - 1), WHOLE] | None,
        field("Seed of the random points of a verification."),
    ] = None
    out: Annotated[
        Path | None,
        field(
            "The table to write, CSV; by default in the data.",
            local=True,
            output=(".csv", ".txt", ".tsv"),
        ),
    ] = None
    resume: Annotated[
        Flag, field("Resume the interrupted run in the file of --out.", local=True)
    ] = False


@dataclass(frozen=True, kw_only=True)
class TurnedModule(Result):
    """A run with a rotating module, and its table."""

    side: str
    profile: str
    table: str
    rows: int
    duration_s: float


def _profile(place: Place, request: TurnRequest) -> TurningProfile:
    chosen = place.library.turning(request.profile)
    return chosen if request.seed is None else chosen.with_seed(request.seed)


def check_turn(place: Place, request: TurnRequest) -> Iterable[str]:
    """Raise an error for an unknown profile or a table that can't be resumed."""
    from torquebench.campaign.turning_runs import read_begun

    chosen = _profile(place, request)
    if chosen.kind != "dynamics":  # steps of torque, at rest
        place.station.description.needed_encoder(request.side)
    if request.resume:
        if request.out is None:
            raise InputError("--resume without --out", "the table of the interrupted run")
        serial = place.station.description.module(request.side).transducer.serial
        read_begun(request.out, request.side, chosen, serial)
    return ()


def preview_turn(place: Place, request: TurnRequest) -> Preview:
    """Rehearse the plan of the run; its duration doesn't include waiting for temperatures."""
    from torquebench.campaign.turning_runs import rehearse_turning

    description, chosen = place.station.description, _profile(place, request)
    rehearsal = rehearse_turning(place.station, request.side, chosen)
    shown = plan_preview(turn_title(request), description, rehearsal)
    if chosen.kind == "dynamics":
        remarks = list(_steps(description, request.side, chosen))
    else:
        remarks = list(_speeds(request.side, chosen))
    return replace(shown, remarks=tuple(remarks))


def _speeds(side: Side, profile: TurningProfile) -> Iterable[str]:
    """Describe speeds, torques, ramps and temperatures."""
    top = profile.top_rpm(side)
    speeds = Message.joined(f"{share * top:g}" for share in profile.speed_shares)
    if profile.random is None:
        yield Message("Speeds: {speeds} rpm, both directions.", speeds)
    else:
        yield Message(
            "Random: {low:g} to {top:g} rpm in both directions, up to ±{share:g} % of range, seed "
            "{seed}.",
            profile.speed_shares[0] * top,
            top,
            100 * profile.torque_shares[-1],
            profile.random.seed,
        )
    if profile.kind == "empty":
        gentle, steep = (top / each for each in (profile.ramps.gentle_s, profile.ramps.steep_s))
        yield Message("Ramps: {gentle:.3g} and {steep:.3g} rpm/s.", gentle, steep)
    elif profile.kind == "calibration":
        torques = Message.joined(f"{100 * share:g}" for share in profile.torque_shares)
        yield Message("Torques: ±{torques} % of range, and 0.", torques)
    if (temperatures := profile.temperatures) is not None:
        wanted = Message.joined(f"{each:g}" for each in temperatures.wanted_c)
        yield Message(
            "Temperatures: {wanted} °C, waited for up to {hours:g} h each, beside this duration.",
            wanted,
            temperatures.longest_h,
        )


def _steps(description: BenchDescription, side: Side, profile: TurningProfile) -> Iterable[str]:
    """Describe steps and sines of torque, and the fastest that the drive can follow."""
    module, steps, sines = description.module(side), profile.steps, profile.sines
    assert steps is not None
    full, rate = module.range_nm, module.drive.torque_rate_nm_per_s
    yield Message(
        "Steps: {sizes} N·m around {preload:g} N·m; the drive takes {seconds:.3g} s for the "
        "largest.",
        Message.joined(f"{share * full:g}" for share in steps.shares),
        steps.preload_share * full,
        max(steps.shares) * full / rate,
    )
    if sines is not None:
        size = sines.share * full
        yield Message(
            "Sines: {size:g} N·m, periods {periods} s; the drive follows those from {least:.3g} s.",
            size,
            Message.joined(f"{each:g}" for each in sines.periods_s),
            TURN * size / rate,
        )


def run_turn(place: Place, request: TurnRequest, progress: Progress) -> TurnedModule:
    """Measure, and write the table after every complete series."""
    from torquebench.campaign.turning_runs import describe_turning, measure_turning, read_begun

    station, chosen, target = place.station, _profile(place, request), request.out
    begun = None
    if target is None:
        folder = place.registry.root / "tables"
        private_folder(folder)
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        target = folder / f"{stamp}-{chosen.name}-{request.side}.csv"
    elif request.resume:
        serial = station.description.module(request.side).transducer.serial
        begun = read_begun(target, request.side, chosen, serial)
    done = measure_turning(
        station,
        request.side,
        chosen,
        target,
        begun=begun,
        wait=request.wait,
        **place.run_options(progress),
    )
    return TurnedModule(
        headline=describe_turning(done),
        simulated=station.description.simulated,
        run_ids=(done.run_id,),
        files=(str(target.absolute()),),
        side=request.side,
        profile=chosen.name,
        table=str(target),
        rows=done.rows,
        duration_s=done.bench_seconds,
    )


def turn_title(request: TurnRequest) -> str:
    """Return the title of a request."""
    return Message("Turn the {side} module: {profile}", request.side, request.profile)


TURN_MODULE = Operation(
    "turn",
    TurnRequest,
    run_turn,
    turn_title,
    preview_turn,
    check_turn,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
)
