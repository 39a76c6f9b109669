"""Calibration profiles: the loaded steps, their order and their durations."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from torquebench.calibration.adaptive import Adaptive
from torquebench.calibration.plausibility import Plausibility
from torquebench.calibration.steps import Step
from torquebench.compensation import WHOLE_SHARE
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.validation import parse_toml, validated

Percent = Annotated[float, Field(gt=0, le=100)]
Seconds = Annotated[float, Field(ge=0, le=86400)]
Count = Annotated[int, Field(ge=1, le=1000)]
Direction = Literal["clockwise", "counter-clockwise"]
Series = Literal["up", "up-down"]
Change = Literal["none", "rotation", "re-seat"]
Consequence = Literal["refuse", "state"]
"""Whether a deviation refuses a certificate, or is stated in it."""

_SIGNS: dict[str, int] = {"clockwise": 1, "counter-clockwise": -1}
_OPTIONS: dict[str, frozenset[str]] = {
    "ladder": frozenset({"rising_only", "repeats", "step_percent", "up_to_percent", "duration_s"}),
    "cycle": frozenset({"repeats", "step_percent", "up_to_percent", "duration_s"}),
    "random": frozenset({"groups", "points", "same_points", "up_to_percent", "duration_s"}),
    "adaptive": frozenset({"points", "target_percent", "repeats", "step_percent", "duration_s"}),
}
_ADAPTIVE_OPTIONS = frozenset({"points", "target_percent"})


_LIMITS = Plausibility(
    loop_percent=0.5,
    repeat_percent=0.2,
    zero_percent=0.15,
    span_percent=1.5,
    direction_percent=0.6,
    change_percent=0.3,
)
"""Limits that every profile of version 0.2.0 had; profiles with these limits keep their hash."""

_OFF_GRID_SHARE = 0.25
"""Smallest distance of random points from the grid of steps, as a share of a step's width."""


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Zero(_Settings):
    """Settings of the unloaded zero.

    ``once`` takes one zero for all series, after the preloads in all directions; ``each-series``
    takes one before every series, as an evaluation with I₀ of each series needs it.
    `return_limit_percent` is the largest zero after a series, in % of full scale.
    """

    duration_s: Seconds = 1.0
    return_limit_percent: Percent | None = None
    when: Literal["once", "each-series"] = "each-series"


class Preload(_Settings):
    """Number of preloads before the first series of a position.

    `percent` is its torque in % of full scale, by default 100.
    """

    cycles: Annotated[int, Field(ge=0, le=100)] = 0
    cycles_after_change: Annotated[int, Field(ge=0, le=100)] | None = None
    on_s: Seconds = 0.0
    off_s: Seconds = 0.0
    percent: Percent | None = None


class Loading(_Settings):
    """Loaded steps, their duration and their repeats.

    Exactly one of `step_percent` and `steps_percent` is given, in % of full scale. Random points
    keep a distance from the grid `step_percent`; `up_to_percent` is their largest torque, to which
    range and grid are scaled; with `same_points` all groups have the same points.
    `step_tolerance_percent` is the largest deviation of a step from its nominal torque, in % of the
    step or of the range.
    """

    pattern: Literal["ladder", "cycle", "random"]
    step_percent: Percent | None = None
    steps_percent: tuple[Percent, ...] = ()
    duration_s: Seconds
    settle_limit_s: Seconds
    directions: tuple[Direction, ...] = Field(min_length=1)
    repeats: Count = 1
    groups: Count | None = None
    points: Annotated[int, Field(ge=4, le=10000)] | None = None
    same_points: bool = False
    up_to_percent: Percent | None = None
    zero_return: bool = False
    step_tolerance_percent: Percent | None = None
    step_tolerance_of: Literal["step", "range"] = "step"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Refuse keys that contradict each other or don't belong to the pattern."""
        if (self.step_percent is None) == (not self.steps_percent):
            raise ValueError("give exactly one of step_percent and steps_percent")
        if list(self.steps_percent) != sorted(set(self.steps_percent)):
            raise ValueError("steps_percent must increase from step to step")
        if len(set(self.directions)) != len(self.directions):
            raise ValueError("directions contains a direction twice")
        random = self.pattern == "random"
        if random != (self.groups is not None) or random != (self.points is not None):
            raise ValueError("groups and points are allowed with the pattern 'random' only")
        if not random and self.same_points:
            raise ValueError("same_points is allowed with the pattern 'random' only")
        if not random and self.up_to_percent is not None:
            raise ValueError("up_to_percent is allowed with the pattern 'random' only")
        return self

    def percents(self) -> tuple[float, ...]:
        """Return the rising steps in % of full scale."""
        if self.steps_percent:
            return self.steps_percent
        assert self.step_percent is not None
        count = int(np.floor(100.0 / self.step_percent + 1e-9))
        rising = [self.step_percent * k for k in range(1, count + 1)]
        if rising[-1] < 100.0 - 1e-9:
            rising.append(100.0)
        return tuple(min(percent, 100.0) for percent in rising)


class Position(_Settings):
    """One mounting position: the change before it and its series."""

    position_deg: float = 0.0
    change: Change = "none"
    series: tuple[Series, ...] = Field(min_length=1)


class Environment(_Settings):
    """Required stability of the environment from the first to the last point."""

    temperature_drift_k: Annotated[float, Field(gt=0, le=50)] = 1.0


class Reference(_Settings):
    """Requirements on the standard."""

    in_date: bool = True


class Deviations(_Settings):
    """Treatment of deviations from the profile in a certificate, by kind.

    A record that was changed later is always refused, because its original content is unknown.
    """

    missing_series: Consequence = "refuse"
    step_off: Consequence = "refuse"
    zero_return: Consequence = "refuse"
    expired_reference: Consequence = "refuse"
    temperature_drift: Consequence = "state"
    unsettled: Consequence = "state"
    changed_record: Literal["refuse"] = "refuse"


class Interruption(_Settings):
    """Conditions for resuming an interrupted calibration.

    ``series`` repeats the interrupted series, ``position`` all series of its mounting position,
    ``never`` the whole calibration. It can be resumed within `longest_h` hours.
    """

    resume: Literal["series", "position", "never"] = "series"
    longest_h: Annotated[float, Field(gt=0, le=8760)] = 24.0


class Profile(_Settings):
    """A calibration profile: a sequence of steps as data, not as code.

    Users can write profiles as TOML files in the form of those in ``calibration/profiles``. The
    flag `verified` is false until the profile has been checked against the licensed text of its
    standard; certificates print it beside the name and the hash. The next calibration is due after
    `valid_days` at the latest.

    Examples
    --------
    >>> profile = load_profile("rapid-in-situ")
    >>> points = [step for step in profile.staircase(50.0) if step.recorded]
    >>> len(points), points[0].nominal_nm, points[49].nominal_nm, points[99].nominal_nm
    (200, 1.0, 50.0, 0.0)
    >>> rising = profile.with_options(rising_only=True, step_percent=10.0)
    >>> [step.nominal_nm for step in rising.staircase(50.0) if step.recorded][:3]
    [5.0, 10.0, 15.0]
    """

    name: str = Field(min_length=1)
    title: str
    source: str
    verified: bool = False
    valid_days: Annotated[int, Field(ge=1, le=3660)] = 365
    loading: Loading
    preload: Preload = Preload()
    zero: Zero = Zero()
    environment: Environment = Environment()
    reference: Reference = Reference()
    deviations: Deviations = Deviations()
    plausibility: Plausibility = Plausibility()
    positions: tuple[Position, ...] = Field(min_length=1)
    adaptive: Adaptive | None = None
    interruption: Interruption | None = None

    @model_validator(mode="after")
    def _places_points_on_branches(self) -> Self:
        """Refuse adaptive points without a coarse ladder on both branches, or fewer than it has."""
        if self.adaptive is None:
            return self
        if self.loading.pattern != "ladder" or [position.series for position in self.positions] != [
            ("up-down",)
        ]:
            raise ValueError("adaptive needs a ladder and one position with one up-down series")
        coarse = 2 * len(self.loading.percents()) * len(self.loading.directions)
        if self.adaptive.points < coarse * self.loading.repeats:
            raise ValueError(
                Message(
                    "adaptive.points is {points}, the coarse series alone has {coarse}",
                    self.adaptive.points,
                    coarse * self.loading.repeats,
                )
            )
        return self

    @property
    def signs(self) -> tuple[int, ...]:
        """Directions in the order in which they are loaded: +1 clockwise, -1 counter-clockwise."""
        return tuple(_SIGNS[direction] for direction in self.loading.directions)

    @property
    def largest_percent(self) -> float:
        """Largest loaded torque, including preloads, in % of full scale."""
        loaded = [self._top_percent]
        if self.preload.cycles or self.preload.cycles_after_change:
            loaded.append(100.0 if self.preload.percent is None else self.preload.percent)
        return max(loaded)

    @property
    def _top_percent(self) -> float:
        """Largest step, in % of full scale."""
        if self.loading.pattern == "random":
            return self.loading.up_to_percent or 100.0
        return self.loading.percents()[-1]

    def within(self, percent: float) -> Self:
        """Return the profile, scaled down to a calibrated range in % of full scale.

        For a calibration to 90 % or more of full scale, the profile is returned unchanged.

        Examples
        --------
        >>> load_profile("verification").within(30.0).largest_percent
        30.0
        """
        if percent >= 100.0 * WHOLE_SHARE or self.largest_percent <= percent * (1.0 + 1e-9):
            return self
        return self.with_options(up_to_percent=min(percent, self._top_percent))

    @classmethod
    def from_toml(cls, text: str, origin: str) -> Self:
        """Return the profile that a TOML text describes.

        Parameters
        ----------
        text : str
            The TOML document.
        origin : str
            Name of the file, for messages.

        Raises
        ------
        InputError
            Where the text isn't TOML, or a key is missing, unknown or outside its limits.
        """
        return validated(cls, parse_toml(text, origin), origin)

    @property
    def sha256(self) -> str:
        """SHA-256 of the profile's settings, options included, as 64 hexadecimal digits."""
        settings = self.model_dump(mode="json")
        for name in ("adaptive", "interruption"):
            if settings[name] is None:  # profiles without this key keep their hash
                del settings[name]
        if self.plausibility in (Plausibility(), _LIMITS):
            del settings["plausibility"]
        if self.preload.percent is None:
            del settings["preload"]["percent"]
        if self.loading.up_to_percent is None:
            del settings["loading"]["up_to_percent"]
        if not self.loading.same_points:
            del settings["loading"]["same_points"]
        if self.loading.step_tolerance_of == "step":
            del settings["loading"]["step_tolerance_of"]
        content = json.dumps(settings, sort_keys=True, ensure_ascii=False)
        return hashlib.sha256(content.encode()).hexdigest()

    def with_options(
        self,
        *,
        rising_only: bool | None = None,
        repeats: int | None = None,
        step_percent: float | None = None,
        up_to_percent: float | None = None,
        duration_s: float | None = None,
        groups: int | None = None,
        points: int | None = None,
        same_points: bool | None = None,
        target_percent: float | None = None,
    ) -> Self:
        """Return the profile with some of its settings changed; None keeps a setting.

        Parameters
        ----------
        rising_only : bool, optional
            Load rising series only, as the rapid calibration's source does (ladders only).
        repeats : int, optional
            Number of repeats of every series.
        step_percent : float, optional
            Width of the steps in % of full scale.
        up_to_percent : float, optional
            Largest step and preload in % of full scale, at most that of the profile; all steps are
            scaled to it. For applications that use only a small part of a module's range.
        duration_s : float, optional
            Duration of each step in s.
        groups : int, optional
            Number of groups (random points only).
        points : int, optional
            Number of points in each group, or largest number of points of an adaptive profile.
        same_points : bool, optional
            Load the same points in every group (random points only).
        target_percent : float, optional
            Expanded uncertainty of the model that ends an adaptive calibration, % of full scale.

        Raises
        ------
        InputError
            Where the profile has no such option, or the value lies outside its limits.
        """
        changes: dict[str, Any] = {
            "rising_only": rising_only,
            "repeats": repeats,
            "step_percent": step_percent,
            "up_to_percent": up_to_percent,
            "duration_s": duration_s,
            "groups": groups,
            "points": points,
            "same_points": same_points,
            "target_percent": target_percent,
        }
        changes = {name: value for name, value in changes.items() if value is not None}
        allowed = _OPTIONS[self.loading.pattern if self.adaptive is None else "adaptive"]
        for name in changes:
            if name not in allowed:
                raise InputError(
                    Message("option {option} for the profile {profile}", name, self.name),
                    Message("the options {allowed}", ", ".join(sorted(allowed))),
                )
        document = self.model_dump(mode="python")
        if "up_to_percent" in changes:
            self._shrink(document, changes.pop("up_to_percent"), changes)
        if changes.pop("rising_only", False):
            for position in document["positions"]:
                position["series"] = tuple("up" for _ in position["series"])
        if "step_percent" in changes:
            document["loading"]["steps_percent"] = ()
        for name, value in changes.items():
            table = "adaptive" if name in _ADAPTIVE_OPTIONS and self.adaptive else "loading"
            document[table][name] = value
        return validated(type(self), document, f"profile {self.name}")

    def _shrink(
        self, document: dict[str, Any], up_to_percent: float, changes: Mapping[str, Any]
    ) -> None:
        """Scale the steps and the preload of a profile down to a largest step."""
        if "step_percent" in changes:
            raise InputError("both a step width and a largest torque", "one of both")
        top = self._top_percent
        if not 0.0 < up_to_percent <= top * (1.0 + 1e-9):
            raise InputError(
                Message("steps up to {up_to_percent:g} % of range", up_to_percent),
                Message(
                    "above 0 and at most {top:g} %, the largest step of profile {name}",
                    top,
                    self.name,
                ),
                "use a smaller torque, or a profile with larger steps",
            )
        up_to_percent = min(up_to_percent, top)
        if self.loading.pattern == "random":
            document["loading"]["up_to_percent"] = up_to_percent
        else:
            document["loading"] |= {
                "step_percent": None,
                "steps_percent": tuple(
                    float(f"{up_to_percent / top * percent:.9g}")
                    for percent in self.loading.percents()
                ),
            }
        document["preload"]["percent"] = min(up_to_percent, self.preload.percent or 100.0)

    def staircase(self, range_nm: float, rng: np.random.Generator | None = None) -> list[Step]:
        """Return all steps in the order in which they are loaded.

        Parameters
        ----------
        range_nm : float
            Full scale in N·m.
        rng : numpy.random.Generator, optional
            Random generator for the points of a random profile; other profiles need none.

        Returns
        -------
        list of Step
            Zeros, preloads, turns and points; `Step.recorded` marks the points.

        Raises
        ------
        InputError
            Where the range isn't above 0, or a profile of random points gets no generator.
        """
        if not (np.isfinite(range_nm) and range_nm > 0):
            raise InputError(
                Message("range {range_nm} N·m", range_nm), "a finite range above 0 N·m"
            )
        if self.loading.pattern == "random" and rng is None:
            raise InputError(
                Message("profile {name} without a random generator", self.name),
                "a numpy.random.Generator",
                "hand in numpy.random.default_rng(seed)",
            )
        return list(_Staircase(self, range_nm, rng).steps())


def _with_change(step: Step, change: Change) -> Step:
    return step if step.change == change else step.model_copy(update={"change": change})


class _Staircase:
    """Builder of the steps of one profile for one range."""

    def __init__(self, profile: Profile, range_nm: float, rng: np.random.Generator | None) -> None:
        self.profile = profile
        self.range_nm = range_nm
        self.rng = rng
        self.series = 0
        self._first_path: list[tuple[Literal["point", "turn"], float, int]] = []

    def steps(self) -> Iterator[Step]:
        """Yield zeros, preloads, turns and points in the order in which they are loaded."""
        profile = self.profile
        # A cycle or a group of random points goes through all directions within one series.
        separate = profile.loading.pattern != "ladder"
        every = profile.signs
        per_direction = [every] if separate else [(sign,) for sign in every]
        once = profile.zero.when == "once"
        for number, position in enumerate(profile.positions):
            change: Change = position.change
            if once:
                for step in [*self._preloads(number, position, every), self._zero(position)]:
                    yield _with_change(step, change)
                    change = "none"
            for signs in per_direction:
                laid_out = self._preloads(number, position, signs) if not once else []
                laid_out += self._all_series(position, signs)
                for step in laid_out:
                    yield _with_change(step, change)
                    change = "none"

    def _preloads(self, number: int, position: Position, signs: Sequence[int]) -> list[Step]:
        """Return the preloads of a position, each to the largest torque and back to zero."""
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

    def _all_series(self, position: Position, signs: Sequence[int]) -> list[Step]:
        """Return a position's steps in all of its series."""
        loading = self.profile.loading
        steps: list[Step] = []
        for shape in position.series * (loading.repeats * (loading.groups or 1)):
            self.series += 1
            if self.profile.zero.when == "each-series":
                steps.append(self._zero(position))
            steps += self._one_series(shape, position, signs)
        return steps

    def _one_series(self, shape: Series, position: Position, signs: Sequence[int]) -> list[Step]:
        """Return the steps of one series by the profile's pattern."""
        steps: list[Step] = []
        path: Iterable[tuple[Literal["point", "turn"], float, int]]
        if self.profile.loading.pattern != "random":
            path = self._ladder_path(shape, signs)
        elif self.profile.loading.same_points:
            path = self._first_path = self._first_path or list(self._random_path(signs))
        else:
            path = self._random_path(signs)
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
        self, shape: Series, signs: Sequence[int]
    ) -> Iterator[tuple[Literal["point", "turn"], float, int]]:
        """Yield kind, signed torque in percent, and branch (+1 loading, -1 unloading) in order."""
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
        """Yield random points of each direction, rising and then falling, with the turn between."""
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
        grid_numbers = np.floor(drawn)
        width = np.minimum(grid, 100.0 - grid_numbers * grid)  # the last step may be narrower
        share = np.minimum((drawn - grid_numbers) * grid / width, 1.0)
        fraction = _OFF_GRID_SHARE + (1.0 - 2.0 * _OFF_GRID_SHARE) * share
        return [float(percent) for percent in grid_numbers * grid + fraction * width]

    def _zero(self, position: Position) -> Step:
        return self._step("zero", 0.0, position, 0, self.profile.zero.duration_s)

    def _step(
        self,
        kind: Literal["zero", "preload", "turn", "point"],
        percent: float,
        position: Position,
        branch: int,
        duration_s: float,
    ) -> Step:
        """Return a step of the present series, its torque in percent of the range."""
        return Step(
            kind=kind,
            series=self.series,
            index=-1,
            nominal_nm=percent * self.range_nm / 100.0,
            branch=branch,
            duration_s=duration_s,
            settle_limit_s=self.profile.loading.settle_limit_s,
            position_deg=position.position_deg,
            change="none",
        )


def available_profiles(package: str = __package__) -> tuple[str, ...]:
    """Return the names of the profiles in a package's folder "profiles".

    Examples
    --------
    >>> available_profiles()[:3]
    ('adaptive', 'check', 'rapid-in-situ')
    """
    folder = resources.files(package) / "profiles"
    names = (entry.name for entry in folder.iterdir() if entry.name.endswith(".toml"))
    return tuple(sorted(name.removesuffix(".toml") for name in names))


def profile_text(name: str | Path, package: str = __package__) -> str:
    """Return the TOML text of a packaged profile (by name) or of a file (by path).

    Parameters
    ----------
    name : str or pathlib.Path
        One of `available_profiles`, or a path that ends in ``.toml``.
    package : str
        The package that contains the profiles.

    Raises
    ------
    InputError
        Where there is no such profile or file.
    """
    text = str(name)
    if not text.endswith(".toml"):
        if text not in available_profiles(package):
            raise InputError(
                Message("profile {text!r}", text),
                ", ".join(available_profiles(package)),
                "give one of these names, or the path of your own .toml file",
            )
        resource = resources.files(package) / "profiles" / f"{text}.toml"
        return resource.read_text(encoding="utf-8")
    try:
        return Path(text).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            Message("profile {text}: {error}", text, error), "a readable TOML file in UTF-8"
        ) from error


def load_profile(name: str | Path) -> Profile:
    """Return a packaged profile (by name) or a user's profile (by the path of its TOML file).

    Parameters
    ----------
    name : str or pathlib.Path
        One of `available_profiles`, or a path that ends in ``.toml``.

    Raises
    ------
    InputError
        Where there is no such profile or file, or the file isn't a valid profile.
    """
    origin = str(name)
    if not origin.endswith(".toml"):
        origin += ".toml"
    return Profile.from_toml(profile_text(name), origin)
