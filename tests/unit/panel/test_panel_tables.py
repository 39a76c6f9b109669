"""Calibrations from elsewhere: text in, a judged table or a sealed record out, never a path."""

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from tests.unit.reports.calibrated_bench import points

from torquebench.bench.description import default_bench
from torquebench.calibration import load_profile
from torquebench.errors import InputError, RecordError, TorquebenchError
from torquebench.panel.service import Actor, NotFoundError, PermissionDeniedError, read_table
from torquebench.panel.service.records.table_import import (
    LONGEST_TABLE,
    TableImport,
    states_reference,
)
from torquebench.panel.service.settings.store import SettingsStore
from torquebench.panel.service.store import PanelStore
from torquebench.records import Registry, RunFolder, check_records
from torquebench.tables import calibration_csv

CHIEF = Actor("Max", "metrologist", "m")
CIRCUMSTANCES = {
    "profile": "staircase",
    "reference_uncertainty_percent": 0.02,
    "reference_uncertainty_of": "torque",
    "resolution_nm": 0.01,
    "performed": "2026-03-02T10:00:00Z",
    "reference_due": "2027-01-31",
}
CHAIN = {
    "called": "../../etc/passwd",  # a word like any other
    "transducer_serial": "T-7",
    "indicator": "DMP41 / 815",
    "measured_by": "A. Kim",
    "reference_serial": "R-9",
}


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SettingsStore]:
    store = PanelStore(tmp_path_factory.mktemp("panel"))
    yield SettingsStore(store, default_bench())
    store.close()


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path / "data") as opened:
        yield opened


@pytest.fixture
def noted() -> list[tuple[Any, ...]]:
    return []


@pytest.fixture
def tables(
    registry: Registry, settings: SettingsStore, noted: list[tuple[Any, ...]]
) -> TableImport:
    return TableImport(
        lambda: registry, settings, lambda *what, **how: noted.append((*what, how)), people
    )


@pytest.fixture
def looking(settings: SettingsStore) -> TableImport:
    """Return a tables without records: whoever only looks needs none."""
    return TableImport(
        lambda: pytest.fail("records were touched"), settings, pytest.fail, pytest.fail
    )


def people() -> tuple[str, ...]:
    return "A. Kim", "B. Li"


@pytest.fixture
def table() -> str:
    measured = points(load_profile("staircase"), simulated=False, temperature_drift_k=0.2)
    return calibration_csv(replace(measured, counter_identity=CHAIN["indicator"]))


def test_a_table_is_judged_and_nothing_is_kept(looking: TableImport, table: str) -> None:
    view = looking.preview({**CIRCUMSTANCES, "content": table})
    assert view.points == len(view.error_nm) == len(view.branch)
    assert view.certifiable
    assert not view.simulated
    assert view.raw.worst_nm == max(map(abs, view.error_nm))
    assert {each.name for each in view.directions} <= {"clockwise", "counter-clockwise"}
    assert all(each.uncertainty_percent for each in view.directions)


def test_the_uncertainty_that_a_table_states_counts_where_none_is_given(
    looking: TableImport, table: str
) -> None:
    request = {**CIRCUMSTANCES, "reference_uncertainty_percent": None}
    own = f"# reference_uncertainty = 0.5 of torque\n{table}"
    assert (states_reference(own), states_reference(table)) == (True, False)
    found = looking.preview({**request, "content": own}).directions
    stated = {**request, "reference_uncertainty_percent": 0.5, "content": table}
    assert found == looking.preview(stated).directions
    assert found != looking.preview({**CIRCUMSTANCES, "content": own}).directions


def test_what_a_profile_misses_is_named(looking: TableImport) -> None:
    view = looking.preview({**CIRCUMSTANCES, "content": "reading_nm,standard_nm\n1.1,1\n2.1,2\n"})
    assert not view.certifiable
    (direction,) = view.directions
    assert direction.torque_nm == (1.0, 2.0)  # evaluated by its own steps
    assert any(each.kind == "missing_step" for each in view.deviations)


def test_an_entered_table_is_a_sealed_record(
    tables: TableImport, registry: Registry, table: str, noted: list[tuple[Any, ...]]
) -> None:
    entered = tables.enter(CHIEF, {**CIRCUMSTANCES, **CHAIN, "content": table})
    folder = RunFolder.open(registry.run(entered.run_id).folder)
    folder.verify()
    assert (folder.path / "table.csv").read_text(encoding="utf-8") == table
    assert folder.metadata["table"] == "../../etc/passwd"
    assert folder.metadata["entered_by"] == "Max"
    assert registry.calibration(entered.calibration_id).summary["table"] == "../../etc/passwd"
    assert check_records(registry).intact
    ((actor, what, details),) = noted
    assert (actor, what) == (CHIEF, "entered a table")
    assert details["calibration_id"] == entered.calibration_id
    with pytest.raises(InputError, match=f"entered as calibration-{entered.calibration_id}"):
        tables.enter(CHIEF, {**CIRCUMSTANCES, **CHAIN, "content": table})


def test_an_operator_enters_nothing(tables: TableImport, registry: Registry, table: str) -> None:
    with pytest.raises(PermissionDeniedError):
        tables.enter(Actor("Olga", "operator", "o"), {**CIRCUMSTANCES, **CHAIN, "content": table})
    assert registry.runs() == []


def test_who_measured_is_a_person_of_the_laboratory(
    tables: TableImport, registry: Registry, table: str
) -> None:
    asked = {**CIRCUMSTANCES, **CHAIN, "content": table}
    with pytest.raises(InputError, match=r"'Somebody', who isn't a person.*one of A\. Kim, B\. Li"):
        tables.enter(CHIEF, {**asked, "measured_by": "Somebody"})
    assert registry.runs() == []
    entered = tables.enter(CHIEF, {**asked, "measured_by": " a. kim"})
    assert registry.calibration(entered.calibration_id).measured_by == "A. Kim"
    for name in ("A. Kim", CHIEF.name):  # who entered it answers for it as well
        with pytest.raises(RecordError, match=r"a person other than A\. Kim and"):
            registry.review("calibrations", entered.calibration_id, checked_by=name)


@pytest.mark.parametrize("missing", ["transducer_serial", "indicator", "reference_serial"])
def test_what_a_certificate_has_to_name_is_asked_for(
    tables: TableImport, table: str, missing: str
) -> None:
    asked = {**CIRCUMSTANCES, **CHAIN, "content": table}
    for given in ({**asked, missing: ""}, {key: asked[key] for key in asked if key != missing}):
        with pytest.raises(InputError, match=missing):
            tables.enter(CHIEF, given)


HEADER = "reading_nm,standard_nm\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "at least 1"),
        ("x" * (LONGEST_TABLE + 1), "at most"),
        (HEADER + "\n" * 6000, "6001 lines"),
        (",".join(f"a{n}" for n in range(40_000)) + "\n1\n", "a line of"),
        ("# a = " + "," * 100_000 + "x\n" + HEADER + "1,1\n", "a line of"),
        (HEADER + "1,\0\n", "NUL"),
        (HEADER + "1e999,1\n", "finite"),
        (HEADER + "nan,1\n", "nan"),
        (HEADER + "1e308,1e308\n", "range"),
        ("# range_nm = inf\n" + HEADER + "1,1\n", "range"),
        (HEADER + '"1,1\n', "quotation"),
        ("<script>\n1", "no column"),
        ("PK\x03\x04", "can't read the table"),
    ],
)
def test_a_hostile_table_is_refused_in_words(
    looking: TableImport, content: str, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        looking.preview({**CIRCUMSTANCES, "content": content})


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("profile", "../../etc/passwd"),
        ("profile", "mine.toml"),
        ("range_nm", float("nan")),
        ("range_nm", 1e300),
        ("resolution_nm", float("inf")),
        ("reference_uncertainty_percent", "0.02"),
        ("reference_uncertainty_percent", None),
        ("reference_points", {"torque_nm": [100.0], "expanded_uncertainty_nm": [0.1]}),
        ("reference_uncertainty_of", "speed"),
        ("reference_uncertainty_of", None),
        ("performed", 1767225600),
        ("performed", "2026-03-02"),
        ("performed", "9999-12-31T23:59:59-23:59"),
        ("reference_due", 0),
        ("surprise", 1),
    ],
)
def test_a_wrong_field_is_named(looking: TableImport, table: str, field: str, value: Any) -> None:
    with pytest.raises((InputError, NotFoundError)) as refused:
        looking.preview({**CIRCUMSTANCES, "content": table, field: value})
    assert field in str(refused.value) or "profiles" in str(refused.value)


def test_a_measurement_of_tomorrow_is_refused_before_the_table_is_read(
    looking: TableImport, table: str
) -> None:
    tomorrow = datetime.now(UTC) + timedelta(days=1)
    with pytest.raises(InputError, match="in the future"):
        looking.preview({**CIRCUMSTANCES, "content": table, "performed": tomorrow.isoformat()})


def test_a_table_of_another_kind_has_no_endless_answer(looking: TableImport) -> None:
    rows = "".join(f"{1 + n * 1e-3:.3f},{1 + n * 1e-3:.3f},{n + 1}\n" for n in range(1000))
    view = looking.preview({**CIRCUMSTANCES, "content": "reading_nm,standard_nm,series\n" + rows})
    assert len(view.deviations) == 200


def test_a_table_without_a_loaded_point_is_shown_as_one(looking: TableImport) -> None:
    content = "reading_nm,standard_nm,branch\n0.02,0,up\n400.3,400,up\n0.05,0,down\n"
    shown = looking.preview({"content": content, "range_nm": 1e9, **CIRCUMSTANCES})
    assert shown.points == 3
    assert not shown.directions


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_an_upload_is_read_as_spreadsheets_save_it(encoding: str) -> None:
    assert read_table("Größe;1,5".encode(encoding)) == "Größe;1,5"


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"\x81", b" " * (LONGEST_TABLE + 1)])
def test_an_upload_that_is_no_text_is_refused(content: bytes) -> None:
    with pytest.raises(TorquebenchError, match="upload"):
        read_table(content)


def test_the_standards_uncertainty_is_a_share_of_range_or_its_certificates_table(
    looking: TableImport, table: str
) -> None:
    asked = {**CIRCUMSTANCES, "content": table}
    without = {key: value for key, value in asked.items() if "uncertainty" not in key}
    points = {"torque_nm": [200.0, 2000.0], "expanded_uncertainty_nm": [0.4, 0.4]}
    found = [
        looking.preview(each).directions[0].uncertainty_percent
        for each in (asked, asked | {"reference_uncertainty_of": "range"},
                     without | {"reference_points": points})
    ]  # fmt: skip
    assert found[1] == pytest.approx(found[2])  # 0.02 % of 2000 N·m
    assert found[1][0] > 1.2 * found[0][0]
    assert found[1][-1] == pytest.approx(found[0][-1])
    for wrong in ({"torque_nm": [0.0], "expanded_uncertainty_nm": [0.4]},
                  {"torque_nm": [200.0, 2000.0], "expanded_uncertainty_nm": [0.4]}):  # fmt: skip
        with pytest.raises(InputError):
            looking.preview(without | {"reference_points": wrong})
