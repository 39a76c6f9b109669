import pytest

from torquebench.calibration import CalibrationData, verify
from torquebench.reports.errors_table import number
from torquebench.reports.verification_report import Verified, verification_tables


def test_the_report_states_the_repeatability_of_the_verification():
    """Groups whose points lie elsewhere aren't compared by number."""
    data = CalibrationData(
        reading_nm=[-39.8, 40.0, 40.0, -39.8],
        standard_nm=[-40.0, 40.0, 40.0, -40.0],
        series=[1, 1, 2, 2],
        branch=[1, 1, 1, 1],
        range_nm=100.0,
    )
    _, verdicts = verification_tables(data, [Verified("raw", data.reading_nm)], "2 groups")
    found = verify(data, {}).of("raw").repeatability
    assert found.worst_nm == pytest.approx(0.0)
    assert verdicts.rows[0][4] == number(found.worst_nm)
    assert found.rule in verdicts.caption
