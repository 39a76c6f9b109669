"""Simulated instruments in a process of their own, as `torquebench simulate` serves them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.simulated.control import SimulationControl
from torquebench.simulators import MisbehaviourKind, Simulators

__all__ = ["Served", "moves", "powered", "served"]

PROCESSES = get_context("forkserver")
ENDS_WITHIN_S = 30.0


class Served:
    """Simulators elsewhere, and their control channel.

    Parameters
    ----------
    description : BenchDescription
        With the ports that they have.
    """

    def __init__(self, description: BenchDescription) -> None:
        self.description = description
        self._control = SimulationControl(description.driver["simulation"]["control"])

    def status(self) -> dict[str, Any]:
        """Return the plant's time and what its drives do."""
        return self._control.ask("status")

    @property
    def now_s(self) -> float:
        """Time of the plant, s."""
        return float(self.status()["time_s"])

    def misbehave(self, endpoint: str, kind: MisbehaviourKind, **how: float | None) -> None:
        """Order a misbehaviour: `amount`, `replies`, `duration_s`."""
        self._control.ask("misbehave", endpoint=endpoint, kind=kind, **how)

    def heal(self) -> None:
        """End all misbehaviour."""
        self._control.ask("heal")

    def close(self) -> None:
        """Leave the control channel."""
        self._control.close()


def powered(status: dict[str, Any]) -> bool:
    """Whether a drive has power, by a status."""
    return any(drive["enabled"] for drive in status["drives"].values())


def moves(status: dict[str, Any]) -> bool:
    """Whether a drive has power, torque or speed, by a status."""
    return powered(status) or any(
        drive["torque_nm"] or drive["speed_rad_s"] for drive in status["drives"].values()
    )


@contextlib.contextmanager
def served(description: BenchDescription) -> Iterator[Served]:
    """Serve all instruments of a description as long as the block lasts."""
    PROCESSES.set_forkserver_preload(["torquebench.simulators"])
    here, there = PROCESSES.Pipe()
    serving = PROCESSES.Process(target=partial(_serve, description, there), daemon=True)
    serving.start()
    there.close()
    with contextlib.ExitStack() as end:
        end.callback(serving.join, ENDS_WITHIN_S)
        end.callback(here.close)  # which ends it
        bench = Served(here.recv())
        end.callback(bench.close)
        yield bench


def _serve(description: BenchDescription, there: Connection) -> None:
    with Simulators(description) as simulators:
        there.send(simulators.description)
        with contextlib.suppress(EOFError):
            there.recv()
