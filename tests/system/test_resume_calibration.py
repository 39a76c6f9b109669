import json
import random
import shutil
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.draws import nightly, some
from tests.system.command_line import run, run_python
from tests.system.killed_calibrations import KILLED
from tests.watching import Watching

from torquebench.bench.audit.chain import AUDIT_FILE
from torquebench.bench.audit.entries import read_audit
from torquebench.bench.description import BenchDescription, default_bench
from torquebench.calibration import Profile, load_profile
from torquebench.campaign.calibrating import measure_calibration
from torquebench.campaign.resuming import (
    find_interrupted,
    read_interrupted,
    resume_calibration,
)
from torquebench.errors import InputError, ModelMismatchError
from torquebench.records import Registry, RunFolder
from torquebench.station import Station, recover_unfinished

# One zero, then two series of ten points: in the zero, in the first, in the second, at its end.
MOMENTS = ("events-1", "events-6", "events-12", "events-16", "events-20", "room-150000")
# One zero, then 24 points in two series, then 24 placed ones.
ADAPTIVE = ("adaptive-20", "adaptive-32")


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, int]]:
    folder = tmp_path_factory.mktemp("killed")
    child = run_python(KILLED, folder, *MOMENTS, *ADAPTIVE, cwd=folder)
    assert child.returncode == 0, child.stderr
    seen = dict(json.loads(line) for line in child.stdout.splitlines())
    return {name: (folder / name, seen[name]) for name in (*MOMENTS, *ADAPTIVE)}


def copied(killed: dict[str, tuple[Path, int]], name: str, to: Path) -> Path:
    shutil.copytree(killed[name][0], to / "data")
    return to / "data"


def points_on_disk(folder: RunFolder) -> list[dict[str, Any]]:
    streams = {d["uid"] for _, d in folder.documents("descriptor") if d["name"] == "points"}
    return [d["data"] for _, d in folder.documents("event") if d["descriptor"] in streams]


@pytest.mark.parametrize("moment", some(MOMENTS, by_day=3))
def test_a_calibration_killed_at_any_moment_keeps_its_points_and_goes_on(
    killed: dict[str, tuple[Path, int]], tmp_path: Path, moment: str
) -> None:
    data, seen = copied(killed, moment, tmp_path), killed[moment][1]
    with Station.open(None, data) as station:
        before = station.registry.runs()[0]
        folder = RunFolder.open(before.folder)
        folder.verify()
        if moment.startswith("events"):
            assert [run.run_id for run in station.recovered] == [before.run_id]
            assert before.status == "interrupted"
        else:
            assert before.status in ("failed", "interrupted"), "a full disk"
        kept = points_on_disk(folder)
        assert sum(1 for _ in folder.documents("event")) >= seen, "acknowledged, so kept"
        if before.status == "failed":  # its last point may have met what stopped it
            kept = kept[:-1]
        interrupted = read_interrupted(station.registry, before)
        assert len(interrupted.points) == len(kept)
        measured = resume_calibration(station, interrupted)
        result, record = measured.result, measured.record
        table = result.data
        assert interrupted.series == 1 + len(kept) // 10
        assert table.series.tolist() == [1] * 10 + [2] * 10
        whole = kept[: 10 * (len(kept) // 10)]  # all: killed before the run could be sealed
        assert table.reading_nm[: len(whole)].tolist() == [
            each["output-steady-reading_nm"] for each in whole
        ], "as they were recorded, bit for bit"
        assert table.time_s is not None
        assert bool(np.all(np.diff(table.time_s) > 0.0))
        # The zero and the preload were done again before the series goes on.
        again = RunFolder.open(record.folder)
        names = [d["name"] for _, d in again.documents("descriptor")]
        assert names[0] == "zero_output"
        assert len(points_on_disk(again)) == 20 - len(whole)
        assert again.metadata["resumes"] == [before.run_id]
        assert again.metadata["points_of_earlier_runs"] == len(whole)
        commands = [line for line in read_audit(again.path / AUDIT_FILE) if "command" in line]
        first = next(line["torque_nm"] for line in commands if line.get("torque_nm"))
        assert abs(first) == 2000.0, "preloaded"
        errors = table.reading_nm - np.asarray(table.true_torque_nm)
        assert float(np.abs(errors).max()) < 40.0
        folder.verify()


@pytest.mark.parametrize("moment", [ADAPTIVE[0], nightly(ADAPTIVE[1])])
def test_an_adaptive_calibration_goes_on_placing_points_by_all_that_it_has(
    killed: dict[str, tuple[Path, int]], tmp_path: Path, moment: str
) -> None:
    data, seen = copied(killed, moment, tmp_path), killed[moment][1]
    with Station.open(None, data) as station:
        kept = points_on_disk(RunFolder.open(station.registry.runs()[0].folder))
        assert len(kept) >= seen - 1
        interrupted = read_interrupted(
            station.registry, find_interrupted(station.registry, "latest")
        )
        placing = len(kept) >= 24
        whole = len(kept) if placing else 12
        assert interrupted.series == (
            max(row["point-series"] for row in kept) + 1 if placing else 2
        )
        result = resume_calibration(station, interrupted).result
    table = result.data
    assert len(table) == 48
    assert table.reading_nm[:whole].tolist() == [
        row["output-steady-reading_nm"] for row in kept[:whole]
    ]
    assert result.placement is not None
    assert result.placement.coarse == 24
    assert result.placement.rounds[0].points == (whole if placing else 24)
    assert ("placed before an interruption" in result.placement.sentence) == placing
    assert bool(np.all(np.diff(table.time_s) > 0.0))
    first, counts = np.unique(table.series, return_index=True)[1], np.bincount(table.series)[1:]
    assert counts.sum() == 48
    for start, count in zip(first.tolist(), counts[counts > 0].tolist(), strict=True):
        part = table.nominal_nm[start : start + count]
        assert len({value > 0.0 for value in part.tolist() if value}) == 1, "one direction a series"
    errors = table.reading_nm - np.asarray(table.true_torque_nm)
    assert float(np.abs(errors).max()) < 40.0


def test_torn_files_are_cut_where_they_tear_and_nothing_is_invented(
    killed: dict[str, tuple[Path, int]], tmp_path: Path
) -> None:
    source = next(killed["events-16"][0].glob("runs/*"))
    whole = [d for _, d in RunFolder.open(source).documents()]
    draw = random.Random(7)
    for number in range(12):
        data = tmp_path / str(number)
        shutil.copytree(killed["events-16"][0], data)
        folder = next(data.glob("runs/*"))
        for name in ("events.jsonl", "raw.arrow", "audit.jsonl"):
            file = folder / name
            content = file.read_bytes()
            torn = content[: draw.randrange(len(content) + 1)]
            # A power cut also leaves blocks that were never written.
            file.write_bytes(torn + b"\0" * draw.choice((0, 0, 17)))
        with Registry.open(data) as registry:
            (found,) = recover_unfinished(registry)
            assert not found.problem, found.problem
            summary = registry.runs()[0]
            assert summary.status == "interrupted"
            recovered = RunFolder.open(summary.folder)
            recovered.verify()
            documents = [d for _, d in recovered.documents()]
            assert documents == whole[: len(documents)]
            if found.points:
                points = read_interrupted(registry, summary).points
                assert len(points) == found.points
            assert recover_unfinished(registry) == ()


def test_the_command_says_what_it_found_and_goes_on(
    killed: dict[str, tuple[Path, int]], tmp_path: Path
) -> None:
    data = copied(killed, "events-16", tmp_path)
    done = run("resume", "latest", "--data", data, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stderr.split())
    assert "warning 10 points of" in said
    assert "from series 2 on" in said
    assert "20 points that the models were fitted to" in " ".join(done.stdout.split())
    with Registry.open(data) as registry:
        (entry,) = registry.calibrations()
        (newest, oldest) = registry.runs()
        assert entry.run_id == newest.run_id
        assert entry.summary["goes on with"] == oldest.run_id
        assert entry.points == 20
        with pytest.raises(InputError, match="completed"):
            read_interrupted(registry, newest)
        with pytest.raises(InputError, match="names no run"):
            find_interrupted(registry, "2020")


def damage_points(data: Path, numbers: tuple[int, ...], how: str) -> RunFolder:
    """Damage the record of points of an open run: another digit, garbage with line feeds, zeros."""
    folder = RunFolder.open(next(data.glob("runs/*")))
    (stream,) = (d["uid"] for _, d in folder.documents("descriptor") if d["name"] == "points")
    file = folder.path / "events.jsonl"
    lines = file.read_bytes().split(b"\n")
    places = [n for n, line in enumerate(lines) if f'"descriptor": "{stream}"'.encode() in line]
    for number in numbers:
        line = lines[places[number]]
        lines[places[number]] = {
            "digit": line.replace(b'nominal_nm": ', b'nominal_nm": 1', 1),
            "garbage": line[:80] + b"\n\xff\x00{}\n\n" + line[150:],
            "zeros": bytes(len(line)),
        }[how]
        assert lines[places[number]] != line
    file.write_bytes(b"\n".join(lines))
    return folder


@pytest.mark.parametrize(
    ("how", "numbers"), [("garbage", (0, 7)), nightly("digit", (4,)), nightly("zeros", (9,))]
)
def test_damaged_points_alone_are_measured_again(
    killed: dict[str, tuple[Path, int]], tmp_path: Path, how: str, numbers: tuple[int, ...]
) -> None:
    data = copied(killed, "events-16", tmp_path)
    whole = [
        row["output-steady-reading_nm"]
        for row in points_on_disk(RunFolder(next(data.glob("runs/*"))))
    ]
    damage_points(data, numbers, how)
    with Station.open(None, data) as station:
        (recovered,) = station.recovered
        assert recovered.damaged.count("damaged (") == len(numbers)
        interrupted = read_interrupted(
            station.registry, find_interrupted(station.registry, "latest")
        )
        assert [(step.series, step.index) for step in interrupted.damaged] == [
            (1, number) for number in numbers
        ]
        assert interrupted.series == 2
        assert len(interrupted.kept) == 10 - len(numbers)
        measured = resume_calibration(station, interrupted)
        table = measured.result.data
        assert table.series.tolist() == [1] * 10 + [2] * 10
        kept = [number for number in range(10) if number not in numbers]
        assert table.reading_nm[kept].tolist() == [whole[number] for number in kept]
        again = points_on_disk(RunFolder.open(measured.record.folder))
        assert len(again) == 10 + len(numbers)
        known = RunFolder.open(measured.record.folder).metadata
        assert [text[:18] for text in known["damaged_points"]] == [
            f"series 1, point {number + 1}"[:18] + ":" * (number < 9) for number in numbers
        ]
        # The point was approached as its series approaches it: it is on the same branch.
        difference = [table.reading_nm[number] - whole[number] for number in numbers]
        assert float(np.abs(difference).max()) < 1.0
        errors = table.reading_nm - np.asarray(table.true_torque_nm)
        assert float(np.abs(errors).max()) < 40.0


def test_the_command_names_damaged_points(
    killed: dict[str, tuple[Path, int]], tmp_path: Path
) -> None:
    data = copied(killed, "events-16", tmp_path)
    damage_points(data, (4,), "digit")
    done = run("resume", "latest", "--data", data, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stderr.split())
    assert (
        "the record of these points was damaged, they were measured again: series 1, point 5"
        in said
    )
    with Registry.open(data) as registry:
        (entry,) = registry.calibrations()
        assert entry.points == 20
        named = entry.summary["measured again because their record was damaged"]
        assert named.startswith("series 1, point 5: 2000 N·m")


@pytest.fixture
def interrupted_bench(
    killed: dict[str, tuple[Path, int]], tmp_path: Path
) -> tuple[Path, BenchDescription]:
    return copied(killed, "events-6", tmp_path), default_bench()


@pytest.mark.parametrize(
    ("place", "value", "what"),
    [
        (("output", "transducer", "serial"), "OTHER", "transducer OTHER"),
        (("counter", "clock"), "oscillator-2", "counter SIM-COUNTER-1/oscillator-2"),
        (("calibrator", "serial"), "OTHER", "standard OTHER"),
        (("calibrator", "certificate_number"), "NEWER", "certificate number NEWER"),
    ],
)
def test_another_chain_is_refused(
    interrupted_bench: tuple[Path, BenchDescription], place: tuple[str, ...], value: str, what: str
) -> None:
    data, description = interrupted_bench
    changed = description.model_dump()
    section = changed
    for key in place[:-1]:
        section = section[key]
    section[place[-1]] = value
    with Station.open(BenchDescription.model_validate(changed), data) as station:
        interrupted = read_interrupted(
            station.registry, find_interrupted(station.registry, "latest")
        )
        with pytest.raises(ModelMismatchError, match=what):
            resume_calibration(station, interrupted)


def test_an_interruption_may_last_too_long(
    interrupted_bench: tuple[Path, BenchDescription],
) -> None:
    data, description = interrupted_bench
    with Station.open(description, data) as station:
        interrupted = read_interrupted(
            station.registry, find_interrupted(station.registry, "latest")
        )
        later = datetime.now(UTC) + timedelta(hours=25)
        with pytest.raises(InputError, match="an interruption of 25"):
            resume_calibration(station, interrupted, now=later)


def two_positions(resume: str) -> Profile:
    """One series in each of two positions, and a second one in the second of them."""
    settings = load_profile("staircase").model_dump(mode="json")
    settings["loading"] |= {"steps_percent": [50.0, 100.0], "duration_s": 0.5}
    settings["loading"] |= {"settle_limit_s": 0.0, "directions": ["clockwise"]}
    settings["preload"] |= {"cycles": 1, "on_s": 0.2, "off_s": 0.2}
    settings["zero"]["duration_s"] = 0.5
    settings["positions"] = [
        {"position_deg": 0.0, "change": "none", "series": ["up"]},
        {"position_deg": 120.0, "change": "rotation", "series": ["up", "up"]},
    ]
    settings["interruption"] = {"resume": resume, "longest_h": 1.0}
    return Profile.model_validate(settings)


@pytest.mark.parametrize(
    ("resume", "series"), [("series", 3), nightly("position", 2), nightly("never", None)]
)
def test_a_profile_says_what_an_interruption_costs(
    tmp_path: Path, resume: str, series: int | None
) -> None:
    profile = two_positions(resume)
    seats: list[float] = []
    others: list[threading.Thread] = []
    with Station.open(None, tmp_path) as station:
        stop_after = 8  # two series of three points, and two of the third

        def abort_late(_done: int, detail: str) -> None:
            if detail.startswith("series 3, point 3"):
                aborting = threading.Thread(target=station.abort, args=("enough",))
                aborting.start()
                others.append(aborting)

        original = station.run

        def watched(*arguments: Any, **options: Any) -> Any:
            return original(*arguments, **{**options, "progress": Watching(abort_late)})

        station.run = watched  # type: ignore[method-assign]
        with pytest.raises(Exception, match="enough"):
            measure_calibration(station, "output", profile)
        station.run = original  # type: ignore[method-assign]
        others[0].join()
        interrupted = read_interrupted(
            station.registry, find_interrupted(station.registry, "latest")
        )
        assert len(interrupted.points) >= stop_after
        seat = station.drivers.operator.seat

        def noted(seating: Any) -> None:
            seats.append(seating.position_deg)
            seat(seating)

        station.drivers.operator.seat = noted  # type: ignore[method-assign]
        if series is None:
            with pytest.raises(InputError, match="without interruption"):
                resume_calibration(station, interrupted)
            return
        assert interrupted.series == series
        result = resume_calibration(station, interrupted).result
        assert seats == [120.0], "seated again where it had been"
        assert result.data.series.tolist() == [1] * 3 + [2] * 3 + [3] * 3
        assert result.data.position_deg is not None
        assert result.data.position_deg.tolist() == [0.0] * 3 + [120.0] * 6
