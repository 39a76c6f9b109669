"""A stuck output is found, and a quiet one isn't taken for it."""

from typing import Any

import numpy as np
import pytest

from torquebench.bench.channels import Channel
from torquebench.bench.description import default_bench
from torquebench.signals import FrequencyCounter, Record, SignalFaultKind

STUCK_S = 0.25
BLOCK_S = 0.05
PERIOD_S = 0.01


def channel(name: str, *, standard: bool = False, states: bool = False) -> Channel:
    bench = default_bench()
    transducer = bench.calibrator.transducer("output") if standard else bench.output.transducer
    counter = FrequencyCounter("regression", PERIOD_S, 100e6)
    transducer = transducer.stated() if states else transducer
    return Channel(name, "output", standard, transducer, counter, STUCK_S, None)


def stated(block: int, torque_nm: Any) -> Record:
    """A block of a read-out that states N·m."""
    time_s = BLOCK_S * block + PERIOD_S * (np.arange(5) + 0.5)
    return Record({"time_s": time_s, "signal": np.broadcast_to(torque_nm, 5).astype(float)})


def counted(block: int, frequency_hz: Any, u_hz: float) -> Record:
    """A block of a counter that evaluates the edges itself."""
    values = np.broadcast_to(frequency_hz, 5).astype(float)
    columns = {
        "time_s": stated(block, 0.0).time_s,
        "frequency_hz": values,
        "frequency_uncertainty_hz": u_hz,
        "fault": np.uint8(0),
    }
    return Record(columns)


def is_stuck(record: Record) -> bool:
    return bool((record["fault"] == SignalFaultKind.STUCK).any())


@pytest.mark.parametrize(
    ("noise_hz", "resolution_hz", "u_hz"),
    [
        (1e-4, 1e-9, 2e-8),  # far below anything that a card resolves
        (1e-5, 1e-3, 3e-4),  # below its own counter's resolution: it repeats
        (0.0, 1e-3, 3e-4),
    ],
)
def test_a_quiet_output_at_constant_torque_is_not_stuck(
    noise_hz: float, resolution_hz: float, u_hz: float
) -> None:
    draw, quiet = np.random.default_rng(1), channel("output_torque")
    for block in range(400):
        frequency = 70e3 + noise_hz * draw.standard_normal(5)
        frequency = resolution_hz * np.round(frequency / resolution_hz)
        assert not is_stuck(quiet.push(counted(block, frequency, u_hz)))


def test_a_read_out_of_few_digits_at_constant_torque_is_not_stuck() -> None:
    coarse = channel("output_reference", standard=True, states=True)
    assert not any(is_stuck(coarse.push(stated(block, 123.4))) for block in range(400))


def test_a_ramp_in_slices_at_the_beginning_is_not_taken_for_noise() -> None:
    draw, quiet = np.random.default_rng(3), channel("output_torque", states=True)
    for block in range(100):
        steps = (5 * block + np.arange(5)) // 2  # commanded slice by slice
        last_digit = 1e-3 * draw.integers(0, 2, 5) * (block < 4)
        signal = np.minimum(2000.0, 150.0 * steps) + last_digit
        assert not is_stuck(quiet.push(stated(block, signal))), block


@pytest.mark.parametrize("by", ["counter", "read-out"])
def test_an_output_that_loses_its_noise_is_stuck_until_it_lives_again(by: str) -> None:
    draw, live = np.random.default_rng(2), channel("output_torque", states=by == "read-out")

    def push(block: int, noise: Any) -> bool:
        if by == "counter":
            return is_stuck(live.push(counted(block, 70e3 + noise, 1e-3)))
        return is_stuck(live.push(stated(block, 500.0 + 0.1 * noise)))

    found = [push(block, draw.standard_normal(5)) for block in range(40)]
    found += [push(block, 0.3) for block in range(40, 60)]
    found += [push(block, draw.standard_normal(5)) for block in range(60, 80)]
    assert found == [40 + STUCK_S / BLOCK_S <= block < 60 for block in range(80)]


@pytest.mark.parametrize("standard", [True, False])
@pytest.mark.parametrize(("rate_nm_per_s", "stuck"), [(80.0, True), (0.5, False)])
def test_a_quiet_output_is_stuck_while_its_partner_moves(
    standard: bool, rate_nm_per_s: float, stuck: bool
) -> None:
    one = channel(
        "output_reference" if standard else "output_torque", standard=standard, states=True
    )
    other = channel(
        "output_torque" if standard else "output_reference", standard=not standard, states=True
    )
    draw, found = np.random.default_rng(3), []
    for block in range(60):
        ramp = rate_nm_per_s * stated(block, 0.0).time_s + 0.05 * draw.standard_normal(5)
        if not standard:
            found.append(is_stuck(one.push(stated(block, 500.0), other)))
        other.push(stated(block, 500.0 + ramp), one)
        if standard:
            found.append(is_stuck(one.push(stated(block, 500.0), other)))
    assert found[-1] is stuck
    assert not any(found[:6]), "not before it must have moved"


def test_a_coarse_read_out_that_follows_its_partner_is_not_stuck() -> None:
    coarse = channel("output_reference", standard=True, states=True)
    module = channel("output_torque", states=True)
    for block in range(200):
        torque = 20.0 * stated(block, 0.0).time_s
        module.push(stated(block, torque), coarse)
        assert not is_stuck(coarse.push(stated(block, np.round(torque)), module))
