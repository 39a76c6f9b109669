"""Two calibrations of one transducer: changes count where they exceed what is known of both."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import nightly

from torquebench.calibration import CalibrationData
from torquebench.campaign.calibration_comparison import compare_calibrations
from torquebench.campaign.fitting import store_model
from torquebench.chain import Effect, Inertia, Mounting, Reference, Temperature, Timebase, Zero
from torquebench.compensation import make_model
from torquebench.errors import InputError
from torquebench.records import CalibrationEntry, Registry
from torquebench.reports.calibration_comparison import calibration_comparison_page
from torquebench.reports.page import render_page
from torquebench.reports.page_pdf import write_report
from torquebench.uncertainty import CertifiedUncertainty

START = datetime(2025, 3, 3, 9, 0, tzinfo=UTC)


def calibrate(
    registry: Registry,
    gain: float,
    *,
    months: int,
    up_to: float = 100.0,
    serial: str = "T-1",
    standard: str = "S-1",
    effects: tuple[Effect, ...] = (),
) -> int:
    torque = np.linspace(-up_to, up_to, 41)
    noise = np.random.default_rng(months).normal(0.0, 0.01, torque.size)
    data = CalibrationData(
        torque / gain + noise,
        torque,
        np.ones(41, dtype=int),
        np.where(torque > 0, 1, -1),
        100.0,
        transducer_serial=serial,
        counter_identity="C-1",
    )
    moment = START + timedelta(days=30 * months)
    entry = registry.add_calibration(
        CalibrationEntry.of_points(data, performed=moment, standard_serial=standard)
    )
    model = make_model("polynomial", degree=1, range_nm=100.0)
    model.fit(data.features(1), data.standard_nm)
    path = registry.root / "models" / f"{entry.calibration_id}.json"
    store_model(path, model, data, {}, effects)
    registry.add_model(entry, kind=model.kind, file=path)
    return entry.calibration_id


@pytest.fixture
def registry(tmp_path: Path):  # type: ignore[no-untyped-def] # a fixture's generator
    with Registry.open(tmp_path) as opened:
        yield opened


def test_a_changed_span_is_significant_where_it_is_large(registry: Registry) -> None:
    second = calibrate(registry, 1.002, months=6)
    first = calibrate(registry, 1.001, months=0)
    found = compare_calibrations(registry, second, first)  # sorted by the time of measuring
    assert (found.before.entry.calibration_id, found.after.entry.calibration_id) == (first, second)
    assert not found.remarks
    worst = found.worst
    assert abs(worst.reading_nm) == pytest.approx(100.0, rel=0.01)
    assert worst.change_nm == pytest.approx(1e-3 * worst.reading_nm, rel=0.15)
    assert worst.significant
    assert worst.normalised_error == worst.change_nm / worst.expanded_uncertainty_nm
    assert "changed at" in found.verdict()


def test_the_same_chain_twice_has_not_changed(registry: Registry) -> None:
    numbers = [calibrate(registry, 1.001, months=month) for month in (0, 6)]
    found = compare_calibrations(registry, *numbers)
    assert not found.significant
    assert "no change beyond" in found.verdict()


def test_only_different_standards_count(registry: Registry) -> None:
    stated = (Reference("certificate", CertifiedUncertainty.flat(0.3, 5.0, 100.0)),)
    one = calibrate(registry, 1.001, months=0, effects=stated)
    same = calibrate(registry, 1.002, months=1, effects=stated)
    other = calibrate(registry, 1.002, months=2, standard="S-2", effects=stated)
    assert compare_calibrations(registry, one, same).significant
    found = compare_calibrations(registry, one, other)
    assert not found.significant
    assert found.worst.expanded_uncertainty_nm > 0.4
    assert any("another reference standard: S-1, then S-2" in each for each in found.remarks)


def test_the_changes_of_one_standard_cancel(registry: Registry) -> None:
    def stated(share: float) -> tuple[Effect, ...]:
        certified = CertifiedUncertainty.flat(0.3, 5.0, 100.0)
        return (Reference("certificate", certified, share, 3.0 * share),)

    one, same = (calibrate(registry, 1.001, months=m, effects=stated(2e-3)) for m in (0, 1))
    other = calibrate(registry, 1.001, months=2, standard="S-2", effects=stated(2e-3))
    later = calibrate(registry, 1.001, months=3, effects=stated(4e-3))
    found = [compare_calibrations(registry, one, each) for each in (same, other, later)]
    largest = [max(step.expanded_uncertainty_nm for step in each.steps) for each in found]
    assert largest[0] < 0.03
    assert largest[1] > 2.0 * np.hypot(0.2, 0.6) / np.sqrt(3.0)
    # the standard has changed by more since its certificate: the difference remains
    assert largest[2] == pytest.approx(2.0 * np.hypot(0.2, 0.6) / np.sqrt(3.0), rel=0.01)


@pytest.mark.parametrize(
    ("effect", "u_nm"),
    [
        (Timebase("another clock", "C-1", 100.0, 4000.0), 0.41 / np.sqrt(3.0)),
        nightly(Mounting("positions", 0.2), 0.2),
        nightly(Temperature("data sheet", 0.5, 1e-3, 23.0, 18.0, 28.0), 100.0 * 0.5e-3 / 3.0),
        nightly(Inertia("empty runs", 0.5, 0.1, 30.0), 0.0),
        (Zero("zeroing", 0.5, 4.0, 0.5), 0.0),
    ],
)
def test_errors_of_calibrations_count_and_those_of_readings_do_not(
    registry: Registry, effect: Effect, u_nm: float
) -> None:
    numbers = [calibrate(registry, 1.001, months=m, effects=(effect,)) for m in (0, 1)]
    plain = [calibrate(registry, 1.001, months=m, serial="T-2") for m in (0, 1)]
    with_it, without = (compare_calibrations(registry, *each) for each in (numbers, plain))
    last = [each.steps[-1].expanded_uncertainty_nm for each in (with_it, without)]
    assert last[0] ** 2 - last[1] ** 2 == pytest.approx(8.0 * u_nm**2, rel=0.03, abs=1e-9)


def test_different_ranges_are_named_and_only_the_common_one_compared(registry: Registry) -> None:
    whole = calibrate(registry, 1.001, months=0)
    part = calibrate(registry, 1.001, months=3, up_to=20.0)
    found = compare_calibrations(registry, whole, part)
    assert max(abs(step.reading_nm) for step in found.steps) < 21.0
    assert any("reach 100 and 20 N·m" in each for each in found.remarks)


def test_what_does_not_compare_is_refused(registry: Registry) -> None:
    one = calibrate(registry, 1.001, months=0)
    other = calibrate(registry, 1.001, months=1, serial="T-2")
    with pytest.raises(InputError, match="one transducer"):
        compare_calibrations(registry, one, other)
    with pytest.raises(InputError, match="twice"):
        compare_calibrations(registry, one, one)
    data = CalibrationData(
        [1.0, 2.0],
        [1.0, 2.0],
        [1, 1],
        [1, 1],
        100.0,
        transducer_serial="T-1",
        counter_identity="C-1",
    )
    bare = registry.add_calibration(CalibrationEntry.of_points(data, performed=START))
    with pytest.raises(InputError, match="has no model"):
        compare_calibrations(registry, one, bare.calibration_id)


def test_the_page_shows_steps_and_figure(registry: Registry, tmp_path: Path) -> None:
    numbers = [calibrate(registry, gain, months=12 * k) for k, gain in enumerate((1.001, 1.002))]
    page = calibration_comparison_page(compare_calibrations(registry, *numbers))
    text = render_page(page)
    assert text.count("<svg") == 1
    assert "E_n" in text
    assert write_report(page, tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")


def test_torques_have_the_decimals_of_their_uncertainty(registry: Registry) -> None:
    numbers = [calibrate(registry, gain, months=m) for m, gain in enumerate((1.0, 1.002), 1)]
    page = calibration_comparison_page(compare_calibrations(registry, *numbers))
    rows = next(
        block.rows for section in page.sections for block in section.blocks if block.kind == "table"
    )
    for row in rows:
        _, _, before, after, change, expanded, _ = row
        assert len({len(each.partition(".")[2]) for each in (before, after, change, expanded)}) == 1
