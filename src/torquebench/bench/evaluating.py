"""Evaluation of a measured block: frequency, torque, conditions and compensated torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.acceleration import (
    LEAST_SPAN_S,
    UNKNOWN,
    Acceleration,
    EncoderAcceleration,
)
from torquebench.bench.active_chain import ActiveChain
from torquebench.bench.blocks import CONDITIONS, KEPT_S, Block
from torquebench.bench.channels import Channel
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.roles import SIDES, Side, angle_channel, torque_channel
from torquebench.chain import Torque
from torquebench.signals import EdgeBlock, History, Record
from torquebench.units import RPM_PER_RAD_S, TURN

FloatArray = NDArray[np.float64]
ANGLE_RATE_HZ = 1000.0


class BlockEvaluator:
    """Evaluates blocks in order, with the values of the standard's read-out and of the probes."""

    def __init__(self, description: BenchDescription, drivers: DriverSet) -> None:
        self._description = description
        self._drivers = drivers
        self.angles = {side: History(round(KEPT_S * ANGLE_RATE_HZ)) for side in SIDES}
        """Encoder counts of the last two minutes."""
        self._accelerations = {side: EncoderAcceleration() for side in SIDES}
        self._per_revolution = {
            side: encoder.counts_per_revolution
            for side in SIDES
            if (encoder := description.module(side).encoder) is not None
        }

    def evaluate(self, measured: Block, channels: Sequence[Channel]) -> Block:
        """Return a block with the readings of these channels and the conditions."""
        records: dict[str, Record] = {
            name: measured.records[name] for name in map(angle_channel, self._per_revolution)
            if name in measured.records
        }  # fmt: skip
        readout = self._drivers.reference
        partners = {(channel.side, not channel.standard): channel for channel in channels}
        for channel in channels:
            name = channel.name
            delivered: EdgeBlock | Record | None
            if channel.standard and readout is not None:
                delivered = readout.read(channel.side, measured.stop_s, measured.timed_s)
            else:  # neither exists if the channel was selected after this block was timed
                delivered = measured.records.get(name, measured.edges.get(name))
            if delivered is not None:
                partner = partners.get((channel.side, channel.standard))
                records[name] = channel.push(delivered, partner)
        records[CONDITIONS] = self._conditions(measured)
        return replace(measured, records=records)

    def _conditions(self, block: Block) -> Record:
        """Return speeds, accelerations and temperatures over a block; NaN for unknown ones."""
        values: dict[str, float] = {"time_s": block.stop_s}
        for side in SIDES:
            angle, speed, acceleration = block.angle(side), np.nan, UNKNOWN
            if angle is not None and side in self._per_revolution:
                self.angles[side].append(angle)
                if len(angle) >= 2:  # a silent encoder doesn't mean standstill
                    speed = mean_speed(angle, self._per_revolution[side])
                acceleration = self._acceleration(side, angle)
            values[f"{side}_speed_rad_s"] = speed
            values[f"{side}_acceleration_rad_s2"] = acceleration.rad_s2
            values[f"{side}_acceleration_uncertainty_rad_s2"] = acceleration.uncertainty_rad_s2
        temperatures = self._drivers.temperature.temperatures()
        for probe in self._description.temperatures:
            values[f"{probe}_c"] = temperatures.get(probe, np.nan)
        columns = np.array([[value] for value in values.values()])
        return Record.unchecked(dict(zip(values, columns, strict=True)), 1)

    def _acceleration(self, side: Side, angle: Record) -> Acceleration:
        """Return a shaft's acceleration over a block; a short block is extended backwards."""
        time_s = angle.time_s
        if time_s.size and time_s[-1] - time_s[0] < LEAST_SPAN_S:
            longer = self.angles[side].window(
                time_s[-1] - LEAST_SPAN_S, np.nextafter(time_s[-1], np.inf)
            )
            angle = angle if longer is None else longer
        return self._accelerations[side](
            angle.time_s, angle["angle_counts"], self._per_revolution[side]
        )

    def compensate(
        self,
        blocks: Sequence[Block],
        channels: Mapping[str, Channel],
        compensations: Mapping[Side, ActiveChain],
    ) -> Block:
        """Join consecutive evaluated blocks, and compensate them."""
        joined, torques = Block.join(blocks), {}
        fine = {
            name: (channel.push_fine(joined.edges[name]), channel.fine_window_s)
            for name, channel in channels.items()
            if channel.fine_window_s is not None and name in joined.edges
        }
        for side, active in compensations.items():
            name = torque_channel(side)
            if name in fine:
                self._compensated(joined, side, active, *fine[name], fine=True)
            else:
                active.end_fine()
            if name in joined.records:
                window_s = self._description.counter.window_s
                torques[side] = self._compensated(
                    joined, side, active, joined.records[name], window_s
                )
        return replace(joined, torques=torques)

    def _compensated(
        self,
        block: Block,
        side: Side,
        active: ActiveChain,
        record: Record,
        window_s: float,
        *,
        fine: bool = False,
    ) -> Torque:
        """Compensate windows with the conditions at the end of each window's block."""
        module, conditions = self._description.module(side), block.records[CONDITIONS]
        angle_rad: FloatArray | None = None
        if active.needs_angle and module.encoder is not None and module.encoder.absolute:
            angle_rad = self._angles(side, record.time_s - module.transducer.group_delay_s)
        if len(conditions) > 1:
            row = conditions.time_s.searchsorted(record.time_s).clip(max=len(conditions) - 1)

        def value(name: str) -> Any:
            """Return a condition at the end of each window's block; once for a single block."""
            values = conditions[name]
            return values.item() if values.size == 1 else values[row]

        quantities = {
            "speed_rpm": value(f"{side}_speed_rad_s") * RPM_PER_RAD_S,
            "temperature_c": value(f"{module.temperature_probe}_c"),
            "acceleration_rad_s2": value(f"{side}_acceleration_rad_s2"),
            "acceleration_uncertainty_rad_s2": value(f"{side}_acceleration_uncertainty_rad_s2"),
            "angle_rad": angle_rad,
            "window_s": window_s,
        }
        return active.push(record, quantities, value("time_s"), fine=fine)

    def _angles(self, side: Side, time_s: FloatArray) -> FloatArray | None:
        """Return the shaft's angle at given times, rad; NaN without a value of the encoder."""
        if not time_s.size:
            return None
        around_s = 2.0 * self._description.counter.window_s
        angle = self.angles[side].window(time_s[0] - around_s, time_s[-1] + around_s)
        if angle is None or len(angle) < 2:
            return None
        counts = np.interp(time_s, angle.time_s, angle["angle_counts"], left=np.nan, right=np.nan)
        return np.asarray(counts * (TURN / self._per_revolution[side]))


def mean_speed(angle: Record, per_revolution: int) -> float:
    """Return the mean speed between the first and the last sample of an encoder, rad/s."""
    counts, time_s = angle["angle_counts"], angle.time_s
    turns = float(counts[-1] - counts[0]) / per_revolution
    return TURN * turns / float(time_s[-1] - time_s[0])
