"""A registry in PostgreSQL restarts while a bench calibrates, verifies, checks and certifies."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests import postgresql_server
from tests.system.interrupted_phases import DOWN_S, LATE_S, PHASES, one_phase

from benchmarks.fault_judging import Outcome

__all__ = ["RESTARTS", "numbered_restart"]

RESTARTS = len(PHASES)


def numbered_restart(index: int, seed: int) -> Outcome:
    """Restart the server once, in the phase of this number, and look what is left."""
    phase = list(PHASES)[index]
    late_s = LATE_S * float(np.random.default_rng([seed, index]).uniform())
    with postgresql_server.restartable() as server, tempfile.TemporaryDirectory() as scratch:
        data = Path(scratch)
        outcome = one_phase(
            "database restarts", phase, data, seed + index, late_s=late_s, server=server
        )
    problems = [f"stranded: {each}" for each in outcome.problems]
    if outcome.alarm:
        problems.append(f"stranded: left for the next start: {outcome.alarm}")
    return replace(
        outcome,
        kind=f"{phase}: PostgreSQL restarts ({DOWN_S:g} s)",
        problems=tuple(problems),
        index=index,
        seed=seed,
    )
