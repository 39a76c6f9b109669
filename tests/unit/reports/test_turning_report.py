"""The report of a verification while it turns: figures, cells, budget."""

from dataclasses import replace

import numpy as np

from torquebench.calibration import CalibrationData
from torquebench.chain import Component, Shared, Torque
from torquebench.reports.page import Diagram, Table
from torquebench.reports.turning_report import turning_section


def test_errors_stand_over_speed_temperature_and_torque_with_cells_and_budget() -> None:
    generator = np.random.default_rng(1)
    count = 4000
    truth = generator.uniform(-50.0, 50.0, count)
    speed, warm = generator.uniform(-1200, 1200, count), generator.uniform(10, 50, count)
    noise = 0.01 * generator.standard_normal(count)
    drag = 0.02 * np.sign(speed)
    data = CalibrationData(
        truth + drag + noise, truth, np.ones(count), np.ones(count), 50.0,
        speed_rpm=speed, temperature_c=warm, true_torque_nm=truth,
    )  # fmt: skip
    torque = Torque(
        truth + noise,
        (
            Component("scatter", Shared.LOADING, np.full(count, 0.01)),
            Component("bearing drag", Shared.MOUNTING, np.full(count, 0.002), -drag),
        ),
    )
    section = turning_section(data, torque, 0.1)
    figure, covered, budget = section.blocks
    assert isinstance(figure, Diagram)
    svg, caption = figure.svg, figure.caption
    assert "the true torque" in caption
    assert all(f"{name} in" in svg for name in ("speed", "temperature", "torque"))
    assert isinstance(covered, Table)
    assert len(covered.rows) == 27
    assert sum(int(row[3]) for row in covered.rows) == count
    shares = [float(row[6].split()[0]) for row in covered.rows]
    assert 90.0 < min(shares) <= max(shares) <= 100.0
    assert isinstance(budget, Table)
    assert [row[0] for row in budget.rows] == ["scatter", "bearing drag"]
    assert float(budget.rows[1][1]) == 0.02
    less = replace(data, temperature_c=None, true_torque_nm=None)
    figure, covered, _ = turning_section(less, torque, 0.1).blocks
    assert isinstance(figure, Diagram)
    svg, caption = figure.svg, figure.caption
    assert "temperature in" not in svg
    assert "against the standard" in caption
    assert {row[1] for row in covered.rows} == {"-"}
