import json
import sqlite3
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import StaticPool, create_engine, event, inspect, text

from torquebench.errors import InputError, RecordError
from torquebench.records import Equipment, Registry, check_records
from torquebench.records.chain import canonical
from torquebench.records.registry.database import REGISTRY_URL, entries_query
from torquebench.records.registry.database_check import schema_changes
from torquebench.records.registry.entries import (
    Adjustment,
    Amendment,
    CheckEntry,
    Registered,
    Report,
    RunEnd,
    RunSummary,
    VerificationEntry,
    Zeroing,
    facts,
    metadata,
)
from torquebench.records.registry.migrating import upgrade
from torquebench.records.registry.migrations import versions
from torquebench.records.registry.schema_version import SCHEMA_VERSION

START = datetime(2025, 1, 31, 12, 0, tzinfo=UTC)


def test_the_migrations_give_the_tables_that_the_code_writes(registry, around):
    with around.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, metadata) == []
        found = {
            index["name"]
            for table in metadata.tables
            for index in inspect(connection).get_indexes(table)
        }
    wanted = {index.name for table in metadata.tables.values() for index in table.indexes}
    assert wanted <= found


MADE_BY_0_2_0 = (Path(__file__).parent / "registry_0_2_0.sql").read_text(encoding="utf-8")
"""The dump of a registry that 0.2.0 wrote, with at least one row in each table."""


@pytest.fixture
def registry_of_0_2_0(tmp_path):
    with closing(sqlite3.connect(tmp_path / "registry.sqlite")) as connection:
        connection.executescript(MADE_BY_0_2_0)
    return tmp_path


def test_a_registry_of_0_2_0_is_upgraded_with_its_chain_unchanged(registry_of_0_2_0):
    head = "30:6aab1a32e6e6d5b2ad53004d28790928bed5d24e0b1a39e1a4577dc370f212c4"
    with Registry.open(registry_of_0_2_0) as registry:
        assert str(registry.head()) == head
        report = check_records(registry, folders=False)
        assert (report.findings, report.records) == ((), 30)
        assert list(schema_changes(registry)) == []
        kinds = Registered.__subclasses__()
        assert all(registry.entries(kind) for kind in kinds)
        assert len(kinds) == len(metadata.tables) - 1  # the chain isn't one
        (calibration,) = registry.calibrations("T-1")
        assert dict(facts(calibration))["standard"] == "R-9"
        assert calibration.valid_nm == (0.0, 10.0)
        assert calibration.summary["placement"].as_plain()["template"] == "{count} points"
        assert calibration.signature is None
        assert calibration.temperature_c is None
        registry.add_equipment(Equipment("bench", "Bench 5"))
        assert check_records(registry, folders=False).intact


def test_the_same_entries_get_the_same_content_as_in_0_2_0(registry_of_0_2_0):
    """The chain covers the content: an entry of 0.2.0 that is added again is equal in its bytes."""
    with Registry.open(registry_of_0_2_0) as old:
        again = {
            kind: [old.add(entry) for entry in old.entries(kind)]
            for kind in (Zeroing, CheckEntry, VerificationEntry, Adjustment, Report, Amendment)
        }
        content = {(link.table, link.key): link.content for link in old.links()}
        for kind, numbers in again.items():
            table = kind.__tablename__
            for before, now in enumerate(numbers, start=1):
                was, is_now = (json.loads(content[table, number]) for number in (before, now))
                for changing in ("id", "recorded", "signature"):
                    was.pop(changing, None), is_now.pop(changing, None)
                assert canonical(is_now) == canonical(was)


def test_the_tables_of_0_2_0_are_made_as_it_made_them():
    """They are derived from the entries; a stored registry has the columns of its version."""
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.executescript(MADE_BY_0_2_0)
        wanted = dict(connection.execute("SELECT name, sql FROM sqlite_master WHERE sql NOT NULL"))
    engine = create_engine("sqlite://", poolclass=StaticPool)
    upgrade(engine, to="0003")
    with engine.connect() as connection:
        query = text("SELECT name, sql FROM sqlite_master WHERE sql NOT NULL")
        made = dict(connection.execute(query).all())
    engine.dispose()
    assert {name: sql.split() for name, sql in made.items()} == {
        name: sql.split() for name, sql in wanted.items()
    }


def test_the_newest_migration_is_the_version_that_is_written():
    import importlib
    import pkgutil

    names = sorted(module.name for module in pkgutil.iter_modules(versions.__path__))
    modules = [importlib.import_module(f"{versions.__name__}.{name}") for name in names]
    assert modules[-1].revision == SCHEMA_VERSION
    assert [module.down_revision for module in modules] == [
        None,
        *(module.revision for module in modules[:-1]),
    ]


def test_opening_again_changes_nothing(registry, tmp_path, registry_url):
    before = registry.head()
    with Registry.open(tmp_path, registry_url) as again:
        assert again.head() == before


def test_a_registry_of_a_newer_version_is_refused(registry, around, tmp_path, registry_url):
    with around.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(RecordError, match=r"has the schema 9999; allowed: 0005 or older"):
        Registry.open(tmp_path, registry_url)


def test_a_registry_before_the_first_release_is_refused(registry, around, tmp_path, registry_url):
    with around.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '0002'"))
    with pytest.raises(RecordError, match=r"0002 of a version before 0.2.0.*records rebuild"):
        Registry.open(tmp_path, registry_url)


def test_every_table_refuses_changes(registry, around):
    with around.connect() as connection:
        if around.dialect.name == "sqlite":
            names = "SELECT name FROM sqlite_master WHERE type = 'trigger'"
        else:
            names = "SELECT tgname FROM pg_trigger WHERE NOT tgisinternal"
        triggers = {name.removesuffix("_update").removesuffix("_delete")
                    for (name,) in connection.execute(text(names))}  # fmt: skip
    assert triggers == {f"keep_{table}" for table in metadata.tables}


def test_a_database_with_other_tables_is_refused(around, tmp_path, registry_url):
    with around.begin() as connection:
        connection.execute(text("CREATE TABLE guests (id INTEGER)"))
    with pytest.raises(RecordError, match="holds other tables: guests"):
        Registry.open(tmp_path, registry_url)


def test_the_registry_may_be_named_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv(REGISTRY_URL, f"sqlite:///{tmp_path}/elsewhere.sqlite")
    with Registry.open(tmp_path / "data") as registry:
        assert registry.name.endswith("elsewhere.sqlite")
    assert not (tmp_path / "data" / "registry.sqlite").exists()


@pytest.mark.parametrize("url", ["nonsense", "mysql://user@server/database", "sqlite+x:///a"])
def test_a_url_of_something_else_is_refused(tmp_path, url):
    with pytest.raises(InputError, match="registry"):
        Registry.open(tmp_path, url)


def test_a_server_that_does_not_answer_is_named_without_its_password(tmp_path):
    socket = tmp_path / "none"
    with pytest.raises(RecordError, match=r"user:\*\*\*@/registry") as caught:
        Registry.open(tmp_path, f"postgresql://user:secret@/registry?unix_sock={socket}")
    assert "secret" not in str(caught.value)


def test_a_refusal_says_how_long_a_server_was_tried(tmp_path):
    url = f"postgresql://user@/registry?unix_sock={tmp_path / 'none'}"
    with pytest.raises(RecordError, match=r"can't be opened: .*; it was tried for 0.3 s"):
        Registry.open(tmp_path, url, longest_s=0.3)


def enter_runs(engine, count):
    begun = [
        {
            "id": number + 1,
            "run_id": f"run-{number:06}",
            "kind": ("calibrate-output", "verify-output", "zero")[number % 3],
            "started": START + timedelta(minutes=(number * 7919) % count),
            "side": "output",
            "operator": "Ana",
            "bench": "Bench 1",
            "simulated": True,
            "profile_name": "",
            "profile_sha256": "",
            "software_version": "0.1.0",
            "folder": f"runs/run-{number:06}",
        }
        for number in range(count)
    ]
    ends = [
        {
            "run_key": run["id"],
            "finished": run["started"],
            "status": "completed",
            "reason": "",
            "manifest_sha256": "",
        }
        for run in begun
    ]
    with engine.begin() as connection:
        connection.execute(RunSummary.__table__.insert(), begun)
        connection.execute(RunEnd.__table__.insert(), ends)
        connection.execute(text("ANALYZE"))


def test_the_first_page_of_a_long_list_of_runs_reads_that_page_only(registry, around):
    enter_runs(around, 3000)
    page = registry.runs(limit=50)
    assert [run.started for run in page] == [
        START + timedelta(minutes=2999 - number) for number in range(50)
    ]
    for kind in (None, "zero"):
        query = entries_query(RunSummary, order=("started", "id"), newest_first=True, kind=kind)
        steps = plan_of(around, query.limit(50))
        assert "SCAN run_ends" not in steps
        assert "Seq Scan" not in steps
        assert "TEMP B-TREE" not in steps
        assert "Sort" not in steps
        assert "ix_runs_" in steps


def plan_of(engine, query):
    explain = "EXPLAIN QUERY PLAN " if engine.dialect.name == "sqlite" else "EXPLAIN "
    compiled = query.compile(engine, compile_kwargs={"literal_binds": True})
    with engine.connect() as connection:
        return "\n".join(str(row) for row in connection.exec_driver_sql(explain + str(compiled)))


def test_the_list_of_runs_is_one_query(registry, around):
    enter_runs(around, 20)
    seen = []
    engine = registry._engine
    event.listen(engine, "before_cursor_execute", lambda *arguments: seen.append(arguments[2]))
    assert len(registry.runs(limit=10)) == 10
    assert registry.number_of_runs() == 20
    queries = [statement for statement in seen if statement.startswith("SELECT")]
    assert len(queries) == 2
    assert "count(" in queries[1]


def test_runs_are_found_by_the_beginning_of_their_name(registry, around):
    enter_runs(around, 30)
    assert [run.run_id for run in registry.runs_beginning("run-00002")] == [
        f"run-00002{digit}" for digit in range(10)
    ]
    assert registry.runs_beginning("x") == []
    assert len(registry.runs_beginning("", limit=7)) == 7
