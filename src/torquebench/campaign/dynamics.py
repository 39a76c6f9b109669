"""Dynamics of a measuring chain: from recorded runs to a file with the inverse filter."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.atomic_write import atomic_write
from torquebench.chain import Dynamics, Readings, effect_from, load_chain
from torquebench.dynamics import (
    PARAMETERS,
    Inertia,
    InverseFilter,
    Known,
    Shaft,
    TransferFunction,
    design_inverse,
    identify,
    identify_inertia,
    shaft_of,
)
from torquebench.errors import InputError
from torquebench.records import json_text
from torquebench.records.columns import quantity, understood
from torquebench.records.table_files import read_table
from torquebench.records.tables import is_simulated

__all__ = ["IdentifiedDynamics", "identify_dynamics", "load_dynamics", "save_dynamics"]

FORMAT = "torquebench dynamics 1"
_UNEVEN = 0.01
_UNCOMPENSATED = 0.1
"""Relative standard uncertainty of an inertia that was identified from uncompensated readings."""


@dataclass(frozen=True, eq=False)
class IdentifiedDynamics:
    """Identified dynamics of a chain.

    Attributes
    ----------
    transfer : TransferFunction
    designed : InverseFilter
    inertia : Inertia or None
        Where an empty run with ramps was given.
    simulated : bool
        Whether a table states that.
    sha256 : dict of str to str
        Of every table, by its name.
    """

    transfer: TransferFunction
    designed: InverseFilter
    inertia: Inertia | None
    simulated: bool
    sha256: dict[str, str]

    @property
    def shaft(self) -> Shaft | None:
        """Stiffness and damping, where the inertia is known."""
        return None if self.inertia is None else shaft_of(self.transfer, self.inertia)

    @property
    def effect(self) -> Dynamics:
        """The effect of a measuring chain."""
        simulated = " (simulated)" if self.simulated else ""
        return Dynamics.of(f"identified from {', '.join(self.sha256)}{simulated}", self.designed)


def identify_dynamics(
    runs: Sequence[Path],
    empty: Path | None = None,
    *,
    model: Path | None = None,
    window_s: float | None = None,
    bandwidth_hz: float | None = None,
) -> IdentifiedDynamics:
    """Identify the dynamics of a chain from tables, and design the inverse filter.

    Parameters
    ----------
    runs : sequence of pathlib.Path
        Tables with time_s, reading_nm and standard_nm: steps or sines of a known torque.
    empty : pathlib.Path, optional
        Table of an empty run with ramps: time_s, reading_nm, speed_rpm and, if there is one,
        acceleration_rad_s2.
    model : pathlib.Path, optional
        Model file of the chain: readings are compensated by its static curve first. Ramps with
        small torques are in the range where a chain's reversal curves most.
    window_s : float, optional
        Length of the counter's window; the sample interval where not given.
    bandwidth_hz : float, optional
        Wanted bandwidth, see `design_inverse`.

    Raises
    ------
    InputError
        Naming what the tables lack or don't identify.
    """
    chain = None if model is None else load_chain(model)

    def torque_of(reading_nm: NDArray[np.float64]) -> NDArray[np.float64]:
        return reading_nm if chain is None else chain.torque(Readings(reading_nm)).value_nm

    known, hashes, simulated = [], {}, False
    for path in runs:
        table = _Table(path, ("time_s", "reading_nm", "standard_nm"))
        known.append(Known(table.interval_s, torque_of(table["reading_nm"]), table["standard_nm"]))
        hashes[path.name] = table.sha256
        simulated = simulated or table.simulated
    if not known:
        raise InputError("no table with a known torque", "one at least")
    inertia = None
    if empty is not None:
        table = _Table(empty, ("time_s", "reading_nm", "speed_rpm"))
        inertia = identify_inertia(
            table["time_s"],
            torque_of(table["reading_nm"]),
            table["speed_rpm"],
            table.acceleration,
        )
        if chain is None:
            bent = _UNCOMPENSATED * inertia.inertia_kgm2
            u = float(np.hypot(inertia.standard_uncertainty_kgm2, bent))
            inertia = replace(inertia, standard_uncertainty_kgm2=u)
        hashes[empty.name] = table.sha256
        simulated = simulated or table.simulated
    interval_s = known[0].interval_s
    transfer = identify(known, interval_s if window_s is None else window_s)
    designed = design_inverse(transfer, interval_s, bandwidth_hz)
    return IdentifiedDynamics(transfer, designed, inertia, simulated, hashes)


def save_dynamics(path: Path, found: IdentifiedDynamics) -> None:
    """Write identified dynamics, whole or not at all."""
    raw, compensated = found.designed.raw, found.designed.compensated
    content = {
        "format": FORMAT,
        "effect": found.effect.specification(),
        "transfer_function": {
            name: {
                "value": getattr(found.transfer, name),
                "standard_uncertainty": found.transfer.standard_uncertainty(name),
            }
            for name in PARAMETERS
        },
        "covariance": found.transfer.covariance,
        "window_s": found.transfer.window_s,
        "inertia": found.inertia,
        "shaft": found.shaft,
        "step": {"raw": raw, "compensated": compensated},
        "bandwidth_hz": found.designed.bandwidth_hz,
        "noise_gain": found.designed.noise_gain,
        "simulated": found.simulated,
        "tables_sha256": found.sha256,
    }
    atomic_write(path, json_text(content, indent=2) + "\n")


def load_dynamics(path: Path) -> Dynamics:
    """Return the effect in a file that `save_dynamics` wrote.

    Raises
    ------
    InputError
        The file can't be read or is another one.
    """
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as problem:
        raise InputError(
            f"{path} can't be read: {problem}", "a file of `torquebench evaluate dynamics`"
        ) from problem
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(
            f"{path} holds no dynamics",
            f"a file whose format is {FORMAT!r}",
            "write one with `torquebench evaluate dynamics`",
        )
    effect = effect_from(content.get("effect", {}))
    if not isinstance(effect, Dynamics):
        raise InputError(f"{path}: effect {effect.kind!r}", "dynamics")
    return effect


class _Table:
    """A table with an even sample rate."""

    def __init__(self, path: Path, required: tuple[str, ...]) -> None:
        table, columns = understood(read_table(path), required)
        self.values = {key: quantity(table, columns, key) for key in required}
        self.simulated = is_simulated(table.remarks)
        self.sha256 = sha256(path.read_bytes()).hexdigest()
        name = "acceleration_rad_s2"
        self.acceleration = table.numbers(name) if name in table.header else None
        step = np.diff(self["time_s"])
        if step.size < 2 or not np.median(step) > 0.0:
            raise InputError(f"{path}: {step.size + 1} rows", "rows in the order of time_s")
        self.interval_s = float(np.mean(step))
        uneven = np.abs(step - self.interval_s) > _UNEVEN * self.interval_s
        if uneven.any():
            row = int(np.argmax(uneven))
            raise InputError(
                f"{table.place(row + 1, 'time_s')}: {step[row]:.6g} s after the row before, "
                f"{self.interval_s:.6g} s on average",
                "an even rate",
                "cut the table at its gaps, and give time_s with more digits",
            )

    def __getitem__(self, key: str) -> NDArray[np.float64]:
        values = self.values[key]
        assert values is not None
        return values
