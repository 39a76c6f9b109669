"""The one owner of an open bench in a server process: pages and HTTP clients talk to it only."""

from __future__ import annotations

import threading
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

from torquebench.bench.description import BenchDescription, default_bench, load_bench
from torquebench.bench.prompts import DeskOperator, PromptDesk
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import ModelMismatchError, RecordError
from torquebench.panel.service.live import STALE_AFTER_S, Connection, LiveHub
from torquebench.panel.service.snapshot import (
    BenchSnapshot,
    CompensationState,
    compensation_state,
    side_snapshots,
)
from torquebench.station import Station, data_directory

__all__ = ["BenchService"]

LIVE_BLOCK_S = 0.03
"""Longest block of a live bench: thirty-three updates a second, s."""
IDLE_PERIOD_S = 0.05


class BenchService:
    """An open bench with everything that a panel does with it.

    Use `open`; see the package's docstring for what belongs where.

    Attributes
    ----------
    station : Station
        The open bench. Doors must not touch it: it is here for the service's own parts.
    live : LiveHub
    prompts : PromptDesk
        Questions to the person at the bench.
    """

    def __init__(self, station: Station, prompts: PromptDesk) -> None:
        self.station = station
        self.prompts = prompts
        self._closed = threading.Event()
        self._viewer = station.acquisition.add_viewer(maximum=400)
        self.live = LiveHub(
            station.description, station.clock, self._viewer, station.drivers.operator.mounted
        )
        self._compensation: dict[Side, tuple[CompensationState | None, str]] = {}
        for side in SIDES:
            self.refresh_compensation(side)
        self.live.start()
        self._idle = threading.Thread(target=self._keep_time, name="torquebench-idle", daemon=True)
        if station.clock.fast:
            self._idle.start()

    @classmethod
    def open(
        cls,
        description: BenchDescription | Path | None = None,
        data_dir: Path | None = None,
        *,
        fast: bool = False,
    ) -> Self:
        """Open the bench and everything around it.

        Parameters
        ----------
        description : BenchDescription, path or None
            None opens the packaged simulated bench.
        data_dir : path, optional
            Default: `$TORQUEBENCH_DATA`, else `./torquebench-data`.
        fast : bool
            A simulated bench works as fast as it computes while a procedure runs, and follows
            the wall while none does: for tests and demonstrations.
        """
        if description is None:
            description = default_bench()
        elif not isinstance(description, BenchDescription):
            description = load_bench(description)
        folder = data_directory(data_dir)
        prompts = PromptDesk()
        operator = None if description.simulated else DeskOperator(prompts)
        station = Station.open(
            _live_paced(description), folder, real_time=not fast, operator=operator
        )
        try:
            return cls(station, prompts)
        except BaseException:
            station.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End everything, the bench without torque. A second call does nothing."""
        if self._closed.is_set():
            return
        self._closed.set()
        if self._idle.is_alive():
            self._idle.join()
        self.live.close()
        self.station.acquisition.remove_viewer(self._viewer)
        self.station.close()

    def _keep_time(self) -> None:
        """Let a fast bench follow the wall while no procedure asks for more."""
        clock = self.station.clock
        while not self._closed.wait(IDLE_PERIOD_S):
            clock.require(clock.now() + IDLE_PERIOD_S)

    # -- what there is to see ---------------------------------------------------------------

    @property
    def connection(self) -> tuple[Connection, str]:
        """Whether samples come, and why not, in words."""
        age_s = self.live.age_s
        if age_s <= STALE_AFTER_S:
            return "live", ""
        ended = not self.station.acquisition.running
        alarm = self.station.supervisor.alarm
        reason = "" if alarm is None else f": {alarm.found}"
        if ended:
            return "lost", f"acquisition has ended{reason}"
        return "stale", f"no samples for {age_s:.1f} s{reason}"

    def snapshot(self) -> BenchSnapshot:
        """Return the bench at this moment; cheap enough for every repaint of every page."""
        station = self.station
        connection, problem = self.connection
        return BenchSnapshot(
            bench_name=station.description.name,
            simulated=station.description.simulated,
            connection=connection,
            connection_problem=problem,
            bench_time_s=self.live.bench_time_s,
            age_s=self.live.age_s,
            sequence=self.live.sequence,
            mounted=station.drivers.operator.mounted(),
            sides=side_snapshots(station, self.live, self._compensation),
            efficiency=self.live.latest()["efficiency_percent"],
            alarms=len(station.supervisor.alarms),
            stopped=station.supervisor.alarm is not None,
            job_id=None,
            commanded_by=None,
        )

    def refresh_compensation(self, side: Side) -> None:
        """Use the registry's active model of a side from now on, where there is one."""
        station = self.station
        try:
            active = station.activate_compensation(side)
        except (ModelMismatchError, RecordError) as error:
            station.deactivate_compensation(side)
            self._compensation[side] = (None, error.found)
            return
        today = datetime.now(UTC).date()
        state = compensation_state(station.registry, int(active.model_id), today)
        self._compensation[side] = (state, "")


def _live_paced(description: BenchDescription) -> BenchDescription:
    """Shorten the counter's blocks so that a live display has something to show."""
    counter = description.counter
    if counter.block_s <= LIVE_BLOCK_S:
        return description
    windows = max(1, int(LIVE_BLOCK_S / counter.window_s + 1e-9))
    paced = counter.model_copy(update={"block_s": windows * counter.window_s})
    return description.model_copy(update={"counter": paced})
