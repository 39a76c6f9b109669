"""One reading through every interface: each states the same torque and the same U."""

import csv
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray
from tests.system.command_line import run
from tests.unit.chain.test_measuring_chain import EFFECTS_OF_ALL_KINDS
from tests.unit.chain.test_turning_chains import INERTIA, TURNING, WARMTH

import torquebench as tb
from torquebench.bench import default_bench
from torquebench.bench.active_chain import ActiveChain, StreamReadings, ZeroTaken
from torquebench.bench.chain_effects import chain_effects
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription, CertifiedPoints
from torquebench.bench.drivers.base import AngleSamples
from torquebench.bench.samples import AcquiredBlock, ChannelSamples, Viewer
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
    Rotation,
    Shared,
    SwitchedOff,
    Torque,
    load_chain,
)
from torquebench.cli.measure import _torque as live_torque
from torquebench.compensation import make_model, save_model
from torquebench.panel.service.live.hub import LiveHub
from torquebench.procedures.reducers.running_table import RunningRecording
from torquebench.reports.certificate.record import Reference as StatedReference
from torquebench.reports.certificate.results import evaluate_results
from torquebench.uncertainty import BudgetLine, CertifiedUncertainty

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
    model = make_model("physics", range_nm=RANGE_NM).fit(data.features(2), data.standard_nm)
    path = tmp_path_factory.mktemp("chain") / "model.json"
    store_model(path, model, data, {}, chain_effects(certified_bench(), "output", 23.0))
    return path


def by_rows(chain: MeasuringChain) -> Told:
    torque = chain.torque(
        Readings(
            np.array([READING_NM]),
            branch=np.ones(1),
            counter_nm=COUNTER_NM,
            speed_rpm=0.0,
            acceleration_rad_s2=0.0,
            temperature_c=TEMPERATURE_C,
            zero_age_h=0.0,
            zero_temperature_c=TEMPERATURE_C,
        )
    )
    return Told(float(torque.value_nm[0]), float(torque.expanded_uncertainty_nm[0]))


def torque_budget(chain: MeasuringChain) -> tuple[BudgetLine, ...]:
    reading = Readings(np.array([READING_NM]), branch=np.ones(1))
    return chain.torque(reading).budget().lines


def by_apply(file: Path, folder: Path) -> Told:
    header = "reading_nm,branch,speed_rpm,acceleration_rad_s2,temperature_c,standard_error_nm"
    row = f"{READING_NM},up,0,0,{TEMPERATURE_C},{COUNTER_NM}"
    (folder / "readings.csv").write_text(f"{header}\n{row}\n")
    options = ("--zero-age", 0, "--zero-temperature", TEMPERATURE_C)
    result = run("apply", file, "readings.csv", "--out", "torque.csv", *options, cwd=folder)
    assert result.returncode == 0, result.stderr
    with (folder / "torque.csv").open() as table:
        (cells,) = csv.DictReader(table)
    return Told(float(cells["torque_nm"]), float(cells["expanded_uncertainty_nm"]))


def live(chain: MeasuringChain) -> tuple[ActiveChain, AcquiredBlock]:
    """Bring a stream to the rising branch, and give it the reading in one window."""
    active = ActiveChain(chain, "1", "physics")
    path = RANGE_NM * np.concatenate(
        [np.linspace(a, b, 80) for a, b in ((0.0, 1.0), (1.0, 0.0), (0.0, 0.75))]
    )
    path[-1] = READING_NM
    time_s = 0.01 * np.arange(path.size)
    counter_nm = np.full(path.size, COUNTER_NM)
    still = {"speed_rpm": 0.0, "acceleration_rad_s2": 0.0, "temperature_c": TEMPERATURE_C}
    active.push(StreamReadings(time_s[:-1], path[:-1], counter_nm[:-1], **still))
    active.zero = ZeroTaken(float(time_s[-1]), TEMPERATURE_C, 0.0)
    last = time_s[-1:]
    counted = counter_nm[-1:]
    torque = active.push(StreamReadings(last, path[-1:], counted, **still))
    samples = ChannelSamples(
        "output_torque", "output", False, last, np.array([82.5e3]), path[-1:],
        np.zeros(1, np.uint8), counted,
    )  # fmt: skip
    angles = AngleSamples(last, np.zeros(1, np.int64), 1000)
    block = AcquiredBlock(
        0, float(last[0]), float(last[0]) + 0.01, {"output_torque": samples},
        {"output": angles}, {"output": 0.0}, {"output_transducer": TEMPERATURE_C}, {},
        compensated={"output": torque},
    )  # fmt: skip
    return active, block


def test_every_interface_states_the_same_u(file: Path, tmp_path: Path) -> None:
    chain = load_chain(file)
    expected = by_rows(chain)
    told = {"apply": by_apply(file, tmp_path)}

    active, block = live(chain)
    hub = LiveHub(default_bench(), BenchClock(fast=True), Viewer(10))
    hub.take(block)
    newest = hub.latest()
    told["panel and API"] = Told(
        newest["output_torque_nm"].value, newest["output_uncertainty_nm"].value
    )
    window = active.window(block.start_s - 0.005, block.stop_s)
    assert window is not None
    steady = window.torque.mean().steady(0.0, 0.0)
    told["steady value"] = Told(float(steady.value_nm[0]), float(steady.expanded_uncertainty_nm[0]))

    point = CalibrationData(
        [READING_NM], [READING_NM], [1], [1], RANGE_NM, speed_rpm=[0.0],
        temperature_c=[TEMPERATURE_C], time_s=[0.0], standard_error_nm=[COUNTER_NM],
    )  # fmt: skip
    checked = judge_check(
        point,
        chain,
        standard=Reference("none", CertifiedUncertainty.of_range(0.0, RANGE_NM)),
        tolerance_percent_fs=0.1,
    ).torque
    told["check"] = Told(float(checked.value_nm[0]), float(checked.expanded_uncertainty_nm[0]))
    found = verify(point, {"chain": chain}).of("chain")
    assert found.expanded_uncertainty_nm is not None
    worst = found.against_standard.worst_nm
    told["verification"] = Told(
        READING_NM + np.sign(expected.torque_nm - READING_NM) * worst, found.expanded_uncertainty_nm
    )
    reference = StatedReference(
        "SIM-CAL-1", "", "SIM-CERT-1", "", 0.01,
        certified=certified_bench().calibrator.uncertainty("output"),
    )  # fmt: skip
    steps = np.linspace(300.0, 1950.0, 12)
    whole = CalibrationData(
        steps, steps, np.ones(12), np.ones(12), RANGE_NM, speed_rpm=np.zeros(12),
        temperature_c=np.full(12, TEMPERATURE_C), time_s=np.zeros(12),
        standard_error_nm=np.full(12, COUNTER_NM),
    )  # fmt: skip
    results = evaluate_results(whole, chain, reference, tolerance_percent_fs=None)
    (step,) = (row for row in results.rows if row.torque_nm == READING_NM)
    assert step.error_after_nm is not None
    assert step.expanded_after_nm is not None
    told["certificate"] = Told(READING_NM + step.error_after_nm, step.expanded_after_nm)

    measured = live_torque("output", [block])
    assert measured.torque_nm is not None
    assert measured.expanded_uncertainty_nm is not None
    told["measure"] = Told(measured.torque_nm, measured.expanded_uncertainty_nm)

    for name, each in told.items():
        assert each.torque_nm == pytest.approx(expected.torque_nm, rel=1e-12), name
        assert each.expanded_nm == pytest.approx(expected.expanded_nm, rel=1e-12), name

    shown = measured.text(8, 2).split()
    assert shown == [f"{expected.torque_nm:.2f}", "±", f"{expected.expanded_nm:.2f}"]
    options = ("--temperature-change", TEMPERATURE_C - 23.0, "--speed", 0, "--zero-age", 0)
    budget = run("budget", file, "--reading", READING_NM, "--branch", "up", *options, cwd=tmp_path)
    assert "k = 2.00" in " ".join(budget.stdout.split())

    # the calibrator has its share by the table of its certificate: no flat share of the range
    standard = [line for line in torque_budget(chain) if line.name == "reference standard"]
    certified = certified_bench().calibrator.uncertainty("output").at(expected.torque_nm)
    assert 2.0 * standard[0].contribution == pytest.approx(float(certified), rel=1e-12)
    assert 0.1 < float(certified) < 0.2


@pytest.fixture(scope="module")
def turning(file: Path) -> Path:
    """The chain with effects that were measured while it turned."""
    stored = tb.load_model(file).stored
    chain = MeasuringChain(stored.model, (WARMTH, TURNING, Inertia("runs", INERTIA, 1e-6, 30.0)))
    made = replace(stored.provenance, effects=chain.specification())
    path = file.with_name("turning.json")
    save_model(path, replace(stored, provenance=made))
    return path


@pytest.mark.parametrize("branch", [True, False])
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
