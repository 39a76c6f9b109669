"""A run's export: what a stranger finds in it."""

import csv
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.unit.reports.calibrated_bench import calibrated_bench

from torquebench.errors import InputError, RecordError
from torquebench.records import Registry
from torquebench.reports.certificate import Issue, build_record, issue_certificate
from torquebench.reports.export import export_run
from torquebench.tables import read_calibration


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path / "data") as opened:
        yield opened


def test_export_explains_every_file_and_column(registry: Registry, tmp_path: Path) -> None:
    bench = calibrated_bench(registry)
    exported = export_run(registry, registry.run(bench.run_id), tmp_path / "out")
    readme = (exported.folder / "README.txt").read_text()
    for name in exported.files:
        assert name.split("/")[0] in readme
    for path in exported.folder.glob("*.csv"):
        lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
        for column in next(csv.reader(lines)):
            assert f"\n{column}\n    " in readme
    assert "As its name says" not in readme
    assert "SIMULATED" in readme
    assert max(map(len, readme.splitlines())) <= 100
    assert {Path(name).suffix for name in exported.files} >= {".csv", ".json", ".pdf", ".xml"}


def test_hashes_and_points_hold(registry: Registry, tmp_path: Path) -> None:
    bench = calibrated_bench(registry)
    exported = export_run(registry, registry.run(bench.run_id), tmp_path / "out")
    for line in (exported.folder / "SHA256SUMS.txt").read_text().splitlines():
        digest, name = line.split("  ")
        assert hashlib.sha256((exported.folder / name).read_bytes()).hexdigest() == digest
    data = read_calibration(exported.folder / "calibration.csv")
    assert data.sha256() == bench.calibration.data_sha256
    lines = (exported.folder / "points.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert len(rows) == bench.calibration.points
    assert list(rows[0]) == ["unix_time_s", "reading_nm", "nominal_nm"]
    assert {"# simulated = true", "# transducer_serial = T-7"} <= set(lines)
    known = json.loads((exported.folder / "registry.json").read_text())
    assert known["calibrations"][0]["calibration"]["transducer_serial"] == "T-7"


def test_export_holds_the_issued_certificate_or_a_draft(registry: Registry, tmp_path: Path) -> None:
    bench = calibrated_bench(registry)
    run = registry.run(bench.run_id)
    draft = export_run(registry, run, tmp_path / "draft")
    assert "certificate-DRAFT-1-en.pdf" in draft.files
    assert any("draft" in remark for remark in draft.remarks)
    record = build_record(registry, bench.calibration, Issue(["A. Boss"], refuse_unreviewed=False))
    issued = issue_certificate(registry, record)
    exported = export_run(registry, run, tmp_path / "issued")
    assert f"certificate-{record.number}.xml" in exported.files
    assert not any("DRAFT" in name for name in exported.files)
    issued.files[0].write_bytes(b"changed")
    again = export_run(registry, run, tmp_path / "changed")
    assert any("NOT INTACT" in remark for remark in again.remarks)


def test_changed_run_is_exported_with_a_warning(registry: Registry, tmp_path: Path) -> None:
    bench = calibrated_bench(registry)
    path = bench.folder / "events.jsonl"
    path.write_bytes(path.read_bytes() + b"torn\n")
    exported = export_run(registry, registry.run(bench.run_id), tmp_path / "out")
    assert any("events.jsonl was changed" in remark for remark in exported.remarks)
    assert any("UNREADABLE" in remark for remark in exported.remarks)
    assert "calibration.csv" in exported.files


def test_unsealed_run_and_full_folder_are_refused(registry: Registry, tmp_path: Path) -> None:
    bench = calibrated_bench(registry, seal=False)
    with pytest.raises(RecordError, match="isn't sealed"):
        export_run(registry, registry.run(bench.run_id), tmp_path / "out")
    sealed = calibrated_bench(registry)
    with pytest.raises(InputError, match="isn't empty"):
        export_run(registry, registry.run(sealed.run_id), tmp_path)
