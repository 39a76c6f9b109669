"""The devices of one bench."""

from __future__ import annotations

from ophyd_async.core import Device

from torquebench.bench.devices.context import BenchContext
from torquebench.bench.devices.drive import DriveDevice
from torquebench.bench.devices.fixture import (
    ClampDevice,
    GuideRailDevice,
    ModeDevice,
    MountingDevice,
    SeatDevice,
)
from torquebench.bench.devices.labels import PointLabel
from torquebench.bench.devices.recorder import Recorder
from torquebench.bench.devices.sensors import Encoder, Reference, TemperatureProbes, Transducer
from torquebench.bench.devices.steady import SteadyTorque
from torquebench.bench.roles import Side


class Module(Device):
    """One side of the bench: drive, mode conversion, transducer, encoder, steady torque."""

    def __init__(self, context: BenchContext, side: Side) -> None:
        self.side = side
        self.drive = DriveDevice(context, side)
        self.mode = ModeDevice(context, side)
        self.transducer = Transducer(context, side)
        self.encoder = Encoder(context, side)
        self.steady = SteadyTorque(context, side)
        super().__init__()


class BenchDevices(Device):
    """All devices that a plan may use.

    Attributes
    ----------
    input, output : Module
        The two modules; `module(side)` picks one.
    reference : Reference
        The mounted calibrator or verification standard.
    point : PointLabel
        Stamp for the events of a procedure.
    recorder : Recorder
        Angles and torques of both sides at the same times.

    Examples
    --------
    A plan that takes one point::

        def one_point(devices):
            yield from bps.mv(devices.mounting, "calibrator")
            yield from bps.mv(devices.clamp, True)
            yield from bps.mv(devices.output.mode, "driven", devices.input.mode, "locked")
            yield from bps.mv(devices.output.drive.power, True)
            yield from bps.prepare(devices.output.steady, SteadySettings(reference=True), wait=True)
            yield from bps.checkpoint()
            yield from bps.mv(devices.point, Point(series=0, step=1, branch=1, nominal_nm=40.0))
            yield from bps.mv(devices.output.drive.torque, 40.0)
            yield from bps.trigger_and_read([devices.output.steady, devices.point])
    """

    def __init__(self, context: BenchContext) -> None:
        self.context = context
        self.input = Module(context, "input")
        self.output = Module(context, "output")
        self.reference = Reference(context)
        self.clamp = ClampDevice(context)
        self.rail = GuideRailDevice(context)
        self.mounting = MountingDevice(context)
        self.seat = SeatDevice(context)
        self.temperatures = TemperatureProbes(context)
        self.point = PointLabel()
        self.recorder = Recorder(context)
        super().__init__()
        for attribute, child in self.children():
            child.set_name(attribute)

    def module(self, side: Side) -> Module:
        """Return the module of a side."""
        return self.input if side == "input" else self.output
