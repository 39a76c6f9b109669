"""What the benchmark of efficiencies calls met and missed."""

import io

from benchmarks.efficiency import Point, coverage, missed, report
from rich.console import Console


def point(seed: int, share: float, expanded: float, error: float, *, both: bool = True) -> Point:
    return Point(seed, share, both, 80.0, 80.0 - error, expanded, {"repeatability": 0.1})


def test_aims_are_those_of_means_of_both_directions() -> None:
    kept = [point(1, 0.2, 0.23, 0.1), point(1, 0.5, 0.11, 0.1), point(1, 1.0, 0.05, 0.0)]
    assert missed(kept) == []
    assert missed([*kept, point(1, 0.2, 0.9, 0.1, both=False)]) == []
    (said,) = missed([*kept, point(1, 0.5, 0.2, 0.1)])
    assert said.startswith("U up to 0.250 %")
    (said,) = missed([*kept, point(1, 0.2, 0.4, 0.1)])
    assert said.startswith("U up to 0.500 %")


def points(benches: int, error: float) -> list[Point]:
    return [
        point(seed, share, 0.1, error, both=both)
        for seed in range(benches)
        for share in (0.2, 0.3, 0.5, 0.75, 1.0)
        for both in (True, False)
    ]


def test_few_benches_decide_no_coverage_and_many_do() -> None:
    few, console = points(2, 0.0), Console(file=io.StringIO())
    parts, met = report(console, "standard", few)
    assert (met, coverage(few)) == (True, 100.0)
    assert "2 benches don't decide" in parts[-1]
    parts, met = report(console, "standard", points(400, 0.0))
    assert not met
    assert "MISSED: coverage 100.0 %" in parts[-1]
    assert not report(console, "standard", points(2, 0.2))[1]
