"""Mode conversion, clamp, guide rail and mounting."""

from __future__ import annotations

from ophyd_async.core import (
    AsyncStatus,
    StandardReadable,
    StandardReadableFormat,
    soft_signal_r_and_setter,
)

from torquebench.bench.devices.context import BenchContext
from torquebench.bench.interlocks import (
    PlannedState,
    check_clamp,
    check_mode_change,
    check_mounting,
    check_rail,
    check_seating,
)
from torquebench.bench.roles import Mode, Mounting, RailPosition, Seating, Side


class ModeDevice(StandardReadable):
    """Test mode of one side: `set("free" | "driven" | "locked")`; only without load."""

    def __init__(self, context: BenchContext, side: Side) -> None:
        self._context = context
        self._side = side
        with self.add_children_as_readables(StandardReadableFormat.UNCACHED_SIGNAL):
            self.mode, _ = soft_signal_r_and_setter(
                str, getter=lambda: context.drivers.modes.mode(side)
            )
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: Mode) -> None:
        """Change the mode. Raises InterlockError under load or in motion."""
        context = self._context
        check_mode_change(context.state, self._side, value)
        await context.call(context.drivers.modes.set_mode, self._side, value)

    def rehearse(self, planned: PlannedState, value: Mode) -> None:
        """Change the mode in the planned state."""
        check_mode_change(planned, self._side, value)
        planned.modes[self._side] = value


class ClampDevice(StandardReadable):
    """The hydraulic clamp: `set(True)` closes it, `set(False)` opens it; only without load."""

    def __init__(self, context: BenchContext) -> None:
        self._context = context
        with self.add_children_as_readables(StandardReadableFormat.UNCACHED_SIGNAL):
            self.clamped, _ = soft_signal_r_and_setter(bool, getter=context.drivers.clamp.clamped)
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: bool) -> None:
        """Close or open the clamp. Raises InterlockError under load or with nothing mounted."""
        context = self._context
        check_clamp(context.state, value)
        await context.call(context.drivers.clamp.set_clamped, value)

    def rehearse(self, planned: PlannedState, value: bool) -> None:
        """Close or open the clamp in the planned state."""
        check_clamp(planned, value)
        planned.closed = value


class GuideRailDevice(StandardReadable):
    """The guide rail of the input module: `set("end" | "away")`; only with the clamp open."""

    def __init__(self, context: BenchContext) -> None:
        self._context = context
        with self.add_children_as_readables(StandardReadableFormat.UNCACHED_SIGNAL):
            self.position, _ = soft_signal_r_and_setter(str, getter=context.state.rail)
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: RailPosition) -> None:
        """Move the rail. Raises InterlockError under load, with a closed clamp or drives on."""
        context = self._context
        check_rail(context.state, value)
        assert context.drivers.rail is not None
        await context.call(context.drivers.rail.move, value)

    def rehearse(self, planned: PlannedState, value: RailPosition) -> None:
        """Move the rail in the planned state."""
        check_rail(planned, value)
        planned.rail_position = value


class MountingDevice(StandardReadable):
    """Part between the flanges: `set` asks the operator to mount it; only with the clamp open.

    `set("calibrator" | "verification_standard" | "reducer" | "nothing")`.
    """

    def __init__(self, context: BenchContext) -> None:
        self._context = context
        with self.add_children_as_readables(StandardReadableFormat.UNCACHED_SIGNAL):
            self.mounted, _ = soft_signal_r_and_setter(str, getter=context.drivers.operator.mounted)
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: Mounting) -> None:
        """Ask for this mounting. Raises InterlockError with a closed clamp or when declined."""
        context = self._context
        check_mounting(context.state, value)
        if value == context.state.mounted():
            return
        await context.call(context.drivers.operator.mount, value)
        context.acquisition.select_for(value)
        # When this is done, the first samples of the reference standard have arrived.
        await context.clock.sleep(context.description.counter.block_s)

    def rehearse(self, planned: PlannedState, value: Mounting) -> None:
        """Change the mounting in the planned state."""
        check_mounting(planned, value)
        planned.mounting = value


class SeatDevice(StandardReadable):
    """Seating of the mounted standard: `set(Seating(...))` asks to turn or re-seat it."""

    def __init__(self, context: BenchContext) -> None:
        self._context = context
        with self.add_children_as_readables():
            self.position_deg, self._set_position = soft_signal_r_and_setter(float)
            self.seatings, self._set_seatings = soft_signal_r_and_setter(int)
        self._count = 0
        super().__init__()

    @AsyncStatus.wrap
    async def set(self, value: Seating) -> None:
        """Ask for this seating. Raises InterlockError with a closed clamp or when declined."""
        context = self._context
        check_seating(context.state)
        await context.call(context.drivers.operator.seat, value)
        self._count += 1
        self._set_position(value.position_deg)
        self._set_seatings(self._count)
        await context.clock.sleep(context.description.counter.block_s)

    def rehearse(self, planned: PlannedState, _value: Seating) -> None:
        """Change nothing: the planned state has no seating."""
        check_seating(planned)
