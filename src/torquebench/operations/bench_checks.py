"""Checks of `doctor` on a configured bench, instrument by instrument."""

from __future__ import annotations

import contextlib
import math
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from torquebench.errors import ModelMismatchError, TorquebenchError
from torquebench.message import Message
from torquebench.operations.place import has_registry
from torquebench.units import DEG_PER_RAD, MS_PER_S, RPM_PER_RAD_S

if TYPE_CHECKING:
    from torquebench.bench.audit.entries import AuditLog
    from torquebench.bench.description import BenchDescription, ModuleDescription
    from torquebench.bench.drivers.base import Drive, DriverSet
    from torquebench.bench.roles import Side
    from torquebench.station import Station


SETTLING_S = 0.3
STANDARD_S, LONGEST_STANDARD_S = 1.0, 10.0
"""Time for which a standard's samples are read, and after which it is said to send none.

A busy computer learns late what the time of a sample is.
"""
FEWEST_READS = 10
"""Number of answers from which the clock of a standard's read-out is known."""
WATCHDOG_MARGIN_S = 0.5
ZERO_TOLERANCE = 0.1
"""Largest deviation of an unloaded signal from its nominal zero, as a share of its span.
"""
ROOM_C = (-10.0, 60.0)


@dataclass(frozen=True)
class Finding:
    """Result of one check.

    Parameters
    ----------
    what : str
    state : {"ok", "note", "problem"}
        Result of the check; a note requires no action.
    found : str
    remedy : str
        What to do, if anything.
    """

    what: str
    state: Literal["ok", "note", "problem"]
    found: str
    remedy: str = ""


def problem(what: str, error: TorquebenchError) -> Finding:
    """Convert an error of a check to a finding."""
    remedy = Message.joined(filter(None, (error.allowed, error.remedy)), "; ")
    return Finding(what, "problem", error.found, remedy)


# -- reachable, identified --------------------------------------------------------------------


def instruments(description: BenchDescription, data: Path) -> Iterator[Finding]:
    """Connect to each instrument independently, and read its identity and status."""
    yield from _connected(description, data)
    yield from _losses(description)


def _connected(description: BenchDescription, data: Path) -> Iterator[Finding]:
    """Yield for each instrument of the bench whether it answers, and as which device."""
    if description.bench.driver != "instruments":
        with _opened(description, data) as drivers:
            for identity in drivers.identities():
                yield _identified(description, identity.role, identity)
        return
    from torquebench.bench.drivers.instruments import ROLES

    yield from _simulators(description)
    with _owned(description, data):
        for role in ROLES:
            if description.driver.get(role) is not None:
                yield _instrument(description, role)


def _losses(description: BenchDescription) -> Iterator[Finding]:
    """State by how much a ramp can continue after a loss of computer or cable."""
    from torquebench.bench.devices.drive import slice_s
    from torquebench.bench.roles import SIDES

    for side in SIDES:
        module = description.module(side)
        rate = module.drive.torque_rate_nm_per_s
        ahead_s = slice_s(module, "torque", rate)
        yield Finding(
            Message("{side} loss", side),
            "ok",
            Message(
                "without computer or cable a ramp adds at most {torque:.3g} N·m, {ahead_s:g} s at "
                "{rate:g} N·m/s; after {watchdog_s:g} s the drive stops",
                rate * ahead_s,
                ahead_s,
                rate,
                module.drive.watchdog_s,
            ),
        )


@contextlib.contextmanager
def _owned(description: BenchDescription, data: Path) -> Iterator[None]:
    """Lock the bench, so that the check doesn't disturb another process's run."""
    from torquebench.station.bench_lock import BenchLock

    with tempfile.TemporaryDirectory() as scratch:
        lock = BenchLock(description, data if data.is_dir() else Path(scratch))
        try:
            yield
        finally:
            lock.release()


@contextlib.contextmanager
def _opened(
    description: BenchDescription, data: Path, log: AuditLog | None = None
) -> Iterator[DriverSet]:
    """Open the instruments without a station; their commands are written to the audit log."""
    from torquebench.bench.audit.writing import audited
    from torquebench.bench.drivers import open_drivers

    with _owned(description, data), contextlib.ExitStack() as closing:
        drivers = open_drivers(description)
        closing.callback(drivers.close)
        if log is not None:
            ramp_s = description.safety.ramp_to_zero_s
            drivers = audited(drivers, log, "doctor", lambda: None, ramp_s)
        yield drivers


def _simulators(description: BenchDescription) -> Iterator[Finding]:
    if "simulation" in description.driver:
        yield Finding("simulators", "note", "every instrument of this bench is simulated")


def _instrument(description: BenchDescription, role: str) -> Finding:
    from torquebench.bench.drivers.base import Drive, Identified
    from torquebench.bench.drivers.instruments import open_role

    name = role.replace("_", " ")
    try:
        instrument = open_role(description, role)
    except TorquebenchError as error:
        return problem(name, error)
    try:
        if isinstance(instrument, Identified):
            found = _identified(description, name, instrument.identity())
            if not isinstance(instrument, Drive) or found.state == "problem":
                return found
            return _with_status(found, instrument, description.module(_side_of(role)))
        counts = instrument.counts()
        return Finding(name, "ok", ", ".join(f"{side} {count}" for side, count in counts.items()))
    except TorquebenchError as error:
        return problem(name, error)
    finally:
        instrument.close()


def _side_of(role: str) -> Side:
    return "input" if role.startswith("input") else "output"


def _with_status(found: Finding, drive: Drive, module: ModuleDescription) -> Finding:
    """Add a drive's status and its own limits to a finding; a failure to read them is a problem."""
    state, own = drive.state(), drive.limits()
    details = drive.identity().details
    reactions = (f"{name} {value}" for name, value in details.items() if "reaction" in name)
    text = Message.joined([found.found, *reactions], "; ")
    if state.enabled:
        remedy = "find out who switched it on"
        return Finding(found.what, "problem", Message("{text}; it has power", text), remedy)
    if not state.remote:
        remedy = "set it to remote control: it ignores commands of the bus"
        return Finding(
            found.what, "problem", Message("{text}; local control (remote bit 0)", text), remedy
        )
    limit_rpm = own.speed_rad_s * RPM_PER_RAD_S
    if own.torque_nm < module.range_nm:
        return Finding(
            found.what,
            "problem",
            Message(
                "{text}; its own limit is {torque_nm:g} N·m, the range {range_nm:g} N·m",
                text,
                own.torque_nm,
                module.range_nm,
            ),
            "raise the limit in the drive's settings, or load with smaller profiles only",
        )
    if limit_rpm < module.limits.speed_rpm * (1.0 - 1e-6):
        text = Message(
            "{text}; its own limit is {limit_rpm:g} of {speed_rpm:g} rpm",
            text,
            limit_rpm,
            module.limits.speed_rpm,
        )
    if state.limited:
        text = Message("{text}; an internal limit of the drive is active", text)
    text = Message("{text}; off{fault}", text, f", {state.fault}" * bool(state.fault))
    return Finding(found.what, found.state, text, found.remedy)


def _identified(description: BenchDescription, name: str, identity: Any) -> Finding:
    found = Message(
        "{manufacturer} {model}, serial {serial}",
        identity.manufacturer,
        identity.model,
        identity.serial,
    )
    described = description.serials.get(identity.role)
    if not identity.serial and described:
        return Finding(
            name,
            "note",
            Message("{found} none", found),
            "it doesn't report a serial number: compare its name plate",
        )
    if described not in (None, identity.serial):
        return Finding(
            name,
            "problem",
            Message("{found}; described is {described}", found, described),
            "connect the described instrument or correct the bench description",
        )
    return Finding(name, "ok", found)


# -- clock, signals ---------------------------------------------------------------------------


def clock(description: BenchDescription, data: Path) -> Iterator[Finding]:
    """Compare the counter's clock with the description."""
    with _opened(description, data) as drivers:
        counter = drivers.counter
        present, timebase_hz = counter.clock_identity, counter.timebase_hz
    described = description.counter.identity
    if present != described:
        yield Finding(
            "clock",
            "problem",
            Message("{present}; described is {described}", present, described),
            "correct counter.serial",
        )
    else:
        yield Finding(
            "clock", "ok", Message("{present}, {frequency:g} MHz", present, timebase_hz / 1e6)
        )


def signals(description: BenchDescription, data: Path) -> Iterator[Finding]:
    """Open the bench without moving it and check whether its signals are plausible."""
    from torquebench.station import Station

    with tempfile.TemporaryDirectory() as scratch:
        known = has_registry(data)
        with Station.open(description, data if known else Path(scratch)) as station:
            station.clock.wait(SETTLING_S)
            yield from signals_of(station)


def signals_of(station: Station) -> Iterator[Finding]:
    """Check whether the signals of an open bench at rest are plausible."""
    yield from _signals_at_rest(station)
    yield from _encoders(station)
    yield from _temperatures(station)
    yield from _standard(station)
    yield from _fixture(station)
    yield from _compensations(station)


def _signals_at_rest(station: Station) -> Iterator[Finding]:
    from torquebench.bench.roles import SIDES, torque_channel

    for side in SIDES:
        what = Message("{side} signal", side)
        try:
            latest = station.acquisition.channel(torque_channel(side)).latest()
        except TorquebenchError as error:
            yield Finding(what, "problem", error.found, error.remedy)
            continue
        scale = station.description.module(side).transducer.scale()
        signal = float(latest[scale.column][0])
        found = Message("{signal:.7g} {unit}", signal, scale.unit)
        full = scale.sensitivity_cw * scale.nominal_torque_nm
        if abs(signal - scale.nominal_zero) > ZERO_TOLERANCE * full:
            yield Finding(
                what,
                "problem",
                Message(
                    "{found}, far from {nominal_zero:g} {unit} unloaded",
                    found,
                    scale.nominal_zero,
                    scale.unit,
                ),
                "unload the side, or check the described signal and whether the cables are swapped",
            )
        else:
            yield Finding(what, "ok", found)


def _encoders(station: Station) -> Iterator[Finding]:
    from torquebench.bench.roles import SIDES

    for side in SIDES:
        what = Message("{side} encoder", side)
        if station.description.module(side).encoder is None:
            yield Finding(what, "note", "none: the module is loaded at rest only")
            continue
        try:
            speed_rad_s = station.acquisition.speed_rad_s(side)
            degrees = station.acquisition.angle_rad(side) * DEG_PER_RAD
        except TorquebenchError as error:
            yield problem(what, error)
            continue
        if station.description.safety.at_standstill(speed_rad_s):
            yield Finding(what, "ok", Message("{degrees:.3f}°, at rest", degrees))
        else:
            turns = Message("turns with {speed:.2f} rpm", speed_rad_s * RPM_PER_RAD_S)
            yield Finding(what, "problem", turns, "bring the side to rest")


def _temperatures(station: Station) -> Iterator[Finding]:
    block = station.acquisition.latest_block
    present = {
        probe: value
        for probe in station.description.temperatures
        if not math.isnan(value := block.temperature_c(probe))
    }
    missing = [probe for probe in station.description.temperatures if probe not in present]
    strange = {
        probe: value for probe, value in present.items() if not ROOM_C[0] <= value <= ROOM_C[1]
    }
    if missing:
        text = ", ".join(missing)
        yield Finding(
            "probes",
            "problem",
            Message("no value of {text}", text),
            "check the probes' connections",
        )
    elif strange:
        probe, value = next(iter(strange.items()))
        yield Finding(
            "probes",
            "problem",
            Message("{probe} {value:.1f} °C", probe, value),
            "check the probe and its wires",
        )
    else:
        shown = [Message("{probe} {value:.1f} °C", *pair) for pair in present.items()]
        yield Finding("probes", "ok", Message.joined(shown))


def _standard(station: Station) -> Iterator[Finding]:
    """Check the signals of a mounted standard, and that they are zero without load."""
    from torquebench.bench.roles import SIDES
    from torquebench.campaign.measuring import standard_at_rest

    if station.drivers.reference is not None:
        yield from _readout(station)
    mounting = station.drivers.operator.mounted()
    for side in SIDES:
        what = Message("{side} standard", side)
        try:
            zero_nm = standard_at_rest(station, side, mounting)
        except TorquebenchError as error:
            yield problem(what, error)
            continue
        if zero_nm is not None:
            yield Finding(what, "ok", Message("{zero_nm:+.3f} N·m without load", zero_nm))


def _readout(station: Station) -> Iterator[Finding]:
    """Check whether a standard with a torque output sends samples continuously."""
    import numpy as np

    from torquebench.bench.roles import SIDES

    reference = station.drivers.reference
    assert reference is not None
    block_s = station.description.counter.block_s
    for side in SIDES:
        what = Message("{side} standard", side)
        try:
            torque = np.empty(0)
            fewest = max(FEWEST_READS, round(STANDARD_S / block_s))
            for number in range(max(fewest, round(LONGEST_STANDARD_S / block_s))):
                if number >= fewest and torque.size:
                    break
                station.clock.wait(block_s)
                now_s = station.clock.now()
                torque = np.append(torque, reference.read(side, now_s, now_s)["signal"])
        except TorquebenchError as error:
            yield problem(what, error)
            continue
        if torque.size == 0:
            remedy = "let its amplifier measure continuously, and check the channel's number"
            found = Message("no sample in {time_s:g} s", LONGEST_STANDARD_S)
            yield Finding(what, "problem", found, remedy)
        elif np.isnan(torque).all():
            yield Finding(what, "note", "states no torque", "mount it to see its signal")
        elif torque.size > 1 and np.ptp(torque[np.isfinite(torque)]) == 0.0:
            found = Message("repeats {torque:g} N·m", torque[0])
            yield Finding(what, "problem", found, "restart its amplifier")
        else:
            yield Finding(
                what,
                "ok",
                Message("{count} samples, {torque:.3f} N·m", torque.size, np.nanmean(torque)),
            )


def _fixture(station: Station) -> Iterator[Finding]:
    """State the modes and the clamp's state by their contacts, for comparison with the bench."""
    from torquebench.bench.roles import SIDES

    drivers = station.drivers
    try:
        modes = Message.joined(
            [Message("{side} {mode}", side, drivers.modes.mode(side)) for side in SIDES]
        )
        yield Finding("modes", "ok", Message("{modes}: compare this with the bench", modes))
        clamped = "closed" if drivers.clamp.clamped() else "open"
        yield Finding("clamp", "ok", Message("{clamped}: compare this with the bench", clamped))
    except TorquebenchError as error:
        yield problem("contacts", error)


def _compensations(station: Station) -> Iterator[Finding]:
    from torquebench.bench.roles import SIDES
    from torquebench.campaign.fitting import model_title

    for side in SIDES:
        try:
            active = station.activate_compensation(side)
        except TorquebenchError as error:
            remedy = error.remedy or f"torquebench calibrate {side}"
            if isinstance(error, ModelMismatchError) and "counter" in error.allowed:
                remedy = Message(
                    "made with {allowed}; {remedy}, or `measure --accept-counter`",
                    error.allowed,
                    remedy,
                )
            yield Finding(Message("{side} model", side), "note", error.found, remedy)
            continue
        yield Finding(
            Message("{side} model", side),
            "ok",
            Message("model-{number} ({title})", active.model_id, model_title(active.kind)),
        )


# -- drives -----------------------------------------------------------------------------------


def drives(description: BenchDescription, data: Path) -> Iterator[Finding]:
    """Power each drive at zero torque; check that it stops on command and by its own watchdog.

    Every command and finding is written to the audit log of the data directory.
    """
    from torquebench.bench.audit.entries import AUDIT_FOLDER, AuditLog
    from torquebench.bench.roles import SIDES, torque_channel
    from torquebench.records.signatures import operator_name

    log = AuditLog(data / AUDIT_FOLDER, bench=description.name)
    log.bind(operator=operator_name())
    with contextlib.closing(log), _opened(description, data, log) as drivers:
        drivers.counter.select(frozenset(torque_channel(side) for side in SIDES))
        for side in SIDES:
            for finding in _drive_tested(drivers, description, side):
                log.write("doctor", what=finding.what, state=finding.state, found=finding.found)
                yield finding


def _drive_tested(
    drivers: DriverSet, description: BenchDescription, side: Side
) -> Iterator[Finding]:
    """Yield how a drive stops and whether its watchdog works; it is switched off afterwards."""
    try:
        yield _stop(drivers, description, side)
        yield _watchdog(drivers, description, side)
    except TorquebenchError as error:
        yield problem(Message("{side} drive", side), error)
    finally:
        _off(drivers.drives[side])


def _off(drive: Drive) -> None:
    try:
        drive.disable()
    except TorquebenchError:
        return


def _stop(drivers: DriverSet, description: BenchDescription, side: Side) -> Finding:
    what, drive = Message("{side} stop", side), drivers.drives[side]
    drive.enable()
    drive.feed_watchdog()
    if not drive.state().enabled:
        return Finding(what, "problem", "it stays off", "check the safety circuit and its supply")
    drive.ramp_to_zero(description.safety.ramp_to_zero_s)
    started = time.perf_counter()
    drive.disable()
    took_ms = (time.perf_counter() - started) * MS_PER_S
    if drive.state().enabled:
        return Finding(
            what, "problem", "it stays on when disabled", "don't use the bench: repair the drive"
        )
    return Finding(what, "ok", Message("disabled, answered in {took_ms:.1f} ms", took_ms))


def _watchdog(drivers: DriverSet, description: BenchDescription, side: Side) -> Finding:
    what, drive = Message("{side} watchdog", side), drivers.drives[side]
    limit_s = description.module(side).drive.watchdog_s
    block_s, allowed_s = description.counter.block_s, limit_s + WATCHDOG_MARGIN_S
    simulated = drivers.simulated_time or "simulation" in description.driver
    drive.enable()
    drive.feed_watchdog()
    fed, passed_s = time.monotonic(), 0.0
    while True:
        # reading blocks advances simulated time; the first blocks may be buffered ones from before
        drivers.counter.read_block(block_s)
        passed_s += block_s
        state, wall_s = drive.state(), time.monotonic() - fed
        unfed_s = passed_s if simulated else wall_s
        if not state.enabled:
            break
        if min(passed_s, wall_s) > allowed_s:
            return Finding(
                what,
                "problem",
                Message("still on {unfed_s:.2f} s after it was last fed", unfed_s),
                "don't use the bench: set up the drive's own watchdog, it is the last line of "
                "defence",
            )
    found = Message(
        "it stopped by itself after {unfed_s:.2f} s: {fault}", unfed_s, state.fault or "disabled"
    )
    if unfed_s > allowed_s:
        return Finding(
            what, "problem", found, Message("set its watchdog to {limit_s:g} s", limit_s)
        )
    return Finding(what, "ok", found)
