"""Torque-angle loops of a printed cycloidal reducer, against what its authors found.

Source: J. Verhoeven, Anti-Backlash-Cycloidal-Actuator (CC BY-SA 4.0), positions 1, 5 and 6 after
run-in: play 2.501°, compliance 0.076 and 0.089 °/(N·m). The torque is that of the motor's current
and saturates near ±25 N·m where ±40 N·m were requested.
"""

import gzip

import numpy as np
import pytest

from torquebench.reducers import LoopSettings, evaluate_hysteresis

FILES = (
    "2024-07-11__15-47-12__torqueramp__base_runin1.csv.gz",
    "2024-07-11__15-51-51__torqueramp__base_runin5.csv.gz",
    "2024-07-11__15-56-27__torqueramp__base_runin6.csv.gz",
)


@pytest.fixture(scope="module")
def table(reference_data):
    rows = []
    for position, name in enumerate(FILES):
        with gzip.open(reference_data(f"cycloidal-reducer/{name}"), "rt") as file:
            found = np.loadtxt(file, delimiter=",", skiprows=1)
        rows.append(np.column_stack([found, np.full(len(found), position)]))
    joined = np.vstack(rows)
    names = ("time", "turns", "torque", "demanded", "current", "fault", "number", "position")
    return dict(zip(names, joined.T, strict=True))


def evaluate(table, rows, settings):
    return evaluate_hysteresis(
        table["torque"][rows],
        2 * np.pi * table["turns"][rows],
        settings,
        position=table["position"][rows],
        loop=table["number"][rows],
        demanded_nm=table["demanded"][rows],
    )


def test_play_is_the_authors_to_1_percent(table):
    # A printed reducer creeps: its loops close within 6 %.
    settings = LoopSettings(4.0, stiffness_interval=(0.4, 0.8), closure_share=0.06)
    result = evaluate(table, table["number"] < 100, settings)
    assert result.backlash.value / 60 == pytest.approx(2.501, rel=0.01)
    assert len(result.loops) == 12
    assert "noisy torque" in {each.name for each in result.findings}


def test_compliances_are_the_authors_to_3_percent_and_saturation_is_named(table):
    # The authors fit what lies beyond the play, about 7 to 25 N·m.
    settings = LoopSettings(24.0, stiffness_interval=(0.3, 1.0))
    result = evaluate(table, table["number"] >= 100, settings)
    assert 1 / result.stiffness_positive.value / 60 == pytest.approx(0.076, rel=0.03)
    assert 1 / result.stiffness_negative.value / 60 == pytest.approx(0.089, rel=0.03)
    saturation = [each for each in result.findings if each.name == "drive saturation"]
    assert "±25" in saturation[0].message
    assert "40 N·m" in saturation[0].message
