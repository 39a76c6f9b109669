"""The open data set of turning chains: write it with its truth, and evaluate results.

``python -m benchmarks.rotating_data FOLDER`` writes the synthetic chains of `benchmarks.rotating`
as tables, one folder a chain (docs/how-to/share-rotating-data.md says what each holds).
``--judge`` compares every ``torque.csv`` that ``torquebench apply`` or another program put beside
them with the truth; a folder that a laboratory added in the same form is judged likewise.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from tests.support.chain_shapes import FloatArray
from tests.support.rotating_chains import (
    EMPTY_C,
    KEPT_ASIDE,
    ROTATING_FAMILIES,
    Measured,
    RotatingChain,
    make_rotating_chain,
)

from benchmarks.reporting import show
from torquebench.errors import InputError
from torquebench.tables import read_table

CHAINS = 4
FORMAT = "torquebench rotating data 1"


def write_chain(folder: Path, chain: RotatingChain) -> None:
    """Write one chain's tables."""
    folder.mkdir(parents=True, exist_ok=True)
    points = chain.calibration()
    state = points.state
    _write(
        folder / "calibration.csv",
        chain,
        {
            "reading_nm": points.reading_nm,
            "standard_nm": points.torque_nm,
            "branch": state.branch,
            "speed_rpm": state.speed_rpm,
            "temperature_c": state.temperature_c,
        },
    )
    for celsius, run in zip(EMPTY_C, chain.empty_runs(), strict=True):
        _write(folder / f"empty-{celsius:g}.csv", chain, _stream(run))
    used = chain.use(noisy=True)
    _write(folder / "readings.csv", chain, {**_stream(used), "branch": used.state.branch})
    truth = {"time_s": used.state.time_s, "torque_nm": used.torque_nm}
    _write(folder / "truth.csv", chain, truth)
    about = {
        "format": FORMAT,
        "chain": f"{chain.family}, seed {chain.seed}",
        "range_nm": chain.range_nm,
        "simulated": True,
        "truth": "exact",
        "truth_expanded_uncertainty_nm": 0.0,
    }
    (folder / "chain.json").write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")


def _stream(measured: Measured) -> dict[str, FloatArray]:
    state = measured.state
    return {
        "time_s": state.time_s,
        "reading_nm": measured.reading_nm,
        "speed_rpm": state.speed_rpm,
        "temperature_c": state.temperature_c,
    }


def _write(path: Path, chain: RotatingChain, columns: Mapping[str, FloatArray]) -> None:
    remarks = f"# range_nm = {chain.range_nm:g}\n# simulated = true\n"
    with path.open("w", encoding="utf-8") as file:
        file.write(remarks + ",".join(columns) + "\n")
        np.savetxt(file, np.column_stack(list(columns.values())), "%.9g", ",")


def judged(folder: Path) -> list[str]:
    """Return a chain's name, RMS and worst error in % of range, and the coverage of U.

    Raises
    ------
    InputError
        A table is missing, has another form, or differs in length.
    """
    about = json.loads((folder / "chain.json").read_text(encoding="utf-8"))
    if about.get("format") != FORMAT:
        raise InputError(f"{folder}: format {about.get('format')!r}", repr(FORMAT))
    truth, found = read_table(folder / "truth.csv"), read_table(folder / "torque.csv")
    true_nm, torque_nm = truth.numbers("torque_nm"), found.numbers("torque_nm")
    if true_nm.size != torque_nm.size:
        raise InputError(
            f"{folder}: {torque_nm.size} torques", f"one for each of {true_nm.size} readings"
        )
    percent, error = 100.0 / about["range_nm"], torque_nm - true_nm
    covered = "-"
    if "expanded_uncertainty_nm" in found:
        u = np.hypot(
            found.numbers("expanded_uncertainty_nm"), about["truth_expanded_uncertainty_nm"]
        )
        covered = f"{100 * float(np.mean(np.abs(error) <= u)):.1f} %"
    return [
        about["chain"] + (" (simulated)" if about["simulated"] else ""),
        f"{percent * float(np.sqrt(np.mean(error**2))):.4f}",
        f"{percent * float(np.max(np.abs(error))):.4f}",
        covered,
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the data set, or evaluate the torques that a program calculated from it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--chains", type=int, default=CHAINS, help="of every family")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--judge", action="store_true", help="compare every torque.csv")
    options = parser.parse_args(arguments)
    if options.judge:
        rows = [judged(path.parent) for path in sorted(options.folder.glob("*/torque.csv"))]
        headings = ["chain", "RMS % FS", "worst % FS", "coverage of U"]
        show(Console(), f"{len(rows)} chains", headings, rows)
        return 0 if rows else 1
    families = [family for family in ROTATING_FAMILIES if family not in KEPT_ASIDE]
    for family in families:
        for seed in range(options.first_seed, options.first_seed + options.chains):
            name = f"{family.replace(' ', '-').lower()}-{seed}"
            write_chain(options.folder / name, make_rotating_chain(family, seed))
    sys.stdout.write(f"{len(families) * options.chains} chains: {options.folder}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
