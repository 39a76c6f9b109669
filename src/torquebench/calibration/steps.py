"""One step of a loading sequence."""

from typing import Literal

from pydantic import BaseModel, ConfigDict


class Step(BaseModel):
    """One step of a loading sequence.

    Parameters
    ----------
    kind : {"zero", "preload", "turn", "point"}
        A zero is read unloaded and subtracted; preloads and turns are loaded and not recorded;
        a point is recorded.
    series : int
        Number of the series, from 1; 0 before the first series.
    index : int
        Number of the point in its series, from 0; -1 where the step isn't recorded.
    nominal_nm : float
        Nominal torque, which is loaded, in N·m, clockwise positive.
    branch : int
        +1 where |torque| grows to this step, -1 where it falls, 0 for a zero.
    duration_s : float
        Duration of the step in s.
    settle_limit_s : float
        Largest additional time until the reading has settled, in s; a point that hasn't settled by
        then is marked.
    position_deg : float
        Mounting position in degrees.
    change : {"none", "rotation", "re-seat"}
        Change of the mounting by the operator before this step.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["zero", "preload", "turn", "point"]
    series: int
    index: int
    nominal_nm: float
    branch: int
    duration_s: float
    settle_limit_s: float = 0.0
    position_deg: float = 0.0
    change: Literal["none", "rotation", "re-seat"] = "none"

    @property
    def recorded(self) -> bool:
        """Whether the step gives a point of the calibration table."""
        return self.kind == "point"
