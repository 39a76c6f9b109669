"""Real recordings of logic analysers and a scope give their known frequencies."""

import configparser
import io
import re
import zipfile

import numpy as np
import pytest
from tests.counting import counted

from torquebench.signals import EdgeBlock


def rising_edges(content: bytes, channel: int | str) -> EdgeBlock:
    """Return the rising edges of one channel of a sigrok session (.sr), one byte a sample."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        parser = configparser.ConfigParser(interpolation=None)
        parser.read_string(archive.read("metadata").decode())
        device = dict(parser["device 1"])
        capture = re.compile(re.escape(device["capturefile"]) + r"(?:-(\d+))?")
        parts = sorted(
            (int(match[1] or 0), name)
            for name in archive.namelist()
            if (match := capture.fullmatch(name))
        )
        raw = b"".join(archive.read(name) for _, name in parts)
    if isinstance(channel, str):
        probes = {value: int(key[5:]) - 1 for key, value in device.items() if key[:5] == "probe"}
        channel = probes[channel]
    number, unit = device["samplerate"].split()
    rate_hz = float(number) * {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6}[unit]
    level = np.frombuffer(raw, dtype=np.uint8) >> channel & 1
    ticks = np.flatnonzero(np.diff(level.astype(np.int8), prepend=level[:1]) == 1)
    return EdgeBlock(ticks, 0, level.size, rate_hz)


@pytest.fixture(scope="module")
def recording(reference_data):
    def read(name, channel):
        content = reference_data(f"sigrok-pulse-trains/{name}").read_bytes()
        return rising_edges(content, channel)

    return read


def test_the_function_generator_on_the_analysers_clock(recording):
    block = recording("fgen_1mhz_12MSps_1s.sr", 0)
    assert block.timebase_hz == 12e6
    assert len(block) == 999_846
    intervals = np.diff(block.ticks)
    assert (intervals.min(), intervals.max()) == (11, 13)
    # Twelve ticks in a period: an interval of 11 or 13 is no irregular pulse.
    first, stop = int(block.ticks[0]), int(block.ticks[-1]) + 1
    window = stop - first
    whole = EdgeBlock(block.ticks - first, 0, window, block.timebase_hz)
    for method, expected in (("reciprocal", 999_846.08), ("regression", 999_846.10)):
        samples = counted(whole, window / block.timebase_hz, method)
        assert samples["frequency_hz"][0] == pytest.approx(expected, abs=0.006)
        assert not samples["fault"].any()


def test_its_frequency_is_steady_over_windows(recording):
    block = recording("fgen_1mhz_12MSps_1s.sr", 0)
    samples = counted(block, 10e-3).raise_on_fault("function generator")
    assert len(samples) == 100
    assert samples["frequency_hz"].mean() == pytest.approx(999_846.1, abs=0.3)
    assert np.ptp(samples["frequency_hz"]) < 5.0


@pytest.mark.parametrize(
    ("name", "edges", "shortest"), [("grbl_cnc_1.sr", 10_508, 492), ("grbl_cnc_3.sr", 56_903, 295)]
)
def test_step_pulses_with_ramps_and_pauses(recording, name, edges, shortest):
    block = recording(name, "STEP (Y axis)")
    assert len(block) == edges
    assert np.diff(block.ticks).min() == shortest
    samples = counted(block, 50e-3, check_train=False)
    # Where the axis moves there is a frequency, where it stands a fault and never 0 Hz.
    assert 0 < samples.valid.sum() < len(samples)
    assert np.nanmax(samples["frequency_hz"]) <= 2e6 / shortest
    assert np.nanmin(samples["frequency_hz"]) > 0


def test_pwm_and_its_crosstalk_have_one_frequency(recording):
    frequencies = []
    for channel in (4, 5):
        block = recording("pwmtest_snippet.sr", channel)
        samples = counted(block, 20e-3).raise_on_fault("pwm")
        frequencies.append(samples["frequency_hz"].mean())
    # 384 samples per period at 24 MHz is 62 500 Hz; the recording is 0.011 % slower.
    assert frequencies == pytest.approx([62_493.0] * 2, abs=1.0)
