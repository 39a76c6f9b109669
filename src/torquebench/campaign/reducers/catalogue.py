"""The tests of a reducer by name, in the order of the full test.

Entries import the bench only when used, so that help lists them quickly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from torquebench.bench.roles import Side
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.campaign.reducers.work import ReducerTestWork

TestName = Literal[
    "starting", "back-driving", "transmission-error", "hysteresis", "no-load", "efficiency", "full"
]


@dataclass(frozen=True)
class ReducerTest:
    """One test of a reducer.

    Parameters
    ----------
    about : str
        Driven side, held side and measured quantity, in one sentence.
    axes : tuple of str
        Live signals of its chart: horizontal and vertical axis.
    kind : str
        Name of its module in `kinds`, and of the entry there, with settings, plan, evaluation and
        figures.
    loads_output : bool
        Whether the test loads the output.
    bench_twist : bool
        Whether the bench's own twist must be measured before.
    empty_run : tuple of side
        Sides that need an empty run.
    """

    name: TestName
    title: str
    about: str
    axes: tuple[str, str] = ("", "")
    kind: str = ""
    loads_output: bool = False
    bench_twist: bool = False
    empty_run: tuple[Side, ...] = ()

    def work(self) -> ReducerTestWork:
        """Import and return the test's settings, plan, evaluation and figures."""
        if not self.kind:
            raise InputError("the plan of the test 'full'", "one of its parts")
        module, _, name = self.kind.partition(".")
        work: ReducerTestWork = getattr(import_module(f"{__package__}.kinds.{module}"), name)
        return work


PARTS = (
    ReducerTest(
        "starting",
        "Starting torque",
        "Input torque rises slowly, output free, until the input turns.",
        ("input_angle_deg", "input_torque_nm"),
        "breakaway.STARTING",
    ),
    ReducerTest(
        "back-driving",
        "Back-driving torque",
        "Output torque rises slowly, input free, until the output turns.",
        ("output_angle_deg", "output_torque_nm"),
        "breakaway.BACK_DRIVING",
    ),
    ReducerTest(
        "transmission-error",
        "Transmission error",
        "Both angles over full output revolutions, without load, in both directions.",
        ("input_angle_deg", "output_angle_deg"),
        "transmission_error.WORK",
    ),
    ReducerTest(
        "hysteresis",
        "Hysteresis loop",
        "Input locked, output loaded: stiffness, backlash, lost motion, loop energy.",
        ("output_angle_deg", "output_torque_nm"),
        "hysteresis.WORK",
        loads_output=True,
        bench_twist=True,
    ),
    ReducerTest(
        "no-load",
        "No-load running torque",
        "Input driven in steps of speed, output free, warm: friction against speed.",
        ("input_speed_rpm", "input_torque_nm"),
        "no_load.WORK",
        empty_run=("input",),
    ),
    ReducerTest(
        "efficiency",
        "Efficiency",
        "Input driven, output braking, warm: efficiency over torque and speed.",
        ("output_torque_nm", "input_torque_nm"),
        "efficiency.WORK",
        loads_output=True,
        empty_run=("input", "output"),
    ),
)
"""Parts of the full test in their order: tests that don't heat the reducer come first."""

TESTS: Mapping[str, ReducerTest] = MappingProxyType(
    {
        test.name: test
        for test in (
            *PARTS,
            ReducerTest("full", "Full test", "All tests, cold ones first, in one report."),
        )
    }
)


def chosen_tests(name: str) -> tuple[ReducerTest, ...]:
    """Return the tests of a name; for the full test, all parts.

    Raises
    ------
    InputError
        There is no test of this name.
    """
    if name not in TESTS:
        raise InputError(
            Message("a reducer test {name!r}", name), Message("one of {list}", ", ".join(TESTS))
        )
    return PARTS if name == "full" else (TESTS[name],)
