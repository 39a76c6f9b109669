"""A complete run in its smallest form, and what it leaves in the registry."""

from pathlib import Path

import numpy as np
import pytest
from tests.watching import Watching

from torquebench.calibration import RAW, load_profile
from torquebench.campaign.calibrating import measure_calibration
from torquebench.campaign.demo import DemoSettings, ModelChoice, run_demo
from torquebench.campaign.measuring import RunAbortedError
from torquebench.campaign.modules import dense_sweep
from torquebench.campaign.results import DemoResult
from torquebench.compensation import RECOMMENDED, load_model
from torquebench.procedures import FrictionSettings
from torquebench.records.signatures import operator_name
from torquebench.station import Station

COARSE = load_profile("rapid-in-situ").with_options(step_percent=25.0)
SETTINGS = DemoSettings(
    calibration=COARSE,
    verification=load_profile("verification").with_options(groups=2, points=8),
    friction=FrictionSettings(speeds_rpm=(300.0, 900.0), repeats=1),
    models=(ModelChoice("polynomial-2"),),
    seed=4,
)


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[DemoResult, Path]:
    folder = tmp_path_factory.mktemp("demo")
    with Station.open(None, folder) as station:
        return run_demo(station, SETTINGS), folder


@pytest.mark.nightly
def test_both_modules_and_the_reducer_are_in_the_result(told: tuple[DemoResult, Path]) -> None:
    result, _ = told
    assert result.simulated
    assert [module.side for module in result.modules] == ["input", "output"]
    assert result.friction is not None
    assert result.friction.compensated
    assert result.bench_seconds > 50.0
    for module in result.modules:
        assert [model.name for model in module.models] == [RECOMMENDED, "polynomial-2"]
        assert module.recommended.name == RECOMMENDED
        assert module.raw.name == RAW
        assert module.raw.model is None
        assert len(module.verification) == 16
        assert len(module.run_ids) == 2
        raw, compensated = module.raw.verification, module.recommended.verification
        assert compensated.against_truth.rms_nm < 0.5 * raw.against_truth.rms_nm
        assert np.array_equal(module.raw.torque_nm, module.verification.reading_nm)
        assert module.recommended.dense.points == module.dense.reading_nm.size


@pytest.mark.nightly
def test_everything_is_registered_and_the_recommended_model_is_in_use(
    told: tuple[DemoResult, Path],
) -> None:
    from torquebench.records import Registry

    result, folder = told
    with Registry.open(folder) as registry:
        assert len(registry.runs()) == 5
        assert len(registry.calibrations()) == 2
        assert len(registry.models()) == 4
        for module in result.modules:
            active = registry.active_model(module.transducer_serial, module.counter_identity)
            assert active is not None
            stored = load_model(active.check_file())
            assert stored.model.kind == RECOMMENDED
            assert stored.provenance.training_data_sha256 == module.calibration.sha256()
            for model in registry.models(module.transducer_serial):
                (verification,) = registry.verifications(model.model_id)
                names = [found["name"] for found in verification.summary["models"]]
                assert names[0] == RAW
                assert len(names) == 2


@pytest.mark.nightly
def test_the_dense_sweep_covers_the_range_up_and_down(told: tuple[DemoResult, Path]) -> None:
    result, _ = told
    dense = result.modules[1].dense
    assert dense is not None
    assert dense.true_torque_nm.max() == 2000.0
    assert dense.true_torque_nm.min() == -2000.0
    assert {-1, 1} <= set(dense.branch.tolist())


def test_without_truth_there_is_no_dense_sweep(tmp_path: Path) -> None:
    from dataclasses import replace

    with Station.open(None, tmp_path) as station:
        context = station.devices.context
        blind = replace(context, drivers=replace(context.drivers, truth=None))
        station.devices.context = blind
        assert dense_sweep(station, "input") is None


def test_an_abort_is_an_error_that_carries_its_record(tmp_path: Path) -> None:
    import threading

    def abort_at_once(done: int, _detail: str) -> None:
        if not done:
            thread.start()

    with Station.open(None, tmp_path) as station:
        thread = threading.Thread(target=station.abort, args=("the test",))
        with pytest.raises(RunAbortedError, match="the test") as aborted:
            measure_calibration(station, "input", COARSE, progress=Watching(abort_at_once))
        thread.join()
        assert aborted.value.record.exit_status == "abort"
        assert station.registry.runs()[0].status == "aborted"
        assert station.registry.calibrations() == []


def test_the_operator_is_the_one_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TORQUEBENCH_OPERATOR", "A. Technician")
    assert operator_name() == "A. Technician"
