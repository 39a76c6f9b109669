"""Item 16: a transducer's calibration alone, compared with that of its chain in place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torquebench.bench.roles import Side
from torquebench.calibration import CalibrationData
from torquebench.figures import Curve
from torquebench.message import Message
from torquebench.papers.items import LIMIT_PERCENT
from torquebench.papers.models import BP_RESIDUAL, RECOMMENDED_NAME, FittedModule
from torquebench.reports.curve_figures import Panel
from torquebench.reports.errors_table import number
from torquebench.reports.page import Diagram, Page, Section, Table


def alone_cells(name: str, side: Side, errors: Sequence[float]) -> list[str]:
    """Return a row of `alone_table` from the errors of `alone_row`."""
    return [Message("{name}: {side}", name, side), *(number(each) for each in errors)]


def alone_table(rows: Sequence[Sequence[str]]) -> Table:
    """Return the table of worst errors, one row per module."""
    return Table(
        (
            "module",
            "raw, % FS",
            "calibrated alone, % FS",
            "calibrated in place, % FS",
            "in place, rising only (BP), % FS",
        ),
        rows,
        "Worst error of fresh readings in the chain: with the transducer's own calibration "
        "(alone), and with the calibration of the whole chain in place.",
    )


def in_place_page(name: str, side: Side, module: FittedModule) -> Page:
    """Return the report that compares a transducer's calibration alone and in place.

    Parameters
    ----------
    name : str
        Name of the bench.
    side : {"input", "output"}
    module : FittedModule
        Module with a calibration of the transducer alone, and fresh readings.
    """
    found = alone_row(module)
    assert found is not None
    data = module.tables.calibration
    return Page(
        "Calibrated alone against in place",
        Message("{name}, {side} module, {range_nm:g} N·m", name, side, data.range_nm),
        [
            Section(
                "Result",
                "",
                (alone_table([alone_cells(name, side, found)]), alone_diagram(side, module)),
            )
        ],
        simulated=data.simulated,
    )


def alone_row(module: FittedModule) -> tuple[float, float, float, float] | None:
    """Return worst errors in % FS: raw, calibrated alone, in place, and by BP in place."""
    data = module.tables.verification
    if module.tables.alone is None or data is None:
        return None
    errors = [
        module.errors_nm(data),
        _by_alone(module, data),
        module.errors_nm(data, RECOMMENDED_NAME),
        module.errors_nm(data, BP_RESIDUAL),
    ]
    raw, alone, place, network = (
        100.0 * float(np.max(np.abs(error))) / data.range_nm for error in errors
    )
    return raw, alone, place, network


def _by_alone(module: FittedModule, data: CalibrationData) -> np.ndarray:
    """Return a cubic's errors, N·m, at fresh readings; it is fitted to the transducer alone."""
    alone = module.tables.alone
    assert alone is not None
    x = alone.reading_nm / data.range_nm
    powers = np.column_stack([x, x**2, x**3])
    weights = np.linalg.lstsq(powers, alone.standard_nm, rcond=None)[0]
    fresh = data.reading_nm / data.range_nm
    return np.asarray(np.column_stack([fresh, fresh**2, fresh**3]) @ weights - data.standard_nm)


def alone_diagram(side: Side, module: FittedModule) -> Diagram:
    """Return the errors of fresh readings by both calibrations."""
    data = module.tables.verification
    assert data is not None
    limit = LIMIT_PERCENT / 100.0 * data.range_nm
    panel = Panel(
        [
            Curve("calibrated alone", data.standard_nm, _by_alone(module, data)),
            Curve(
                "calibrated in place",
                data.standard_nm,
                module.errors_nm(data, RECOMMENDED_NAME),
            ),
        ],
        "torque in N·m",
        "error in N·m",
        markers=True,
        limits=(-limit, limit),
        range_nm=data.range_nm,
    )
    return Diagram(
        [panel],
        Message(
            "Errors of fresh readings in the chain of the {side} module by either calibration. "
            "Dashed: ±0.1 % FS.",
            side,
        ),
    )
