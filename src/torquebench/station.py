"""One open bench: devices, acquisition, run engine, active compensation, safety.

Both doors (commands and panel) talk to a `Station` and to nothing below it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from bluesky.utils import Msg

from torquebench.bench.devices import BenchDevices
from torquebench.bench.drivers.base import OperatorPrompts, Side

__all__ = ["Progress", "ProgressCallback", "RunRecord", "Station"]

Plan = Generator[Msg, Any, Any]


@dataclass(frozen=True)
class Progress:
    """How far a running plan is."""

    done: int
    total: int
    message: str


ProgressCallback = Callable[[Progress], None]


@dataclass(frozen=True)
class RunRecord:
    """What is left of a run: its folder and how it ended."""

    run_id: str
    kind: str
    folder: Path
    exit_status: Literal["success", "abort", "fail"]
    result: Any = None
    """What the plan returned (None unless it succeeded)."""
    reason: str = ""
    metadata: Mapping[str, Any] = field(default_factory=dict)


class Station:
    """An open bench.

    Use as a context manager: leaving it brings the bench to zero torque, ends every thread and
    closes the instruments::

        with Station.open(None, "torquebench-data") as station:
            record = station.run(plan(station.devices), kind="calibration")

    Commands that plans may use beside the usual ones: `Msg("sleep", None, seconds)` (what
    `bps.sleep` sends) sleeps in bench time; `Msg("progress", None, done, total, message)`
    reports progress to the callback given to `run`.

    Attributes
    ----------
    description, devices, clock, acquisition, supervisor, interlocks, registry, data_dir
    """

    devices: BenchDevices

    @classmethod
    def open(
        cls,
        description: object = None,
        data_dir: Path | str | None = None,
        *,
        real_time: bool = False,
        operator: OperatorPrompts | None = None,
    ) -> Station:
        """Open the bench: drivers, acquisition, devices, run engine.

        Parameters
        ----------
        description : BenchDescription, path or None
            None opens the packaged simulated bench.
        data_dir : path, optional
            Default: `$TORQUEBENCH_DATA`, else `./torquebench-data`.
        real_time : bool
            Simulated time follows the wall instead of running as fast as it computes.
        operator : OperatorPrompts, optional
            Who mounts things; the driver's own when not given.
        """
        raise NotImplementedError

    def run(
        self,
        plan: Plan,
        *,
        kind: str,
        metadata: Mapping[str, Any] | None = None,
        progress: ProgressCallback | None = None,
        on_pause: Callable[[Station], Literal["resume", "abort"]] | None = None,
    ) -> RunRecord:
        """Run a plan to its end, with everything it emits kept in a run folder.

        Blocks the caller; `pause`, `resume` and `abort` come from other threads or from Ctrl-C.
        Whatever happens, the bench is at zero torque when this returns. An aborted run returns
        a record with `exit_status = "abort"`; a failed one is sealed and its error raised.
        """
        raise NotImplementedError

    def pause(self) -> None:
        """Pause at the next point; the torque goes to zero, the run stays open."""

    def resume(self) -> None:
        """Go on with a paused run; `devices.interruptions` has grown by one meanwhile."""

    def abort(self, reason: str = "") -> None:
        """End the run with zero torque."""

    def activate_compensation(self, side: Side) -> None:
        """Load the registry's active model of this side's transducer and counter.

        Raises
        ------
        ModelMismatchError
            There is none for exactly this transducer serial and this counter.
        """

    def close(self) -> None:
        """Zero torque, end every thread, close the instruments. A second call does nothing."""
