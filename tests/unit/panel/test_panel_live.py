import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import periodogram

from torquebench.bench.blocks import CONDITIONS, Block, Viewer
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import default_bench
from torquebench.chain import Component, Shared, Torque
from torquebench.errors import InputError
from torquebench.panel.service import SIGNALS, spectrum
from torquebench.panel.service.live.hub import LiveHub
from torquebench.signals import Record, SignalFaultKind

OWN = Component("own", Shared.CALIBRATION, np.full(3, 0.01))


def block(
    index: int,
    *,
    torque_nm: float = 10.0,
    output_nm: float = 640.0,
    speed_rad_s: float = 10.0,
    fault: int = 0,
    models: tuple[str, ...] = ("input",),
) -> Block:
    start = 0.03 * index
    time_s = start + np.array([0.005, 0.015, 0.025])

    def record(value: float, code: int) -> Record:
        values = np.full(3, np.nan if code else value) + np.array([-0.5, 0.0, 0.5])
        fault = np.full(3, code, np.uint8)
        return Record({"time_s": time_s, "reading_nm": values, "fault": fault})

    conditions = {
        "time_s": start + 0.03,
        "input_speed_rad_s": speed_rad_s,
        "output_speed_rad_s": speed_rad_s / 80.0,
        "input_transducer_c": 23.0,
    }
    return Block(
        start,
        start + 0.03,
        records={
            "input_torque": record(torque_nm, 0),
            "output_torque": record(output_nm, fault),
            CONDITIONS: Record({name: np.array([value]) for name, value in conditions.items()}),
        },
        torques={
            side: Torque(np.full(3, value), (OWN,))
            for side, value in (("input", torque_nm), ("output", output_nm))
            if side in models
        },
    )


@pytest.fixture
def hub() -> LiveHub:
    return LiveHub(default_bench(), BenchClock(fast=True), Viewer(10))


def test_it_is_waited_for_a_row_beyond_a_time(hub: LiveHub) -> None:
    hub.take(block(0))
    assert hub.wait_beyond(0.02)
    assert not hub.wait_beyond(0.05, timeout_s=0.01)
    later = threading.Timer(0.05, lambda: hub.take(block(1)))
    later.start()
    assert hub.wait_beyond(0.05, timeout_s=60.0)
    later.join()


def test_increments_hold_every_row_once(hub: LiveHub) -> None:
    sequence, times = 0, []
    for number in range(20):
        hub.take(block(number))
        if number % 3 == 0:
            found = hub.since(sequence)
            sequence = found.sequence
            times += found.time_s.tolist()
    times += hub.since(sequence).time_s.tolist()
    assert np.allclose(times, 0.03 * np.arange(1, 21))
    assert hub.since(hub.sequence).time_s.size == 0
    assert hub.since(10**9).sequence == 20  # a watcher of the server before this one


def test_a_slow_watcher_is_told_what_it_missed(hub: LiveHub) -> None:
    for number in range(5000):
        hub.take(block(number))
    found = hub.since(0)
    assert found.missed + found.time_s.size == 5000
    assert found.time_s[-1] == pytest.approx(150.0)


def test_rows_keep_extremes_raw_and_compensated(hub: LiveHub) -> None:
    hub.take(block(0))
    found = hub.since(0)
    assert (found.low["input_raw_nm"][0], found.high["input_raw_nm"][0]) == (9.5, 10.5)
    assert found.values["input_torque_nm"][0] == 10.0
    assert found.values["input_expanded_uncertainty_nm"][0] == pytest.approx(0.02)
    assert np.isnan(found.values["output_torque_nm"][0])


def test_a_fault_is_no_number_and_goes_stale(hub: LiveHub, monkeypatch: pytest.MonkeyPatch) -> None:
    hub.take(block(0))
    now = time.monotonic() + 1.5
    monkeypatch.setattr(time, "monotonic", lambda: now)
    hub.take(block(1, fault=int(max(SignalFaultKind))))
    latest = hub.latest()
    assert latest["output_raw_nm"].stale
    assert latest["output_raw_nm"].fault
    assert latest["output_raw_nm"].value == 640.0
    assert not latest["input_raw_nm"].stale
    assert np.isnan(hub.since(1).values["output_raw_nm"][0])
    assert latest["output_reference_nm"].value is None
    assert latest["output_reference_nm"].stale


@pytest.mark.parametrize(
    ("change", "percent"),
    [({}, 80.0), ({"output_nm": 900.0}, 100 * 80 / 90), ({"speed_rad_s": 0.0}, None)],
)
def test_efficiency_is_stated_where_it_means_something(
    hub: LiveHub, change: dict[str, float], percent: float | None
) -> None:
    # 10 N·m at the input's speed, 640 N·m at an eightieth of it
    hub.take(block(0, models=("input", "output"), **change))
    found = hub.latest()["efficiency_percent"].value
    assert found is None if percent is None else found == pytest.approx(percent)


def test_without_a_reducer_there_is_no_efficiency() -> None:
    hub = LiveHub(default_bench(), BenchClock(fast=True), Viewer(10), lambda: "calibrator")
    hub.take(block(0, models=("input", "output")))
    assert hub.latest()["efficiency_percent"].value is None


@pytest.mark.parametrize("models", [(), ("input",), ("output",)])
def test_readings_without_a_model_give_no_efficiency(hub: LiveHub, models: tuple[str, ...]) -> None:
    """The raw reading took the place of a torque, and nothing said so."""
    hub.take(block(0, models=models))
    assert hub.latest()["efficiency_percent"].value is None


def test_memory_stays_as_it_is_over_an_hour(hub: LiveHub) -> None:
    levels = hub._memory.levels
    before = [level._values.nbytes for level in levels]
    for number in range(0, 4000):
        hub.take(block(number))
    assert [level._values.nbytes for level in levels] == before
    assert sum(before) < 8e6
    shown = hub.trend(3600.0, ["input_raw_nm"], points=100)
    assert shown.time_s.size <= 100
    assert shown.sequence == hub.sequence


def test_unknown_signals_are_refused(hub: LiveHub) -> None:
    with pytest.raises(InputError, match="one of"):
        hub.since(0, ["torque"])


def test_many_watchers_read_while_rows_come(hub: LiveHub) -> None:
    ended = threading.Event()
    problems: list[BaseException] = []

    def guarded(read: Callable[[], object]) -> Callable[[], None]:
        def work() -> None:
            try:
                while not ended.is_set():
                    read()
            except BaseException as error:
                problems.append(error)

        return work

    reads = (lambda: hub.since(0), lambda: hub.trend(60.0), hub.latest)
    threads = [threading.Thread(target=guarded(read)) for read in reads]
    for thread in threads:
        thread.start()
    for number in range(300):
        hub.take(block(number))
    ended.set()
    for thread in threads:
        thread.join()
    assert problems == []
    assert {len(SIGNALS)} == {len(hub.since(0).values)}


def test_single_windows_are_kept_for_spectra(hub: LiveHub) -> None:
    for number in range(10):
        hub.take(block(number))
    found = hub.windows("output_raw_nm", 0.06, 0.12)
    np.testing.assert_allclose(found.time_s, [0.065, 0.075, 0.085, 0.095, 0.105, 0.115])
    np.testing.assert_allclose(found.value_nm, [639.5, 640.0, 640.5] * 2)
    assert hub.windows("input_torque_nm", 0.0, 1.0).value_nm.tolist() == [10.0] * 30
    assert hub.windows("output_torque_nm", 0.0, 1.0).time_s.size == 0
    for number in range(10, 4100):  # a little more than two minutes
        hub.take(block(number))
    assert hub.windows("output_raw_nm", 0.0, 1e9).time_s[0] == pytest.approx(3.005, abs=0.1)
    with pytest.raises(InputError, match="input_speed_rpm"):
        hub.windows("input_speed_rpm", 0.0, 1.0)


@given(count=st.integers(16, 400), seed=st.integers(0, 2**16))
def test_the_spectrum_is_that_of_scipy(count: int, seed: int) -> None:
    value_nm = np.random.default_rng(seed).normal(40.0, 1.0, count)
    found = spectrum(np.arange(count) * 0.01, value_nm)
    frequency_hz, power = periodogram(
        value_nm, 100.0, window="hann", detrend="constant", scaling="spectrum"
    )
    np.testing.assert_allclose(found.frequency_hz, frequency_hz, rtol=1e-9)
    whole = slice(1, -1)  # neither the mean nor the highest frequency is a sine's amplitude
    expected = np.sqrt(2.0 * power)[whole]
    np.testing.assert_allclose(found.amplitude_nm[whole], expected, rtol=1e-9, atol=1e-12)
