"""Constants of the twin: presets, and drawing all of them by a seed."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["Preset", "TwinParameters"]

Preset = Literal["nominal", "worn"]


@dataclass(frozen=True)
class TwinParameters:
    """Every constant of the simulated bench.

    Examples
    --------
    >>> TwinParameters.draw("nominal", seed=3) == TwinParameters.draw("nominal", seed=3)
    True
    """

    preset: Preset
    seed: int

    @classmethod
    def draw(cls, preset: Preset = "nominal", seed: int = 0) -> "TwinParameters":
        """Draw every constant: "nominal" is a healthy bench, "worn" has larger everything."""
        return cls(preset, seed)
