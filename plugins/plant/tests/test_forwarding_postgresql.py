"""Records of benches arrive in the plant once, complete and in order, despite interruptions."""

import shutil
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from plugins.plant.tests.plant_bench import (
    START,
    add_run,
    backlash_results,
    calibration_results,
    filled,
)
from sqlalchemy import text
from sqlalchemy.engine import URL, make_url
from tests import postgresql_server
from tests.support.draws import nightly

from torquebench.calibration import CalibrationData
from torquebench.errors import InputError, RecordError
from torquebench.progress import NoProgress
from torquebench.records import CalibrationEntry, Registry, RunFolder, UnavailableError
from torquebench.records.registry import metadata
from torquebench.station.entering import enter_run
from torquebench_plant import FolderStore, Plant, forward
from torquebench_plant.database import PlantDatabase
from torquebench_plant.forwarding import BenchLink


def sent(data: Path, url: URL) -> Any:
    with Registry.open(data) as registry:
        return forward(registry, url)


def counted(plant: Plant, table: str) -> int:
    with plant.transaction() as connection:
        return int(connection.scalar(text(f"SELECT count(*) FROM plant.{table}")) or 0)


def test_everything_arrives_once(plant: Plant, tmp_path: Path) -> None:
    data = filled(tmp_path / "data")
    _, url = plant.register_bench("Bench 1", "Hall 3")
    first, again = sent(data, url), sent(data, url)
    assert first.problems == []
    assert (first.folders, again.entries, again.folders) == (4, 0, 0)
    with Registry.open(data) as registry:
        assert again.head == registry.head() == first.head
        assert first.entries == registry.head().sequence
    (state,) = plant.benches()
    assert (state.runs, state.folders) == (4, 4)
    assert plant.verify_chain(state) == (first.entries, [])
    found = plant.runs()
    assert [run.kind for run in found] == ["calibrate-output"] + ["test-hysteresis"] * 3
    assert [(run.serial, run.batch) for run in found[1:]] == [
        ("S-3", "B2"),
        ("S-2", "B1"),
        ("S-1", "B0"),
    ]
    store = FolderStore(plant.folders_url)
    with Registry.open(data) as registry:
        for run in found:
            manifest = registry.run(run.run_id).manifest_sha256
            assert store.verify(run.url, manifest) == []
    changed = Path(store.path(found[0].url)) / "results.json"
    changed.write_text("{}")
    with Registry.open(data) as registry:
        (problem,) = store.verify(found[0].url, registry.run(found[0].run_id).manifest_sha256)
    assert "results.json was changed" in problem


def test_progress_is_shown_of_what_is_sent_only(plant: Plant, tmp_path: Path) -> None:
    class Shown(NoProgress):
        def __init__(self) -> None:
            self.steps: list[tuple[str, int | None]] = []

        def start(self, title: str, total: int | None = None) -> None:
            self.steps.append((title, total))

    _, url = plant.register_bench("Bench 1")
    with Registry.open(filled(tmp_path / "data")) as registry:
        first, again = Shown(), Shown()
        entries = forward(registry, url, first).entries
        forward(registry, url, again)
    assert first.steps == [("Sending entries", entries), ("Sending run folders", 4)]
    assert again.steps == []


def test_every_table_of_a_bench_is_known_to_the_plant(plant: Plant) -> None:
    with plant.transaction() as connection:
        names = set(
            connection.scalars(
                text("SELECT table_name FROM information_schema.tables WHERE table_schema='plant'")
            )
        )
    assert set(metadata.tables) - names == {"chain", "run_ends"}  # as links; in runs


@pytest.mark.parametrize("kept", [0, nightly(1), 2, nightly(5)])
def test_a_link_that_goes_down_loses_and_repeats_nothing(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: int
) -> None:
    """The link is cut when the plant has stored data, before the bench gets the answer."""
    data = filled(tmp_path / "data")
    _, url = plant.register_bench("Bench 1")
    monkeypatch.setattr("torquebench_plant.forwarding.BATCH", 3)
    calls = iter(range(100))
    whole = BenchLink.append

    def cut(self: BenchLink, entries: list[dict[str, Any]]) -> Any:
        answer = whole(self, entries)
        if next(calls) == kept:
            raise UnavailableError("the link is down")
        return answer

    monkeypatch.setattr(BenchLink, "append", cut)
    with pytest.raises(UnavailableError):
        sent(data, url)
    monkeypatch.setattr(BenchLink, "append", whole)
    done = sent(data, url)
    (state,) = plant.benches()
    with Registry.open(data) as registry:
        assert done.head == registry.head() == state.head
        assert counted(plant, "links") == registry.head().sequence
    assert plant.verify_chain(state)[1] == []
    assert (state.runs, state.folders) == (4, 4)


def test_a_folder_that_was_cut_off_is_sent_again(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = filled(tmp_path / "data")
    _, url = plant.register_bench("Bench 1")
    put = FolderStore.put

    def cut(self: FolderStore, where: str, content: bytes) -> None:
        if "test-hysteresis-0001/manifest" in where:
            raise RecordError("the share is away")
        put(self, where, content)

    monkeypatch.setattr(FolderStore, "put", cut)
    done = sent(data, url)
    assert (done.folders, len(done.problems)) == (3, 1)
    monkeypatch.setattr(FolderStore, "put", put)
    done = sent(data, url)
    assert (done.entries, done.folders, done.problems) == (0, 1, [])
    assert counted(plant, "results") == 3


def test_a_changed_folder_is_not_sent(plant: Plant, tmp_path: Path) -> None:
    data = filled(tmp_path / "data")
    (data / "runs" / "20260105T000000Z-test-hysteresis-0000" / "results.json").write_text("{}")
    _, url = plant.register_bench("Bench 1")
    done = sent(data, url)
    assert done.folders == 3
    assert "changed after sealing" in done.problems[0]
    assert not list((tmp_path / "share").rglob("*.part"))


def test_benches_of_one_name_with_the_same_runs_stay_apart(plant: Plant, tmp_path: Path) -> None:
    one, other = filled(tmp_path / "one"), filled(tmp_path / "other", prefix="Z")
    (_, first), (_, second) = plant.register_bench("Bench"), plant.register_bench("Bench")
    sent(one, first)
    sent(other, second)
    assert [state.title for state in plant.benches()] == ["1 Bench", "2 Bench"]
    assert len(plant.runs()) == 8
    run_id = "20260105T000000Z-test-hysteresis-0000"
    assert [plant.run(run_id, bench).serial for bench in (1, 2)] == ["S-1", "Z-1"]
    assert len({run.url for run in plant.runs()}) == 8
    with pytest.raises(InputError, match=r"of 2 benches: . Bench, . Bench"):
        plant.run(run_id)


def test_a_registry_that_was_changed_is_refused(plant: Plant, tmp_path: Path) -> None:
    """If a row and its link are rewritten, the next link's hash doesn't match."""
    data = filled(tmp_path / "data")
    _, url = plant.register_bench("Bench 1")
    with Registry.open(data) as registry:
        for statement in (
            "DROP TRIGGER keep_chain_update",
            "UPDATE chain SET content = replace(content, 'Ana', 'Bob') WHERE \"table\" = 'runs'",
        ):
            registry.execute(statement)
    with pytest.raises(RecordError, match="doesn't continue the chain"):
        sent(data, url)
    assert counted(plant, "links") == 0


def test_a_copy_an_older_state_and_another_registry_are_refused(
    plant: Plant, tmp_path: Path
) -> None:
    data = filled(tmp_path / "data", 1)
    old = shutil.copytree(data, tmp_path / "old")
    (_, url), (_, other) = plant.register_bench("Bench 1"), plant.register_bench("Bench 2")
    with Registry.open(data) as registry:
        add_run(registry, "late", "test-hysteresis", backlash_results("S-9"), hours=30)
    sent(data, url)
    with pytest.raises(RecordError, match="doesn't have the last of them"):
        sent(old, url)
    with pytest.raises(InputError, match="as bench 1 Bench 1"):
        sent(data, other)
    with pytest.raises(RecordError, match="it is a copy"):
        sent(old, other)
    # A registry that was made anew goes on in the place of the old one.
    _, anew = plant.register_bench("Bench 1", replaces=1)
    sent(filled(tmp_path / "anew", 2), anew)
    assert {run.bench for run in plant.runs()} == {"3 Bench 1"}


def test_a_bench_can_add_its_own_rows_only(plant: Plant, tmp_path: Path) -> None:
    _, url = plant.register_bench("Bench 1")
    _, other = plant.register_bench("Bench 2")
    sent(filled(tmp_path / "data"), other)
    with BenchLink(url) as link:
        for statement in (
            "SELECT * FROM plant.runs",
            "INSERT INTO plant.results VALUES (2, 'x', 'y', '', 1, 1, '', '', '')",
            "UPDATE plant.benches SET name = 'mine'",
            "DELETE FROM plant.links",
            "SELECT plant.withdraw(2, '20260105T000000Z-test-hysteresis-0000', 'me', 'so')",
            "SELECT plant.note_rows(2, 0)",
            "SELECT plant.mark_withdrawn(2, 0)",
        ):
            with pytest.raises(RecordError, match="permission denied"), link.transaction() as it:
                it.execute(text(statement))
        assert link.missing_folders() == []
        stolen = {
            "run_id": "20260105T000000Z-test-hysteresis-0000",
            "manifest_sha256": "0" * 64,
            "url": f"{plant.folders_url}/1-Bench-1/x",
            "bytes": 1,
            "left_out": [],
            "facts": {"quantities": []},
        }
        with pytest.raises(RecordError, match="isn't in the chain"):
            link.arrived([stolen])
        sent(filled(tmp_path / "own"), url)
        with Registry.open(tmp_path / "own") as registry:
            known = registry.run(str(stolen["run_id"])).manifest_sha256
        elsewhere = {**stolen, "manifest_sha256": known}
        for outside in ("2-Bench-2/x", "x", "11-Bench/x", "1-Bench-1/../2-Bench-2/x"):
            path = f"{plant.folders_url}/{outside}"
            with pytest.raises(RecordError, match="lies outside"):
                link.arrived([{**elsewhere, "url": path}])
            with pytest.raises(RecordError, match="lies outside"):
                link.arrived([{**elsewhere, "points_url": path}])
    with pytest.raises(RecordError, match="never changed"), plant.transaction() as connection:
        connection.execute(text("UPDATE plant.links SET content = ''"))


DISK_FILLING = (
    "CREATE TEMP TABLE large AS SELECT repeat('x', 1000) FROM generate_series(1, 10)",
    "SELECT lo_create(0)",
    "SELECT lo_creat(-1)",
    "SELECT lo_from_bytea(0, decode(repeat('00', 1000), 'hex'))",
    "CREATE TABLE public.large (content text)",
)
"""What 0.2.0 let a bench's role do, as large as it likes and seen by no query of the plant."""


def test_a_bench_cannot_fill_the_disk_beside_its_records(plant: Plant, tmp_path: Path) -> None:
    _, url = plant.register_bench("Bench 1")
    assert plant.open_rights() == []
    with BenchLink(url) as link:
        for statement in DISK_FILLING:
            with pytest.raises(RecordError, match="permission denied"), link.transaction() as one:
                one.exec_driver_sql(statement)
    sent(filled(tmp_path / "data"), url)
    assert counted(plant, "links") > 0


def test_rights_that_only_the_servers_administrator_can_take_are_told(
    plant_socket: Path, tmp_path: Path
) -> None:
    """The owner of a database isn't the owner of the server's own functions."""
    admin = make_url(postgresql_server.create_database(plant_socket, "owned"))
    with PlantDatabase(admin) as server, server.transaction() as connection:
        connection.exec_driver_sql("CREATE ROLE owner LOGIN CREATEROLE")
        connection.exec_driver_sql("ALTER DATABASE owned OWNER TO owner")
    folders = f"file://{tmp_path}/share"
    with Plant.create(admin.set(username="owner"), folders) as plant:
        missing = plant.open_rights()
        assert len(missing) >= 3
        assert all("lo_" in statement for statement in missing)
        with PlantDatabase(admin) as server, server.transaction() as connection:
            for statement in missing:
                connection.exec_driver_sql(statement)
        assert plant.open_rights() == []


@pytest.mark.parametrize(
    ("ahead", "said"),
    [
        (timedelta(days=3 * 365.25), "is 3 years ahead"),
        (timedelta(days=-30), "is 30 days behind"),
    ],
)
def test_a_bench_whose_clock_is_wrong_by_days_sends_nothing(
    ahead: timedelta, said: str, plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, url = plant.register_bench("Bench 1")
    data = filled(tmp_path / "data")
    set_clock(monkeypatch, ahead)
    with pytest.raises(InputError, match=said) as refused:
        sent(data, url)
    assert "NTP" in refused.value.remedy
    assert counted(plant, "links") == 0
    monkeypatch.undo()
    assert sent(data, url).clock == ""


def test_a_bench_whose_clock_is_wrong_by_minutes_is_told(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, url = plant.register_bench("Bench 1")
    set_clock(monkeypatch, timedelta(minutes=10))
    done = sent(filled(tmp_path / "data"), url)
    assert "ahead of the plant's" in done.clock
    assert done.entries > 0


def test_a_bench_whose_entries_are_of_the_future_stands_out(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bench's clock was wrong while it measured, and right when it sent."""
    (_, url), (_, right) = plant.register_bench("Bench 1"), plant.register_bench("Bench 2")
    sent(filled(tmp_path / "right", prefix="R"), right)
    set_clock(monkeypatch, timedelta(days=1000), "torquebench.records.registry.database")
    data = filled(tmp_path / "data")
    monkeypatch.undo()
    sent(data, url)
    ahead, in_time = (state.ahead_s for state in plant.benches())
    assert ahead == pytest.approx(1000 * 86_400, rel=0.01)
    assert in_time == 0.0


def set_clock(
    monkeypatch: pytest.MonkeyPatch, ahead: timedelta, module: str = "torquebench_plant.forwarding"
) -> None:
    """Set the clock that a module reads."""

    class Clock(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> datetime:
            return datetime.now(tz) + ahead

    monkeypatch.setattr(f"{module}.datetime", Clock)


def test_a_trigger_of_a_bench_never_acts_with_the_rights_of_the_administrator(
    plant: Plant, tmp_path: Path
) -> None:
    """A function with its owner's rights would also run triggers of the tables that it changes."""
    _, url = plant.register_bench("Bench 1")
    sent(filled(tmp_path / "data"), url)
    with plant.transaction() as connection:  # as on a server that takes no right from anybody
        connection.exec_driver_sql(f'GRANT TEMPORARY ON DATABASE "{plant.url.database}" TO PUBLIC')
    with BenchLink(url) as link, link.transaction() as connection:
        for name in ("arriving", "folders", "runs", "results", "links", "benches"):
            connection.execute(text(f"CREATE TEMP TABLE {name} (run_id text, facts json)"))
            connection.execute(text(f"GRANT ALL ON pg_temp.{name} TO PUBLIC"))
        connection.exec_driver_sql(
            "CREATE FUNCTION pg_temp.stolen() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
            "INSERT INTO plant.settings VALUES ('stolen', current_user); RETURN NULL; END $$"
        )
        for name in ("arriving", "folders", "runs", "results", "links", "benches"):
            connection.execute(
                text(
                    f"CREATE TRIGGER stolen BEFORE INSERT OR UPDATE OR DELETE ON pg_temp.{name} "
                    "FOR EACH STATEMENT EXECUTE FUNCTION pg_temp.stolen()"
                )
            )
        connection.execute(text("SELECT * FROM plant.append('[]'::json)"))
        connection.execute(text("SELECT plant.arrived('[]'::json)"))
    with plant.transaction() as connection:
        names = set(connection.scalars(text("SELECT name FROM plant.settings")))
    assert names == {"version", "folders", "identity"}


def test_a_plant_of_another_version_is_refused_with_what_to_do(plant: Plant) -> None:
    """Its tables lack the fields that records have gained since."""
    with plant.transaction() as connection:
        connection.execute(text("UPDATE plant.settings SET content = '1' WHERE name = 'version'"))
    with pytest.raises(RecordError, match=r"version 1.*one of version 2.*plant init"):
        Plant.open(plant.url)


def test_a_withdrawn_run_is_withdrawn_everywhere(plant: Plant, tmp_path: Path) -> None:
    """Withdraw runs in the plant or at a bench, also if two benches have the same run."""
    data = filled(tmp_path / "data")
    copy = tmp_path / "copy"
    shutil.copytree(data / "runs", copy / "runs")
    with Registry.open(copy, f"sqlite:///{copy / 'registry.sqlite'}") as registry:
        for folder in sorted((copy / "runs").iterdir()):
            enter_run(registry, RunFolder(folder))
    (_, url), (_, second) = plant.register_bench("Bench 1"), plant.register_bench("Bench 2")
    sent(data, url)
    sent(copy, second)
    first, later = (f"20260105T0{k}0000Z-test-hysteresis-000{k}" for k in (0, 1))
    assert plant.withdraw(plant.run(first, 1), by="Boss", reason="wrong oil") == 2
    assert len(plant.runs(withdrawn=False)) == 6
    for folder, link in ((data, url), (copy, second)):
        done = sent(folder, link)
        assert len(done.withdrawn) == 1
        with Registry.open(folder) as registry:
            assert registry.discarded(first)
        assert sent(folder, link).withdrawn == []
    with pytest.raises(InputError, match="wrong oil"):
        plant.withdraw(plant.run(first, 2), by="Boss", reason="again")
    with Registry.open(data) as registry:
        registry.discard_run(later, by="Ana", reason="slipped")
    sent(data, url)
    assert {run.run_id for run in plant.runs(withdrawn=True)} == {first, later}
    assert plant.run(later, 2).withdrawn_reason == "slipped"
    sent(copy, second)
    with Registry.open(copy) as registry:
        assert registry.discarded(later)


def test_a_model_of_a_withdrawn_calibration_goes_out_of_use(plant: Plant, tmp_path: Path) -> None:
    data = tmp_path / "data"
    run_id = "20260105T090000Z-calibrate-output-0009"
    with Registry.open(data) as registry:
        add_run(registry, run_id, "calibrate-output", calibration_results())
        points = CalibrationData(**calibration_results()["data"])
        entry = registry.add_calibration(
            CalibrationEntry.of_points(points, performed=START, run_id=run_id)
        )
        (tmp_path / "model.json").write_text("{}")
        model = registry.add_model(
            entry, kind="polynomial", file=tmp_path / "model.json", metrics={}
        )
        registry.activate(model.model_id)
    _, url = plant.register_bench("Bench 1")
    sent(data, url)
    plant.withdraw(plant.run(run_id), by="Boss", reason="wrong standard")
    (said,) = sent(data, url).withdrawn
    assert "out of use" in said
    with Registry.open(data) as registry:
        assert registry.active_model("T-1", "C-1/oscillator") is None


def test_text_that_json_escapes_arrives_as_it_is(plant: Plant, tmp_path: Path) -> None:
    odd = 'a "quoted" \\ back\\slash \\u0000 \x00 \x01\x1f\x7f \n tab\t µ 中 \u2028 \U0001f600'
    data = tmp_path / "data"
    with Registry.open(data) as registry:
        folder = add_run(registry, "one", "test-hysteresis", backlash_results("S-1"))
        end = registry.runs()[0]
        assert folder.sealed
        registry.amend("runs", 1, {"operator": odd}, amended_by="Ana", reason=odd)
        assert end.run_id == "one"
    _, url = plant.register_bench("Bench 1")
    done = sent(data, url)
    with Registry.open(data) as registry:
        assert done.head == registry.head()


def test_a_plant_made_again_in_its_database_registers_benches(plant: Plant, tmp_path: Path) -> None:
    _, before = plant.register_bench("Bench 1")
    folders = plant.folders_url
    with plant.transaction() as connection:
        connection.execute(text("DROP SCHEMA plant CASCADE"))
    with Plant.create(plant.url, folders) as again:
        number, url = again.register_bench("Bench 1")
        assert (number, url.username == before.username) == (1, False)
        assert sent(filled(tmp_path / "data"), url).folders == 4
        again.add_reader(f"anna_{again.url.database}")
        with pytest.raises(RecordError, match=r"already exists.*choose another name"):
            again.add_reader(f"anna_{again.url.database}")
    wrong = url.set(username="nobody_known")
    with pytest.raises(RecordError, match="user and password in the URL"):
        Plant.open(wrong)
    refused = pytest.raises(RecordError, match="role that may do this")
    with BenchLink(url) as link, refused, link.transaction() as connection:
        connection.execute(text("SELECT * FROM plant.runs"))


def test_what_is_no_plant_is_named(plant: Plant, plant_socket: Path, tmp_path: Path) -> None:
    empty = postgresql_server.create_database(plant_socket, f"empty_{tmp_path.name}")
    with pytest.raises(RecordError, match="no plant's registry"):
        Plant.open(empty)
    with pytest.raises(InputError, match="needs a server"):
        Plant.open("sqlite:///x")
    with pytest.raises(RecordError, match="has a schema"):
        Plant.create(plant.url, "file:///x")
    with pytest.raises(InputError, match="is no bench"), Registry.open(tmp_path / "d") as registry:
        forward(registry, plant.url)
    with pytest.raises(InputError, match="bench number 9"):
        plant.register_bench("Bench", replaces=9)
