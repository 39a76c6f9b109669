from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.bench import default_bench
from torquebench.bench.certificates.torque import (
    ReferenceCertificate,
    read_certificate,
    read_uncertainty,
)
from torquebench.bench.description import stated_uncertainty
from torquebench.bench.roles import SIDES
from torquebench.errors import InputError

HEADER = "side,torque_nm,error_nm,expanded_uncertainty_nm\n"


@given(
    st.lists(st.floats(-0.4, 0.4), min_size=2, max_size=30),
    st.floats(0.0, 1.0),
)
def test_correction_undoes_the_certified_error_anywhere_between_points(
    errors: list[float], share: float
) -> None:
    torque = np.arange(len(errors)) * 10.0
    certificate = ReferenceCertificate(torque, np.array(errors), np.full(len(errors), 0.01))
    true = share * torque[-1]
    indication = true + np.interp(true, torque, errors)
    assert certificate.correct(indication) == pytest.approx(true, abs=1e-9)


@pytest.mark.parametrize(
    "columns",
    [
        ([0.0], [0.0], [0.1]),
        ([0.0, 0.0], [0.0, 0.0], [0.1, 0.1]),
        ([0.0, 1.0], [0.0, np.nan], [0.1, 0.1]),
        ([0.0, 1.0], [0.0], [0.1, 0.1]),
        ([0.0, 1.0], [0.0, -2.0], [0.1, 0.1]),
    ],
    ids=["one-point", "duplicate", "nan", "short-column", "indication-falls"],
)
def test_a_certificate_that_corrects_nothing_is_refused(
    columns: tuple[list[float], list[float], list[float]],
) -> None:
    with pytest.raises(InputError):
        ReferenceCertificate(*(np.array(column) for column in columns))


def test_a_file_is_read_side_by_side_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "calibrator.csv"
    path.write_text(HEADER + "output,100,0.02,0.02\noutput,0,0,0.02\ninput,0,0,1\ninput,5,0.1,1\n")
    found = read_certificate(path)
    assert found["output"].torque_nm.tolist() == [0.0, 100.0]
    assert found["input"].correct(5.1) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        ("side,torque_nm\ninput,1\n", "error_nm"),
        (HEADER + "left,1,0,0\n", "line 2, column side: 'left'"),
        (HEADER + "input,1,0,0\ninput,2x5,0,0\n", "line 3, column torque_nm: '2x5'"),
    ],
)
def test_a_wrong_file_is_named_with_its_line(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "calibrator.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=message):
        read_certificate(path)
    with pytest.raises(InputError, match="nowhere"):
        read_certificate(tmp_path / "nowhere.csv")


def test_a_file_or_what_the_instruments_bring_states_u_over_the_torque(tmp_path: Path) -> None:
    path = tmp_path / "calibrator.csv"
    path.write_text(HEADER + "output,0,0,0.1\noutput,40,0,0.02\noutput,2000,0.1,0.2\n")
    bench = default_bench()
    named = bench.calibrator.model_copy(update={"certificate": str(path)})
    brought = {
        side: ReferenceCertificate(np.array([1.0, 50.0]), np.zeros(2), np.full(2, 0.002))
        for side in SIDES
    }
    of_file = bench.model_copy(update={"calibrator": named}).certified_by({"calibrator": brought})
    assert of_file.calibrator.uncertainty("output").at(1020.0) == pytest.approx(0.11)
    assert of_file.calibrator.uncertainty("input").at(25.0) == pytest.approx(0.01)  # 0.02 % of 50
    of_driver = bench.certified_by({"calibrator": brought})
    assert of_driver.calibrator.uncertainty("input").at(25.0) == pytest.approx(0.002)
    again = type(bench).model_validate(of_driver.model_dump(mode="json"))  # as a run keeps it
    assert again.calibrator.uncertainty("input") == of_driver.calibrator.uncertainty("input")
    recorded = of_driver.model_dump(mode="json")["calibrator"]
    assert stated_uncertainty(recorded, "input", 50.0).at(25.0) == pytest.approx(0.002)


def test_u_of_one_transducer_is_read_from_a_file_with_both(tmp_path: Path) -> None:
    path = tmp_path / "calibrator.csv"
    path.write_text(HEADER + "output,2000,0,0.2\ninput,50,0,0.01\n")
    assert read_uncertainty(path, "output").at(-1000.0) == pytest.approx(0.1)
    path.write_text("torque_nm,expanded_uncertainty_nm\n40,0.02\n20,0.02\n20,0.03\n")
    with pytest.raises(InputError, match=r"calibrator\.csv: U"):
        read_uncertainty(path)
