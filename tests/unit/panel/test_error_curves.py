"""The error curve of a calibration on the panel is that of the measuring chain."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.reports.calibrated_bench import calibrated_bench

from torquebench.chain import MeasuredTemperature, load_chain
from torquebench.compensation import load_model, save_model
from torquebench.panel.service.records.queries import RecordQueries
from torquebench.records import Registry, RunFolder
from torquebench.reports.certificate import run_data

WARMTH = MeasuredTemperature(
    "empty runs", 20.0, 0.0, 60.0, (0.0, 20.0, 60.0), (-20.0, 0.0, 40.0), (0.1, 0.0, 0.1),
    (-0.002, 0.0, 0.004), (1e-5, 0.0, 1e-5),
)  # fmt: skip


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path / "data") as opened:
        yield opened


def test_an_error_curve_contains_the_chain_s_corrections(registry: Registry) -> None:
    bench = calibrated_bench(registry)
    number = bench.calibration.calibration_id
    (entry,) = registry.models()
    stored = load_model(entry.check_file())
    made = replace(stored.provenance, effects=(WARMTH.specification(),))
    path = entry.file.with_name("warm.json")
    save_model(path, replace(stored, provenance=made))
    warm = registry.add_model(bench.calibration, kind="polynomial", file=path)
    found = RecordQueries(registry).error_curve(number, warm.model_id)
    data = run_data(RunFolder.open(bench.folder))
    chain = load_chain(path)
    torque = chain.torque(data.readings())
    assert np.max(np.abs(torque.added("temperature of span"))) > 0.1
    assert found.model_error_nm == tuple((torque.value_nm - data.standard_nm).tolist())
