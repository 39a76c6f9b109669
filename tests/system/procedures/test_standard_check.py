"""A standard that is wrong is found before the series begins, and no healthy one is refused."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import drawn, nightly

from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.chain_effects import with_stated_limits
from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData, Plausibility, Profile, load_profile
from torquebench.campaign.calibrating import CALIBRATION, measure_calibration
from torquebench.campaign.fitting import ModelChoice, fit_models
from torquebench.campaign.measuring import standard_at_rest
from torquebench.campaign.registering import registers_calibration
from torquebench.errors import BenchError, SignalFault
from torquebench.operations.bench_checks import _standard
from torquebench.procedures.standard_check import PairedTorque, check_pair
from torquebench.progress import NoProgress
from torquebench.records import Adjustment, RunFolder
from torquebench.station import Station

PROFILE = load_profile("rapid-in-situ").with_options(step_percent=25.0)
BARE = load_profile("rapid-in-situ").with_options(step_percent=25.0)
BARE = BARE.model_copy(update={"preload": BARE.preload.model_copy(update={"cycles": 0})})
KIND = "polynomial-2"
KNOWN = registers_calibration([ModelChoice(KIND)], KIND)
SIDE: Side = "output"


def calibrate(station: Station, profile: Profile = PROFILE) -> None:
    measured = measure_calibration(station, SIDE, profile, metadata=KNOWN)
    CALIBRATION.evaluate_and_register(station.registry, measured)


def points_of_last_run(station: Station) -> int:
    newest = max(station.registry.runs(), key=lambda run: run.started)
    return len(list(RunFolder.open(newest.folder).points()))


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    with Station.open(None, tmp_path_factory.mktemp("data")) as station:
        calibrate(station)
        yield station


@pytest.fixture
def station(calibrated: Station) -> Iterator[Station]:
    yield calibrated
    calibrated.drivers.counter.twin._faults.clear()
    if calibrated.supervisor.alarm is not None:
        calibrated.clock.wait(1.0)
        calibrated.acknowledge_alarm("A. Tester")


def spoil(station: Station, kind: str, amount: float) -> None:
    twin = station.drivers.counter.twin
    twin.inject_fault(f"{SIDE}_reference", kind, start_s=twin.time_s, duration_s=1e6, amount=amount)


@pytest.mark.parametrize("profile", [PROFILE, BARE], ids=["preload", "no preload"])
@pytest.mark.parametrize("scale", [1.01, 0.99])
def test_a_scale_that_is_one_percent_off_ends_the_run_before_its_series(
    station: Station, scale: float, profile: Profile
) -> None:
    spoil(station, "wrong_span", scale)
    with pytest.raises(BenchError, match="with model-1") as refused:
        measure_calibration(station, SIDE, profile)
    assert "records adjust transducer SIM-T2000" in refused.value.remedy
    # without preload the steps of 25 % are the first loads
    assert points_of_last_run(station) <= (0 if profile is PROFILE else 2)


def test_a_reversed_sign_ends_the_run_before_its_series(station: Station) -> None:
    spoil(station, "wrong_span", -1.0)
    with pytest.raises(SignalFault, match="apart"):
        measure_calibration(station, SIDE, PROFILE)
    assert points_of_last_run(station) == 0


def test_an_offset_is_found_at_rest(station: Station) -> None:
    assert abs(standard_at_rest(station, SIDE, "calibrator")) < 2.0
    assert [each.state for each in _standard(station)] == ["ok", "ok"]
    spoil(station, "outlier", 0.01)  # 2 % of the range
    with pytest.raises(BenchError, match=r"SIM-CAL-1-OUT states \+4\d.*without load|unloaded"):
        standard_at_rest(station, SIDE, "calibrator")
    states = {each.what: each.state for each in _standard(station)}
    assert states == {"input standard": "ok", "output standard": "problem"}
    with pytest.raises(BenchError, match="unloaded the standard SIM-CAL-1-OUT"):
        measure_calibration(station, SIDE, PROFILE)
    assert points_of_last_run(station) == 0


def test_a_model_that_cannot_be_read_is_stated(tmp_path: Path) -> None:
    words = r"not compared with the model in use, which can't be read: model file .*json is missing"
    with Station.open(None, tmp_path) as station:
        calibrate(station, BARE)
        station.registry.model(1).file.unlink()
        stages = Stages()
        measured = measure_calibration(station, SIDE, BARE, metadata=KNOWN, progress=stages)
        assert re.fullmatch(words, stages.ends[0])
        assert [re.fullmatch(words, text) for text in measured.record.metadata["remarks"]]
        done = CALIBRATION.evaluate_and_register(station.registry, measured)
    (fitted,) = done.fitted
    assert len([text for text in fitted.remarks if re.fullmatch(words, text)]) == 1


class Stages(NoProgress):
    """Keeps how stages end."""

    def __init__(self) -> None:
        self.ends: list[str] = []

    def finish(self, detail: str = "") -> None:
        """Keep it."""
        self.ends.append(detail)


def test_a_chain_that_was_changed_on_record_is_calibrated_anew(tmp_path: Path) -> None:
    with Station.open(None, tmp_path) as station:
        calibrate(station)
        spoil(station, "wrong_span", 0.995)
        with pytest.raises(BenchError, match="with model-1"):
            measure_calibration(station, SIDE, PROFILE)
        station.registry.add_adjustment(
            Adjustment(
                kind="transducer",
                serial="SIM-T2000",
                what="another bearing",
                performed=datetime.now(UTC),
                performed_by="A. Tester",
            )
        )
        measure_calibration(station, SIDE, PROFILE)


@pytest.mark.parametrize("seed", [3, nightly(4)])
def test_a_healthy_bench_is_calibrated_again(tmp_path: Path, seed: int) -> None:
    description = default_bench()
    driver = {"preset": "worn" if seed % 2 else "nominal", "seed": seed}
    description = description.model_copy(update={"driver": driver})
    with Station.open(description, tmp_path) as station:
        calibrate(station)
        measure_calibration(station, SIDE, BARE)


# -- a chain and a standard that know nothing of the twin ---------------------------------------


class Chain:
    """A transducer with an error of span, a friction loop and noise; a standard of its class."""

    def __init__(self, rng: np.random.Generator, range_nm: float, class_percent: float) -> None:
        self.rng, self.range_nm = rng, range_nm
        self.span = rng.uniform(-8e-3, 8e-3)
        self.bend = rng.uniform(-2e-3, 2e-3)
        self.loop = rng.uniform(0.0, 1.5e-3)
        self.noise = rng.uniform(0.5e-4, 2e-4)
        self.standard_span = rng.uniform(-0.7e-2, 0.7e-2) * class_percent
        self.remounting = rng.normal(0.0, 2e-5)

    def reading(self, torque: np.ndarray, branch: np.ndarray) -> np.ndarray:
        x = torque / self.range_nm
        loop = self.loop * np.sign(x) * branch * (np.abs(x) < 0.999)
        error = self.span * x + self.bend * x**2 * np.sign(x) + loop
        noise = self.rng.normal(0.0, self.noise / 5.0, torque.shape)
        return torque + self.range_nm * (error + noise)

    def standard(self, torque: np.ndarray) -> np.ndarray:
        noise = self.rng.normal(0.0, 1e-5 * self.range_nm, torque.shape)
        return torque * (1.0 + self.standard_span + self.remounting) + noise

    def pair(self, torque_nm: float, scale: float = 1.0) -> PairedTorque:
        torque = np.array([torque_nm])
        return PairedTorque(
            float(self.reading(torque, np.ones(1))[0]),
            scale * float(self.standard(torque)[0]),
            self.range_nm * self.noise / 5.0,
            23.0,
            23.0,
        )

    def model(self, description: BenchDescription) -> ActiveChain:
        rising = np.linspace(0.1, 1.0, 10) * self.range_nm
        torque = np.concatenate([rising, rising[-2::-1]])
        torque, branch = np.concatenate([torque, -torque]), np.r_[np.ones(10), -np.ones(9)]
        branch = np.tile(branch, 2)
        data = CalibrationData(
            self.reading(torque, branch),
            self.standard(torque),
            np.repeat([1, 2], 19),
            branch,
            self.range_nm,
            tared=True,
        )
        (fitted,) = fit_models(data, [ModelChoice("polynomial-3")])
        return ActiveChain(with_stated_limits(fitted.chain, description, SIDE), "7", "polynomial")


@pytest.mark.parametrize("seed", drawn(12, by_day=3))
def test_chains_of_others(seed: int) -> None:
    rng = np.random.default_rng(seed)
    description = default_bench()
    chain = Chain(rng, 2000.0, description.calibrator.expanded_uncertainty_percent)
    before, limits = chain.model(description), PROFILE.plausibility
    args = description, SIDE, description.calibrator
    for direction in (1.0, -1.0):
        for share in (0.02, 0.1, 0.5, 1.0):
            pair = chain.pair(direction * share * 2000.0)
            check_pair(*args, pair, limits, before)
            check_pair(*args, pair, limits)
            check_pair(*args, pair, Plausibility())
        for scale in (1.01, 0.99, -1.0):
            wrong = chain.pair(direction * 2000.0, scale)
            with pytest.raises(BenchError, match="model-7"):
                check_pair(*args, wrong, limits, before)
            with pytest.raises(BenchError, match="model-7"):
                check_pair(*args, wrong, Plausibility(), before)
        with pytest.raises(BenchError, match="at one load"):
            check_pair(*args, chain.pair(direction * 2000.0, -1.0), Plausibility())
