"""Unloaded is where a table commands no torque; only tables that are silent are guessed."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.chain.test_turning_chains import RANGE_NM, seated, unloaded

from torquebench.calibration import CalibrationData
from torquebench.calibration.data import UNLOADED_SHARE
from torquebench.campaign.turning import identify_turning
from torquebench.chain import Zero

LEFT_NM = (0.06, -0.04)
"""What the chain still reads after unloading from either direction."""


def table(missed_nm: float, *, commanded: bool) -> CalibrationData:
    """Return points whose commanded zeros the drive misses by a torque."""
    points = unloaded(seated(stated=True)[0], LEFT_NM)
    assert points.unloaded is not None
    missed = np.where(points.unloaded, missed_nm, 0.0)
    return CalibrationData(
        points.reading_nm + missed,
        points.standard_nm + missed,
        np.ones(points.standard_nm.size),
        points.branch,
        RANGE_NM,
        nominal_nm=np.where(points.unloaded, 0.0, points.standard_nm) if commanded else None,
        speed_rpm=points.speed_rpm,
        temperature_c=points.temperature_c,
        zero_temperature_c=points.zero_temperature_c,
        zero_nm=points.zero_nm,
    )


def zero(data: CalibrationData) -> float:
    """Return U (k = 1) of a zero of the identified chain, N·m."""
    found = identify_turning(data, seated(stated=True)[1]).effects[-1]
    assert isinstance(found, Zero)
    return found.zero_nm


@pytest.fixture(scope="module")
def contained() -> float:
    """U of a zero with what unloading leaves, where the drive reaches 0 exactly."""
    return zero(table(0.0, commanded=True))


def test_a_commanded_zero_counts_however_far_the_drive_misses_it(contained: float) -> None:
    data = table(20.0 * UNLOADED_SHARE * RANGE_NM, commanded=True)
    assert zero(data) == pytest.approx(contained, rel=0.1)


def test_a_small_commanded_torque_is_a_load(contained: float) -> None:
    data = table(0.5 * UNLOADED_SHARE * RANGE_NM, commanded=True)
    assert data.nominal_nm is not None
    loaded = replace(data, nominal_nm=np.where(data.nominal_nm == 0.0, 0.01, data.nominal_nm))
    assert zero(loaded) < 0.8 * contained


def test_a_silent_table_is_guessed_with_the_threshold_of_all_tables(contained: float) -> None:
    near, far = (table(share * UNLOADED_SHARE * RANGE_NM, commanded=False) for share in (0.5, 2.0))
    assert zero(near) == pytest.approx(contained, rel=0.1)
    assert zero(far) < 0.8 * contained
