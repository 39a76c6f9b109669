"""A module's torque as N·m, V or mV/V: described, scaled and checked like a frequency."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from torquebench.bench.channels import open_channel
from torquebench.bench.description import BenchDescription, TransducerDescription, default_bench
from torquebench.bench.drivers.simulated.driver import open_simulated
from torquebench.errors import InputError, SignalFault
from torquebench.procedures.reducers.running_table import RunningTable
from torquebench.signals import Record, SignalFaultKind
from torquebench.validation import validated

PLATE: dict[str, Any] = {"serial": "T-1", "nominal_torque_nm": 2000.0}
AMPLIFIER = {"filter_delay_s": 0.004, "signal_uncertainty_percent": 0.002}


def transducer(**keys: Any) -> TransducerDescription:
    described: TransducerDescription = validated(TransducerDescription, PLATE | keys, "bench.toml")
    return described


def on_bench(**keys: Any) -> BenchDescription:
    bench = default_bench()
    output = bench.output.model_copy(update={"transducer": transducer(**keys)})
    return bench.model_copy(update={"output": output})


@pytest.mark.parametrize(
    ("keys", "at_1000"),
    [
        ({"signal": "Nm"}, (1000.0, -1000.0)),
        ({"signal": "V", "signal_at_nominal": 10.0}, (5.0, -5.0)),
        ({"signal": "mV/V", "signal_at_nominal": 1.5}, (0.75, -0.75)),
        (
            {"signal": "mV/V", "signal_at_nominal": 1.5, "signal_at_nominal_ccw": 1.4},
            (0.75, -0.7),
        ),
    ],
)
def test_a_stated_signal_becomes_torque_with_the_zero_that_was_measured(
    keys: dict[str, Any], at_1000: tuple[float, float]
) -> None:
    description = on_bench(**keys, **AMPLIFIER)
    drivers = open_simulated(description)
    try:
        channel = open_channel("output_torque", description, drivers, "nothing")
    finally:
        drivers.close()
    channel.zero = zero = 0.01 * at_1000[0]
    signal = zero + np.array([at_1000[0], 0.0, at_1000[1], np.nan, 9.0 * at_1000[0]])
    record = channel.push(Record({"time_s": 0.1 * np.arange(5), "signal": signal}))
    np.testing.assert_allclose(record["reading_nm"][:3], [1000.0, 0.0, -1000.0], atol=1e-9)
    np.testing.assert_allclose(record["counter_nm"][0], 0.04)
    faults = [0, 0, 0, SignalFaultKind.LOST_DATA, SignalFaultKind.OUT_OF_MODULATION]
    assert record["fault"].tolist() == faults
    assert np.isnan(record["reading_nm"][3:]).all()
    assert "frequency_hz" not in record
    assert description.counter_nm("output") == pytest.approx(0.04)
    assert description.output.transducer.group_delay_s == 0.004
    with pytest.raises(SignalFault, match="4 % of the nominal torque"):
        channel.zero = 0.1 * at_1000[0]


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"signal": "V", **AMPLIFIER}, "signal_at_nominal"),
        ({"signal": "Nm", "filter_delay_s": 0.004}, "signal_uncertainty_percent"),
        ({"signal": "Nm", "signal_uncertainty_percent": 0.002}, "filter_delay_s"),
        ({"signal": "Nm", "signal_at_nominal": 5.0, **AMPLIFIER}, "signal_at_nominal"),
        (
            {"signal": "mV/V", "signal_at_nominal": 2.0, "option_khz": 240, **AMPLIFIER},
            "option_khz",
        ),
        ({"signal_at_nominal": 10.0}, "signal_at_nominal"),
        ({"signal": "kHz"}, "signal"),
    ],
)
def test_a_key_that_does_not_belong_to_the_signal_is_named(
    keys: dict[str, Any], named: str
) -> None:
    with pytest.raises(InputError, match=named):
        transducer(**keys)


def test_an_instrument_that_states_another_signal_than_described_is_named() -> None:
    description = on_bench()
    drivers = open_simulated(description)
    try:
        channel = open_channel("output_torque", description, drivers, "nothing")
    finally:
        drivers.close()
    with pytest.raises(InputError, match=r"output_torque delivers time_s, signal.*'frequency'"):
        channel.push(Record({"time_s": [0.0], "signal": [1.0]}))


def test_a_recorded_description_is_read_again() -> None:
    description = on_bench(signal="mV/V", signal_at_nominal=1.5, **AMPLIFIER)
    assert BenchDescription.model_validate(description.model_dump(mode="json")) == description


def test_a_zero_that_drifts_is_the_same_torque_in_every_signal() -> None:
    """A module's zero moved by 2 N·m between two zeroings of a reducer test."""
    keys: tuple[dict[str, Any], ...] = (
        {},
        {"signal": "Nm", **AMPLIFIER},
        {"signal": "V", "signal_at_nominal": 10.0, **AMPLIFIER},
        {"signal": "mV/V", "signal_at_nominal": 1.5, **AMPLIFIER},
    )
    for signal in keys:
        devices: Any = SimpleNamespace(context=SimpleNamespace(description=on_bench(**signal)))
        scale = transducer(**signal).scale()
        table = RunningTable(devices, ("output",))
        zeros = [(time_s, float(scale.signal(torque)), 0.0) for time_s, torque in ((0, 0), (10, 2))]
        table.zeros["output"] += zeros
        table.rows += [{"output": {"time_s": time_s}} for time_s in (2.5, 5.0)]
        standing, u = table._drift("output")
        np.testing.assert_allclose(standing, [0.5, 1.0], atol=1e-9)
        assert u == pytest.approx(0.5 * 2.0 / np.sqrt(3.0))
