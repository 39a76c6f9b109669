"""An operation of one's own: hold a torque against the calibrator and record the creep.

torquebench --operations creep.py creep output --dry-run
torquebench --operations creep.py creep output
torquebench --operations creep.py panel
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from torquebench.bench import Side
from torquebench.bench.devices import BenchDevices, Point, SteadySettings
from torquebench.campaign import measure
from torquebench.message import Message
from torquebench.operations import (
    MountedRequest,
    Number,
    Numbers,
    Operation,
    Place,
    Preview,
    Result,
    field,
    plan_preview,
)
from torquebench.procedures import Plan, rehearse, zero
from torquebench.procedures.guarding import loading_limits
from torquebench.procedures.messages import checkpoint, move, prepare, progress, sleep, take
from torquebench.procedures.setup import Setup, measured_in, start_metadata
from torquebench.progress import Progress
from torquebench.reports.page import Facts, Page, Section, Table


class CreepRequest(MountedRequest):
    """Hold a torque against the calibrator and record how the reading drifts from it."""

    side: Annotated[Side, field("Which module.", title="Module", argument=True)]
    torque_percent_fs: Annotated[Number, field("Torque, % of the range.", ge=-100, le=100)] = 50.0
    duration_s: Annotated[Number, field("How long it is held.", ge=10, le=7200)] = 300.0
    interval_s: Annotated[Number, field("Time between two points.", ge=1, le=600)] = 30.0


@dataclass(frozen=True, kw_only=True)
class CreepResult(Result):
    """Change of the reading against the standard since the first point."""

    torque_nm: float
    time_s: Numbers
    creep_nm: Numbers

    def page(self) -> Page:
        """Return its description for terminal, panel and report."""
        facts = Facts([("Torque", f"{self.torque_nm:g} N·m"), ("Run", self.run_ids[0])])
        points = zip(self.time_s, self.creep_nm, strict=True)
        table = Table(("time, s", "creep, N·m"), [(f"{t:.0f}", f"{c:+.3g}") for t, c in points])
        return Page(self.headline, "", [Section("", "", [facts, table])], simulated=self.simulated)


def creep(devices: BenchDevices, request: CreepRequest) -> Plan[Sequence[Any]]:
    """Zero, load, and take a point at each interval; the run can be paused at each of them."""
    side, module = request.side, devices.module(request.side)
    torque_nm = request.torque_percent_fs / 100 * devices.context.description.module(side).range_nm
    count = 1 + int(request.duration_s // request.interval_s)
    rows: list[Any] = []

    def measuring() -> Plan[None]:
        yield from zero(devices, side, standard=True)
        yield from prepare(module.steady, SteadySettings(reference=True), wait=True)
        for number in range(count):
            yield from progress(number, count, Message("point {number}", number + 1))
            yield from checkpoint()
            yield from move(devices.point, Point(step=number, nominal_nm=torque_nm))
            yield from move(module.drive.torque, torque_nm)  # again after a pause
            rows.append((yield from take(module.steady, devices.point, stream="points")))
            if number + 1 < count:
                yield from sleep(request.interval_s)
        yield from progress(count, count, "done")

    setup = Setup("calibration", side, "calibrator", opposite="locked")
    metadata = start_metadata(devices, "creep", count, side)
    limits = loading_limits(devices, side, torque_nm)
    yield from measured_in(setup, devices, measuring(), metadata, limits)
    return rows


def title(request: CreepRequest) -> str:
    return Message("Creep of the {side} module", request.side)


def preview(place: Place, request: CreepRequest) -> Preview:
    devices = place.station.devices
    rehearsal = rehearse(devices, creep(devices, request))
    return plan_preview(title(request), place.station.description, rehearsal)


def run(place: Place, request: CreepRequest, progress: Progress) -> CreepResult:
    measured = measure(
        place.station,
        lambda: creep(place.station.devices, request),
        kind=f"creep-{request.side}",
        title=title(request),
        **place.run_options(progress, request.mounting),
    )
    rows = measured.result
    difference = [row["reading_nm"] - row["standard_nm"] for row in rows]
    changes = [value - difference[0] for value in difference]
    return CreepResult(
        headline=Message(
            "Creep of the {side} module: {creep:+.3g} N·m after {seconds:g} s.",
            request.side,
            changes[-1],
            rows[-1]["time_s"] - rows[0]["time_s"],
        ),
        simulated=place.station.description.simulated,
        run_ids=(measured.record.run_id,),
        torque_nm=rows[0]["commanded_nm"],
        time_s=[row["time_s"] - rows[0]["time_s"] for row in rows],
        creep_nm=changes,
    )


CREEP = Operation(
    "creep",
    CreepRequest,
    run,
    title,
    preview,
    where="bench",
    moves=True,
    loads=True,
    can_pause=True,
)
