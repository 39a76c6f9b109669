"""Calibrations from elsewhere: a table in, a judged result or a sealed record out."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.support.uploads import evaluated
from tests.unit.reports.calibrated_bench import points

from torquebench.calibration import load_profile
from torquebench.errors import InputError, RecordError, TorquebenchError
from torquebench.operations import PackagedLibrary, Place
from torquebench.operations.static import (
    IMPORT,
    MOST_DEVIATIONS,
    STATIC,
    EnteredTable,
    EvaluatedStatic,
    ImportedTable,
    StaticTable,
)
from torquebench.progress import NO_PROGRESS
from torquebench.records import Registry, RunFolder, check_records
from torquebench.tables import calibration_csv

CIRCUMSTANCES = {
    "profile": "staircase",
    "reference_uncertainty": "0.02 of torque",
    "resolution_nm": 0.01,
    "performed": "2026-03-02T10:00:00Z",
    "reference_due": "2027-01-31",
}
CHAIN = {
    "transducer": "T-7",
    "indicator": "DMP41 / 815",
    "measured_by": "A. Kim",
    "reference_serial": "R-9",
}
CLERK = "Max"


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path / "data") as opened:
        yield opened


@pytest.fixture(scope="module")
def table() -> str:
    measured = points(load_profile("staircase"), simulated=False, temperature_drift_k=0.2)
    return calibration_csv(replace(measured, counter_identity=CHAIN["indicator"]))


def looked_at(tmp_path: Path, content: str, **fields: Any) -> EvaluatedStatic:
    file = tmp_path / "table.csv"
    file.write_text(content, encoding="utf-8")
    request = StaticTable.model_validate({**CIRCUMSTANCES, "table": file, **fields})
    place = Place("", PackagedLibrary())
    STATIC.doubts(place, request)
    result = STATIC.run(place, request, NO_PROGRESS)
    assert isinstance(result, EvaluatedStatic)
    return result


def entered(registry: Registry, file: Path, **fields: Any) -> EnteredTable:
    values = {**CIRCUMSTANCES, **CHAIN, "table": file, **fields}
    request = ImportedTable.model_validate(values)
    place = Place(CLERK, PackagedLibrary(), registry, people=lambda: ("A. Kim", "B. Li"))
    IMPORT.doubts(place, request)
    result = IMPORT.run(place, request, NO_PROGRESS)
    assert isinstance(result, EnteredTable)
    return result


def test_the_uncertainty_that_a_table_states_counts_where_none_is_given(
    tmp_path: Path, table: str
) -> None:
    own = f"# reference_uncertainty = 0.5 of torque\n{table}"
    directions = looked_at(tmp_path, own, reference_uncertainty=None).evaluated.directions
    given, other = (
        looked_at(tmp_path, table, reference_uncertainty=stated).evaluated.directions
        for stated in ("0.5 of torque", "0.02 of torque")
    )
    expanded = [each[0].before.expanded_percent.tolist() for each in (directions, given, other)]
    assert expanded[0] == expanded[1] != expanded[2]


def test_what_a_profile_misses_is_named(tmp_path: Path) -> None:
    found = looked_at(tmp_path, "reading_nm,standard_nm\n1.1,1\n2.1,2\n")
    assert found.failed
    (direction,) = found.evaluated.directions
    assert direction.before.evaluation.torque_nm.tolist() == [1.0, 2.0]
    assert any(each.kind == "missing_step" for each in found.deviations)


def test_an_entered_table_is_a_sealed_record(
    registry: Registry, tmp_path: Path, table: str
) -> None:
    file = tmp_path / "from elsewhere.csv"
    file.write_text(table, encoding="utf-8", newline="")
    result = entered(registry, file)
    folder = RunFolder.open(registry.run(result.run_ids[0]).folder)
    folder.verify()
    assert (folder.path / "table.csv").read_text(encoding="utf-8") == table
    assert folder.metadata["table"] == "from elsewhere.csv"
    assert folder.metadata["entered_by"] == CLERK
    assert check_records(registry).intact
    with pytest.raises(InputError, match=f"entered as {result.calibration}"):
        entered(registry, file)


def test_who_measured_is_a_person_of_the_laboratory(
    registry: Registry, tmp_path: Path, table: str
) -> None:
    file = tmp_path / "table.csv"
    file.write_text(table, encoding="utf-8")
    with pytest.raises(InputError, match=r"'Somebody', who isn't a person"):
        entered(registry, file, measured_by="Somebody")
    assert registry.runs() == []
    result = entered(registry, file, measured_by=" a. kim")
    (entry,) = registry.calibrations()
    assert (result.calibration, entry.measured_by) == ("calibration-1", "A. Kim")
    for name in ("A. Kim", CLERK):  # who entered it answers for it as well
        with pytest.raises(RecordError, match=r"a person other than A\. Kim and"):
            registry.review("calibrations", entry.calibration_id, checked_by=name)


@pytest.mark.parametrize(
    ("missing", "option"),
    [
        ("transducer", "--transducer"),
        ("indicator", "--indicator"),
        ("measured_by", "--measured-by"),
        ("reference_serial", "--reference-serial"),
    ],
)
def test_what_a_certificate_has_to_name_is_asked_for(
    registry: Registry, tmp_path: Path, table: str, missing: str, option: str
) -> None:
    file = tmp_path / "table.csv"
    lines = [line for line in table.splitlines() if "serial" not in line and "counter" not in line]
    file.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match=option):
        entered(registry, file, **{missing: ""})
    assert registry.runs() == []


HEADER = "reading_nm,standard_nm\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "empty"),
        (HEADER + "1,\0\n", "NUL"),
        (HEADER + "1e999,1\n", "finite"),
        (HEADER + "nan,1\n", "nan"),
        (HEADER + "1e308,1e308\n", "at most|range"),
        ("# range_nm = inf\n" + HEADER + "1,1\n", "range"),
        (HEADER + '"1,1\n', "quotation"),
        ("<script>\n1", "no column|HTML"),
        ("PK\x03\x04", "can't read"),
    ],
)
def test_a_hostile_table_is_refused_in_words(tmp_path: Path, content: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        looked_at(tmp_path, content)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("profile", "../../etc/passwd"),
        ("range_nm", float("nan")),
        ("range_nm", 1e300),
        ("resolution_nm", float("inf")),
        ("reference_uncertainty", "0.02 of speed"),
        ("reference_uncertainty", "20 of torque"),
        ("reference_uncertainty", "nobodys.xml"),
        ("performed", 1767225600),
        ("performed", "tomorrow"),
        ("performed", "2999-01-01"),
        ("reference_due", 0),
        ("surprise", 1),
    ],
)
def test_a_wrong_field_is_refused(tmp_path: Path, table: str, field: str, value: Any) -> None:
    with pytest.raises((TorquebenchError, ValueError)):
        looked_at(tmp_path, table, **{field: value})


def test_a_table_of_another_kind_has_no_endless_answer(tmp_path: Path) -> None:
    rows = "".join(f"{1 + n * 1e-3:.3f},{1 + n * 1e-3:.3f},{n + 1}\n" for n in range(1000))
    found = looked_at(tmp_path, f"reading_nm,standard_nm,series\n{rows}")
    assert len(found.deviations) == MOST_DEVIATIONS


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_an_upload_is_read_as_spreadsheets_save_it(encoding: str) -> None:
    content = "reading_nm;standard_nm\n0,1;0\n100,2;100\n200,1;200\n"
    assert evaluated(content.encode(encoding), "t.csv").points == 3


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"\x81", b"x" * 512 * 1025])
def test_an_upload_that_is_no_text_is_refused(content: bytes) -> None:
    with pytest.raises(TorquebenchError):
        evaluated(content, "t.csv")


def test_the_standards_uncertainty_is_a_share_of_range_or_its_certificates_table(
    tmp_path: Path, table: str
) -> None:
    certificate = tmp_path / "certificate.csv"
    certificate.write_text("torque_nm,expanded_uncertainty_nm\n200,0.4\n2000,0.4\n")
    found = [
        looked_at(tmp_path, table, reference_uncertainty=stated)
        .evaluated.directions[0]
        .before.expanded_percent
        for stated in ("0.02 of torque", "0.02 of range", str(certificate))
    ]
    assert found[1] == pytest.approx(found[2])  # 0.02 % of 2000 N·m
    assert found[1][0] > 1.2 * found[0][0]
    assert found[1][-1] == pytest.approx(found[0][-1])
