import shutil
from dataclasses import replace
from datetime import UTC, date, datetime

import pytest
from sqlalchemy import select, text
from sqlalchemy.exc import DatabaseError
from tests.support.draws import drawn

from torquebench.calibration import CalibrationData, verify
from torquebench.errors import InputError, RecordError
from torquebench.records import (
    Adjustment,
    CalibrationEntry,
    CertificateEntry,
    CheckEntry,
    Equipment,
    Registry,
    Report,
    RunFolder,
    Zeroing,
    anchor_of,
    calibration_changes,
    check_records,
    sha256_of_file,
)
from torquebench.records.registry.database_check import schema_changes
from torquebench.records.registry.entries import RunSummary, TorqueRange, links, metadata

START = datetime(2025, 1, 31, 12, 0, tzinfo=UTC)


def fill(registry, folder):
    """Enter at least one record in every table."""
    with RunFolder.create(
        folder / "runs", {"registry_head": str(registry.head())}, kind="zero", run_id="run-1"
    ) as writer:
        run = RunSummary(
            run_id="run-1",
            kind="zero",
            started=START,
            simulated=True,
            software_version="0.1.0",
            folder=writer.path,
        )
        registry.add_run(run)
        writer.document("start", {"uid": "1"})
    registry.end_run(RunFolder(writer.path))
    registry.add_audit_end(folder / "audit", 7, "ab" * 32)
    registry.add_equipment(Equipment("transducer", "T-1", "HBK", "T40B", 2000.0, {"class": 0.05}))
    registry.fit_component(("bench", "Bench 1"), ("transducer", "T-1"), "output.transducer")
    registry.add_adjustment(
        Adjustment(
            kind="transducer",
            serial="T-1",
            what="span set",
            performed=START,
            performed_by="Ana",
            checked_by="Ben",
        )
    )
    certificate = folder / "certificate.csv"
    certificate.write_text("side,torque_nm\n", encoding="utf-8")
    registry.add_report(
        Report(
            "calibrator",
            "TC-1",
            "C-77",
            "Laboratory",
            date(2024, 6, 1),
            date(2026, 6, 1),
            valid_nm=TorqueRange(-2000.0, 2000.0),
            expanded_uncertainty_percent=0.02,
            file=certificate,
        )
    )
    registry.add_zeroing(
        Zeroing(
            transducer_serial="T-1",
            performed=START,
            zero_hz=60001.5,
            zero_nm=0.1,
            temperature_c=23.0,
            run_id="run-1",
            simulated=True,
        )
    )
    data = CalibrationData(
        [0.1, 5.2, 10.1],
        [0.0, 5.0, 10.0],
        [1, 1, 2],
        [1, 1, 1],
        10.0,
        transducer_serial="T-1",
        counter_identity="C-1",
    )
    calibration = registry.add_calibration(
        CalibrationEntry.of_points(
            data, performed=START, run_id="run-1", standard_serial="TC-1", measured_by="Ana"
        )
    )
    file = folder / "model.json"
    file.write_text("{}", encoding="utf-8")
    model = registry.add_model(calibration, kind="radial-basis", file=file, metrics={"rms": 0.25})
    registry.activate(model.model_id, operator="Ana")
    registry.add_verification(model.model_id, verify(data, {}), run_id="run-1")
    registry.add_check(
        CheckEntry(
            transducer_serial="T-1",
            performed=START,
            verdict="pass",
            worst_percent_fs=0.02,
            tolerance_percent_fs=0.1,
            simulated=True,
            standard_serial="VS-1",
            model_id=model.model_id,
            run_id="run-1",
            measured_by="Ana",
        )
    )
    issued = folder / "certificates" / "2025-001" / "a.pdf"
    issued.parent.mkdir(parents=True)
    issued.write_bytes(b"%PDF")
    registry.add_certificate(
        CertificateEntry(
            number="2025-001",
            calibration_id=calibration.calibration_id,
            issued=START,
            authorised_by="Cy",
            files={"a.pdf": sha256_of_file(issued)},
        )
    )
    registry.review("calibrations", calibration.calibration_id, checked_by="Ben")
    registry.amend(
        "calibrations",
        calibration.calibration_id,
        {"measured_by": "Anna"},
        amended_by="Ben",
        reason="misspelt",
    )


@pytest.fixture
def filled(registry, tmp_path):
    fill(registry, tmp_path)
    return registry


def tables():
    return [table for table in metadata.sorted_tables if table is not links]


FIELDS = [
    (table.name, column.name)
    for table in tables()
    for column in table.columns
    if not column.primary_key
]


def other_value(column, value):
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    if isinstance(value, dict):
        return {**value, "more": 1}
    if isinstance(value, datetime):
        return value.replace(year=2031)
    if value is None:
        kind = column.type.python_type
        return {float: 1.5, int: 1, datetime: START, date: date(2031, 1, 1)}.get(kind, "x")
    return date(2031, 1, 1) if isinstance(value, date) else value[:-1] + "~"


def test_every_table_holds_a_record_and_all_are_intact(filled):
    with filled.session() as session:
        for table in tables():
            assert session.execute(select(table)).first() is not None, table.name
    report = check_records(filled)
    assert report.findings == ()
    assert report.intact
    assert (report.runs, report.files) == (1, 3)
    assert report.records == report.head.sequence


@pytest.mark.parametrize("part", drawn(12, by_day=1))
def test_every_changed_field_is_named_with_its_table_and_row(filled, unguarded, part):
    with unguarded.connect() as connection:
        for name, field in FIELDS[part::12]:
            table = metadata.tables[name]
            column = table.columns[field]
            row = connection.execute(select(table).order_by(table.c.id).limit(1)).one()
            before = row._mapping[field]
            here = table.c.id == row.id
            connection.execute(
                table.update().where(here).values({field: other_value(column, before)})
            )
            connection.commit()
            found = check_records(filled, folders=False).findings
            connection.execute(table.update().where(here).values({field: before}))
            connection.commit()
            assert [(each.kind, each.where, each.field) for each in found] == [
                ("changed", f"{name} {row.id}", field)
            ]
    assert check_records(filled).intact


def test_a_change_says_what_was_entered_and_what_is_there_now(filled, unguarded):
    with unguarded.begin() as connection:
        connection.execute(text("UPDATE equipment_descriptions SET range_nm = 500 WHERE id = 1"))
    (found,) = check_records(filled).findings
    assert str(found) == "equipment_descriptions 1, range_nm: 500.0 instead of 2000.0"


def test_removed_and_added_rows_are_named(filled, unguarded):
    with unguarded.begin() as connection:
        connection.execute(text("DELETE FROM zeroings"))
        connection.execute(
            text(
                "INSERT INTO reviews (id, subject, subject_key, checked, checked_by, accepted, "
                "remark) SELECT 77, subject, subject_key, checked, 'Dan', accepted, remark "
                "FROM reviews"
            )
        )
    found = [str(each) for each in check_records(filled).findings]
    assert found == [
        "reviews 77: added past the registry",
        "zeroings 1: removed after it was entered",
    ]


def test_a_change_of_row_and_chain_alike_breaks_the_hashes(filled, unguarded):
    with unguarded.begin() as connection:
        connection.execute(text("UPDATE runs SET operator = 'Eve'"))
        connection.execute(
            text(
                'UPDATE chain SET content = replace(content, \'"operator":""\', '
                '\'"operator":"Eve"\') WHERE "table" = \'runs\''
            )
        )
    (found,) = check_records(filled).findings
    assert (found.kind, found.where) == ("chain", "runs 1")
    assert "doesn't have the hash that it was sealed with" in str(found)


def test_a_chain_cut_short_is_seen_from_what_was_noted_down(filled, unguarded, tmp_path):
    noted = filled.head()
    with unguarded.begin() as connection:
        connection.execute(text("DELETE FROM amendments"))
        connection.execute(text(f"DELETE FROM chain WHERE sequence = {noted.sequence}"))
    assert check_records(filled).intact  # nothing inside the registry can show this
    (found,) = check_records(filled, anchors=(noted,)).findings
    assert f"doesn't pass through entry {noted.sequence}" in str(found)


def test_a_rewritten_chain_is_seen_from_the_run_folders(registry, tmp_path, unguarded):
    registry.add_equipment(Equipment("bench", "Bench 1"))
    fill(registry, tmp_path)
    with Registry.open(tmp_path / "forged") as forged:
        forged.add_equipment(Equipment("bench", "Bench 2"))
        with forged.session() as session:
            query = select(links.c.content, links.c.recorded, links.c.sha256)
            link = session.execute(query.where(links.c.sequence == 1)).one()
    with unguarded.begin() as connection:
        update = links.update().where(links.c.sequence == 1)
        connection.execute(update.values(dict(link._mapping)))
    kinds = {each.kind for each in check_records(registry).findings}
    assert "chain" in kinds
    with unguarded.begin() as connection:
        connection.execute(text("UPDATE chain SET sha256 = previous_sha256 WHERE sequence = 2"))
    assert "anchor" in {each.kind for each in check_records(registry).findings}


def test_changed_files_and_run_folders_are_named(filled, tmp_path):
    (tmp_path / "model.json").write_text("{ }", encoding="utf-8")
    (tmp_path / "certificate.csv").unlink()
    (tmp_path / "certificates" / "2025-001" / "a.pdf").write_bytes(b"%PDF forged")
    with (tmp_path / "runs" / "run-1" / "events.jsonl").open("a", encoding="utf-8") as events:
        events.write("{}\n")
    found = {str(each).removeprefix(str(tmp_path)) for each in check_records(filled).findings}
    assert found == {
        "/model.json: changed after it was registered",
        "/certificate.csv: the file is missing",
        "/certificates/2025-001/a.pdf: changed after it was registered",
        f"/runs/run-1: {tmp_path}/runs/run-1/events.jsonl was changed after sealing",
    }
    manifest = tmp_path / "runs" / "run-1" / "manifest.json"
    manifest.write_text(manifest.read_text(encoding="utf-8") + " ", encoding="utf-8")
    assert any("manifest was changed" in str(each) for each in check_records(filled).findings)
    shutil.rmtree(tmp_path / "runs")
    assert any("no run in" in str(each) for each in check_records(filled).findings)


def test_tables_indexes_and_triggers_are_compared_with_those_that_were_made(
    registry, around, unguarded
):
    missing = {"keep_" + table.name for table in metadata.sorted_tables}
    found = {each.where: each.found for each in schema_changes(registry)}
    if registry.dialect == "sqlite":
        missing = {f"{name}_{event}" for name in missing for event in ("update", "delete")}
        assert set(found.values()) == {"is missing"}
    else:
        assert set(found.values()) == {"differs from what was made"}
    assert set(found) == {f"trigger {name}" for name in missing}
    with around.begin() as connection:
        connection.execute(text("DROP INDEX ix_runs_started"))
        connection.execute(text("ALTER TABLE runs ADD COLUMN mood TEXT"))
    more = {each.where for each in schema_changes(registry)} - set(found)
    assert more == {"index ix_runs_started", "table runs"}


def test_the_schema_as_it_is_made_has_no_changes(registry):
    assert list(schema_changes(registry)) == []


def test_the_database_itself_refuses_to_change_a_record(filled, around):
    statements = ["UPDATE chain SET content = '{}'", "DELETE FROM chain"]
    for table in tables():
        statements += [f"UPDATE {table.name} SET id = 99", f"DELETE FROM {table.name}"]
    for statement in statements:
        with pytest.raises(DatabaseError, match="append-only"), around.begin() as connection:
            connection.execute(text(statement))
    assert check_records(filled).intact


RUNS = RunSummary.__table__


@pytest.mark.parametrize("change", [RUNS.update().values(operator="Eve"), RUNS.delete()])
def test_a_change_through_the_session_is_refused(filled, change):
    with pytest.raises(RecordError, match="runs is append-only"), filled.writing() as session:
        session.execute(change)
    assert check_records(filled).intact


def test_a_failed_transaction_leaves_neither_rows_nor_links(filled):
    before = filled.head()
    run = filled.runs()[0]
    with pytest.raises(RecordError, match="is registered"):
        filled.add_run(run)
    with pytest.raises(RecordError, match="isn't registered"):
        filled.add_zeroing(
            Zeroing(
                transducer_serial="T-9", performed=START, zero_hz=6e4, zero_nm=0.0, run_id="run-9"
            )
        )
    assert filled.head() == before
    assert "T-9" not in {each.serial for each in filled.equipment()}
    filled.add_run(replace(run, run_id="run-2"))
    assert check_records(filled, folders=False).intact


@pytest.mark.parametrize("noted", ["", "12", "x:" + "a" * 64, "3:" + "a" * 63, "3:" + "g" * 64])
def test_a_chain_end_that_is_none_is_refused(noted):
    with pytest.raises(InputError, match="chain end"):
        anchor_of(noted)


def test_what_a_certificate_rests_on_is_checked_without_the_rest(filled, unguarded):
    (entry,) = filled.calibrations()
    assert calibration_changes(filled, entry.calibration_id) == ()
    with unguarded.begin() as connection:
        connection.execute(text("UPDATE reviews SET checked_by = 'Eve'"))  # no part of it
        connection.execute(text("UPDATE models SET range_nm = 11"))
        connection.execute(text("UPDATE reports SET due = '2031-01-01'"))
        connection.execute(text("DELETE FROM chain WHERE \"table\" = 'run_ends'"))
        connection.execute(text("UPDATE chain SET recorded = 'now' WHERE \"table\" = 'runs'"))
    found = calibration_changes(filled, entry.calibration_id)
    assert [change.partition(":")[0] for change in found] == [
        "runs 1",
        "run_ends 1",
        "models 1, range_nm",
        "reports 1, due",
    ]
    with pytest.raises(RecordError, match="calibration 7 isn't registered"):
        calibration_changes(filled, 7)
