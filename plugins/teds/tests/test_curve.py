"""A compensation as calibration curve: the stated residual is that of the curve in the memory."""

import numpy as np
import pytest

from torquebench.compensation import CompensationTable, compile_table, features, make_model
from torquebench.errors import InputError
from torquebench_teds import Section, Sheet, decode, encode, fit_curve
from torquebench_teds.curve import curve_bits, torque_span

RANGE_NM = 1000.0
BASIC = {"manufacturer": 31, "model": 1, "version_letter": "A", "version": 2, "serial": 3}
DATED = {"calibration_date": None, "calibration_initials": "", "calibration_period_days": 365}


@pytest.fixture(scope="module")
def table() -> CompensationTable:
    reading = np.linspace(-RANGE_NM, RANGE_NM, 41)
    torque = 1.002 * reading + 3e-7 * reading**2 - 4e-9 * reading**3
    model = make_model("polynomial").fit(features(reading), torque)
    return compile_table(model, uncertainty=False)


def bridge(low: float = -RANGE_NM, high: float = RANGE_NM, unit: str = "N·m") -> Section:
    return Section(
        33,
        {
            "measurand": unit,
            "min_physical": low,
            "max_physical": high,
            "electrical_precision": 2,
            "min_electrical": -0.002,
            "max_electrical": 0.002,
            "bridge": "full",
            "impedance_ohm": 350.0,
            "response_time_s": None,
            "excitation_v": 5.0,
            "min_excitation_v": 1.0,
            "max_excitation_v": 10.0,
            "location": 0,
            **DATED,
        },
    )


def amplifier(sheet: Sheet, share: float) -> float:
    """Return the torque that a sheet gives at a share of the electrical span."""
    curve = sheet.section(41)
    assert curve is not None
    pieces = [each for each in curve.values["segments"] if each["start_percent"] <= 100.0 * share]
    percent = sum(term["coefficient"] * share ** term["power"] for term in pieces[-1]["terms"])
    return RANGE_NM * (percent / 50.0 - 1.0)


@pytest.mark.parametrize("segments", [1, 4])
def test_the_stated_residual_is_that_of_the_memory(table: CompensationTable, segments: int) -> None:
    fit = fit_curve(table, (-RANGE_NM, RANGE_NM), segments=segments)
    sheet = decode(encode(Sheet(BASIC, (bridge(), Section(41, {**fit.values, **DATED})))))
    reading = np.linspace(-RANGE_NM, RANGE_NM, 777)
    found = np.array([amplifier(sheet, each) for each in 0.5 + 0.5 * reading / RANGE_NM])
    worst = np.max(np.abs(found - table.torque(reading)))
    assert worst <= 1.001 * fit.residual_nm + 1e-9
    assert fit.residual_percent_fs < 2e-4  # coefficients of 32 bits
    assert len(fit.values["segments"]) == segments


@pytest.fixture(scope="module")
def bent() -> CompensationTable:
    """A chain whose error has different slopes in the two directions."""
    reading = np.linspace(-RANGE_NM, RANGE_NM, 81)
    torque = reading + np.abs(reading) ** 1.5 / 5e3
    model = make_model("bayesian-network").fit(features(reading), torque)
    return compile_table(model, uncertainty=False)


def test_the_room_of_a_memory_is_used_where_it_brings_something(bent: CompensationTable) -> None:
    """Version 0.2.0 always used one segment."""
    span = (-RANGE_NM, RANGE_NM)
    one = fit_curve(bent, span, segments=1)
    for most in (1000, 2000, 4000):
        fit = fit_curve(bent, span, most_bits=most)
        assert fit.segments > 1
        assert curve_bits(fit.segments, fit.power) <= most
        assert fit.residual_nm < 0.5 * one.residual_nm
        values = {"domain": "electrical", "segments": []}
        empty = len(encode(Sheet(BASIC, (bridge(), Section(41, {**values, **DATED})))))
        full = len(encode(Sheet(BASIC, (bridge(), Section(41, {**fit.values, **DATED})))))
        assert abs(8 * (full - empty) - (curve_bits(fit.segments, fit.power) - 8)) <= 8


def test_a_curve_is_no_larger_than_it_has_to_be(table: CompensationTable) -> None:
    """A cubic needs one segment, however large the memory is."""
    assert fit_curve(table, (-RANGE_NM, RANGE_NM), most_bits=20_000).segments == 1
    smallest = fit_curve(table, (-RANGE_NM, RANGE_NM), most_bits=10)
    assert (smallest.segments, smallest.power) == (1, 1)


def test_too_few_powers_are_stated_as_residual(table: CompensationTable) -> None:
    straight = fit_curve(table, (-RANGE_NM, RANGE_NM), segments=1, power=1)
    assert straight.residual_nm > 100 * fit_curve(table, (-RANGE_NM, RANGE_NM)).residual_nm
    reading = np.linspace(-RANGE_NM, RANGE_NM, 501)
    line = np.polynomial.Polynomial.fit(reading, table.torque(reading), 1)
    least = np.max(np.abs(line(reading) - table.torque(reading)))
    assert straight.residual_nm == pytest.approx(least, rel=0.3)


@pytest.mark.nightly
def test_a_hysteresis_is_stated_on_its_branches() -> None:
    rising = np.linspace(0.0, RANGE_NM, 21)
    reading = np.concatenate([rising, rising[::-1]])
    branch = np.repeat([1.0, -1.0], 21)
    torque = reading - branch * np.sin(np.pi * reading / RANGE_NM)
    model = make_model("hybrid").fit(features(reading, branch=branch), torque)
    fit = fit_curve(compile_table(model, uncertainty=False), (0.0, RANGE_NM))
    assert fit.branch_residual_nm == pytest.approx(1.0, abs=0.3)
    assert fit.residual_nm < 0.2 * fit.branch_residual_nm


def test_a_span_beyond_the_calibrated_range_is_refused(table: CompensationTable) -> None:
    with pytest.raises(InputError, match=r"span -2000 to 2000 N·m"):
        fit_curve(table, (-2000.0, 2000.0))


@pytest.mark.parametrize(
    ("section", "said"),
    [
        (bridge(unit="N"), "a bridge sensor in N"),
        (bridge(5.0, 5.0), "span 5.0 to 5.0"),
        (Section(33, {**bridge().values, "max_electrical": -0.002}), "electrical values"),
    ],
)
def test_a_bridge_without_spans_of_torque_is_refused(section: Section, said: str) -> None:
    with pytest.raises(InputError, match=said):
        torque_span(section)
