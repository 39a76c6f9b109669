"""From a profile and a range to the steps that are loaded, in their order."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from torquebench.calibration.steps import Step

if TYPE_CHECKING:
    from torquebench.calibration.profile import Change, Position, Profile, Series

__all__ = ["Staircase"]

OFF_GRID_SHARE = 0.25
"""Points off the grid keep at least this share of a step's width from it."""


class Staircase:
    """Lays out the steps of one profile at one range."""

    def __init__(
        self, profile: "Profile", range_nm: float, rng: np.random.Generator | None
    ) -> None:
        self.profile = profile
        self.range_nm = range_nm
        self.rng = rng
        self.series = 0

    def steps(self) -> Iterator[Step]:
        """Yield zeros, preloads, turns and points in the order in which they are loaded."""
        profile = self.profile
        # A cycle or a group of random points goes through all directions within one series.
        whole = profile.loading.pattern != "ladder"
        every = profile.signs
        per_direction = [every] if whole else [(sign,) for sign in every]
        once = profile.zero.when == "once"
        for number, position in enumerate(profile.positions):
            change: Change = position.change
            if once:
                for step in [*self._preloads(number, position, every), self._zero(position)]:
                    yield step.model_copy(update={"change": change})
                    change = "none"
            for signs in per_direction:
                laid_out = self._preloads(number, position, signs) if not once else []
                laid_out += self._all_series(position, signs)
                for step in laid_out:
                    yield step.model_copy(update={"change": change})
                    change = "none"

    def _preloads(self, number: int, position: "Position", signs: Sequence[int]) -> list[Step]:
        preload = self.profile.preload
        after_change = preload.cycles_after_change
        cycles = preload.cycles if number == 0 or after_change is None else after_change
        largest = 100.0 if preload.percent is None else preload.percent
        return [
            self._step("preload", percent, position, 1 if percent else -1, duration)
            for _ in range(cycles)
            for sign in signs
            for percent, duration in ((largest * sign, preload.on_s), (0.0, preload.off_s))
        ]

    def _all_series(self, position: "Position", signs: Sequence[int]) -> list[Step]:
        loading = self.profile.loading
        steps: list[Step] = []
        for shape in position.series * (loading.repeats * (loading.groups or 1)):
            self.series += 1
            if self.profile.zero.when == "each-series":
                steps.append(self._zero(position))
            steps += self._one_series(shape, position, signs)
        return steps

    def _one_series(
        self, shape: "Series", position: "Position", signs: Sequence[int]
    ) -> list[Step]:
        steps: list[Step] = []
        if self.profile.loading.pattern == "random":
            path = self._random_path(signs)
        else:
            path = self._ladder_path(shape, signs)
        index = 0
        duration = self.profile.loading.duration_s
        for kind, percent, branch in path:
            if kind == "turn":
                steps.append(self._step("turn", percent, position, branch, 0.0))
                continue
            step = self._step("point", percent, position, branch, duration)
            steps.append(step.model_copy(update={"index": index}))
            index += 1
        return steps

    def _ladder_path(
        self, shape: "Series", signs: Sequence[int]
    ) -> Iterator[tuple[Literal["point", "turn"], float, int]]:
        rising = self.profile.loading.percents()
        for sign in signs:
            for percent in rising:
                yield "point", sign * percent, 1
            if shape == "up-down":
                for percent in rising[-2::-1]:
                    yield "point", sign * percent, -1
            if shape == "up-down" or self.profile.loading.zero_return:
                yield "point", 0.0, -1

    def _random_path(
        self, signs: Sequence[int]
    ) -> Iterator[tuple[Literal["point", "turn"], float, int]]:
        loading = self.profile.loading
        assert loading.points is not None
        assert self.rng is not None
        top = loading.up_to_percent or 100.0
        parts = 2 * len(signs)
        counts = [(loading.points + parts - 1 - k) // parts for k in range(parts)]
        for number, sign in enumerate(signs):
            for percent in self._off_grid(counts[2 * number]):
                yield "point", sign * percent * top / 100.0, 1
            yield "turn", sign * top, 1
            for percent in self._off_grid(counts[2 * number + 1])[::-1]:
                yield "point", sign * percent * top / 100.0, -1

    def _off_grid(self, count: int) -> list[float]:
        """Draw one rising point in each of `count` equal cells, off the grid of the steps."""
        assert self.rng is not None
        grid = self.profile.loading.step_percent or 100.0 / count
        drawn = (np.arange(count) + self.rng.uniform(0.0, 1.0, count)) * (100.0 / count) / grid
        whole = np.floor(drawn)
        width = np.minimum(grid, 100.0 - whole * grid)  # the last step may be a narrower one
        share = np.minimum((drawn - whole) * grid / width, 1.0)
        fraction = OFF_GRID_SHARE + (1.0 - 2.0 * OFF_GRID_SHARE) * share
        return [float(percent) for percent in whole * grid + fraction * width]

    def _zero(self, position: "Position") -> Step:
        return self._step("zero", 0.0, position, 0, self.profile.zero.duration_s)

    def _step(
        self,
        kind: Literal["zero", "preload", "turn", "point"],
        percent: float,
        position: "Position",
        branch: int,
        duration_s: float,
    ) -> Step:
        return Step(
            kind=kind,
            series=self.series,
            index=-1,
            target_nm=percent * self.range_nm / 100.0,
            branch=branch,
            duration_s=duration_s,
            settle_limit_s=self.profile.loading.settle_limit_s,
            position_deg=position.position_deg,
            change="none",
        )
