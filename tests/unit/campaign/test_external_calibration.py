"""A table from elsewhere is one sealed record: its standard, its model, its circumstances."""

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path

import pytest
from tests.unit.reports.calibrated_bench import points

from torquebench.calibration import CalibrationData, load_profile
from torquebench.campaign.bench_chains import recorded_effects, referenced
from torquebench.campaign.external_calibration import (
    ExternalCalibration,
    RegisteredTable,
    register_table,
)
from torquebench.campaign.fitting import store_model
from torquebench.chain import Reference
from torquebench.compensation import load_model, make_model
from torquebench.errors import InputError, RecordError
from torquebench.records import (
    Equipment,
    Registry,
    Report,
    RunFolder,
    check_records,
    sha256_of_file,
)
from torquebench.reports.certificate import Issue, build_record, run_data
from torquebench.reports.certificate.record import Party
from torquebench.reports.certificate.source import Source
from torquebench.tables import read_calibration, table_text, write_calibration
from torquebench.uncertainty import CertifiedUncertainty

PROFILE = load_profile("staircase")
ISSUE = Issue(
    ["A. Boss"], laboratory=Party("Lab", city="Ulm", country="DE"), refuse_unreviewed=False
)
CIRCUMSTANCES = ExternalCalibration(
    performed=datetime(2026, 3, 2, tzinfo=UTC),
    measured_by="A. Kim",
    place="Lab 3",
    transducer=Equipment("transducer", "T-7", "HBK", "T12", 2000.0),
    indicator="DMP41 / 815",
    reference=Report("calibrator", "R-9", "K-77", "PTB", due=date(2027, 1, 31)),
    reference_model="TN 2000",
    resolution_nm=0.02,
    reference_uncertainty=0.05,
)


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path / "data") as opened:
        yield opened


@pytest.fixture
def data() -> CalibrationData:
    measured = points(PROFILE, simulated=False, temperature_drift_k=0.2)
    return replace(measured, counter_identity=CIRCUMSTANCES.indicator)


def model_file(folder: Path, data: CalibrationData, range_nm: float = 2000.0) -> Path:
    model = make_model("polynomial", degree=2, range_nm=range_nm)
    model.fit(data.features(2) * [range_nm / 2000.0, 1.0], data.standard_nm * range_nm / 2000.0)
    path = folder / f"model-{range_nm:g}.json"
    store_model(path, model, replace(data, range_nm=range_nm), {})
    return path


def enter(
    registry: Registry,
    data: CalibrationData,
    circumstances: ExternalCalibration = CIRCUMSTANCES,
    model: Path | None = None,
) -> RegisteredTable:
    table = registry.root.parent / "table.csv"
    write_calibration(table, data)
    return register_table(
        registry,
        table_text(table),
        data,
        PROFILE,
        circumstances,
        operator="C. Clerk",
        model=None if model is None else load_model(model),
        sha256=sha256_of_file(table),
    )


def test_everything_is_kept_and_sealed(
    registry: Registry, data: CalibrationData, tmp_path: Path
) -> None:
    entered = enter(registry, data, model=model_file(tmp_path, data))
    folder = RunFolder.open(registry.run(entered.run_id).folder)
    folder.verify()
    assert (folder.path / "table.csv").read_bytes() == (tmp_path / "table.csv").read_bytes()
    assert folder.metadata["entered_by"] == "C. Clerk"
    entry = entered.calibration
    assert (entry.measured_by, entry.standard_serial) == ("A. Kim", "R-9")
    assert entry.performed == CIRCUMSTANCES.performed
    assert entry.due == date(2027, 3, 2)
    assert entered.model is not None
    assert entered.model.check_file().parent == registry.root / "models"
    kept = load_model(entered.model.check_file()).provenance
    assert kept.calibrated_on == "2026-03-02"  # of the table's measurement, not of the fit
    assert check_records(registry).intact


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1", "utf-16"])
def test_a_table_is_kept_whatever_its_encoding(
    registry: Registry, data: CalibrationData, encoding: str
) -> None:
    table = registry.root.parent / "table.csv"
    write_calibration(table, data)
    text = f"# Prüfer = Müller\n{table.read_text(encoding='utf-8')}"
    table.write_text(text, encoding=encoding)
    read = read_calibration(table)
    entered = register_table(
        registry,
        table_text(table),
        read,
        PROFILE,
        CIRCUMSTANCES,
        operator="C. Clerk",
        sha256=sha256_of_file(table),
    )
    folder = RunFolder.open(registry.run(entered.run_id).folder)
    assert (folder.path / "table.csv").read_text(encoding="utf-8") == text
    folder.verify()


def test_its_certificate_states_what_was_said_of_it(
    registry: Registry, data: CalibrationData, tmp_path: Path
) -> None:
    entered = enter(registry, data, model=model_file(tmp_path, data))
    # What is known of the standard today says nothing of the calibration then.
    registry.add_report(
        Report("calibrator", "R-9", "K-99", due=date(2030, 1, 1), expanded_uncertainty_percent=1.0)
    )
    record = build_record(registry, entered.calibration, ISSUE)
    assert record.reference.certificate_number == "K-77"
    assert record.reference.due == date(2027, 1, 31)
    assert not record.reference.of_range
    assert record.method.table == "table.csv"
    assert record.compensation == "polynomial, degree 2"
    assert {table.compensated for table in record.static} == {True, False}
    assert record.static[0].resolution_nm == 0.02
    budget = {line.name: line.standard_uncertainty_nm for line in record.budget}
    torque = abs(record.results[record.budget_step].torque_nm)
    of_torque = 0.05 / 100.0 * torque / 2.0
    assert budget["reference standard"] == pytest.approx(of_torque, rel=1e-3)
    assert budget["resolution of indication and zero"] == pytest.approx(0.02 / 6.0**0.5)


def test_a_model_for_another_range_is_refused(
    registry: Registry, data: CalibrationData, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="for ±4000 N·m"):
        enter(registry, data, model=model_file(tmp_path, data, range_nm=4000.0))
    assert registry.runs() == []


def test_a_later_certificate_of_the_standard_hides_no_expired_one(
    registry: Registry, data: CalibrationData
) -> None:
    due = replace(CIRCUMSTANCES.reference, due=date(2026, 3, 1))
    entered = enter(registry, data, replace(CIRCUMSTANCES, reference=due))
    with pytest.raises(RecordError, match=r"expired on 2026-03-01 \(clause reference.in_date"):
        build_record(registry, entered.calibration, ISSUE)


def test_the_standard_of_its_own_comments_counts_once_with_its_limits(
    registry: Registry, data: CalibrationData
) -> None:
    own = Reference("A", CertifiedUncertainty.of_torque(2e-4), 1e-4, 3e-5)
    stated = replace(CIRCUMSTANCES, reference_uncertainty=own.certified)
    entered = enter(registry, replace(data, reference=own), stated)
    folder = RunFolder(registry.run(entered.run_id).folder)
    points = run_data(folder)
    assert points.reference is None  # the run's metadata have it
    (effect,) = recorded_effects(folder.metadata, points)
    assert effect == replace(own, record="certificate K-77 of R-9")
    assert referenced(points, folder.metadata).reference == effect


@pytest.mark.parametrize(
    "uncertainty", [0.05, CertifiedUncertainty.of_table([200.0, 2000.0], [0.2, 0.6])]
)
def test_another_model_and_the_certificate_use_the_standard_of_the_table(
    registry: Registry, data: CalibrationData, uncertainty: CertifiedUncertainty | float
) -> None:
    entered = enter(registry, data, replace(CIRCUMSTANCES, reference_uncertainty=uncertainty))
    folder = RunFolder(registry.run(entered.run_id).folder)
    (effect,) = recorded_effects(folder.metadata, data)
    assert isinstance(effect, Reference)
    assert effect.record == "certificate K-77 of R-9"
    expected = uncertainty
    if isinstance(uncertainty, float):
        expected = CertifiedUncertainty.of_torque(1e-2 * uncertainty)
    assert effect.certified == expected
    source = Source.of(registry, entered.calibration)
    assert source.reference.uncertainty(data.range_nm) == expected
