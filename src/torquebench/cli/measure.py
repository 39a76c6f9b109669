"""`torquebench measure`: print torque, speed, temperature and compensation live."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.bench.roles import Side
from torquebench.cli.chain_words import tell_compensation
from torquebench.cli.options import (
    DEFAULT_DATA,
    BenchOption,
    CounterOptions,
    DataOption,
    bench_description,
)
from torquebench.cli.reports import Told
from torquebench.cli.terminal.console import answer_line, is_json, note, out
from torquebench.message import Message
from torquebench.units import RPM_PER_RAD_S

if TYPE_CHECKING:
    from torquebench.bench.active_chain import ActiveChain
    from torquebench.bench.blocks import Block, Viewer
    from torquebench.errors import InputError
    from torquebench.station import Station

UNLOADED_SHARE, RESOLUTION_SHARE = 5e-3, 2e-5
"""Of full scale: less torque counts as no load, and less hysteresis as none."""


@dataclass(frozen=True, kw_only=True)
class Measured(Told):
    """Models in use; each `MeasuredInterval` is printed before as a line of its own, as `line`."""

    compensation: Mapping[Side, str]
    not_in_u: Mapping[Side, Sequence[str]]
    lines: int


def measure(
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    interval: Annotated[
        float, typer.Option(min=0.1, max=60, help="Averaging time of a line, s.")
    ] = 0.5,
    count: Annotated[
        int | None, typer.Option(min=1, help="Number of lines; without it, until Ctrl-C.")
    ] = None,
    zero: Annotated[
        bool, typer.Option("--zero", help="First measure the zero of the unloaded bench.")
    ] = False,
    *,
    counter: CounterOptions,
) -> Measured:
    """Show torque ± U (k = 2) of both sides, speed, temperature and compensation, live.

    Nothing is moved. A line is the mean over `--interval` seconds and is rewritten in place; into a
    pipe, each line is written.
    """
    description = bench_description(bench)
    note(f"opening {description.name}")

    from torquebench.bench.roles import SIDES
    from torquebench.cli.recovered import tell_recovered
    from torquebench.station import Station

    with Station.open(description, data, real_time=True) as station:
        tell_recovered(station)
        if station.description.simulated:
            note("simulated bench")
        states, missing = tell_compensation(station, SIDES, counter.accepted())
        if zero:
            _take_zero(station)
        lines = 0
        try:
            for _ in _shown(station, interval, count):
                lines += 1
        except KeyboardInterrupt:
            out().print()
        note("measuring ended; nothing was moved")
        return Measured(
            headline=Message("{count} lines.", lines),
            simulated=station.description.simulated,
            compensation=states,
            not_in_u=missing,
            lines=lines,
        )


def _take_zero(station: Station) -> None:
    from torquebench.procedures import zero_modules

    station.run(zero_modules(station.devices), kind="zero")


def _shown(station: Station, interval_s: float, count: int | None) -> Iterator[None]:
    """Print a line after each interval, and yield then."""
    viewer = station.acquisition.add_viewer()
    console = out()
    shown, refusals = 0, ("", "")
    try:
        while count is None or shown < count:
            measured = measured_interval(station, _blocks(viewer, interval_s))
            line = measured.line()
            before, refusals = refusals, (measured.input.detail, measured.output.detail)
            for earlier, detail in zip(before, refusals, strict=True):
                if detail and not earlier:
                    if console.is_terminal and shown:
                        console.print()
                    note(detail)
            shown += 1
            if is_json():
                answer_line(**asdict(measured))
            elif console.is_terminal and not console.quiet:
                console.file.write("\r\x1b[2K" + line)
                console.file.flush()
            else:
                console.print(line, soft_wrap=True)
            yield
        if console.is_terminal:
            console.print()
    finally:
        station.acquisition.remove_viewer(viewer)


def _blocks(viewer: Viewer, interval_s: float) -> list[Block]:
    """Collect blocks that cover an interval of bench time."""
    from torquebench.errors import BenchError

    blocks: list[Block] = []
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
    """Mean torque ± U (k = 2) of one side, and its state.

    Attributes
    ----------
    torque_nm, expanded_uncertainty_nm : float or None
    state : str
        "compensated", "raw", "beyond range" or the fault's name.
    detail : str
        For a value beyond a range: the effect, the value and the range. Without load: the
        hysteresis that earlier loads left.
    hysteresis_nm, hysteresis_expanded_nm : float or None
        Part of the torque and of U (k = 2) due to earlier loads.
    """

    torque_nm: float | None
    expanded_uncertainty_nm: float | None
    state: str
    detail: str = ""
    hysteresis_nm: float | None = None
    hysteresis_expanded_nm: float | None = None

    def text(self, whole: int, decimals: int) -> str:
        """Return torque ± U with fixed digits, or the state in a field of the same width."""
        width = whole + 3 + max(5, decimals + 2)
        if self.torque_nm is None:
            return f"{self.state:>{width}.{width}}"
        if self.expanded_uncertainty_nm is None:
            return f"{self.torque_nm:z{whole}.{decimals}f} raw".ljust(width)
        expanded = f"{self.expanded_uncertainty_nm:5.{decimals}f}"
        return f"{self.torque_nm:z{whole}.{decimals}f} ± {expanded}"


@dataclass(frozen=True)
class MeasuredInterval:
    """Mean values of one interval."""

    time_s: float
    input: MeasuredSide
    output: MeasuredSide
    speed_rpm: float
    acceleration_rpm_s: float
    temperature_c: float

    def line(self) -> str:
        """Return a line of at most 80 columns; speed and acceleration are those of the input."""
        turning = f"{self.speed_rpm:7.1f} rpm {self.acceleration_rpm_s:+5.0f}/s "
        if math.isnan(self.speed_rpm):  # without an encoder
            turning = ""
        return (
            f"{self.time_s:6.1f} s in {self.input.text(7, 3)} out {self.output.text(8, 2)}"
            f" N·m {turning}{self.temperature_c:.1f} °C"
        )


def measured_interval(station: Station, blocks: list[Block]) -> MeasuredInterval:
    """Average the blocks of an interval."""
    newest = blocks[-1]
    return MeasuredInterval(
        newest.stop_s,
        _torque("input", blocks, station.acquisition.compensation("input")),
        _torque("output", blocks, station.acquisition.compensation("output")),
        newest.speed_rad_s("input") * RPM_PER_RAD_S,
        newest.condition("input_acceleration_rad_s2") * RPM_PER_RAD_S,
        newest.temperature_c(station.description.input.temperature_probe),
    )


def _torque(side: Side, blocks: list[Block], active: ActiveChain | None = None) -> MeasuredSide:
    import numpy as np

    from torquebench.bench.blocks import fault_of
    from torquebench.bench.roles import torque_channel
    from torquebench.chain import COVERAGE_FACTOR, joined

    records = [block.records[torque_channel(side)] for block in blocks]
    fault = next((fault_of(record) for record in records if record["fault"].any()), None)
    if fault is not None:
        return MeasuredSide(None, None, fault.name.lower().replace("_", " "))
    compensated = [block.torques[side] for block in blocks if side in block.torques]
    if len(compensated) == len(blocks):
        mean = joined(compensated).mean()
        if not np.all(np.isfinite(mean.value_nm)):
            refusal = None
            if active is not None:
                refusal = active.refusal(side, blocks[0].start_s, blocks[-1].stop_s)
            return MeasuredSide(None, None, "beyond range", _range_of(refusal))
        value, expanded = float(mean.value_nm[0]), float(mean.expanded_uncertainty_nm[0])
        added = float(mean.added("hysteresis")[0])
        unsure = COVERAGE_FACTOR * float(mean.component("hysteresis")[0])
        detail = "" if active is None else _hysteresis(side, active, value, added, unsure)
        return MeasuredSide(value, expanded, "compensated", detail, added, unsure)
    torque = np.concatenate([record["reading_nm"] for record in records])
    return MeasuredSide(float(np.mean(torque)), None, "raw")


def _hysteresis(
    side: Side, active: ActiveChain, torque_nm: float, added_nm: float, expanded_nm: float
) -> str:
    """Return what earlier loads leave on an unloaded chain, if it is more than its resolution."""
    from torquebench.message import Message

    full_scale_nm = float(active.chain.model.full_scale_nm_)
    unloaded = abs(torque_nm) < UNLOADED_SHARE * full_scale_nm
    if not unloaded or abs(added_nm) + expanded_nm < RESOLUTION_SHARE * full_scale_nm:
        return ""
    return Message(
        "{side} without load: {added:+.2g} ± {expanded:.2g} N·m of it are hysteresis, which "
        "earlier loads left; a new zero removes it",
        side,
        added_nm,
        expanded_nm,
    )


def _range_of(refusal: InputError | None) -> str:
    return "" if refusal is None else f"{refusal.found}, allowed {refusal.allowed}"
