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
    DEFAULT_LAYOUT,
    SIGNALS,
    BandLayout,
    LiveLayout,
    Scale,
    histogram,
    spectrum,
)
from torquebench.panel.service.live.markers import Markers
from torquebench.panel.service.live.rings import TrendMemory
from torquebench.panel.service.store import PanelStore
from torquebench.panel.text import LANGUAGES, Text

NOW = datetime(2026, 11, 22, tzinfo=UTC)


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda signal: signal.name)
def test_every_signal_can_be_chosen(signal: Column) -> None:
    for language in LANGUAGES:
        assert column_title(Text(language), signal.name) != signal.name
    band = BandLayout(signals=(signal.name,))
    assert signal.unit == "N·m" or signal.unit in FLOORS
    assert band.axes[0][0] == signal.unit


def test_each_side_has_its_own_scale_where_values_differ_by_the_ratio() -> None:
    speeds = BandLayout(signals=("input_speed_rpm", "output_speed_rpm"))
    assert speeds.axes == (("rpm", "input"), ("rpm", "output"))
    assert (speeds.axis("input_speed_rpm"), speeds.axis("output_speed_rpm")) == (0, 1)
    warm = BandLayout(signals=("input_temperature_c", "output_temperature_c"))
    assert warm.axes == (("°C", ""),)
    mixed = BandLayout(signals=("output_torque_nm", "input_speed_rpm", "output_speed_rpm"))
    assert mixed.axes == (("N·m", ""), ("rpm", ""))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: BandLayout(signals=("torque",)), "no signal"),
        (
            lambda: BandLayout(
                signals=("output_torque_nm", "input_speed_rpm", "efficiency_percent")
            ),
            "N·m, rpm, %",
        ),
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
    wanted = DEFAULT_LAYOUT.model_copy(update={"span": "hour_1"})
    store.keep_preference("Ana", "live", DEFAULT_LAYOUT.model_dump(mode="json"))
    store.keep_preference("Ana", "live", wanted.model_dump(mode="json"))
    store.keep_preference("Ben", "live", DEFAULT_LAYOUT.model_dump(mode="json"))
    store.close()
    again = PanelStore(tmp_path)
    assert LiveLayout.model_validate(again.preference("Ana", "live")) == wanted
    assert LiveLayout.model_validate(again.preference("Ben", "live")) == DEFAULT_LAYOUT
    again.close()


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
