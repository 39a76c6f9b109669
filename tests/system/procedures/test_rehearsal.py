"""A plan is gone through, checked and timed before anything moves."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import bluesky.plan_stubs as bps
import numpy as np
import pytest

from torquebench.bench.description import StandardDescription, default_bench
from torquebench.bench.drivers.simulated import driver
from torquebench.bench.drivers.simulated.readout import SimulatedReadout
from torquebench.bench.roles import SIDES, Seating
from torquebench.bench.safety.limits import StepLimits
from torquebench.calibration import Step, load_profile
from torquebench.errors import InputError, InterlockError, LimitError
from torquebench.procedures import calibrate, friction_sweep, rehearse, verify
from torquebench.procedures.guarding import guarded
from torquebench.procedures.reducers.friction import FrictionSettings
from torquebench.procedures.reducers.loop import hysteresis_loops
from torquebench.procedures.reducers.setup import ReducerLimits
from torquebench.procedures.reducers.turning import TransmissionSettings, transmission_error
from torquebench.procedures.turning.calibrating import calibrate_turning
from torquebench.procedures.turning.empty import EmptyTable, turn_empty
from torquebench.procedures.turning.profile import load_turning_profile
from torquebench.signals import FrequencyCounter
from torquebench.station import Station
from torquebench.units import RPM_PER_RAD_S

COARSE = load_profile("rapid-in-situ").with_options(step_percent=25.0)


def test_the_rehearsed_plan_gives_the_staircase_it_will_load(station: Station) -> None:
    rehearsal = rehearse(station.devices, calibrate(station.devices, "output", COARSE))
    points = [step for step in COARSE.staircase(2000.0) if step.recorded]
    assert rehearsal.points == len(points)
    assert rehearsal.result.data.reading_nm.tolist() == [step.nominal_nm for step in points]
    assert rehearsal.result.data.branch.tolist() == [step.branch for step in points]


def test_a_rehearsal_moves_nothing(station: Station) -> None:
    before = station.clock.now()
    rehearse(station.devices, calibrate(station.devices, "output", COARSE))
    assert station.drivers.operator.mounted() == "nothing"
    assert not station.drivers.clamp.clamped()
    assert not station.drivers.drives["output"].state().enabled
    assert station.clock.now() == before


def test_it_ends_without_torque_and_with_drives_off(station: Station) -> None:
    rehearsal = rehearse(station.devices, calibrate(station.devices, "input", COARSE))
    by_device = {}
    for move in rehearsal.moves:
        by_device[move.device] = move.value
    assert by_device["input torque"] == 0.0
    assert by_device["input power"] is False


def test_the_setup_comes_before_any_torque(station: Station) -> None:
    rehearsal = rehearse(station.devices, calibrate(station.devices, "output", COARSE))
    names = [move.device for move in rehearsal.moves]
    first_torque = names.index("output torque")
    for earlier in ("mounting", "clamp", "input mode", "output mode", "output power"):
        assert names.index(earlier) < first_torque


def test_the_duration_counts_steps_ramps_and_zeros(station: Station) -> None:
    rehearsal = rehearse(station.devices, calibrate(station.devices, "output", COARSE))
    held = sum(step.duration_s for step in COARSE.staircase(2000.0))
    assert held < rehearsal.duration_s < held + 10.0
    taken = station.run(calibrate(station.devices, "output", COARSE), kind="calibrate-output")
    assert taken.bench_seconds == pytest.approx(rehearsal.duration_s, abs=5.0)


def test_a_step_beyond_the_limit_is_refused_before_anything_moves(station: Station) -> None:
    excess = Step(kind="point", series=1, index=0, nominal_nm=2500.0, branch=1, duration_s=0.5)
    plan = verify(station.devices, "output", load_profile("verification"), [excess])
    with pytest.raises(LimitError, match="2500"):
        rehearse(station.devices, plan)
    assert station.drivers.operator.mounted() == "nothing"


@contextmanager
def bench(folder: Path, *, window_s: float = 0.01, reference: str = "edges") -> Iterator[Station]:
    """Open a simulated bench whose counter, or whose standard's read-out, is slow."""
    described = default_bench()
    counter = described.counter.model_copy(update={"window_s": window_s, "block_s": window_s * 5})
    driver = dict(described.driver) | {"reference": reference}
    changed = described.model_copy(update={"counter": counter, "driver": driver})
    with Station.open(changed, folder / "data") as station:
        yield station


@pytest.mark.parametrize(("window_s", "profile"), [(0.15, "rapid-in-situ"), (0.1, "staircase")])
def test_an_amplifier_too_slow_for_a_step_is_refused_before_anything_moves(
    tmp_path: Path, window_s: float, profile: str
) -> None:
    chosen = load_profile(profile)
    with bench(tmp_path, window_s=window_s) as station:
        plan = calibrate(station.devices, "output", chosen)
        if profile == "staircase":
            assert rehearse(station.devices, plan).points
            return
        with pytest.raises(InputError, match=r"0\.3 s, output_torque states a value each 0\.15 s"):
            rehearse(station.devices, plan)
        assert station.drivers.operator.mounted() == "nothing"


def test_a_standard_whose_read_out_is_slower_than_the_counter_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class SlowReadout(SimulatedReadout):
        period_s = 0.05

        def connect(self, standard: StandardDescription | None) -> None:
            super().connect(standard)
            timebase_hz = self._counting.timebase_hz
            counter = partial(FrequencyCounter, "regression", self.period_s, timebase_hz)
            self._counters = {side: counter() for side in SIDES}

    monkeypatch.setattr(driver, "SimulatedReadout", SlowReadout)
    with bench(tmp_path, window_s=0.01, reference="readout") as station:
        plan = calibrate(station.devices, "output", COARSE)
        assert rehearse(station.devices, plan).points
        taken = station.run(calibrate(station.devices, "output", COARSE), kind="calibrate-output")
    data = taken.result.data
    np.testing.assert_allclose(data.standard_nm, data.reading_nm, atol=25.0)


def test_a_speed_beyond_the_limit_is_refused(station: Station) -> None:
    settings = FrictionSettings(speeds_rpm=(100.0, 2000.0))
    with pytest.raises(LimitError, match="2000"):
        rehearse(station.devices, friction_sweep(station.devices, settings))


LARGE = ReducerLimits(
    ratio=80.0, rated_torque_nm=4000.0, largest_torque_nm=9000.0, largest_input_rpm=9000.0
)
FAST = load_turning_profile("turning-calibration").model_copy(
    update={"largest_rpm": {"input": 5000.0}}
)
EXCESSIVE = {
    "friction sweep": lambda devices: friction_sweep(
        devices, FrictionSettings(speeds_rpm=(2000.0,))
    ),
    "turning calibration": lambda devices: calibrate_turning(devices, "input", FAST),
    "empty run": lambda devices: turn_empty(devices, "input", FAST, EmptyTable("input")),
    "transmission error": lambda devices: transmission_error(
        devices, LARGE, TransmissionSettings(output_rpm=60.0)
    ),
    "hysteresis": lambda devices: hysteresis_loops(devices, LARGE),
}


@pytest.mark.parametrize("name", EXCESSIVE)
def test_a_plan_beyond_the_limits_is_refused_before_its_first_message(
    station: Station, name: str
) -> None:
    with pytest.raises(LimitError, match="requested from the"):
        next(EXCESSIVE[name](station.devices))


def test_a_rehearsal_heeds_the_narrower_limits_of_its_plan(station: Station) -> None:
    def plan():
        yield from _ready(station.devices)
        yield from bps.mv(station.devices.output.drive.torque, 100.0)

    def within(torque_nm):
        return guarded(plan, StepLimits("output", torque_nm=torque_nm))

    assert rehearse(station.devices, within(100.0)).moves
    for refused in (
        lambda: rehearse(station.devices, within(99.0)),
        lambda: station.run(within(99.0), kind="test"),
    ):
        with pytest.raises(LimitError, match="±99 N·m"):
            refused()


def test_a_rehearsal_does_not_count_the_narrower_limits_of_a_run(station: Station) -> None:
    with station.supervisor.limits.within(StepLimits("output", torque_nm=1.0)):
        assert rehearse(station.devices, calibrate(station.devices, "output", COARSE)).points


def test_a_guide_rail_that_the_bench_lacks_is_not_moved(tmp_path) -> None:
    bench = default_bench().model_copy(update={"guide_rail": None})
    with Station.open(bench, tmp_path / "data") as station:

        def plan():
            yield from bps.mv(station.devices.rail, "away")

        for refused in (
            lambda: rehearse(station.devices, plan()),
            lambda: station.run(plan(), kind="test"),
        ):
            with pytest.raises(InputError, match="guide rail"):
                refused()


def test_torque_without_clamp_and_power_is_refused(station: Station) -> None:
    def careless():
        yield from bps.mv(station.devices.output.drive.torque, 100.0)

    with pytest.raises(InterlockError, match="in mode 'free'"):
        rehearse(station.devices, careless())


def test_a_mode_change_under_load_is_refused(station: Station) -> None:
    devices = station.devices

    def careless():
        yield from bps.mv(devices.mounting, "calibrator")
        yield from bps.mv(devices.clamp, True)
        yield from bps.mv(devices.output.mode, "driven")
        yield from bps.mv(devices.output.drive.power, True)
        yield from bps.mv(devices.output.drive.torque, 100.0)
        yield from bps.mv(devices.output.mode, "free")

    with pytest.raises(InterlockError, match="output drive at 100 N·m"):
        rehearse(devices, careless())


def test_a_calibration_without_the_calibrator_is_refused(station: Station) -> None:
    from torquebench.procedures.setup import ProcedureGate

    def careless():
        yield from bps.mv(station.devices.mounting, "reducer")
        yield from bps.abs_set(ProcedureGate(station.devices), "calibration", wait=True)

    with pytest.raises(InterlockError, match="reducer"):
        rehearse(station.devices, careless())


def test_every_point_has_a_checkpoint_of_its_own(station: Station) -> None:
    rng = np.random.default_rng(1)
    profile = load_profile("verification").with_options(groups=1, points=8)
    steps = profile.staircase(50.0, rng)
    commands = []

    def watched(plan):
        answer = None
        while True:
            try:
                message = plan.send(answer)
            except StopIteration as end:
                return end.value
            commands.append((message.command, message.kwargs.get("name")))
            answer = yield message

    rehearse(station.devices, watched(verify(station.devices, "input", profile, steps)))
    since_last = 0
    for command, name in commands:
        if command == "checkpoint":
            since_last = 0
        if (command, name) == ("create", "points"):
            since_last += 1
            assert since_last == 1


def _ready(devices):
    yield from bps.mv(devices.mounting, "calibrator")
    yield from bps.mv(devices.clamp, True)
    yield from bps.mv(devices.output.mode, "driven")
    yield from bps.mv(devices.output.drive.power, True)


def _drawn_back(devices):
    yield from bps.mv(devices.rail, "away")
    yield from bps.mv(devices.mounting, "calibrator")


def _loaded(devices):
    yield from _ready(devices)
    yield from bps.mv(devices.output.drive.torque, 100.0)


ORDERS = {
    "close the clamp that is closed, loaded": (_loaded, "clamp", True),
    "open the clamp, loaded": (_loaded, "clamp", False),
    "open the clamp that is open": (None, "clamp", False),
    "clamp nothing": (None, "clamp", True),
    "the rail, clamped": (_ready, "rail", "away"),
    "the rail at rest": (None, "rail", "away"),
    "clamp with the rail drawn back": (_drawn_back, "clamp", True),
    "a mode, loaded": (_loaded, "output.mode", "free"),
    "a mode with its drive on": (_ready, "output.mode", "free"),
    "power off, loaded": (_loaded, "output.drive.power", False),
    "mount what is mounted": (_ready, "mounting", "calibrator"),
    "mount with the clamp closed": (_ready, "mounting", "reducer"),
    "seat nothing": (None, "seat", Seating("rotation", 120.0)),
    "seat with the clamp closed": (_ready, "seat", Seating("rotation", 120.0)),
    "torque on a side that is off": (None, "input.drive.torque", 1.0),
    "the largest speed": (_ready, "output.drive.speed", 20.0 / RPM_PER_RAD_S),
    "more than the largest speed": (_ready, "output.drive.speed", 20.1 / RPM_PER_RAD_S),
    "more than the largest torque": (_ready, "output.drive.torque", 2401.0),
}


@pytest.mark.parametrize("name", ORDERS)
def test_a_rehearsal_refuses_what_the_bench_refuses_and_nothing_else(
    station: Station, name: str
) -> None:
    before, path, value = ORDERS[name]

    def plan():
        device = station.devices
        if before is not None:
            yield from before(device)
        for part in path.split("."):
            device = getattr(device, part)
        yield from bps.mv(device, value)

    def refused(do):
        try:
            do()
        except (InterlockError, LimitError) as refusal:
            return type(refusal), refusal.found
        return None

    rehearsed = refused(lambda: rehearse(station.devices, plan()))
    assert refused(lambda: station.run(plan(), kind="test")) == rehearsed
