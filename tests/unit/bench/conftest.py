"""A simulated bench below its devices, opened and closed around a test."""

import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from typing import Any, cast

import pytest

from torquebench.bench.acquisition import Acquisition
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import DEFAULT_BENCH, BenchDescription
from torquebench.bench.drivers import open_drivers
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.drivers.simulated.driver import SimulatedBench
from torquebench.bench.interlocks import PresentState
from torquebench.bench.safety import SafetySupervisor
from torquebench.bench.state import CommandState
from torquebench.validation import validated

Describe = Callable[..., BenchDescription]


def _described(**changes: Any) -> BenchDescription:
    """Describe the simulated bench with keys changed: `output__limits__torque_nm=2100`."""
    text = (resources.files("torquebench.bench") / DEFAULT_BENCH).read_text(encoding="utf-8")
    values = tomllib.loads(text)
    for dotted, value in changes.items():
        *sections, key = dotted.split("__")
        place = values
        for section in sections:
            place = place.setdefault(section, {})
        place[key] = value
    return validated(BenchDescription, values, "bench.toml")


@dataclass
class LowBench:
    """Everything of a bench that lies below its devices."""

    description: BenchDescription
    drivers: DriverSet
    clock: BenchClock
    commands: CommandState
    supervisor: SafetySupervisor
    acquisition: Acquisition
    state: PresentState

    @property
    def simulated(self) -> SimulatedBench:
        return cast(SimulatedBench, self.drivers.counter)

    def load_output(self, torque_nm: float) -> None:
        """Mount the calibrator and load the output module, past every interlock."""
        self.drivers.operator.mount("calibrator")
        self.acquisition.select_for("calibrator")
        self.acquisition.use_reference("output")
        self.drivers.clamp.set_clamped(True)
        self.drivers.modes.set_mode("input", "locked")
        self.drivers.modes.set_mode("output", "driven")
        self.drivers.drives["output"].enable()
        self.commands.output.at_zero(self.clock.now())
        self.commands.output.on()
        self.command_torque(torque_nm, 1e5)

    def command_torque(self, torque_nm: float, rate_nm_per_s: float) -> None:
        """Command the output module, past every interlock."""
        self.commands.output.ask("torque", torque_nm, rate_nm_per_s, self.clock.now())
        self.drivers.drives["output"].command_torque(torque_nm, rate_nm_per_s)
        self.commands.output.told(
            "torque", self.commands.output.set_points["torque"], self.clock.now()
        )

    def zeroed_and_off(self) -> bool:
        """Whether the supervisor's way to safety has been gone to its end."""
        states = [drive.state() for drive in self.drivers.drives.values()]
        return not any(state.enabled or state.torque_nm or state.speed_rad_s for state in states)


@contextmanager
def _open(
    real_time: bool = False, wrap: Callable[[DriverSet], DriverSet] | None = None, **changes: Any
) -> Iterator[LowBench]:
    description = _described(**changes)
    drivers = open_drivers(description)
    if wrap is not None:
        drivers = wrap(drivers)
    clock = BenchClock(fast=not real_time)
    commands = CommandState()
    supervisor = SafetySupervisor(description, drivers, clock, commands)
    acquisition = Acquisition(description, drivers, clock, supervisor, commands)
    state = PresentState(description, drivers, supervisor, commands, acquisition)
    try:
        supervisor.start()
        acquisition.start()
        yield LowBench(description, drivers, clock, commands, supervisor, acquisition, state)
    finally:
        acquisition.close()
        supervisor.close()
        drivers.close()


@pytest.fixture
def describe() -> Describe:
    return _described


@pytest.fixture
def open_bench() -> Callable[..., Any]:
    return _open


@pytest.fixture
def bench() -> Iterator[LowBench]:
    with _open() as opened:
        yield opened
