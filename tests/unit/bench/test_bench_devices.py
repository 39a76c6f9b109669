import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest
from bluesky.protocols import (
    Configurable,
    HasHints,
    Locatable,
    Movable,
    Preparable,
    Readable,
    Stoppable,
    Triggerable,
)

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.chain_effects import chain_effects
from torquebench.bench.devices import (
    BenchDevices,
    MeasuredZero,
    Point,
    PointLabel,
    SteadySettings,
)
from torquebench.bench.devices.context import BenchContext
from torquebench.bench.safety import AlarmKind
from torquebench.chain import Counter, Effect, MeasuredTemperature, MeasuringChain, Readings
from torquebench.compensation import make_model
from torquebench.errors import BenchError, InputError, InterlockError, LimitError, SignalFault

OpenBench = Callable[..., Any]


@asynccontextmanager
async def ready(bench: Any) -> AsyncIterator[BenchDevices]:
    """Devices of a bench with the calibrator clamped and the output driven, drive on."""
    context = BenchContext(
        bench.description,
        bench.drivers,
        bench.clock,
        bench.acquisition,
        bench.supervisor,
        bench.state,
        bench.commands,
    )
    devices = BenchDevices(context)
    await devices.connect()
    await devices.mounting.set("calibrator")
    await devices.clamp.set(True)
    await devices.input.mode.set("locked")
    await devices.output.mode.set("driven")
    await devices.output.drive.power.set(True)
    yield devices


def play(bench: Any, scene: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run a scene on an event loop whose thinking takes no simulated time."""
    loop = bench.clock.new_event_loop()
    try:
        loop.run_until_complete(scene())
    finally:
        loop.close()


def test_devices_speak_the_protocols_of_bluesky(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            axis, steady = devices.output.drive.torque, devices.output.steady
            for protocol in (Movable, Stoppable, Locatable, Readable, HasHints):
                assert isinstance(axis, protocol)
            for protocol in (Triggerable, Preparable, Readable, Configurable, HasHints):
                assert isinstance(steady, protocol)
            for device in (devices.clamp, devices.mounting, devices.input.mode, devices.point):
                assert isinstance(device, Movable)
                assert isinstance(device, Readable)

    play(bench, scene)


def test_every_reading_is_described_with_its_unit(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            await devices.output.steady.prepare(SteadySettings(reference=True))
            await devices.output.steady.trigger()
            readable = [
                devices.clamp,
                devices.mounting,
                devices.temperatures,
                devices.point,
                devices.output.mode,
                devices.output.encoder,
                devices.output.transducer,
                devices.output.steady,
                devices.output.drive.torque,
                devices.output.drive.power,
            ]
            units = {}
            for device in readable:
                reading, description = await device.read(), await device.describe()
                assert set(reading) == set(description)
                units |= {key: entry.get("units") for key, entry in description.items()}
            assert units["output-transducer-reading_nm"] == "N·m"
            assert units["output-encoder-speed_rad_s"] == "rad/s"
            assert units["output-drive-torque-setpoint"] == "N·m"
            assert units["temperatures-ambient_c"] == "°C"
            assert units["output-steady-frequency_hz"] == "Hz"
            assert units["point-nominal_nm"] == "N·m"
            configuration = await devices.output.transducer.read_configuration()
            assert configuration["output-transducer-serial"]["value"] == "SIM-T2000"
            assert configuration["output-transducer-zero-signal"]["value"] == 60e3

    play(bench, scene)


def test_a_steady_value_states_reading_standard_and_truth_of_one_window(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            steady = devices.output.steady
            await steady.prepare(SteadySettings(settle_s=0.4, window_s=0.4, reference=True))
            expected = set(await steady.describe())
            await devices.output.drive.torque.set(400.0)
            before = bench.clock.now()
            await steady.trigger()
            reading = await steady.read()
            assert set(reading) == expected
            value = {key.removeprefix("output-steady-"): r["value"] for key, r in reading.items()}
            assert value["reading_nm"] == pytest.approx(400.0, abs=0.02 * 2000)
            assert value["standard_nm"] == pytest.approx(value["true_torque_nm"], abs=5.0)
            assert value["commanded_nm"] == 400.0
            assert 0.0 < value["reading_standard_error_nm"] < 2.0
            assert 20 <= value["samples"] <= 40
            assert value["time_s"] == pytest.approx(before + 0.5, abs=0.06)
            assert isinstance(value["settled"], bool)
            assert bench.clock.now() == pytest.approx(before + 0.7, abs=0.06), (
                "settling is counted from the command, which took 0.1 s itself"
            )

    play(bench, scene)


def test_the_truth_of_a_steady_value_is_that_of_what_was_settled(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            steady = devices.output.steady
            await steady.prepare(SteadySettings(settle_s=0.0, window_s=0.6, reference=True))
            bench.command_torque(800.0, 4000.0)  # takes the first third of the window
            await steady.trigger()
            reading = await steady.read()
            value = {key.removeprefix("output-steady-"): r["value"] for key, r in reading.items()}
            assert value["standard_nm"] == pytest.approx(800.0, abs=5.0)
            assert value["true_torque_nm"] == pytest.approx(value["standard_nm"], abs=3.0)

    play(bench, scene)


def test_a_ramp_has_its_time_although_the_computer_is_behind(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            behind_s, now = 0.2, bench.clock.now
            bench.clock.present = lambda: now() + behind_s
            before_s = now()
            await devices.output.drive.torque.set(400.0)  # takes 0.1 s
            assert now() == pytest.approx(before_s + behind_s + 0.1, abs=0.06)
            to_zero_s = bench.supervisor.unload(("output",))
            assert to_zero_s > behind_s + 0.1

    play(bench, scene)


def test_a_step_of_a_rapid_staircase_lasts_what_its_settings_say(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            await devices.output.steady.prepare(SteadySettings(0.2, 0.3, reference=True))
            started = bench.clock.now()
            for step in range(6):
                await devices.output.drive.torque.set(40.0 * step)
                await devices.output.steady.trigger()
            assert bench.clock.now() == pytest.approx(started + 6 * 0.5)

    play(bench, scene)


def test_waiting_for_a_settled_window_ends_at_the_limit_with_a_mark(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            steady = devices.output.steady
            bench.commands.output.torque_nm = 0.0
            await steady.prepare(SteadySettings(0.0, 0.1, limit_s=0.5))
            slow = asyncio.ensure_future(devices.output.drive.torque.set(2000.0))  # takes 0.5 s
            await asyncio.sleep(0)
            started = bench.clock.now()
            await steady.trigger()
            taken = bench.clock.now() - started
            reading = await steady.read()
            assert reading["output-steady-settled"]["value"] or taken == pytest.approx(
                0.6, abs=0.06
            )
            assert taken > 0.1
            await slow

    play(bench, scene)


def test_a_fault_in_the_window_is_an_error_unless_it_passes_within_the_limit(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            steady = devices.output.steady
            inject = bench.simulated.twin.inject_fault
            await steady.prepare(SteadySettings(0.0, 0.2))
            inject("output_torque", "missing_pulses", duration_s=0.012)
            with pytest.raises(SignalFault, match="output_torque: pulses are missing"):
                await steady.trigger()
            with pytest.raises(SignalFault, match="before it was triggered"):
                await steady.read()
            await steady.prepare(SteadySettings(0.0, 0.2, limit_s=1.0))
            inject("output_torque", "missing_pulses", duration_s=0.012)
            await steady.trigger()
            assert (await steady.read())["output-steady-samples"]["value"] > 0

    play(bench, scene)


def test_a_fault_that_passes_in_the_last_windows_is_waited_for(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            steady = devices.output.steady
            await steady.prepare(SteadySettings(0.0, 0.2, limit_s=0.1))
            begun_s = bench.clock.now()
            value = asyncio.ensure_future(steady.trigger())
            await bench.clock.sleep_until(begun_s + 0.15)  # in the first window and in the last
            bench.simulated.twin.inject_fault("output_torque", "missing_pulses", duration_s=0.012)
            await value
            assert (await steady.read())["output-steady-time_s"]["value"] > begun_s + 0.25

    play(bench, scene)


def test_no_standard_no_standard_torque(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            await devices.output.drive.power.set(False)
            await devices.clamp.set(False)
            await devices.mounting.set("nothing")
            with pytest.raises(SignalFault, match="nothing mounted"):
                await devices.output.steady.prepare(SteadySettings(reference=True))

    play(bench, scene)


def test_an_active_compensation_adds_its_torque_to_a_steady_value(bench: Any) -> None:
    readings = np.linspace(-2000.0, 2000.0, 81)
    model = make_model("polynomial", degree=1, range_nm=2000.0).fit(
        readings[:, None], readings + 7.0
    )

    async def scene() -> None:
        async with ready(bench) as devices:
            bench.acquisition.set_compensation(
                "output", ActiveChain(MeasuringChain(model), "1", "p")
            )
            await devices.output.steady.trigger()
            value = await devices.output.steady.read()
            added = (
                value["output-steady-torque_nm"]["value"]
                - value["output-steady-reading_nm"]["value"]
            )
            assert added == pytest.approx(7.0, abs=1e-6)
            assert value["output-steady-torque_uncertainty_nm"]["value"] >= 0.0

    play(bench, scene)


def test_a_steady_torque_is_the_mean_of_its_windows_torques(bench: Any) -> None:
    readings = np.linspace(-2000.0, 2000.0, 81)
    model = make_model("polynomial", degree=2, range_nm=2000.0).fit(
        readings[:, None], readings + 1e-5 * readings**2
    )

    async def scene() -> None:
        async with ready(bench) as devices:
            active = ActiveChain(MeasuringChain(model, (Counter("counter"),)), "1", "p")
            bench.acquisition.set_compensation("output", active)
            await devices.output.steady.trigger()
            value = await devices.output.steady.read()
            reading, torque, uncertainty, error = (
                value[f"output-steady-{name}"]["value"]
                for name in (
                    "reading_nm",
                    "torque_nm",
                    "torque_uncertainty_nm",
                    "reading_standard_error_nm",
                )
            )
            of_mean = active.chain.torque(Readings(np.array([reading]))).value_nm[0]
            # a square rectifies whatever there is of noise and ripple
            assert torque >= of_mean - 1e-9
            assert torque == pytest.approx(of_mean, abs=0.1)
            stated = devices.output.steady.torque
            assert stated.value_nm[0] == torque
            assert stated.standard_uncertainty_nm[0] == uncertainty
            assert stated.component("noise of the reading")[0] >= error
            scatter = active.chain.torque(Readings(np.array([reading]))).component("scatter")[0]
            assert stated.component("scatter")[0] == pytest.approx(scatter, rel=1e-3)

    play(bench, scene)


def of_gain(gain: float, range_nm: float, *effects: Effect) -> ActiveChain:
    """Return a chain that states the reading times a gain."""
    readings = np.linspace(-range_nm, range_nm, 81)
    model = make_model("polynomial-1", range_nm=range_nm).fit(readings[:, None], gain * readings)
    return ActiveChain(MeasuringChain(model, effects), "1", "p")


def test_a_steady_torque_is_the_steady_value_of_the_torque(bench: Any) -> None:
    """The mean torque was shifted by ripple and drift of the reading, however large its gain."""

    async def scene() -> None:
        async with ready(bench) as devices:
            bench.acquisition.set_compensation("output", of_gain(1.01, 2000.0))
            await devices.output.drive.torque.set(300.0)
            # whole periods are a part of the window, so that mean and steady value differ
            settings = SteadySettings(settle_s=0.0, window_s=0.25, period_s=0.087)
            await devices.output.steady.prepare(settings)
            await devices.output.steady.trigger()
            value = await devices.output.steady.read()
            reading, torque = (
                value[f"output-steady-{name}"]["value"] for name in ("reading_nm", "torque_nm")
            )
            assert torque == pytest.approx(1.01 * reading, rel=1e-7)

    play(bench, scene)


def test_steady_value_recorder_and_a_row_of_a_file_state_the_same_u(bench: Any) -> None:
    effects = chain_effects(bench.description, "output", 23.0)

    async def scene() -> None:
        async with ready(bench) as devices:
            active = of_gain(1.0, 2000.0, *effects)
            bench.acquisition.set_compensation("output", active)
            await devices.output.drive.torque.set(800.0)
            await devices.recorder.set("mark")
            await devices.output.steady.trigger()
            await devices.recorder.trigger()
            read = await devices.output.steady.read()
            steady = {name.removeprefix("output-steady-"): read[name]["value"] for name in read}
            row = active.chain.torque(
                Readings(
                    np.array([steady["reading_nm"]]),
                    counter_nm=steady["reading_standard_error_nm"],
                    speed_rpm=steady["speed_rpm"],
                    acceleration_rad_s2=0.0,
                    temperature_c=steady["temperature_c"],
                )
            )
            u = row.standard_uncertainty_nm[0]
            # live, the inertia is corrected by an acceleration that isn't quite 0
            assert steady["torque_nm"] == pytest.approx(row.value_nm[0], abs=0.01 * u)
            assert steady["torque_uncertainty_nm"] == pytest.approx(u, rel=1e-3)
            taken = devices.recorder.taken
            shown_s = taken.time_s + bench.description.output.transducer.group_delay_s
            window = active.window(float(shown_s[0]) - 1e-6, float(shown_s[-1]) + 1e-6)
            assert window is not None
            assert taken.output_torque_nm.tolist() == window[1].value_nm.tolist()
            assert taken.output_parts.standard_uncertainty_nm == pytest.approx(
                window[1].standard_uncertainty_nm, rel=1e-12
            )

    play(bench, scene)


def test_a_compensation_does_not_change_what_is_recorded_as_the_reading(
    open_bench: OpenBench,
) -> None:
    """A calibration takes readings: an active model has no part in them."""

    def taken(active: ActiveChain | None) -> dict[str, Any]:
        found: dict[str, Any] = {}

        async def scene() -> None:
            async with ready(bench) as devices:
                bench.acquisition.set_compensation("output", active)
                await devices.output.drive.torque.set(300.0)
                settings = SteadySettings(settle_s=0.0, limit_s=0.5, reference=True)
                await devices.output.steady.prepare(settings)
                await devices.output.steady.trigger()
                values = await devices.output.steady.read()
                found.update({name: each["value"] for name, each in values.items()})

        with open_bench() as bench:
            play(bench, scene)
        return found

    raw, compensated = taken(None), taken(of_gain(1.01, 2000.0))
    added = {"output-steady-torque_nm", "output-steady-torque_uncertainty_nm"}
    assert set(compensated) - set(raw) == added
    assert {name: compensated[name] for name in raw} == raw


WARM_ONLY = MeasuredTemperature(
    "empty runs", 45.0, 40.0, 50.0, (40.0, 50.0), (0.0, 0.0), (0.1, 0.1)
)


@pytest.mark.parametrize(
    ("range_nm", "effects", "title", "allowed"),
    [
        (2000.0, [WARM_ONLY], "temperature of zero and span, measured", "40 to 50 °C"),
        (1e-4, [], "static curve with hysteresis", "margin included"),
    ],
)
def test_recordings_and_steady_values_name_the_effect_that_refuses(
    bench: Any, range_nm: float, effects: list[Effect], title: str, allowed: str
) -> None:
    """NaN went into a recording without an error, and a steady value blamed the static curve."""

    async def scene() -> None:
        async with ready(bench) as devices:
            await devices.output.drive.torque.set(100.0)
            await bench.clock.sleep(0.3)
            active = of_gain(1.0, range_nm, *effects)
            bench.acquisition.set_compensation("output", active)
            await devices.recorder.set("mark")
            await bench.clock.sleep(0.3)
            for trigger in (devices.recorder.trigger, devices.output.steady.trigger):
                with pytest.raises(InputError) as refused:
                    await trigger()
                assert str(refused.value.found).startswith(f"output module: {title}: ")
                assert allowed in str(refused.value.allowed)
            assert active.refusal("output", 0.0, 0.1) is None

    play(bench, scene)


@pytest.mark.parametrize(
    "settings",
    [{"window_s": 0.0}, {"settle_s": -1.0}, {"limit_s": -1.0}, {"window_s": float("nan")}],
)
def test_impossible_settings_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InputError):
        SteadySettings(**settings)


def test_a_command_is_refused_where_interlocks_refuse(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            torque = devices.output.drive.torque
            with pytest.raises(LimitError, match="2400"):
                await torque.set(2500.0)
            with pytest.raises(InterlockError, match="mode 'locked'"):
                await devices.input.drive.torque.set(1.0)
            await torque.set(300.0)
            with pytest.raises(InterlockError, match="300 N·m"):
                await devices.output.mode.set("free")
            with pytest.raises(InterlockError, match="300 N·m"):
                await devices.clamp.set(False)
            with pytest.raises(InterlockError, match="clamp closed"):
                await devices.mounting.set("reducer")
            assert bench.drivers.drives["output"].state().torque_nm == 300.0

    play(bench, scene)


def test_stopping_an_axis_takes_torque_and_speed_off(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            torque = devices.output.drive.torque
            await torque.set(500.0)
            assert (await torque.locate())["setpoint"] == 500.0
            await torque.stop()
            assert (await torque.locate())["setpoint"] == 0.0
            await bench.clock.sleep(0.3)
            assert bench.drivers.drives["output"].state().torque_nm == 0.0

    play(bench, scene)


def test_taking_the_power_off_a_loaded_drive_ramps_first(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            await devices.output.drive.torque.set(500.0)
            await devices.output.drive.power.set(False)
            assert not bench.drivers.drives["output"].state().enabled
            assert not (await devices.output.drive.power.enabled.get_value())
            assert (await devices.output.drive.torque.setpoint.get_value()) == 0.0

    play(bench, scene)


def test_an_alarm_ends_whatever_a_device_is_waiting_for(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            await devices.output.drive.torque.set(500.0)
            await devices.output.steady.prepare(SteadySettings(0.0, 100.0))
            waiting = devices.output.steady.trigger()
            await asyncio.sleep(0.05)
            bench.supervisor.trip(AlarmKind.STOP, "test", "stop", "", "go on")
            with pytest.raises(BenchError, match="stop requested"):
                await waiting
            with pytest.raises(BenchError, match="stop requested"):
                await devices.output.steady.trigger()
            with pytest.raises(InterlockError, match="alarm is latched"):
                await devices.output.drive.torque.set(1.0)
            assert not (await devices.output.drive.power.enabled.get_value()) or not (
                bench.supervisor.wait_safe(0.0)
            )

    play(bench, scene)


def test_a_zero_is_set_on_module_and_standard(bench: Any) -> None:
    async def scene() -> None:
        async with ready(bench) as devices:
            await devices.output.transducer.zero.set(MeasuredZero(60_012.5, 0.01))
            assert bench.acquisition.zero("output_torque") == 60_012.5
            await devices.reference.output_zero.set(MeasuredZero(60_001.0, 0.01))
            assert bench.acquisition.zero("output_reference") == 60_001.0
            reading = await devices.reference.read()
            assert reading["reference-serial"]["value"] == "SIM-CAL-1"

    play(bench, scene)


def test_a_label_stamps_its_point() -> None:
    async def scene() -> None:
        label = PointLabel()
        await label.set(Point(series=2, step=7, branch=-1, nominal_nm=-40.0, position_deg=90.0))
        reading = await label.read()
        assert reading[label.key("branch")]["value"] == -1
        assert reading[label.key("position_deg")]["value"] == 90.0
        assert set(await label.describe()) == set(reading)

    asyncio.run(scene())
