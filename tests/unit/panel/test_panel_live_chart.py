"""Layouts, markers, spectra and the rows behind the live chart."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from torquebench.columns import Column
from torquebench.errors import InputError
from torquebench.panel.pages.live.chart import FLOORS
from torquebench.panel.pages.records.column_titles import column_title
from torquebench.panel.service import (
    SIGNALS,
    BandLayout,
    ComputedChannel,
    LiveLayout,
    LoopLayout,
    Scale,
    computed,
    histogram,
    spectrum,
)
from torquebench.panel.service.live.markers import Markers
from torquebench.panel.service.live.rings import TrendMemory
from torquebench.panel.service.store import PanelStore
from torquebench.panel.text import LANGUAGES, Text

THREE_UNITS = ("output_torque_nm", "input_speed_rpm", "efficiency_percent")
NOW = datetime(2026, 11, 22, tzinfo=UTC)


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda signal: signal.name)
def test_every_signal_can_be_chosen(signal: Column) -> None:
    for language in LANGUAGES:
        assert column_title(Text(language), signal.name) != signal.name
    assert signal.unit == "N·m" or signal.unit in FLOORS
    assert LiveLayout().axes([signal.name])[0][0] == signal.unit


def test_each_side_has_its_own_scale_where_values_differ_by_the_ratio() -> None:
    layout, speeds = LiveLayout(), ("input_speed_rpm", "output_speed_rpm")
    assert layout.axes(speeds) == (("rpm", "input"), ("rpm", "output"))
    assert [layout.axis(speeds, name) for name in speeds] == [0, 1]
    assert layout.axes(("input_temperature_c", "output_temperature_c")) == (("°C", ""),)
    assert layout.axes(("output_torque_nm", *speeds)) == (("N·m", ""), ("rpm", ""))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: LiveLayout(digits=("torque",)), "no signal"),
        (lambda: LiveLayout(xy=LoopLayout(signals=())), "choose one"),
        (lambda: LiveLayout(bands=(BandLayout(signals=THREE_UNITS),)), "N·m, rpm, %"),
        (lambda: LiveLayout(bands=(BandLayout(),)), "choose one"),
        (lambda: Scale(kind="fixed", low=3.0, high=3.0), "not below"),
        (lambda: Scale(kind="fixed", low=float("nan"), high=3.0), "finite"),
    ],
)
def test_a_layout_that_cannot_be_drawn_is_refused(make: object, said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        make()  # type: ignore[operator]


def test_a_layout_is_kept_for_each_person(tmp_path: Path) -> None:
    store = PanelStore(tmp_path)
    assert store.preference("Ana", "live") is None
    wanted = LiveLayout().model_copy(update={"span": "hour_1"})
    store.keep_preference("Ana", "live", LiveLayout().model_dump(mode="json"))
    store.keep_preference("Ana", "live", wanted.model_dump(mode="json"))
    store.keep_preference("Ben", "live", LiveLayout().model_dump(mode="json"))
    store.close()
    again = PanelStore(tmp_path)
    assert LiveLayout.model_validate(again.preference("Ana", "live")) == wanted
    assert LiveLayout.model_validate(again.preference("Ben", "live")) == LiveLayout()
    again.close()


POWER = ComputedChannel(title="Power", formula="output_torque * output_speed", unit="kW")


@given(torque=st.floats(-2e3, 2e3), speed=st.floats(-50.0, 50.0), ratio=st.floats(1.0, 200.0))
def test_formulas_compute_in_their_unit(torque: float, speed: float, ratio: float) -> None:
    signals = {
        "output_torque_nm": np.array([torque, np.nan]),
        "output_speed_rpm": np.array([speed, speed]),
        "input_speed_rpm": np.array([speed * ratio, 0.0]),
    }
    power = computed(POWER.formula, POWER.unit, signals, ratio)
    assert power[0] == pytest.approx(torque * speed * np.pi / 30e3)
    assert np.isnan(power[1])
    slip = computed("input_speed / ratio - output_speed", "rpm", signals, ratio)
    assert slip[0] == pytest.approx(0.0, abs=1e-9)
    assert slip[1] == pytest.approx(-speed)
    root = computed("sqrt(output_torque ** 2) + max(1*Nm, 2*Nm)", "N·m", signals, ratio)
    assert root[0] == pytest.approx(abs(torque) + 2.0)
    assert np.isnan(computed("1 / (output_speed - output_speed)", "s", signals, ratio)).all()


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("output_torque + input_speed", "same unit"),
        ("output_torque + 1", "same unit"),
        ("output_torque / input_torque", "is in 1"),
        ("output_torque * nothing", "no signal"),
        ("output_torque ** input_torque", "exponent"),
        ("Nm ** output_angle", "exponent"),
        ("9 ** 9 ** 9", "exponent"),
        ("output_torque; 1", "is not a formula"),
        ("-" * 199 + "1", "is in 1|has more than"),
        ("(" * 200, "is not a formula"),
        ("output_torque if 1 else 2", "has more than"),
        ("[output_torque for x in (1,)]", "has more than"),
        ("output_torque.value.tofile('x')", "has more than"),
        ("__import__('os')", "has more than"),
        ("sqrt.__globals__", "has more than"),
        ("abs(output_torque, 1)", "has more than"),
        ("abs(*(output_torque,))", "has more than"),
        ("'N·m' * 3", "has more than"),
        ("(lambda: 1)()", "has more than"),
        ("abs", "no signal"),
    ],
)
def test_a_formula_of_another_unit_or_beyond_arithmetic_is_refused(formula: str, said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        ComputedChannel(title="Torque", formula=formula, unit="N·m")


def test_a_computed_channel_is_a_signal_of_its_layout() -> None:
    layout = LiveLayout().including(POWER)
    assert layout.bands[2].signals[-1] == "=Power"
    assert layout.axes(layout.bands[2].signals) == (("rpm", ""), ("kW", ""))
    assert {"output_torque_nm", "output_speed_rpm"} <= set(layout.sources)
    assert "=Power" not in layout.sources
    large = LiveLayout(view="digits", computed=(POWER,), digits=("=Power",))
    assert set(large.sources) == {"output_torque_nm", "output_speed_rpm"}
    assert LiveLayout.model_validate_json(large.model_dump_json(exclude_defaults=True)) == large
    assert large.without(POWER).digits == LiveLayout().digits
    loop = LiveLayout(computed=(POWER,), xy=LoopLayout(x="=Power")).without(POWER)
    assert (loop.computed, loop.xy) == ((), LoopLayout())
    with pytest.raises(ValidationError, match="same name"):
        layout.including(POWER)


def test_markers_are_counted_and_empty_notes_refused() -> None:
    markers = Markers()
    assert markers.add(1.0, NOW, "  clamp\t tightened ", "Ana").note == "clamp tightened"
    assert markers.add(2.0, NOW, "again", "Ana").number == 2
    for note in ("", "   ", "x" * 201, "bell\a"):
        with pytest.raises(InputError, match="characters"):
            markers.add(3.0, NOW, note, "Ana")
    assert [marker.number for marker in markers.all()] == [1, 2]


@given(
    frequency=st.floats(2.0, 40.0),
    amplitude=st.floats(1e-3, 1e3),
    mean=st.floats(-2e3, 2e3),
)
def test_a_sine_is_found_at_its_frequency(frequency: float, amplitude: float, mean: float) -> None:
    time = np.arange(1000) * 0.01
    found = spectrum(time, mean + amplitude * np.sin(2.0 * np.pi * frequency * time))
    peak = int(found.amplitude_nm.argmax())
    assert abs(found.frequency_hz[peak] - frequency) <= 0.051
    # between two lines a Hann window loses 15 % of a sine's height
    assert 0.84 * amplitude - 1e-9 <= found.amplitude_nm[peak] <= 1.02 * amplitude


def test_a_gap_is_not_bridged() -> None:
    time = np.concatenate([np.arange(200), 1000.0 + np.arange(100)]) * 0.01
    value = np.where(time < 5.0, np.sin(2.0 * np.pi * 10.0 * time), 50.0)
    found = spectrum(time, value)
    assert found.frequency_hz[int(found.amplitude_nm.argmax())] == pytest.approx(10.0, abs=0.3)
    assert found.amplitude_nm.max() < 1.1
    value[::2] = np.nan
    with pytest.raises(InputError, match="readings"):
        spectrum(time[:20], value[:20])
    with pytest.raises(InputError, match="readings"):
        histogram(value[:20])


def test_a_span_comes_as_finely_as_it_is_kept() -> None:
    memory = TrendMemory(1, 100, (10,))
    for number in range(500):
        value = np.array([float(number)])
        memory.append(0.1 * number, value, value, value)
    newest = memory.between(45.0, 46.0)
    assert newest.mean[0].tolist() == [float(n) for n in range(450, 461)]
    older = memory.between(20.0, 30.0)
    assert older.time_s.size == 10
    assert (older.low[0, 0], older.high[0, 0]) == (200.0, 209.0)
    assert memory.between(60.0, 70.0).time_s.size == 0
