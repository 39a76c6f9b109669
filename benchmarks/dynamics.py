"""Dynamic filters: speed compared with PyDynamic 2.5.1, and bandwidth of a step response."""

from __future__ import annotations

import argparse
import contextlib
import io
import platform
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from rich.console import Console

from benchmarks.reporting import BENCHMARKS, judge, least_seconds, write_section
from torquebench.dynamics import TransferFunction, UncertainFilter, design_inverse

_CHAINS = {
    "input module": TransferFunction(513.0, 0.06, 53e-6, 167e-6, 5e-5),
    "output module": TransferFunction(255.0, 0.10, 53e-6, 167e-6, 1e-4),
    "well damped": TransferFunction(1000.0, 0.40, 26e-6, 120e-6, 2e-5),
}
_U = np.diag([2.0**2, 0.003**2, (2e-6) ** 2, (2e-6) ** 2])


def speeds(samples: int, repeats: int) -> list[tuple[str, float, float]]:
    """Return for each case its name, our samples per second, and the ratio to PyDynamic's."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        from PyDynamic.uncertainty.propagate_filter import FIRuncFilter
    generator = np.random.default_rng(1)
    values = 100.0 * generator.standard_normal(samples)
    changing = 0.5 + generator.random(samples)
    transfer = _CHAINS["input module"]
    covered = replace(transfer, covariance=tuple(map(tuple, _U.tolist())))
    inverse = design_inverse(covered, 5e-5).filter
    root = 1e-3 * generator.standard_normal((60, 60))
    long = UncertainFilter(generator.standard_normal(60) / 60, covariance=root @ root.T)

    def fir(each: UncertainFilter) -> Callable[[], object]:
        def call() -> object:
            with contextlib.redirect_stdout(io.StringIO()):
                return FIRuncFilter(values, changing, each.weights, each.covariance, kind="diag")

        return call

    plain = np.sqrt(np.diag(root @ root.T))
    apart = UncertainFilter(long.weights, covariance=np.diag(plain**2))
    cases: list[tuple[str, Callable[[], object], Callable[[], object]]] = [
        (
            f"inverse filter, {inverse.weights.size} taps, changing noise",
            lambda: inverse.stream().push(values, changing),
            fir(inverse),
        ),
        (
            "60 taps, full covariance, changing noise",
            lambda: long.stream().push(values, changing),
            fir(long),
        ),
    ]

    def short_way() -> object:
        with contextlib.redirect_stdout(io.StringIO()):
            return FIRuncFilter(values, changing, long.weights, plain, kind="diag")

    uncorrelated = "60 taps, uncorrelated coefficients, changing noise (its short way, no aim)"
    cases.append((uncorrelated, lambda: apart.stream().push(values, changing), short_way))
    found = []
    for name, ours, theirs in cases:
        own, other = (
            least_seconds({name: way}, rounds)[name]
            for way, rounds in ((ours, 5 * repeats), (theirs, repeats))
        )
        found.append((name, samples / own, other / own))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="half a minute")
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks.md")
    options = parser.parse_args(arguments)
    rows = speeds(500 if options.quick else 2000, 1 if options.quick else 3)
    lines = [
        "## What do dynamic filters cost and gain?",
        "",
        f"`python -m benchmarks dynamics`, {platform.machine()}, Python "
        f"{platform.python_version()}: samples per second with u of every sample, and how many "
        "times as fast as PyDynamic 2.5.1 in the same run, 2000 samples.",
        "",
        "| case | samples/s | times as fast |",
        "| --- | --- | --- |",
        *(f"| {name} | {rate:.2g} | {ratio:.0f} |" for name, rate, ratio in rows),
        "",
        "A step of torque (simulated chains), raw and behind the inverse filter:",
        "",
        "| chain | bandwidth raw / filtered, Hz | times | overshoot raw / filtered, % | noise |",
        "| --- | --- | --- | --- | --- |",
    ]
    figures = {
        f"PyDynamic / filter, time, {name}": ratio
        for name, _, ratio in rows
        if "no aim" not in name
    }
    for name, transfer in _CHAINS.items():
        designed = design_inverse(transfer, transfer.window_s)
        raw, step = designed.raw, designed.compensated
        gain = step.bandwidth_hz / raw.bandwidth_hz
        figures[f"bandwidth, filtered / raw, {name}"] = gain
        figures[f"overshoot, filtered, {name}"] = step.overshoot
        lines.append(
            f"| {name}, {transfer.resonance_hz:g} Hz, damping {transfer.damping_ratio:g}, "
            f"window {1e3 * transfer.window_s:g} ms | {raw.bandwidth_hz:.0f} / "
            f"{step.bandwidth_hz:.0f} | {gain:.2f} | {100 * raw.overshoot:.0f} / "
            f"{100 * max(step.overshoot, 0.0):.1f} | × {designed.noise_gain:.1f} |"
        )
    text = "\n".join(lines)
    sys.stdout.write(text + "\n")
    if options.write:
        write_section(BENCHMARKS, "dynamics", text)
    return int(not judge(Console(), "dynamics", figures)[1])
