"""Previews of operations: loads, speeds and duration, rehearsed with the same plan."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from torquebench.bench.roles import SIDES, Side
from torquebench.message import Message
from torquebench.reports.page import Facts, Page, Section, Table
from torquebench.units import HOUR, MINUTE, RPM_PER_RAD_S

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.calibration import Profile, Step
    from torquebench.procedures import Rehearsal


@dataclass(frozen=True)
class LoadedSeries:
    """Neighbouring steps of one kind on one branch of a loading sequence.

    Parameters
    ----------
    series : str
        Numbers of the series, such as "2–4"; empty before the first one.
    what : str
    steps, times : int
        Number of steps of one series, and number of equal series.
    first_nm, last_nm : float
    step_s, total_s : float
        Shortest duration of a step, and of all steps together.
    """

    series: str
    what: str
    steps: int
    times: int
    first_nm: float
    last_nm: float
    step_s: float
    total_s: float


@dataclass(frozen=True)
class TestPart:
    """A part of a reducer test, with its largest torques and speeds.

    Parameters
    ----------
    title : str
    duration_s, longest_s : float
        Shortest bench time, and longest one with all repeats that the test may add.
    longest_warm_up_s : float
        Longest additional time for warming up.
    points : int
    largest_torque_nm, largest_speed_rpm : mapping of side to float
    """

    title: str
    duration_s: float
    longest_s: float
    longest_warm_up_s: float
    points: int
    largest_torque_nm: Mapping[str, float]
    largest_speed_rpm: Mapping[str, float]


@dataclass(frozen=True)
class Preview:
    """Preview of an operation, checked against limits and interlocks; nothing has moved.

    Parameters
    ----------
    title : str
    duration_s : float
        Bench time without additional waits for settling or warming up, s.
    points : int
    largest_torque_nm, limit_torque_nm : mapping of side to float
        Largest commanded torque, and the bench's limit.
    largest_speed_rpm, limit_speed_rpm : mapping of side to float
    time_s, nominal_nm : tuple of float
        The torque commanded to the loaded side over time, for a loading sequence; else empty.
    mounts : tuple of str
        Mountings that the operator will have to perform, in order.
    series : tuple of LoadedSeries
        Series of a loading sequence.
    parts : tuple of TestPart
        Parts of a reducer test.
    remarks : tuple of str
    simulated : bool
    doubts : tuple of str
        Doubts about the result from the operation's check, such as an expired standard or a wrong
        clock.
    """

    title: str
    duration_s: float
    points: int
    largest_torque_nm: Mapping[str, float] = field(default_factory=dict)
    limit_torque_nm: Mapping[str, float] = field(default_factory=dict)
    largest_speed_rpm: Mapping[str, float] = field(default_factory=dict)
    limit_speed_rpm: Mapping[str, float] = field(default_factory=dict)
    time_s: tuple[float, ...] = ()
    nominal_nm: tuple[float, ...] = ()
    mounts: tuple[str, ...] = ()
    series: tuple[LoadedSeries, ...] = ()
    parts: tuple[TestPart, ...] = ()
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    simulated: bool = False

    def page(self) -> Page:
        """Return its description for all screens."""
        facts = [("Duration", duration_words(self.duration_s)), ("Points", str(self.points))]
        for what, unit, largest, limits in (
            ("torque", "N·m", self.largest_torque_nm, self.limit_torque_nm),
            ("speed", "rpm", self.largest_speed_rpm, self.limit_speed_rpm),
        ):
            facts += [
                (
                    Message("Largest {what}, {side}", what, side),
                    Message("{value:.4g} of {limit:g} {unit}", value, limits[side], unit),
                )
                for side, value in largest.items()
                if value and side in limits
            ]
        if self.mounts:
            facts.append(("To be mounted", Message.joined(dict.fromkeys(self.mounts))))
        blocks: list[Any] = [Facts(facts)]
        if self.series:
            blocks.append(self._steps())
        if self.parts:
            blocks.append(self._parts())
        remarks = [Facts([("Remark", each) for each in self.remarks])] * bool(self.remarks)
        return Page(
            self.title, "", [Section("", "", [*blocks, *remarks])], simulated=self.simulated
        )

    def _steps(self) -> Table:
        header = ("series", "what", "steps", "from, N·m", "to, N·m", "each, s", "in all, s")
        rows = [
            (
                part.series,
                part.what,
                f"{part.times} × {part.steps}" if part.times > 1 else str(part.steps),
                f"{part.first_nm:g}",
                f"{part.last_nm:g}",
                f"{part.step_s:g}",
                f"{part.total_s:.1f}",
            )
            for part in self.series
        ]
        return Table(header, rows)

    def _parts(self) -> Table:
        header = (
            "part",
            "time, min",
            "warm-up, min",
            "points",
            "input, N·m",
            "input, rpm",
            "output, N·m",
            "output, rpm",
        )
        rows = [
            (
                part.title,
                _range_min(part.duration_s, part.longest_s),
                f"≤ {part.longest_warm_up_s / MINUTE:.0f}" if part.longest_warm_up_s else "–",
                str(part.points),
                *(
                    f"{largest[side]:.4g}" if largest.get(side) else "–"
                    for side in SIDES
                    for largest in (part.largest_torque_nm, part.largest_speed_rpm)
                ),
            )
            for part in self.parts
        ]
        return Table(header, rows)


def _range_min(shortest_s: float, longest_s: float) -> str:
    if longest_s > shortest_s:
        return f"{shortest_s / MINUTE:.0f}–{longest_s / MINUTE:.0f}"
    return f"{shortest_s / MINUTE:.1f}"


def duration_words(seconds: float) -> str:
    """Return a duration as text.

    Examples
    --------
    >>> duration_words(42.4), duration_words(125.0), duration_words(7260.0)
    ('42 s', '2 min 5 s', '2 h 1 min')
    """
    whole = round(seconds)
    if whole < MINUTE:
        return f"{whole} s"
    if whole < HOUR:
        return f"{whole // MINUTE:.0f} min {whole % MINUTE:.0f} s"
    return f"{whole // HOUR:.0f} h {whole % HOUR // MINUTE:.0f} min"


def limits_of(description: BenchDescription) -> tuple[dict[str, float], dict[str, float]]:
    """Return the bench's limits of torque (N·m) and speed (rpm) by side."""
    limits = {side: description.module(side).limits for side in SIDES}
    return (
        {side: limits[side].torque_nm for side in SIDES},
        {side: limits[side].speed_rpm for side in SIDES},
    )


def plan_preview(title: str, description: BenchDescription, rehearsal: Rehearsal[Any]) -> Preview:
    """Return the preview of a rehearsed plan: its duration, points, mountings and largest loads.

    Parameters
    ----------
    title : str
        Title of the operation.
    description : BenchDescription
        Bench with the limits.
    rehearsal : Rehearsal
        Result of `procedures.rehearse`.
    """
    torque_nm, speed_rpm = limits_of(description)
    mounted = [move.value for move in rehearsal.moves if move.device == "mounting"]
    torques, speeds = rehearsal.largest("torque"), rehearsal.largest("speed")
    return Preview(
        title=title,
        duration_s=rehearsal.duration_s,
        points=rehearsal.points,
        largest_torque_nm={side: value for side, value in torques.items() if value},
        limit_torque_nm=torque_nm,
        largest_speed_rpm={side: value * RPM_PER_RAD_S for side, value in speeds.items() if value},
        limit_speed_rpm=speed_rpm,
        mounts=tuple(str(value).replace("_", " ") for value in mounted),
    )


def loading_preview(
    title: str,
    description: BenchDescription,
    side: Side,
    profile: Profile,
    rehearsal: Rehearsal[Any],
    steps: Sequence[Step] | None = None,
) -> Preview:
    """Return the preview of a loading sequence on one side."""
    moves = [
        (move.time_s, float(move.value))
        for move in rehearsal.moves
        if move.device == f"{side} torque" and isinstance(move.value, int | float)
    ]
    remarks: list[str] = [
        Message("Setup: {moves}.", Message.joined(_setup(rehearsal))),
        Message(
            "Profile {name}, SHA-256 {hash}…{unchecked}.",
            profile.name,
            profile.sha256[:12],
            "" if profile.verified else ", not checked against a licensed text",
        ),
    ]
    steps = steps or profile.staircase(description.module(side).range_nm)
    if profile.adaptive is not None:
        remarks.append(_placing(profile, sum(step.recorded for step in steps)))
    return replace(
        plan_preview(title, description, rehearsal),
        time_s=tuple(time for time, _ in moves),
        nominal_nm=tuple(value for _, value in moves),
        series=tuple(_series(steps)),
        remarks=tuple(remarks),
    )


def _placing(profile: Profile, coarse: int) -> str:
    """Describe the part of an adaptive profile after the coarse series."""
    settings = profile.adaptive
    assert settings is not None
    end = Message("until {points} points are measured", settings.points)
    if settings.target_percent is not None:
        end = Message(
            "until U (k = 2) is {target:g} % FS everywhere, or {end}", settings.target_percent, end
        )
    return Message(
        "After these {coarse}: up to {count} points at a time where the model ({model}) is least "
        "certain, up and down in both directions, {end}.",
        coarse,
        settings.points_at_a_time,
        settings.model,
        end,
    )


def _setup(rehearsal: Rehearsal[Any]) -> Iterable[str]:
    """Describe the commands before a drive is switched on."""
    for move in itertools.takewhile(
        lambda move: not move.device.endswith("power"), rehearsal.moves
    ):
        if move.device == "mounting":
            yield Message("mount the {what}", str(move.value).replace("_", " "))
        elif move.device == "rail":
            yield "move the rail to its end" if move.value == "end" else "retract the rail"
        elif move.device == "clamp":
            yield "close the clamp" if move.value else "open the clamp"
        elif move.device.endswith("mode"):
            yield Message("{device} {value}", move.device.removesuffix(" mode"), move.value)


# -- steps of a loading sequence ------------------------------------------------------------


def _series(steps: Sequence[Step]) -> Iterable[LoadedSeries]:
    """Yield the parts of each series; equal series are listed once."""
    by_series = [
        list(groups) for _, groups in itertools.groupby(_groups(steps), lambda g: g[0].series)
    ]
    for _, repeated in itertools.groupby(by_series, _load):
        alike = list(repeated)
        first, last = alike[0][0][0].series, alike[-1][0][0].series
        numbers = "" if not first else str(first) if first == last else f"{first}–{last}"
        for group in alike[0]:
            yield _part(group, numbers, len(alike))


def _groups(steps: Sequence[Step]) -> Iterable[list[Step]]:
    """Yield neighbouring steps of one kind on one branch of one series, in one direction."""

    def key(step: Step) -> tuple[object, ...]:
        if step.kind in ("preload", "turn"):
            return (step.kind, step.series)
        return (step.kind, step.series, step.branch, step.duration_s)

    for _, neighbours in itertools.groupby(steps, key):
        group = list(neighbours)
        start = 0
        if group[0].kind == "point":
            for number, (before, after) in enumerate(itertools.pairwise(group), start=1):
                if before.nominal_nm * after.nominal_nm < 0:
                    yield group[start:number]
                    start = number
        yield group[start:]


def _load(groups: list[list[Step]]) -> list[tuple[object, ...]]:
    return [
        (step.kind, step.branch, step.nominal_nm, step.duration_s, step.change)
        for group in groups
        for step in group
    ]


def _part(group: list[Step], series: str, times: int) -> LoadedSeries:
    first, last = group[0], group[-1]
    what: str = first.kind
    if first.kind == "point":
        what = "points rising" if first.branch > 0 else "points falling"
    elif first.kind == "zero":
        what = "zero, unloaded"
    if first.change != "none":
        what = Message(
            "{what} after {change} to {angle:g}°", what, first.change, first.position_deg
        )
    return LoadedSeries(
        series=series,
        what=what,
        steps=len(group),
        times=times,
        first_nm=first.nominal_nm,
        last_nm=last.nominal_nm,
        step_s=first.duration_s,
        total_s=times * sum(step.duration_s for step in group),
    )


def joined_previews(previews: Sequence[Preview], title: str) -> Preview:
    """Return the preview of several parts that follow each other."""
    if len(previews) == 1:
        return previews[0]
    largest: dict[str, float] = {}
    time_s: list[float] = []
    before_s = 0.0
    for part in previews:
        largest |= part.largest_torque_nm
        time_s += [before_s + moment for moment in part.time_s]
        before_s += part.duration_s
    return replace(
        previews[0],
        title=title,
        duration_s=before_s,
        points=sum(part.points for part in previews),
        largest_torque_nm=largest,
        time_s=tuple(time_s),
        nominal_nm=tuple(value for part in previews for value in part.nominal_nm),
        mounts=tuple(mount for part in previews for mount in part.mounts),
        series=tuple(each for part in previews for each in part.series),
        remarks=tuple(dict.fromkeys(each for part in previews for each in part.remarks)),
    )
