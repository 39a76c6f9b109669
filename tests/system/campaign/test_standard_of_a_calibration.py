"""What a calibration on the bench keeps of its standard, and what its chain and certificate say."""

from pathlib import Path

import numpy as np
import pytest

from torquebench.bench import default_bench
from torquebench.bench.chain_effects import standard_effect
from torquebench.bench.description import BenchDescription
from torquebench.calibration import load_profile
from torquebench.campaign.bench_chains import bench_effects
from torquebench.campaign.calibrating import CALIBRATION, measure_calibration
from torquebench.campaign.fitting import ModelChoice
from torquebench.campaign.registering import registers_calibration
from torquebench.chain import Reference, load_chain
from torquebench.records import RunFolder
from torquebench.reports.certificate.source import Source
from torquebench.station import Station

CHOICES = (ModelChoice("polynomial-1"),)


def test_the_certificates_table_reaches_chain_record_and_certificate(tmp_path: Path) -> None:
    profile = load_profile("rapid-in-situ").with_options(step_percent=25.0)
    noted = registers_calibration(CHOICES, None)
    with Station.open(default_bench(), tmp_path) as station:
        measured = measure_calibration(station, "input", profile, metadata=noted)
        stated = station.drivers.certificates["calibrator"]["input"].certified
        data = measured.result.data
        done = CALIBRATION.evaluate_and_register(station.registry, measured)
        (entry,) = station.registry.models(data.transducer_serial)
        chain = load_chain(entry.file)
        calibration = done.registered.calibration
        source = Source.of(station.registry, calibration)
    assert stated.at(25.0) < 0.5 * 2e-4 * 50.0  # far below the class of the calibrator
    (effect,) = (each for each in chain.stored if isinstance(each, Reference))
    assert effect.certified == stated
    assert data.standard_temperature_c is not None
    assert np.all(np.abs(data.standard_temperature_c - 23.0) < 2.0)
    unknown = standard_effect(default_bench(), "input").temperature_of_torque
    assert 0.0 < effect.temperature_of_torque < 0.5 * unknown
    # as a plant or a bench that finishes the run later evaluates it, without the instruments
    folder = RunFolder.open(measured.record.folder)
    description = BenchDescription.model_validate(folder.metadata["bench"])
    (again, *_) = bench_effects(description, data)
    assert again == effect
    assert source.reference.uncertainty(data.range_nm) == stated
    assert source.reference.label == "reference_text_table"
    largest = 100.0 * stated.largest_nm(50.0) / 50.0
    assert source.reference.expanded_uncertainty_percent == pytest.approx(largest, rel=5e-3)
