"""Run benchmarks: `python -m benchmarks [NAME …] [--quick] [options of a benchmark]`.

Without a name it lists them with their aims. Exits with 1 where an aim is missed.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from itertools import takewhile

from benchmarks.reporting import AIMS

QUESTIONS = {
    "compensation": "How well does the default model compensate, and the others?",
    "contradictions": "Are healthy tables accepted, and faults in others found?",
    "design": "How many points does a calibration need?",
    "evaluations": "How right are evaluations of recordings?",
    "rotating": "How accurate are rotating chains?",
    "turning_bench": "How accurate is the simulated bench while it rotates?",
    "reducers": "How accurate are reducer tests?",
    "efficiency": "How well is an efficiency known?",
    "safety": "How fast is the bench made safe?",
    "signals": "How fast are counters, and how noisy?",
    "live_path": "How fast is the path from edges to compensated torque?",
    "table": "How fast are compiled tables?",
    "apply": "How fast are files of readings?",
    "dynamics": "What do dynamic filters cost and gain?",
    "registry": "How large may the registry grow?",
    "panel_browser": "How responsive is the panel?",
    "installation": "What does an installation need?",
}


def main(arguments: Sequence[str]) -> int:
    """Run the named benchmarks one after the other; return 1 where an aim is missed."""
    names = list(takewhile(lambda each: not each.startswith("-"), arguments))
    options = list(arguments[len(names) :])
    unknown = [name for name in names if name not in QUESTIONS]
    if unknown or not names:
        for name, question in QUESTIONS.items():
            print(f"{name:<16}{question}")
            for figure, wanted in AIMS.get(name, {}).items():
                print(f"{'':<18}{figure}: {wanted}")
        if arguments:
            print(f"found {' '.join(arguments)}; allowed: names of the table, then options")
        return 2 if arguments else 0
    codes = [import_module(f"benchmarks.{name}").main(options) for name in names]
    return int(any(codes))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
