"""One reading through every interface: each states the same torque and the same U."""

import csv
import json
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from importlib import resources
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, Self

import h5py
import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray
from tests.support.draws import nightly
from tests.system.command_line import run
from tests.unit.chain.test_measuring_chain import EFFECTS_OF_ALL_KINDS
from tests.unit.chain.test_turning_chains import INERTIA, TURNING, WARMTH

import torquebench as tb
from torquebench.bench import default_bench
from torquebench.bench.active_chain import ActiveChain, ZeroTaken
from torquebench.bench.blocks import CONDITIONS as BLOCK_CONDITIONS
from torquebench.bench.blocks import Block, Viewer
from torquebench.bench.chain_effects import chain_effects, with_stated_limits
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import DEFAULT_BENCH, BenchDescription, CertifiedPoints
from torquebench.bench.devices import Recorder
from torquebench.calibration import CalibrationData, verify
from torquebench.campaign.checking import judge_check
from torquebench.campaign.fitting import store_model
from torquebench.campaign.reducers.uncertainty import Bench, torque_uncertainty
from torquebench.chain import (
    Component,
    Effect,
    Inertia,
    MeasuringChain,
    Readings,
    Reference,
    Ripple,
    Rotation,
    Shared,
    SwitchedOff,
    Torque,
    TorqueParts,
    load_chain,
)
from torquebench.cli.measure import _torque as live_torque
from torquebench.compensation import make_model, save_model
from torquebench.panel.service.live.hub import LatestValue, LiveHub
from torquebench.panel.service.live.snapshot import (
    CompensationState,
    side_snapshots,
)
from torquebench.procedures.reducers.running_table import RunningRecording
from torquebench.records import RunFolder
from torquebench.records.export.streams import export_streams
from torquebench.reports.certificate.record import Reference as StatedReference
from torquebench.reports.certificate.results import evaluate_results
from torquebench.signals import Record
from torquebench.station.journal import RunJournal
from torquebench.uncertainty import CertifiedUncertainty
from torquebench_opcua import live_values
from torquebench_sparkplug.metrics import _side as side_metrics

FloatArray = NDArray[np.float64]

RANGE_NM = 2000.0
READING_NM = 1500.0
COUNTER_NM = 0.004
TEMPERATURE_C = 25.5


@dataclass(frozen=True)
class Told:
    """Torque and U by one interface."""

    torque_nm: float
    expanded_nm: float

    @classmethod
    def of(cls, torque: Torque) -> Self:
        return cls(float(torque.value_nm[0]), float(torque.expanded_uncertainty_nm[0]))


@dataclass(frozen=True)
class Conditions:
    """What was measured with the reading, right after zeroing."""

    speed_rpm: float = 0.0
    acceleration_rad_s2: float = 0.0
    temperature_c: float = TEMPERATURE_C
    zero_temperature_c: float = TEMPERATURE_C
    angle_rad: float = 0.0
    window_s: float = 0.01


CONDITIONS = {"file": Conditions(), "turning": Conditions(310.0, 4.0, 31.0, 24.0, 1.1)}
RIPPLE = Ripple(
    "empty runs", 1000.0, 0.01, (1.0,), ((0.2, 0.0, 0.1, 0.0, 0.0),), ((0.1, 0.0, 0.2, 0.0, 0.0),),
    (0.0, 1000.0), (0.01, 0.03),
)  # fmt: skip


def certified_bench() -> BenchDescription:
    """Return the simulated bench with a calibrator whose certificate has a table."""
    points = CertifiedPoints(torque_nm=[40.0, 2000.0], expanded_uncertainty_nm=[0.02, 0.2])
    bench = default_bench()
    calibrator = bench.calibrator.model_copy(update={"certified": {"output": points}})
    return bench.model_copy(update={"calibrator": calibrator})


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    share = np.linspace(0.05, 1.0, 15)
    share = np.concatenate([share, share[::-1], -share, -share[::-1]])
    branch = np.repeat([1, -1, 1, -1], 15)
    noise = 1e-4 * np.random.default_rng(4).standard_normal(share.size)
    loop = 3e-4 * np.sign(share) * branch * (1.0 - np.abs(share))
    reading = RANGE_NM * (0.997 * share + 1e-3 * share**2 + loop + noise)
    data = CalibrationData(reading, RANGE_NM * share, np.repeat([1, 2], 30), branch, RANGE_NM)
    model = make_model("hybrid", range_nm=RANGE_NM).fit(data.features(2), data.standard_nm)
    path = tmp_path_factory.mktemp("chain") / "model.json"
    store_model(path, model, data, {}, chain_effects(certified_bench(), "output", 23.0))
    return path


def by_rows(chain: MeasuringChain, at: Conditions, *, steady: bool = False) -> Torque:
    """A single reading; or a steady mean, which has no acceleration and no ripple."""
    return chain.torque(
        Readings(
            np.array([READING_NM]),
            branch=np.ones(1),
            counter_nm=COUNTER_NM,
            speed_rpm=at.speed_rpm,
            acceleration_rad_s2=0.0 if steady else at.acceleration_rad_s2,
            angle_rad=None if steady else at.angle_rad,
            window_s=np.inf if steady else at.window_s,
            temperature_c=at.temperature_c,
            zero_age_h=0.0,
            zero_temperature_c=at.zero_temperature_c,
        )
    )


def by_apply(file: Path, at: Conditions, folder: Path) -> Told:
    header = "reading_nm,branch,speed_rpm,acceleration_rad_s2,angle_deg,temperature_c"
    angle_deg = float(np.degrees(at.angle_rad))
    row = f"{READING_NM},up,{at.speed_rpm},{at.acceleration_rad_s2},{angle_deg!r}"
    table = f"# window_s = {at.window_s}\n{header},standard_error_nm\n"
    table += f"{row},{at.temperature_c},{COUNTER_NM}\n"
    (folder / "readings.csv").write_text(table)
    options = ("--zero-age", 0, "--zero-temperature", at.zero_temperature_c)
    result = run("apply", file, "readings.csv", "--out", "torque.csv", *options, cwd=folder)
    assert result.returncode == 0, result.stderr
    with (folder / "torque.csv").open() as written:
        (cells,) = csv.DictReader(line for line in written if not line.startswith("#"))
    applied = tb.load_model(file).apply(
        folder / "readings.csv", zero_age_h=0.0, zero_temperature_c=at.zero_temperature_c
    )
    names = ("torque_nm", "expanded_uncertainty_nm")
    assert [applied[name][0].as_py() for name in names] == [float(cells[name]) for name in names]
    return Told(*(float(cells[name]) for name in names))


def live(chain: MeasuringChain, at: Conditions) -> tuple[ActiveChain, Block]:
    """Bring a stream to the rising branch, and give it the reading in one window."""
    active = ActiveChain(chain, "1", "hybrid")
    path = RANGE_NM * np.concatenate(
        [np.linspace(a, b, 80) for a, b in ((0.0, 1.0), (1.0, 0.0), (0.0, 0.75))]
    )
    path[-1] = READING_NM
    time_s = 0.01 * np.arange(path.size)
    known = {
        "speed_rpm": at.speed_rpm, "temperature_c": at.temperature_c,
        "acceleration_rad_s2": at.acceleration_rad_s2, "acceleration_uncertainty_rad_s2": 0.0,
        "angle_rad": at.angle_rad, "window_s": at.window_s,
    }  # fmt: skip
    whole = Record(
        {
            "time_s": time_s, "frequency_hz": 82.5e3, "reading_nm": path,
            "counter_nm": COUNTER_NM, "fault": np.uint8(0),
        }
    )  # fmt: skip

    def push(record: Record) -> Torque:
        angle_rad = np.full(len(record), at.angle_rad)
        return active.push(record, known | {"angle_rad": angle_rad}, float(record.time_s[-1]))

    push(whole.at(slice(0, -1)))
    active.zero = ZeroTaken(float(time_s[-2]), at.zero_temperature_c, 0.0)
    last = whole.at(slice(-1, None))
    torque, start_s = push(last), float(last.time_s[0])
    conditions = {
        "time_s": np.array([start_s + 0.01]), "input_speed_rad_s": 0.0, "output_speed_rad_s": 0.0,
        "output_transducer_c": at.temperature_c,
    }  # fmt: skip
    angle = Record({"time_s": last.time_s, "angle_counts": np.zeros(1, np.int64)})
    records = {
        "output_torque": last, "input_torque": last, "output_angle": angle,
        BLOCK_CONDITIONS: Record(conditions),
    }  # fmt: skip
    return active, Block(start_s, start_s + 0.01, {}, records, {"output": torque})


def by_watchers(block: Block) -> dict[str, Told]:
    """The panel with its API, and what OPC UA and Sparkplug make of its values."""
    bench = default_bench()
    hub = LiveHub(bench, BenchClock(fast=True), Viewer(10))
    hub.take(block)
    state = CompensationState(1, 1, "hybrid", datetime.now(UTC), None, valid=True)
    station: Any = SimpleNamespace(description=bench)
    sides = side_snapshots(station, hub, {"input": (None, ""), "output": (state, "")})
    nothing = LatestValue(None, np.inf)
    shown: Any = SimpleNamespace(sides=sides, efficiency=nothing, connection="live", stopped=False)
    live, metrics = live_values(shown), dict(side_metrics(sides["output"], 0))
    pairs = {
        "panel and API": [sides["output"].torque, sides["output"].expanded_uncertainty],
        "OPC UA": [live["output", name] for name in ("Torque", "Uncertainty")],
        "Sparkplug": [metrics[f"Torque/{name}"] for name in ("Value", "Expanded uncertainty")],
    }
    return {name: Told(*(each.value for each in pair)) for name, pair in pairs.items()}


def by_devices(active: ActiveChain, block: Block) -> dict[str, Told]:
    """The steady value of plans, and the recorder of reducer tests."""
    start_s, stop_s = block.start_s - 0.005, block.stop_s
    window = active.window(start_s, stop_s)
    assert window is not None
    steady = Told.of(window[1].mean().steady(0.0, 0.0, 0.0))
    acquisition: Any = SimpleNamespace(compensation=lambda _: active)
    context: Any = SimpleNamespace(description=default_bench(), acquisition=acquisition)
    recorded = Recorder(context)._columns("output", block.records["output_torque"], window)
    u = float(recorded.parts.standard_uncertainty_nm[0])
    return {"steady value": steady, "recorder": Told(float(recorded.torque_nm[0]), 2.0 * u)}


def by_exports(block: Block, folder: Path) -> dict[str, Told]:
    """The journal of a run, and the files that it is exported to."""
    with RunFolder.create(folder / "runs", {}, kind="record") as writer:
        RunJournal(writer, ("output_transducer",)).write(block)
    found = {}
    for kind in ("csv", "parquet", "hdf5"):
        path = folder / f"samples.{kind}"
        export_streams(writer.folder, path, kind)
        names = ("output_compensated_nm", "output_torque_uncertainty_nm")
        if kind == "hdf5":
            with h5py.File(path) as file:
                cells = [file["samples"][name][0] for name in names]
        else:
            read = partial(pl.read_csv, comment_prefix="#") if kind == "csv" else pl.read_parquet
            cells = [read(path)[name][0] for name in names]
        found[kind] = Told(float(cells[0]), 2.0 * float(cells[1]))
    return found


def by_points(chain: MeasuringChain, at: Conditions) -> dict[str, Told]:
    """A check, a verification and a certificate: of steady means."""

    def points(reading_nm: NDArray[np.float64]) -> CalibrationData:
        ones = np.ones(reading_nm.size)
        return CalibrationData(
            reading_nm, reading_nm, ones, ones, RANGE_NM, speed_rpm=at.speed_rpm * ones,
            temperature_c=at.temperature_c * ones, time_s=0.0 * ones,
            standard_error_nm=COUNTER_NM * ones, zero_temperature_c=at.zero_temperature_c * ones,
        )  # fmt: skip

    point = points(np.array([READING_NM]))
    nothing = Reference("none", CertifiedUncertainty.of_range(0.0, RANGE_NM))
    checked = judge_check(point, chain, standard=nothing, tolerance_percent_fs=0.1).torque
    verified = verify(point, {"chain": chain}).of("chain")
    assert verified.expanded_uncertainty_nm is not None
    error = verified.against_standard.worst_nm
    error *= np.sign(float(checked.value_nm[0]) - READING_NM)
    reference = StatedReference(
        "SIM-CAL-1", "", "SIM-CERT-1", "", 0.01,
        certified=certified_bench().calibrator.uncertainty("output"),
    )  # fmt: skip
    whole = points(np.linspace(300.0, 1950.0, 12))
    results = evaluate_results(whole, chain, reference, tolerance_percent_fs=None)
    (step,) = (row for row in results.rows if row.torque_nm == READING_NM)
    assert step.error_after_nm is not None
    assert step.expanded_after_nm is not None
    return {
        "check": Told.of(checked),
        "verification": Told(READING_NM + error, verified.expanded_uncertainty_nm),
        "certificate": Told(READING_NM + step.error_after_nm, step.expanded_after_nm),
    }


def told_alike(told: dict[str, Told], expected: Torque) -> None:
    for name, each in told.items():
        torque_nm, expanded_nm = expected.value_nm[0], expected.expanded_uncertainty_nm[0]
        assert each.torque_nm == pytest.approx(torque_nm, rel=1e-12), name
        assert each.expanded_nm == pytest.approx(expanded_nm, rel=1e-12), name


@pytest.mark.parametrize("which", CONDITIONS)
def test_every_interface_states_the_same_u(
    which: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    file, at = request.getfixturevalue(which), CONDITIONS[which]
    chain = load_chain(file)
    expected = by_rows(chain, at)
    active, block = live(chain, at)
    measured = live_torque("output", [block])
    assert measured.torque_nm is not None
    assert measured.expanded_uncertainty_nm is not None
    budget = expected.budget()
    split = TorqueParts.of(expected).standard_uncertainty_nm
    told = {
        "apply": by_apply(file, at, tmp_path),
        "measure": Told(measured.torque_nm, measured.expanded_uncertainty_nm),
        "budget": Told(budget.value, budget.expanded_uncertainty()),
        "parts": Told(float(expected.value_nm[0]), 2.0 * float(split[0])),
        **by_watchers(block),
        **by_devices(active, block),
        **by_exports(block, tmp_path),
    }
    told_alike(told, expected)
    told_alike(by_points(chain, at), by_rows(chain, at, steady=True))
    # the budget's own lines are U, each of them once
    lines = {line.name: line.contribution for line in budget.lines}
    assert len(lines) == len(budget.lines) == len(expected.components)
    assert 2.0 * np.linalg.norm(list(lines.values())) == pytest.approx(
        expected.expanded_uncertainty_nm[0], rel=1e-12
    )
    groups = [
        np.linalg.norm([lines[part.name] for part in expected.components if part.shared is group])
        for group in Shared
    ]
    assert 2.0 * np.linalg.norm(groups) == pytest.approx(
        expected.expanded_uncertainty_nm[0], rel=1e-12
    )
    shown = measured.text(8, 2).split()
    assert shown == [
        f"{expected.value_nm[0]:.2f}", "±", f"{expected.expanded_uncertainty_nm[0]:.2f}"
    ]  # fmt: skip

    # the calibrator has its share by the table of its certificate: no flat share of the range
    certified = certified_bench().calibrator.uncertainty("output").at(expected.value_nm[0])
    assert 2.0 * lines["reference standard"] == pytest.approx(float(certified), rel=1e-12)
    assert 0.1 < float(certified) < 0.2


def test_a_file_takes_the_limits_of_the_bench_that_it_is_used_on(
    file: Path, tmp_path: Path
) -> None:
    """Live, a model of a table had the bench's limits; a file of the same readings had none."""
    stored, description = tb.load_model(file).stored, default_bench()
    of_table = replace(stored.provenance, effects=(), transducer_serial="SIM-T2000")
    save_model(tmp_path / "model.json", replace(stored, provenance=of_table))
    example = resources.files("torquebench.bench") / DEFAULT_BENCH
    (tmp_path / "bench.toml").write_text(example.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "readings.csv").write_text(f"reading_nm,branch\n{READING_NM},up\n")
    command = ("apply", "model.json", "readings.csv", "--out", "torque.csv")
    done = run(*command, "--bench", "bench.toml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    cells = pl.read_csv(tmp_path / "torque.csv")
    used = with_stated_limits(load_chain(tmp_path / "model.json"), description, "output")
    expected = used.torque(Readings(np.array([READING_NM]), branch=np.ones(1)))
    told_alike(
        {"apply": Told(cells["torque_nm"][0], cells["expanded_uncertainty_nm"][0])}, expected
    )
    assert "temperature of zero" in {part.name for part in expected.components}
    options = ("--reading", READING_NM, "--branch", "up", "--bench", "bench.toml", "--json")
    (found,) = json.loads(run("budget", "model.json", *options, cwd=tmp_path).stdout)["answer"][
        "readings"
    ]
    told_alike({"budget": Told(found["torque_nm"], found["expanded_uncertainty_nm"])}, expected)
    refused = run("apply", file, *command[2:], "--bench", "bench.toml", cwd=tmp_path)
    assert refused.returncode == 2
    assert "SIM-T2000" in refused.stderr


def test_the_command_of_a_budget_states_u_and_lines_of_the_chain(
    file: Path, tmp_path: Path
) -> None:
    options = (
        "--temperature",
        24.5,
        "--zero-temperature",
        23,
        "--speed",
        0,
        "--zero-age",
        0,
        "--branch",
        "up",
    )
    done = run("budget", file, "--reading", READING_NM, *options, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (told,) = json.loads(done.stdout)["answer"]["readings"]
    expected = load_chain(file).torque(
        Readings(
            np.array([READING_NM]), branch=np.ones(1), speed_rpm=0.0, temperature_c=24.5,
            zero_temperature_c=23.0, zero_age_h=0.0,
        )
    )  # fmt: skip
    assert told["coverage_factor"] == pytest.approx(2.0, rel=1e-12)
    told_alike({"budget": Told(told["torque_nm"], told["expanded_uncertainty_nm"])}, expected)
    lines = [line["contribution"] for line in told["lines"]]
    assert 2.0 * np.linalg.norm(lines) == pytest.approx(told["expanded_uncertainty_nm"], rel=1e-12)


@pytest.mark.parametrize("steady", [False, nightly(True)])
@pytest.mark.parametrize("kind", ["file", "turning", "polynomial"])
def test_budget_and_apply_state_the_same_u_under_any_conditions(
    kind: str, tmp_path: Path, request: pytest.FixtureRequest, *, steady: bool
) -> None:
    """To the last digit, standing and turning, at any age and temperature."""
    source = "file" if kind == "polynomial" else kind
    stored = tb.load_model(request.getfixturevalue(source)).stored
    if kind == "polynomial":
        reading = np.linspace(-RANGE_NM, RANGE_NM, 41)
        model = make_model(kind, range_nm=RANGE_NM).fit(reading[:, None], 1.003 * reading)
        stored = replace(stored, model=model)
    dated = replace(stored.provenance, calibrated_on="2025-03-01")
    save_model(tmp_path / "model.json", replace(stored, provenance=dated))
    generator = np.random.default_rng([steady, len(kind)])
    count, zero_age, zeroed_c = 4, generator.uniform(0.0, 9.0), generator.uniform(15.0, 35.0)
    rows = {
        "reading_nm": generator.uniform(-1900.0, 1900.0, count),
        "standard_error_nm": generator.exponential(0.3, count),
        "speed_rpm": generator.uniform(-900.0, 900.0, count) * (generator.random(count) < 0.7),
        "temperature_c": generator.uniform(13.0, 37.0, count),
    }
    if not steady:
        rows["acceleration_rad_s2"] = generator.uniform(-20.0, 20.0, count)
        rows["angle_deg"] = generator.uniform(0.0, 360.0, count)
    branch = generator.choice(["up", "down", "unknown"], count)
    table = pl.DataFrame(rows | {"branch": branch}).write_csv()
    remarks = f"# steady = {str(steady).lower()}\n# measured_on = 2026-01-17\n# window_s = 0.02\n"
    (tmp_path / "readings.csv").write_text(remarks + table)
    zero = ("--zero-age", zero_age, "--zero-temperature", zeroed_c)
    done = run("apply", "model.json", "readings.csv", "--out", "torque.csv", *zero, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    applied = pl.read_csv(tmp_path / "torque.csv", comment_prefix="#")
    names = {
        "reading_nm": "--reading", "standard_error_nm": "--standard-error", "speed_rpm": "--speed",
        "temperature_c": "--temperature", "acceleration_rad_s2": "--acceleration",
        "angle_deg": "--angle",
    }  # fmt: skip
    for row in range(count):
        options = [f"{names[name]}={float(rows[name][row])!r}" for name in rows]
        options += ["--steady"] if steady else ["--window=0.02"]
        options += [f"--branch={branch[row]}", "--age=322", "--json"]
        budget = run("budget", "model.json", *options, *zero, cwd=tmp_path)
        assert budget.returncode == 0, budget.stderr
        (told,) = json.loads(budget.stdout)["answer"]["readings"]
        assert told["torque_nm"] == applied["torque_nm"][row]
        stated = applied["expanded_uncertainty_nm"][row]
        assert told["expanded_uncertainty_nm"] == pytest.approx(stated, rel=1e-14)
        lines = {line["name"]: line for line in told["lines"]}
        if "reference standard" in lines:
            assert lines["reference standard"]["shared"] == "calibration"
        corrections = sum(line["value"] for line in told["lines"])
        assert rows["reading_nm"][row] + corrections == pytest.approx(told["torque_nm"], abs=1e-9)


def test_an_exported_table_has_the_curve_s_share_of_u(file: Path, tmp_path: Path) -> None:
    done = run("export", file, "--out", "table.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    table = pl.read_csv(tmp_path / "table.csv", comment_prefix="#")[100:-100:300]
    chain = load_chain(file)
    for branch, name in ((1.0, "up"), (-1.0, "down")):
        reading = table["reading_nm"].to_numpy()
        torque = chain.torque(Readings(reading, branch=np.full(reading.size, branch)))
        assert table[f"torque_{name}_nm"].to_numpy() == pytest.approx(torque.value_nm, rel=1e-12)
        assert table[f"curve_uncertainty_{name}_nm"].to_numpy() == pytest.approx(
            torque.component("static curve"), rel=1e-12
        )


@pytest.fixture(scope="module")
def turning(file: Path) -> Path:
    """The chain with effects that were measured while it turned."""
    stored = tb.load_model(file).stored
    measured = (WARMTH, TURNING, Inertia("runs", INERTIA, 1e-6, 30.0), RIPPLE)
    chain = MeasuringChain.of(stored).with_effects(measured)
    made = replace(stored.provenance, effects=chain.specification())
    path = file.with_name("turning.json")
    save_model(path, replace(stored, provenance=made))
    return path


@pytest.mark.parametrize("branch", [True, nightly(False)])
@pytest.mark.parametrize("chain", ["file", "turning"])
def test_a_record_gives_the_same_by_command_and_in_python(
    chain: str, tmp_path: Path, request: pytest.FixtureRequest, *, branch: bool
) -> None:
    count = 30_000  # several blocks of the command
    time_s = 0.01 * np.arange(count)
    torque = 1900.0 * np.sin(0.3 * time_s)
    noise = np.random.default_rng(6).standard_normal((2, count))
    columns = {
        "time_s": time_s,
        "reading_nm": torque + 0.1 * noise[0],
        "speed_rpm": 900.0 * np.sin(0.5 * time_s) + noise[1],
        "temperature_c": 25.0 + 10.0 * np.sin(0.01 * time_s),
        "note": np.full(count, "a row of a record whose file is longer than one block, " * 2),
    }
    if branch:
        columns["branch"] = np.where(np.gradient(np.abs(torque)) >= 0.0, "up", "down")
    record, model = tmp_path / "record.csv", request.getfixturevalue(chain)
    pl.DataFrame(columns).write_csv(record)
    assert record.stat().st_size > 2 * 2**21
    done = run("apply", model, record, "--out", "torque.csv", "--zero-age", 0.5, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told = pl.read_csv(tmp_path / "torque.csv")
    found = tb.load_model(model)
    for readings in (record, pl.read_csv(record)):
        applied = pl.DataFrame(found.apply(readings, zero_age_h=0.5))
        for name in ("torque_nm", "expanded_uncertainty_nm"):
            assert applied[name].to_list() == told[name].to_list()
    if chain == "turning":
        still = pl.DataFrame(found.apply(pl.read_csv(record).drop("time_s")))
        assert (still["torque_nm"] - applied["torque_nm"]).abs().max() > 0.05  # of inertia


def running(steady: Torque, speed_rpm: FloatArray) -> RunningRecording:
    nothing, number = np.zeros(len(steady)), np.zeros(len(steady), np.int64)
    return RunningRecording(
        nominal_rpm=nothing, nominal_nm=nothing, speed_rpm={"output": speed_rpm},
        torque_nm={"output": steady.value_nm}, standard_error_nm={"output": nothing},
        stated={"output": steady}, zero_uncertainty_nm={"output": 0.0}, true_torque_nm=None,
        direction=number, branch=number, repeat=number, series=number, temperature_c=nothing,
        time_s=nothing, compensated={"output": True}, unsettled=0,
    )  # fmt: skip


@dataclass(frozen=True)
class Unheard(Effect):
    """An effect that no list can contain."""

    title: ClassVar[str] = "unheard"
    shared: Shared = Shared.CALIBRATION

    def components(self, _readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        return (Component("unheard", self.shared, np.full(torque_nm.size, 0.7)),)


@pytest.mark.parametrize("unheard", [None, *Shared])
def test_a_reducer_test_splits_what_the_chain_states_and_loses_nothing(
    file: Path, unheard: Shared | None
) -> None:
    """Also of a chain with effects of all kinds, and with one that no list can contain."""
    chain = load_chain(file)
    effects = [each for each in EFFECTS_OF_ALL_KINDS if not isinstance(each, SwitchedOff)]
    if unheard is not None:
        effects.append(Unheard("somebody", unheard))
    chain = MeasuringChain(chain.model, tuple(effects))
    torque = np.array([-1500.0, -10.0, 10.0, 1500.0])
    speed = np.array([-5.0, 9.0, -9.0, 5.0])
    stated = chain.torque(
        Readings(
            torque,
            branch=np.ones(4),
            time_s=np.arange(4.0),
            speed_rpm=speed,
            acceleration_rad_s2=np.array([2.0, -3.0, 4.0, -5.0]),
            acceleration_uncertainty_rad_s2=0.5,
            temperature_c=TEMPERATURE_C,
            zero_temperature_c=TEMPERATURE_C - 1.0,
        )
    )
    names = {each.name for each in stated.components}
    assert {"inertia", "ripple by angle", "dynamics", "temperature gradient", "creep"} <= names
    bench = Bench(default_bench(), {}, {})
    every = torque_uncertainty(bench, running(stated, speed), "output")
    for row, known in enumerate(every):
        parts = (
            known.relative * abs(stated.value_nm[row]), known.zero_nm, known.model_nm,
            known.speed_nm_per_rpm * abs(speed[row]), known.mounting_nm, known.loading_nm,
            known.repeatability_nm,
        )  # fmt: skip
        assert 2.0 * np.linalg.norm(parts) == pytest.approx(
            stated.expanded_uncertainty_nm[row], rel=1e-12
        )


def test_a_test_without_compensation_takes_the_limits_of_the_bench() -> None:
    bench = default_bench()
    nothing = np.zeros(1)
    recording = replace(running(Torque(nothing, ()), np.array([900.0])), stated={"output": None})
    (known,) = torque_uncertainty(Bench(bench, {}, {}), recording, "output")
    rotation = next(each for each in chain_effects(bench, "output") if isinstance(each, Rotation))
    assert known.mounting_nm == pytest.approx(rotation.drag_nm / np.sqrt(3.0))
    assert 900.0 * known.speed_nm_per_rpm == pytest.approx(
        0.9 * rotation.zero_nm_per_1000rpm / np.sqrt(3.0)
    )
