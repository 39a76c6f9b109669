"""A loading sequence before it is run: steps, order and duration; within 80 columns."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType
from rich.text import Text

from torquebench.cli.terminal.console import narrow_table
from torquebench.units import MINUTE

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription
    from torquebench.bench.drivers.base import Side
    from torquebench.calibration import Placement, Profile, Step
    from torquebench.procedures import Rehearsal

__all__ = ["placement_table", "staircase_tables"]


def staircase_tables(
    description: BenchDescription, side: Side, profile: Profile, rehearsal: Rehearsal[Any]
) -> Iterable[RenderableType]:
    """Yield the loads of a rehearsed calibration.

    Parameters
    ----------
    description : BenchDescription
    side : {"input", "output"}
    profile : Profile
    rehearsal : Rehearsal
        Of the plan that will run.
    """
    module = description.module(side)
    steps = profile.staircase(module.range_nm)
    simulated = " - simulated" if description.simulated else ""
    yield Text(
        f"{side.capitalize()} module, {module.range_nm:g} N·m, "
        f"transducer {module.transducer.serial}{simulated}",
        style="bold",
    )
    checked = "" if profile.verified else ", not checked against a licensed text"
    yield Text(f"profile {profile.name} (SHA-256 {profile.sha256[:12]}…{checked})")
    yield Text(f"setup    {_setup(rehearsal)}")
    table = narrow_table(
        columns=(">series", "what", ">steps", ">from N·m", ">to N·m", ">each s", ">in all s")
    )
    for number, alike in _alike(_by_series(steps)):
        first = alike[0]
        for group in first:
            if group[0].change != "none":
                table.add_row(
                    "", f"{group[0].change} to {group[0].position_deg:g}°", style="yellow"
                )
            table.add_row(*_row(group, number, len(alike)))
    yield table
    if profile.adaptive is not None:
        yield Text(_placing(profile, sum(step.recorded for step in steps)))
    largest = max(abs(step.nominal_nm) for step in steps)
    most = "" if profile.adaptive is None else "at most "
    yield Text(
        f"{most}{rehearsal.points} points in {_minutes(rehearsal.duration_s)} "
        f"without waiting longer to settle;\n"
        f"largest torque {largest:g} N·m, limit {module.limits.torque_nm:g} N·m"
    )
    yield Text("")


def _placing(profile: Profile, coarse: int) -> str:
    """Describe the part of an adaptive profile after the coarse series."""
    settings = profile.adaptive
    assert settings is not None
    end = f"until {settings.points} points are measured"
    if settings.target_percent is not None:
        end = f"until U (k = 2)\nis {settings.target_percent:g} % FS everywhere, or {end}"
    return (
        f"after these {coarse}: up to {settings.points_at_a_time} points at a time where the model "
        f"({settings.model})\nis least certain, up and down in both directions, {end}"
    )


def placement_table(placement: Placement) -> RenderableType:
    """Return how an adaptive calibration went, one line a decision."""
    table = narrow_table(
        "U (k = 2) of the model at its largest",
        columns=(">points", ">U % FS", ">placed next", ">U predicted % FS"),
    )
    for each in placement.rounds:
        following = [str(each.proposed), f"{each.predicted_percent:.4f}"] if each.proposed else []
        table.add_row(str(each.points), f"{each.expanded_percent:.4f}", *following)
    return table


def _setup(rehearsal: Rehearsal[Any]) -> str:
    """Return, in words, the commands before the drive is switched on."""
    words = []
    for move in itertools.takewhile(
        lambda move: not move.device.endswith("power"), rehearsal.moves
    ):
        if move.device == "mounting":
            words.append(f"mount the {str(move.value).replace('_', ' ')}")
        elif move.device == "guide rail":
            words.append("move the rail to its end" if move.value == "end" else "retract the rail")
        elif move.device == "clamp":
            words.append("close the clamp" if move.value else "open the clamp")
        elif move.device.endswith("mode"):
            words.append(f"{move.device.removesuffix(' mode')} {move.value}")
    return ", ".join(words)


def _groups(steps: Sequence[Step]) -> Iterable[list[Step]]:
    """Yield neighbouring steps of one kind on one branch of one series."""

    def key(step: Step) -> tuple[object, ...]:
        if step.kind in ("preload", "turn"):
            return (step.kind, step.series)
        return (step.kind, step.series, step.branch, step.duration_s)

    for _, group in itertools.groupby(steps, key):
        yield from _by_direction(list(group))


def _by_direction(group: list[Step]) -> Iterable[list[Step]]:
    """Split points where they change from one direction to the other."""
    if group[0].kind != "point":
        yield group
        return
    start = 0
    for number, (before, after) in enumerate(itertools.pairwise(group), start=1):
        if before.nominal_nm * after.nominal_nm < 0:
            yield group[start:number]
            start = number
    yield group[start:]


def _by_series(steps: Sequence[Step]) -> Iterable[list[list[Step]]]:
    """Yield the groups of each series, in order."""
    for _, groups in itertools.groupby(_groups(steps), lambda group: group[0].series):
        yield list(groups)


def _alike(
    series: Iterable[list[list[Step]]],
) -> Iterable[tuple[str, list[list[list[Step]]]]]:
    """Yield repeated series as one, with their numbers in words."""

    def load(groups: list[list[Step]]) -> list[tuple[object, ...]]:
        return [
            (step.kind, step.branch, step.nominal_nm, step.duration_s, step.change)
            for group in groups
            for step in group
        ]

    for _, repeated in itertools.groupby(series, load):
        alike = list(repeated)
        first, last = alike[0][0][0].series, alike[-1][0][0].series
        name = str(first) if first == last else f"{first}–{last}"
        yield (name if first else ""), alike


def _row(group: list[Step], series: str, times: int) -> list[str]:
    first, last = group[0], group[-1]
    total = f"{times * sum(step.duration_s for step in group):.1f}"
    if first.kind == "zero":
        count = f"{times} × 1" if times > 1 else ""
        return [series, "zero, unloaded", count, "0", "0", f"{first.duration_s:g}", total]
    if first.kind == "point":
        what = "points " + ("up" if first.branch > 0 else "down")
    else:
        what = first.kind
    return [
        series,
        what,
        f"{times} × {len(group)}" if times > 1 else str(len(group)),
        f"{first.nominal_nm:g}",
        f"{last.nominal_nm:g}",
        f"{first.duration_s:g}",
        total,
    ]


def _minutes(seconds: float) -> str:
    """Return a duration in words.

    Examples
    --------
    >>> _minutes(47.2), _minutes(600.0)
    ('47 s', '10 min 0 s')
    """
    whole = round(seconds)
    return f"{whole} s" if whole < 120 else f"{whole // MINUTE} min {whole % MINUTE} s"
