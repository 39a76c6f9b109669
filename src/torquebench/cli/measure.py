"""`torquebench measure`: a live line of torque, speed, temperature and compensation."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.console import answer, answer_line, is_json, note, out
from torquebench.cli.options import (
    CLOCK_TOLERANCE_PPM,
    DEFAULT_DATA,
    AcceptCounterOption,
    BenchOption,
    ClockToleranceOption,
    DataOption,
    accepted_counter,
    bench_description,
)
from torquebench.units import RPM_PER_RAD_S

if TYPE_CHECKING:
    from torquebench.bench.drivers.base import Side
    from torquebench.bench.samples import AcquiredBlock, Viewer
    from torquebench.chain import Timebase
    from torquebench.station import Station

__all__ = ["compensated", "measure"]


def measure(
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    interval: Annotated[
        float, typer.Option(min=0.1, max=60, help="Averaging time of a line, s.")
    ] = 0.5,
    count: Annotated[
        int | None, typer.Option(min=1, help="Number of lines; without it, until Ctrl-C.")
    ] = None,
    accept_counter: AcceptCounterOption = None,
    clock_tolerance_ppm: ClockToleranceOption = CLOCK_TOLERANCE_PPM,
    zero: Annotated[
        bool, typer.Option("--zero", help="First measure the zero of the unloaded bench.")
    ] = False,
) -> None:
    """Show torque ± U (k = 2) of both sides, speed, temperature and compensation, live.

    Nothing is moved. A line is the mean over `--interval` seconds and is rewritten in place; into a
    pipe, each line is written.
    """
    description = bench_description(bench)
    note(f"opening {description.name}")

    from torquebench.bench.drivers.base import SIDES
    from torquebench.cli.recovered import tell_recovered
    from torquebench.station import Station

    accepted = accepted_counter(accept_counter, clock_tolerance_ppm)
    with Station.open(description, data, real_time=True) as station:
        tell_recovered(station)
        states = {side: compensated(station, side, accepted) for side in SIDES}
        if zero:
            _take_zero(station)
        if station.description.simulated:
            note("simulated bench")
        for side, state in states.items():
            note(f"{side}: {state}")
        answer(simulated=station.description.simulated, compensation=states, lines=0)
        try:
            _show(station, interval, count)
        except KeyboardInterrupt:
            out().print()
        note("measuring ended; nothing was moved")


def compensated(station: Station, side: Side, accepted: Timebase | None = None) -> str:
    """Compensate a side by its active model if there is one, and say by which."""
    from torquebench.errors import ModelMismatchError

    try:
        active = station.activate_compensation(side, accepted)
    except ModelMismatchError as error:
        return f"not compensated, {error.found}"
    made = ""
    if active.accepted is not None:
        made = (
            f", made with {active.accepted.identity}: {active.accepted.tolerance_ppm:g} ppm added"
        )
    return f"compensated by model-{active.model_id} ({active.kind}){made}"


def _take_zero(station: Station) -> None:
    from torquebench.procedures import zero_modules

    station.run(zero_modules(station.devices), kind="zero")


def _show(station: Station, interval_s: float, count: int | None) -> None:
    viewer = station.acquisition.add_viewer()
    console = out()
    shown = 0
    try:
        while count is None or shown < count:
            measured = measured_interval(station, _blocks(viewer, interval_s))
            line = measured.line()
            shown += 1
            answer(lines=shown)
            if is_json():
                answer_line(**asdict(measured))
            elif console.is_terminal and not console.quiet:
                console.file.write("\r\x1b[2K" + line)
                console.file.flush()
            else:
                console.print(line, soft_wrap=True)
        if console.is_terminal:
            console.print()
    finally:
        station.acquisition.remove_viewer(viewer)


def _blocks(viewer: Viewer, interval_s: float) -> list[AcquiredBlock]:
    """Collect blocks that cover an interval of bench time."""
    from torquebench.errors import BenchError

    blocks: list[AcquiredBlock] = []
    covered_s = 0.0
    while covered_s < interval_s - 1e-9:
        block = viewer.get(timeout_s=5.0)
        if block is None:
            raise BenchError(
                "no samples for 5 s", "an uninterrupted stream", "run `torquebench doctor`"
            )
        blocks.append(block)
        covered_s += block.stop_s - block.start_s
    return blocks


@dataclass(frozen=True)
class MeasuredSide:
    """Mean torque ± U (k = 2) of one side, and its kind: compensated, raw or a fault.

    Attributes
    ----------
    torque_nm, expanded_uncertainty_nm : float or None
    state : str
        "compensated", "raw", "beyond range" or the fault's name.
    """

    torque_nm: float | None
    expanded_uncertainty_nm: float | None
    state: str

    def text(self, whole: int, decimals: int) -> str:
        """Return torque ± U with digits for the side, or the state in as many columns."""
        width = whole + 3 + max(5, decimals + 2)
        if self.torque_nm is None:
            return f"{self.state:>{width}.{width}}"
        if self.expanded_uncertainty_nm is None:
            return f"{self.torque_nm:{whole}.{decimals}f} raw".ljust(width)
        expanded = f"{self.expanded_uncertainty_nm:5.{decimals}f}"
        return f"{self.torque_nm:{whole}.{decimals}f} ± {expanded}"


@dataclass(frozen=True)
class MeasuredInterval:
    """Content of one line."""

    time_s: float
    input: MeasuredSide
    output: MeasuredSide
    speed_rpm: float
    acceleration_rpm_s: float
    temperature_c: float

    def line(self) -> str:
        """Return one line of at most 80 columns; speed and its rate of the input."""
        return (
            f"{self.time_s:6.1f} s in {self.input.text(7, 3)} out {self.output.text(8, 2)}"
            f" N·m {self.speed_rpm:7.1f} rpm {self.acceleration_rpm_s:+5.0f}/s "
            f"{self.temperature_c:.1f} °C"
        )


def measured_interval(station: Station, blocks: list[AcquiredBlock]) -> MeasuredInterval:
    """Return the means of an interval."""
    from torquebench.bench.acceleration import UNKNOWN

    newest = blocks[-1]
    return MeasuredInterval(
        newest.stop_s,
        _torque("input", blocks),
        _torque("output", blocks),
        newest.speed_rad_s.get("input", math.nan) * RPM_PER_RAD_S,
        newest.accelerations.get("input", UNKNOWN).rad_s2 * RPM_PER_RAD_S,
        newest.temperatures[station.description.input.temperature_probe],
    )


def _torque(side: Side, blocks: list[AcquiredBlock]) -> MeasuredSide:
    import numpy as np

    from torquebench.bench.drivers.base import torque_channel
    from torquebench.chain import joined

    samples = [block.channels[torque_channel(side)] for block in blocks]
    fault = next((each.fault_kind for each in samples if each.fault.any()), None)
    if fault is not None:
        return MeasuredSide(None, None, fault.name.lower().replace("_", " "))
    compensated = [block.compensated[side] for block in blocks if side in block.compensated]
    if len(compensated) == len(blocks):
        mean = joined(compensated).mean()
        if not np.all(np.isfinite(mean.value_nm)):
            return MeasuredSide(None, None, "beyond range")
        value, expanded = float(mean.value_nm[0]), float(mean.expanded_uncertainty_nm[0])
        return MeasuredSide(value, expanded, "compensated")
    torque = np.concatenate([each.torque_nm for each in samples])
    return MeasuredSide(float(np.mean(torque)), None, "raw")
